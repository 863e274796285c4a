"""``gplfd run``: demonstrations, skill, and every door opened once."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import tyro

from experiments.commands.complaint import complain
from experiments.study.doors import named_doors

if TYPE_CHECKING:
    import gymnasium as gym

    from experiments.datasets.npz import LabelledDemonstrations
    from experiments.episodes.log import EpisodeLog
    from experiments.episodes.metrics import EpisodeMetrics
    from experiments.episodes.rollout import Progress
    from experiments.recording.tiago_meshes import TiagoLooks
    from gplfd_env.config import DoorConfig
    from policies.agent import Agent

CONFIGURATION, METRICS = "run.json", "metrics.json"
DEMONSTRATIONS: Final = "demonstrations.npz"


@dataclass(frozen=True, kw_only=True, slots=True)
class Run:
    """Learn from demonstrations, open doors, and keep numbers and recordings.

    Writes DIR/metrics.json (one object per door), DIR/<door>.rrd (Rerun recording),
    DIR/<door>.npz (everything that was logged), DIR/demonstrations.npz and
    DIR/run.json (versions, command, settings).
    """

    doors: tuple[str, ...] = ("small", "medium", "large")
    """Doors to open: names (see `gplfd list`) or radii in metres."""

    policy: str = "gp"
    """Policy to use; see `gplfd list`."""

    seed: int = 0
    """Seed of teacher, policy and environment, 0 or more."""

    demonstrations_per_door: int = 2
    """How often the synthetic human opens each of the three demonstrated doors."""

    demonstrations: Annotated[Path | None, tyro.conf.arg(metavar="FILE.npz")] = None
    """Learn from this .npz file of demonstrations instead of the synthetic human."""

    looks: Literal["primitives", "tiago"] = "primitives"
    """Draw the robot in recordings by its own shapes, or by the manufacturer's meshes
    from an installed example-robot-data: pip install 'gplfd[tiago]'."""

    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder to write to; results/POLICY-seedSEED by default."""

    def execute(self) -> int:
        """Run the command and return the exit status."""
        from experiments.files.plain_data import write_json
        from experiments.files.table import text_table
        from experiments.results.table import run_table

        try:
            plan = _plan(self)
        except (ValueError, OSError, ModuleNotFoundError) as error:
            return complain(error)
        _say(f"writing to {plan.folder}")
        _tell_of_earlier_doors(plan)
        _write_inputs(self, plan)
        metrics: list[EpisodeMetrics] = []
        for door in plan.doors:
            metrics.append(_open_door(self, plan, door))
            write_json(plan.folder / METRICS, [one.as_json() for one in metrics])
        print(text_table(run_table(metrics)))
        shown = next((d.name for d in plan.doors if d.name == "medium"), None)
        recording = plan.folder / f"{shown or plan.doors[0].name}.rrd"
        print(f"\nlook at it:  gplfd view {recording}")
        return 0


@dataclass(frozen=True, kw_only=True, slots=True)
class _Door:
    name: str
    config: DoorConfig
    agent: Agent


@dataclass(frozen=True, kw_only=True, slots=True)
class _Plan:
    doors: tuple[_Door, ...]
    demonstrations: LabelledDemonstrations
    looks: TiagoLooks | None
    folder: Path


def _plan(run: Run) -> _Plan:
    """Check all arguments, learn, and only then create the folder.

    Raises:
        ValueError: An argument or the demonstration file is wrong.
        OSError: The file cannot be read or the folder not be made.
        ModuleNotFoundError: The meshes that are to be drawn are not installed.
    """
    from policies.registry import make_agent

    if run.seed < 0:
        raise ValueError(f"--seed {run.seed} must be 0 or more")
    if run.demonstrations_per_door < 1:
        raise ValueError(
            f"--demonstrations-per-door {run.demonstrations_per_door} must be 1 or more"
        )
    configs = named_doors(run.doors)
    folder = run.out or Path("results") / f"{run.policy}-seed{run.seed}"
    if folder.exists() and not folder.is_dir():
        raise ValueError(f"--out {folder} is a file; give a folder")
    looks = _looks(run)
    given = _demonstrations(run)
    started = time.perf_counter()
    doors = tuple(
        _Door(
            name=name,
            config=config,
            agent=make_agent(
                run.policy, given.demonstrations, seed=run.seed, radius=config.radius
            ),
        )
        for name, config in configs.items()
    )
    _say(
        f"policy {run.policy} from {len(given.demonstrations)} demonstrations "
        f"({time.perf_counter() - started:.1f} s)"
    )
    folder.mkdir(parents=True, exist_ok=True)
    return _Plan(doors=doors, demonstrations=given, looks=looks, folder=folder)


