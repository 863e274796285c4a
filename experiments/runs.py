"""A run: learn once, open some doors, and keep numbers and recordings in a folder."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import math
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Literal

import gymnasium as gym
import numpy as np

from experiments.arguments import check_folder, check_least
from experiments.datasets.npz import (
    LabelledDemonstrations,
    load_demonstrations,
    save_demonstrations,
)
from experiments.episodes.doors import named_doors
from experiments.episodes.log import EpisodeLog
from experiments.episodes.metrics import EpisodeMetrics, episode_metrics
from experiments.episodes.rollout import Progress, rollout
from experiments.files.plain_data import write_json
from experiments.files.provenance import content_hash, provenance
from experiments.progress import LOG, progress_bar
from experiments.recording import record_episode
from experiments.recording.tiago_meshes import TiagoLooks, tiago_looks
from experiments.teacher import DEMONSTRATED_RADII, Teacher
from gplfd_env import ENVIRONMENT_ID
from gplfd_env.config import DoorConfig
from gplfd_env.randomization import door_randomization
from gplfd_env.scene import build_scene
from policies.agent import Agent
from policies.registry import make_agent, policy_named

CONFIGURATION: Final = "run.json"
METRICS: Final = "metrics.json"
DEMONSTRATIONS: Final = "demonstrations.npz"


def open_doors(
    doors: Sequence[str],
    folder: Path,
    *,
    policy: str,
    seed: int,
    demonstrations: Path | int,
    randomization: str,
    looks: Literal["primitives", "tiago"],
    options: Mapping[str, Any],
) -> tuple[EpisodeMetrics, ...]:
    """Learn, open each door once, and write everything.

    Nothing is written before everything is checked and the policy has learned; then
    what an earlier run left in the folder is removed.

    Args:
        doors: Names of doors, or radii [m] as text.
        folder: Where to write.
        policy: Name of the policy.
        seed: Seed of teacher, policy and environment.
        demonstrations: A file to learn from, or how often the synthetic human opens
            each of the three demonstrated doors.
        randomization: Name of what the environment draws anew.
        looks: How recordings draw the robot.
        options: The command's, for the record; JSON-able.

    Raises:
        ValueError: An argument or the demonstration file is wrong.
        OSError: A file cannot be read or written.
        ModuleNotFoundError: The meshes that are to be drawn are not installed.
    """
    check_least("--seed", seed, 0)
    configs = named_doors(doors)
    door_randomization(randomization)
    policy_named(policy)
    check_folder(folder)
    earlier = _files_of_earlier_run(folder)
    drawn = _looks(looks)
    given = _demonstrations(demonstrations, seed)
    agents = _agents(policy, given, configs, seed)
    LOG.info("writing to %s", folder)
    for file in earlier:
        file.unlink(missing_ok=True)
    _write_inputs(folder, given, configs, options)
    metrics: list[EpisodeMetrics] = []
    for door, config in configs.items():
        started = time.perf_counter()
        with contextlib.closing(
            gym.make(ENVIRONMENT_ID, door=config, randomization=randomization)
        ) as env:
            log = _watched_rollout(env, agents[door], policy, door, seed)
            log.save(folder / f"{door}.npz")
            model = env.unwrapped.model  # type: ignore[attr-defined]
            recording = folder / f"{door}.rrd"
            record_episode(recording, log, model, given.demonstrations, drawn)
        metrics.append(episode_metrics(log))
        write_json(folder / METRICS, [one.as_json() for one in metrics])
        _report(metrics[-1], time.perf_counter() - started)
    return tuple(metrics)


def _files_of_earlier_run(folder: Path) -> list[Path]:
    """Return what an earlier run wrote to the folder, door by door.

    Raises:
        ValueError: Its configuration does not say which doors it opened.
    """
    configuration = folder / CONFIGURATION
    if not configuration.exists():
        return []
    try:
        doors = json.loads(configuration.read_bytes())["config"]["door_configs"]
        names = [f"{door}{end}" for door in doors for end in (".npz", ".rrd")]
    except (ValueError, LookupError, TypeError) as error:
        raise ValueError(
            f"{configuration} does not say what was written beside it; choose another "
            "--out"
        ) from error
    # A name that leads elsewhere is not one that a run wrote.
    own = [name for name in names if Path(name).name == name]
    return [folder / name for name in (METRICS, *own)]


def _looks(looks: Literal["primitives", "tiago"]) -> TiagoLooks | None:
    if looks == "primitives":
        return None
    robot = build_scene(DoorConfig())
    return tiago_looks([robot.body(index).name for index in range(robot.nbody)])


def _demonstrations(given: Path | int, seed: int) -> LabelledDemonstrations:
    if isinstance(given, Path):
        return load_demonstrations(given)
    check_least("--demonstrations-per-door", given, 1)
    return LabelledDemonstrations(
        demonstrations=Teacher().demonstrate_doors(
            DEMONSTRATED_RADII, given, rng=np.random.default_rng(seed)
        ),
        radii=tuple(radius for radius in DEMONSTRATED_RADII for _ in range(given)),
    )


def _agents(
    policy: str,
    given: LabelledDemonstrations,
    configs: Mapping[str, DoorConfig],
    seed: int,
) -> dict[str, Agent]:
    started = time.perf_counter()
    shown = given.demonstrations
    agents = {
        door: make_agent(policy, shown, seed=seed, radius=config.radius)
        for door, config in configs.items()
    }
    LOG.info(
        "policy %s from %d demonstrations (%.1f s)",
        policy,
        len(shown),
        time.perf_counter() - started,
    )
    return agents


def _write_inputs(
    folder: Path,
    given: LabelledDemonstrations,
    configs: Mapping[str, DoorConfig],
    options: Mapping[str, Any],
) -> None:
    doors = {door: dataclasses.asdict(config) for door, config in configs.items()}
    kept = folder / DEMONSTRATIONS
    save_demonstrations(kept, given.demonstrations, given.radii)
    config = {**options, "demonstrations_sha256": content_hash(kept)}
    config["door_configs"] = doors
    write_json(folder / CONFIGURATION, provenance(config))


def _watched_rollout(
    env: gym.Env[Any, Any], agent: Agent, policy: str, door: str, seed: int
) -> EpisodeLog:
    """Run the episode behind a progress bar and return its log."""
    with progress_bar(desc=door, unit=" s simulated") as bar:

        def show(progress: Progress) -> None:
            angle = math.degrees(progress.door_angle)
            bar.set_postfix_str(f"door at {angle:.0f} deg", refresh=False)
            bar.update(progress.time - bar.n)

        return rollout(env, agent, policy=policy, door=door, seed=seed, on_step=show)


def _report(metrics: EpisodeMetrics, seconds: float) -> None:
    outcome = "opened" if metrics.success else f"not opened ({metrics.failure})"
    LOG.info(
        "%s: %s, %.1f deg in %.1f s (%.1f s)",
        metrics.door,
        outcome,
        metrics.final_angle_deg,
        metrics.duration,
        seconds,
    )
