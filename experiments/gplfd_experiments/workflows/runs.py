"""A run: learn once, open doors, and store metrics and recordings, or a data set."""

import contextlib
import time
from collections import Counter
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from logging import DEBUG
from pathlib import Path
from typing import Any, Final

import gymnasium as gym
import mujoco
import numpy as np

from gplfd_env.doors.config import DoorConfig, door_config
from gplfd_env.robot import robots, urdf
from gplfd_experiments.console import arguments
from gplfd_experiments.console.progress import LOG, progress_bar
from gplfd_experiments.episodes import build
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.metrics import episode_metrics, why_closed
from gplfd_experiments.episodes.task import EpisodeTask, episode_task, named_doors
from gplfd_experiments.files.plain_data import write_json
from gplfd_experiments.files.provenance import content_hash, provenance
from gplfd_experiments.recording import video
from gplfd_experiments.recording.episode import record_episode
from gplfd_experiments.studies.sources import source_of
from gplfd_experiments.studies.store import POLICY_ERROR
from gplfd_experiments.workflows.settings import (
    EpisodeSettings,
    RecordSettings,
    RunSettings,
)
from gplfd_policies.agents.agent import Agent
from gplfd_policies.demonstrations import npz
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.registry.catalogue import method_and_skill, policy_named
from gplfd_policies.registry.method import Policy

CONFIGURATION: Final = "run.json"
METRICS: Final = "metrics.json"


def open_doors(
    settings: RunSettings, folder: Path, options: Mapping[str, Any]
) -> list[dict[str, Any]]:
    """Learn once per kind of doors, open each door once, and write everything.

    Doors of one kind are opened in lockstep by a learner. If the policy raises an error
    in acting, the other doors are still opened. Before the first episodes have ended,
    nothing is written. The options are stored.
    """
    paths = {name: getattr(settings, name) for name in ("demonstrations", "skill")}
    absolute = {name: path and path.absolute() for name, path in paths.items()}
    folder, settings = folder.absolute(), replace(settings, **absolute)
    policy = policy_named(settings.policy)  # It may change the working folder.
    fields: Any = {"disturbance": settings.disturbance}
    fields["policy_source"] = source_of(policy)
    if settings.demonstrations is not None:
        fields["demonstrations_per_door"] = 2
    tasks = episode_tasks(settings, [settings.seed], **fields)
    _check_source(settings, tasks)
    videos: dict[str, Path] = {}
    if settings.video is not None:
        videos = video.video_paths(settings.video, [task.door for task in tasks])
        videos = {door: path.absolute() for door, path in videos.items()}
        video.check_video()
    body = robots.robot_named(settings.robot)
    if body.search is not None:
        LOG.info(urdf.chosen(body))
    if moved := [task.door for task in tasks if task.base == "mobile"]:
        LOG.info("on the mobile base, out of reach without: %s", ", ".join(moved))
    arguments.check_folder(folder)
    kinds: dict[str, list[EpisodeTask]] = {}
    for task in tasks:
        kinds.setdefault(task.demonstrations_key, []).append(task)
    files = dict.fromkeys(kinds, npz.FILE)
    if len(kinds) > 1:
        files = {key: f"demonstrations-{kinds[key][0].door}.npz" for key in kinds}
    names = [CONFIGURATION, METRICS, *files.values()]
    names += [f"{task.door}{suffix}" for task in tasks for suffix in (".npz", ".rrd")]
    # Some file systems do not distinguish capitals.
    name, times = Counter(map(str.casefold, names)).most_common(1)[0]
    if times > 1:
        raise ValueError(f"{name} would be two files of this run; rename a door's file")
    results = [*map(folder.joinpath, names), *videos.values()]
    if existing := [path.name for path in results if path.exists()]:
        raise ValueError(
            f"{folder} holds earlier results ({', '.join(existing)}); remove them, or "
            "give another --out"
        )
    started = time.perf_counter()
    labelled: dict[str, npz.LabelledDemonstrations] = {}
    batches: dict[Hashable, list[tuple[EpisodeTask, Agent]]] = {}
    with build.reported_errors(settings.policy, policy):
        for key, alike in kinds.items():
            labelled[key], make = _learn(settings, alike, policy)
            for task in alike:
                # Only agents of a method are known to be alike.
                own = task.door if policy.method is None else ""
                batches.setdefault((key, task.base, own), []).append((task, make()))
    LOG.info("ready to act (%.1f s)", time.perf_counter() - started)

    rows: dict[str, dict[str, Any]] = {}
    for task, episode in _opened([*batches.values()], policy):
        if not rows:
            LOG.info("writing to %s", folder)
            kept = {files[key]: labelled[key] for key in kinds}
            sources = {task.door: files[task.demonstrations_key] for task in tasks}
            _write_origin(settings, folder, tasks, kept, sources, options)
        if isinstance(episode, dict):
            rows[task.door] = episode
        else:
            log, model = episode
            rows[task.door] = measured = episode_metrics(log)
            log.save(folder / f"{task.door}.npz")
            demonstrations = labelled[task.demonstrations_key].demonstrations
            record_episode(folder / f"{task.door}.rrd", log, model, demonstrations)
            if file := videos.get(task.door):
                count = video.write_video(file, log, model)
                LOG.info(f"wrote {file} ({count} pictures, {count / video.RATE:.1f} s)")
            low, high = model.jnt_range[[model.joint(name).id for name in body.arm]].T
            angles = log.motion.joint_pos
            margins = np.minimum(angles - low, high - angles).min(axis=0)
            if margins.min() < 0.01:
                joint = body.arm[int(margins.argmin())]
                LOG.warning("warning: %s: %s came to a limit", task.door, joint)
            why = why_closed(log.failure, log.reason)
            ended = f"not opened ({why})" if why else "opened"
            angle = f"{measured['final_angle_deg']:z.1f} deg"  # z: not -0.0
            LOG.info(f"{task.door}: {ended}, {angle} in {measured['duration']:.1f} s")
        metrics = [rows[task.door] for task in tasks if task.door in rows]
        write_json(folder / METRICS, metrics)
    return metrics