def _looks(run: Run) -> TiagoLooks | None:
    if run.looks == "primitives":
        return None
    from experiments.recording.tiago_meshes import tiago_looks
    from gplfd_env.config import DoorConfig
    from gplfd_env.scene import build_scene

    robot = build_scene(DoorConfig())
    return tiago_looks([robot.body(index).name for index in range(robot.nbody)])


def _demonstrations(run: Run) -> LabelledDemonstrations:
    import numpy as np

    from experiments.datasets.npz import (
        LabelledDemonstrations,
        load_demonstrations,
    )
    from experiments.teacher import DEMONSTRATED_RADII, Teacher

    if run.demonstrations is not None:
        return load_demonstrations(run.demonstrations)
    each = run.demonstrations_per_door
    return LabelledDemonstrations(
        demonstrations=Teacher().demonstrate_doors(
            DEMONSTRATED_RADII, each, rng=np.random.default_rng(run.seed)
        ),
        radii=tuple(radius for radius in DEMONSTRATED_RADII for _ in range(each)),
    )


def _write_inputs(run: Run, plan: _Plan) -> None:
    from experiments.datasets.npz import save_demonstrations
    from experiments.files.plain_data import write_json
    from experiments.files.provenance import content_hash, provenance

    given = plan.demonstrations
    save_demonstrations(plan.folder / DEMONSTRATIONS, given.demonstrations, given.radii)
    config: dict[str, Any] = {
        name: str(value) if isinstance(value, Path) else value
        for name, value in dataclasses.asdict(run).items()
    }
    learned_from = run.demonstrations or plan.folder / DEMONSTRATIONS
    config["demonstrations_sha256"] = content_hash(learned_from)
    config["door_configs"] = {
        door.name: dataclasses.asdict(door.config) for door in plan.doors
    }
    write_json(plan.folder / CONFIGURATION, provenance(config))


def _tell_of_earlier_doors(plan: _Plan) -> None:
    now = {door.name for door in plan.doors}
    recordings = sorted(plan.folder.glob("*.rrd"))
    earlier = [path.name for path in recordings if path.stem not in now]
    if earlier:
        _say(f"{plan.folder} also keeps {', '.join(earlier)} of an earlier run")


def _open_door(run: Run, plan: _Plan, door: _Door) -> EpisodeMetrics:
    """Open one door, write its log and recording, and return its metrics."""
    import gymnasium as gym

    from experiments.episodes.metrics import episode_metrics
    from experiments.recording import record_episode
    from gplfd_env import ENVIRONMENT_ID

    started = time.perf_counter()
    with contextlib.closing(gym.make(ENVIRONMENT_ID, door=door.config)) as env:
        log = _watched_rollout(env, run, door)
        log.save(plan.folder / f"{door.name}.npz")
        record_episode(
            plan.folder / f"{door.name}.rrd",
            log,
            env.unwrapped.model,  # type: ignore[attr-defined]
            plan.demonstrations.demonstrations,
            plan.looks,
        )
    metrics = episode_metrics(log)
    outcome = "opened" if log.success else f"not opened ({log.failure})"
    _say(
        f"{door.name}: {outcome}, {metrics.final_angle_deg:.1f} deg in "
        f"{metrics.duration:.1f} s ({time.perf_counter() - started:.1f} s)"
    )
    return metrics


def _watched_rollout(env: gym.Env[Any, Any], run: Run, door: _Door) -> EpisodeLog:
    """Run the episode behind a progress bar and return its log."""
    from tqdm import tqdm

    from experiments.episodes.rollout import rollout

    # disable=None: no bar when stderr is not a terminal.
    with tqdm(desc=door.name, unit=" s simulated", leave=False, disable=None) as bar:

        def show(progress: Progress) -> None:
            angle = math.degrees(progress.door_angle)
            bar.set_postfix_str(f"door at {angle:.0f} deg", refresh=False)
            bar.update(progress.time - bar.n)

        return rollout(
            env,
            door.agent,
            policy=run.policy,
            door=door.name,
            door_config=dataclasses.asdict(door.config),
            seed=run.seed,
            on_step=show,
        )


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