def episode_tasks(
    settings: EpisodeSettings, seeds: Sequence[int], **fields: Any
) -> list[EpisodeTask]:
    """Check settings; return a task per door and seed, with further fields of it."""
    arguments.check_least("--seed", settings.seed, 0)
    disturbance = fields.get("disturbance", "none")
    arguments.check_circumstances(settings.randomization, disturbance, settings.start)
    names = ["policy", "demonstrations_per_door", "demonstrated_forces"]
    names += ["randomization", "start", "robot"]
    fields = {name: getattr(settings, name) for name in names} | fields
    arguments.check_least(
        "--demonstrations-per-door", fields["demonstrations_per_door"], 1, 1000
    )
    doors = named_doors(settings.doors, start=settings.start, robot=settings.robot)
    return [
        episode_task(door, config, seed=seed, **fields)
        for door, config in doors.items()
        for seed in seeds
    ]


def _check_source(settings: RunSettings, tasks: Sequence[EpisodeTask]) -> None:
    """Raise a ValueError if a file with one kind of motion cannot serve all doors."""
    if settings.skill is None and settings.demonstrations is None:
        return
    option = "--demonstrations" if settings.skill is None else "--skill"
    if settings.skill is not None and settings.start == "approach":
        raise ValueError(
            "--skill contains no reaching: omit it to learn reaching as well, or omit "
            "--start approach"
        )
    if settings.demonstrated_forces:
        raise ValueError(
            "--demonstrated-forces applies to demonstrations of the synthetic human: "
            f"omit it, or omit {option}"
        )
    (first, kind), *others = (
        (task.door, {"motion": "hinged"} | DoorConfig(**task.door_config).kind)
        for task in tasks
    )
    for door, other in others:
        if differ := [name for name in kind if kind[name] != other[name]]:
            raise ValueError(
                f"doors {first} and {door} are of two kinds (they differ in "
                f"{', '.join(differ)}), but {option} contains one kind; use two runs, "
                f"or omit {option}"
            )


def _learn(
    settings: RunSettings, alike: Sequence[EpisodeTask], policy: Policy
) -> tuple[npz.LabelledDemonstrations, Callable[[], Agent]]:
    """Learn for doors of one kind; return demonstrations and a factory of agents."""
    if settings.skill is not None:
        method, skill = method_and_skill(settings.policy, settings.skill)
        npz.check_frame(skill.frame, settings.skill)
        aligned = skill.aligned.demonstrated
        times = aligned.duration * aligned.times
        # The skill contains the forces, if any.
        motions = [Demonstration(times=times, poses=pose) for pose in aligned.poses]
        labelled = npz.LabelledDemonstrations(
            demonstrations=tuple(motions), radii=(None,) * len(motions)
        )
        return labelled, partial(method.follow, skill)
    if settings.demonstrations is not None:
        labelled = npz.load_demonstrations(settings.demonstrations)
        npz.check_frame(labelled.frame, settings.demonstrations)
    else:
        labelled = build.demonstrations_of(alike[0])
    if policy.kind != "reference":
        doors = ", ".join(task.door for task in alike)
        number = len(labelled.demonstrations)
        LOG.info(f"learning from {number} demonstrations for {doors}")
    return labelled, build.learned_agents(alike[0], policy, labelled)


def _opened(
    batches: list[list[tuple[EpisodeTask, Agent]]], policy: Policy
) -> Iterator[tuple[EpisodeTask, tuple[EpisodeLog, mujoco.MjModel] | dict[str, Any]]]:
    """Open the doors of each batch in lockstep, or one by one if the policy fails.

    Each task comes with its log and scene, or a failure by the policy's error.
    """
    for batch in batches:
        (task, agent), *others = batch
        tasks, agents = zip(*batch, strict=True)
        try:
            with (
                progress_bar(desc="opening", unit=" steps") as bar,
                build.reported_errors(task.policy, policy, acting=True),
            ):
                logs = build.open_together(
                    tasks, agents, forecast_period=0.35, before_step=bar.update
                )
        except build.PolicyError as error:
            if others:
                batches += [[member] for member in batch]  # later in this loop
                continue
            LOG.error("%s: %s", task.door, error, exc_info=LOG.isEnabledFor(DEBUG))
            failure = {
                "policy": task.policy,
                "door": task.door,
                "radius": DoorConfig(**task.door_config).radius,
                "seed": task.seed,
                "error": str(error),
                "success": False,
                "failure": POLICY_ERROR,
            }
            yield task, failure
        else:
            for task, log in zip(tasks, logs, strict=True):
                yield task, (log, build.model_of(task, agent.control))


def _write_origin(
    settings: RunSettings,
    folder: Path,
    tasks: Sequence[EpisodeTask],
    kept: Mapping[str, npz.LabelledDemonstrations],
    sources: Mapping[str, str],
    options: Mapping[str, Any],
) -> None:
    """Write the demonstrations, and the settings and versions of the run."""
    for name, labelled in kept.items():
        npz.save_demonstrations(
            folder / name,
            labelled.demonstrations,
            labelled.radii,
            frame=labelled.frame,
            signals=labelled.signals,
        )
    source, skill = settings.demonstrations, settings.skill
    if source is not None:
        source = npz.demonstrations_file(source)
    record = {
        **options,
        "policy_source": tasks[0].policy_source,
        "demonstrations_sha256": {n: content_hash(source or folder / n) for n in kept},
        "demonstrations_of": sources,
        "skill_sha256": None if skill is None else content_hash(skill),
        "door_configs": {task.door: task.door_config for task in tasks},
    }
    write_json(folder / CONFIGURATION, provenance(record))


def record_dataset(
    folder: Path, settings: RecordSettings, options: Mapping[str, Any]
) -> int:
    """Open every door several times and write the data set; the options are stored."""
    from gplfd_experiments.data.minari import write_dataset

    arguments.check_least("--episodes", settings.episodes, 1, 100_000)
    arguments.check_least("--max-steps", settings.max_steps, 1)
    name, policy = settings.policy, policy_named(settings.policy)
    seeds = range(settings.seed, settings.seed + settings.episodes)
    tasks = episode_tasks(settings, seeds)
    arguments.check_folder(folder.parent)
    folder = folder.absolute()  # A policy may change the working folder.
    first = tasks[0]
    if other := next((task for task in tasks if task.base != first.base), None):
        raise ValueError(
            f"door {first.door} is opened with base={first.base!r} and door "
            f"{other.door} with base={other.base!r}; a data set has one environment: "
            "record two data sets"
        )
    steps = settings.max_steps
    limit = {} if steps is None else {"max_episode_steps": steps}
    # The first agent determines the environment of all episodes; resets change doors.
    with build.reported_errors(name, policy):
        control = build.learned_agents(first, policy)().control
    with contextlib.closing(build.make_environment(first, control, **limit)) as env:
        write_dataset(
            folder,
            _recorded(env, tasks, policy),
            env=env,
            policy=name,
            config=options,
            overwrite=settings.overwrite,
        )
    return len(tasks)


def _recorded(
    env: gym.Env[Any, Any], tasks: Sequence[EpisodeTask], policy: Policy
) -> Iterator[Any]:
    """Run and yield the episode of every task."""
    from gplfd_experiments.data.minari import Recorder, outcome

    recorder, inner = Recorder(env), env.unwrapped
    for task in progress_bar(tasks, desc="recording", unit="episode"):
        with build.reported_errors(task.policy, policy):
            agent = build.learned_agents(task, policy)()
            # HDF5 keeps no empty mapping, which the default door would be.
            radius = door_config(dict(task.door_config)).radius
            door = {"radius": radius, **task.door_config}
            seen, _ = recorder.reset(seed=task.reset_seed, options={"door": door})
            agent.inform(inner.door_geometry)  # type: ignore[attr-defined]
            agent.reset(seen)
            ended = False
            while not ended:
                action = agent.act(seen).command(agent.control)
                seen, _, terminated, truncated, _ = recorder.step(action)
                ended = terminated or truncated
        episode = recorder.episode
        LOG.info("%s, seed %d: %s", task.door, task.seed, outcome(episode))
        yield episode
