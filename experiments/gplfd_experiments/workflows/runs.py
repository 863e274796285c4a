"""A run: learn once, open doors, and store metrics and recordings in a folder."""

import contextlib
import math
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from logging import DEBUG
from pathlib import Path
from typing import Any, Final, NamedTuple

import mujoco
import numpy as np

from gplfd_env.doors.config import DoorConfig
from gplfd_env.robot.config import RobotConfig
from gplfd_env.robot.robots import robot_named
from gplfd_env.robot.urdf import chosen
from gplfd_experiments.console.arguments import (
    check_circumstances,
    check_folder,
    check_least,
)
from gplfd_experiments.console.progress import LOG, progress_bar
from gplfd_experiments.episodes.build import (
    PolicyError,
    demonstrations_of,
    learned_agents,
    make_environment,
    reported_errors,
)
from gplfd_experiments.episodes.failures import why_closed
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.metrics import episode_metrics
from gplfd_experiments.episodes.rollout import rollout
from gplfd_experiments.episodes.task import EpisodeTask, episode_task, named_doors
from gplfd_experiments.files.plain_data import write_json
from gplfd_experiments.files.provenance import content_hash, provenance
from gplfd_experiments.recording.episode import record_episode
from gplfd_experiments.recording.video import (
    STANDARD,
    check_video,
    video_paths,
    write_video,
)
from gplfd_experiments.studies.sources import source_of
from gplfd_experiments.studies.store import POLICY_ERROR
from gplfd_experiments.workflows.settings import RunSettings
from gplfd_policies.agents.agent import Agent
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.demonstrations.npz import (
    FILE,
    FRAME,
    LabelledDemonstrations,
    demonstrations_file,
    load_demonstrations,
    save_demonstrations,
)
from gplfd_policies.registry.catalogue import method_and_skill, policy_named
from gplfd_policies.registry.method import Policy

CONFIGURATION: Final = "run.json"
METRICS: Final = "metrics.json"
_OF_DOOR: Final = (".npz", ".rrd")  # Suffixes of the files of a door.


class _Learned(NamedTuple):
    """Learned agents for a kind of doors, and what they learned from."""

    labelled: LabelledDemonstrations
    make: Callable[[], Agent]
    file: str
    """Name of the file of these demonstrations in the run."""


def open_doors(
    settings: RunSettings, folder: Path, options: Mapping[str, Any]
) -> list[dict[str, Any]]:
    """Learn, open each door once, and write everything.

    Doors of several kinds are opened by several agents. Each learns from demonstrations
    of its kind. If the policy raises an error in acting, the door counts as not opened
    and the other doors are still opened. Nothing is written before the first episode
    has ended. ``options`` are stored with the results.
    """
    # A policy may change the working folder.
    paths = {name: getattr(settings, name) for name in ("demonstrations", "skill")}
    absolute = {name: path and path.absolute() for name, path in paths.items()}
    folder, settings = folder.absolute(), replace(settings, **absolute)
    policy = policy_named(settings.policy)
    tasks = _tasks(settings, policy)
    videos: dict[str, Path] = {}
    if settings.video is not None:
        videos = video_paths(settings.video, [task.door for task in tasks])
        videos = {door: path.absolute() for door, path in videos.items()}
        check_video()
    body = robot_named(settings.robot)
    if body.search is not None:
        LOG.info(chosen(body))
    check_folder(folder)
    files = _demonstrations_files(tasks)
    _check_files(folder, tasks, files.values(), videos.values())
    _check_source(settings, tasks)

    started = time.perf_counter()
    with reported_errors(settings.policy, policy):
        learned = _learn(settings, tasks, policy, files)
        agents = {task.door: learned[task.demonstrations_key].make() for task in tasks}
    LOG.info("ready to act (%.1f s)", time.perf_counter() - started)

    metrics: list[dict[str, Any]] = []
    for task in tasks:
        started = time.perf_counter()
        episode = _episode(task, agents[task.door], policy)
        if not metrics:
            _write_origin(settings, folder, tasks, learned, options)
        if isinstance(episode, dict):
            metrics.append(episode)
        else:
            log, model = episode
            measured = episode_metrics(log)
            metrics.append(measured)
            log.save(folder / f"{task.door}.npz")
            demonstrations = learned[task.demonstrations_key].labelled.demonstrations
            recording = folder / f"{task.door}.rrd"
            record_episode(recording, log, model, demonstrations)
            if video := videos.get(task.door):
                images = write_video(video, log, model, STANDARD)
                seconds = images / STANDARD.rate
                LOG.info("wrote %s (%d pictures, %.1f s)", video, images, seconds)
            if joint := _joint_at_limit(log, model, body):
                LOG.warning("warning: %s: %s came to a limit", task.door, joint)
            why = why_closed(log.failure, log.reason)
            ended = f"not opened ({why})" if why else "opened"
            angle = round(measured["final_angle_deg"], 1) + 0.0  # not -0.0
            seconds = time.perf_counter() - started
            LOG.info(
                f"{task.door}: {ended}, {angle:.1f} deg in {measured['duration']:.1f} "
                f"s ({seconds:.1f} s)"
            )
        write_json(folder / METRICS, metrics)
    return metrics


def _joint_at_limit(log: EpisodeLog, model: mujoco.MjModel, robot: RobotConfig) -> str:
    """Return the joint of the arm that came within 0.01 rad of a limit, or ""."""
    low, high = model.jnt_range[[model.joint(name).id for name in robot.arm]].T
    angles = log.motion.joint_pos
    margins = np.minimum(angles - low, high - angles).min(0)
    return robot.arm[int(margins.argmin())] if margins.min() < 0.01 else ""


def _tasks(settings: RunSettings, policy: Policy) -> list[EpisodeTask]:
    """Return the task of each door, after checks of the settings."""
    check_least("--seed", settings.seed, 0)
    check_circumstances(settings.randomization, settings.disturbance, settings.start)
    per_door = (
        settings.demonstrations_per_door if settings.demonstrations is None else 2
    )
    check_least("--demonstrations-per-door", per_door, 1, 1000)
    doors = named_doors(settings.doors, start=settings.start, robot=settings.robot)
    return [
        episode_task(
            door,
            config,
            policy=settings.policy,
            policy_source=source_of(policy),
            seed=settings.seed,
            demonstrations_per_door=per_door,
            demonstrated_forces=settings.demonstrated_forces,
            randomization=settings.randomization,
            disturbance=settings.disturbance,
            start=settings.start,
            robot=settings.robot,
        )
        for door, config in doors.items()
    ]


def check_frame(frame: str, source: Path) -> None:
    """Raise a ValueError if the frame of a set or a skill is not that of a door."""
    if frame not in ("door", FRAME):
        raise ValueError(
            f"{source} cannot open doors: its frame is not a door's but {frame!r}; "
            "import the recordings with gplfd demos import FILES --frame hinge"
        )


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
    kinds = {
        task.door: {"motion": "hinged"} | DoorConfig(**task.door_config).kind
        for task in tasks
    }
    first = tasks[0].door
    for door, kind in kinds.items():
        if differ := [name for name in kind if kind[name] != kinds[first][name]]:
            raise ValueError(
                f"doors {first} and {door} are of two kinds (they differ in "
                f"{', '.join(differ)}), but {option} contains one kind; use two "
                f"runs, or omit {option}"
            )


def _learn(
    settings: RunSettings,
    tasks: Sequence[EpisodeTask],
    policy: Policy,
    files: Mapping[str, str],
) -> dict[str, _Learned]:
    """Learn once per kind of doors.

    Returns learned agents by `EpisodeTask.demonstrations_key`.
    """
    kinds: dict[str, list[EpisodeTask]] = {}
    for task in tasks:
        kinds.setdefault(task.demonstrations_key, []).append(task)
    learned: dict[str, _Learned] = {}
    for key, alike in kinds.items():
        first = alike[0]
        if settings.skill is not None:
            method, skill = method_and_skill(first.policy, settings.skill)
            check_frame(skill.frame, settings.skill)
            aligned = skill.aligned.demonstrated
            times = aligned.duration * aligned.times
            # The skill contains the forces, if any.
            motions = [Demonstration(times=times, poses=pose) for pose in aligned.poses]
            labelled = LabelledDemonstrations(
                demonstrations=tuple(motions), radii=(None,) * len(motions)
            )
            make: Callable[[], Agent] = partial(method.follow, skill)
        else:
            if settings.demonstrations is not None:
                labelled = load_demonstrations(settings.demonstrations)
                check_frame(labelled.frame, settings.demonstrations)
            else:
                labelled = demonstrations_of(first)
            if policy.kind != "reference":
                doors = ", ".join(task.door for task in alike)
                number = len(labelled.demonstrations)
                LOG.info(f"learning from {number} demonstrations for {doors}")
            make = learned_agents(first, policy, labelled)
        learned[key] = _Learned(labelled, make, files[key])
    return learned


def _episode(
    task: EpisodeTask, agent: Agent, policy: Policy
) -> tuple[EpisodeLog, mujoco.MjModel] | dict[str, Any]:
    """Open a door; return the log and the scene, or a failure by the policy's error."""
    LOG.debug("%s: opening it with %s", task.door, task.policy)
    try:
        with (
            contextlib.closing(make_environment(task, agent.control)) as env,
            progress_bar(desc=task.door, unit=" s simulated") as bar,
            reported_errors(task.policy, policy, acting=True),
        ):

            def show(seconds: float, door_angle: float) -> None:
                angle = math.degrees(door_angle)
                bar.set_postfix_str(f"door at {round(angle)} deg", refresh=False)
                bar.update(seconds - bar.n)

            log = rollout(
                env,
                agent,
                policy=task.policy,
                door=task.door,
                seed=task.reset_seed,
                on_step=show,
            )
            return log, env.unwrapped.model  # type: ignore[attr-defined]
    except PolicyError as error:
        LOG.error("%s: %s", task.door, error, exc_info=LOG.isEnabledFor(DEBUG))
        return {
            "policy": task.policy,
            "door": task.door,
            "radius": DoorConfig(**task.door_config).radius,
            "seed": task.seed,
            "error": str(error),
            "success": False,
            "failure": POLICY_ERROR,
        }


def _write_origin(
    settings: RunSettings,
    folder: Path,
    tasks: Sequence[EpisodeTask],
    learned: Mapping[str, _Learned],
    options: Mapping[str, Any],
) -> None:
    """Write the demonstrations, and the settings and versions of the run."""
    LOG.info("writing to %s", folder)
    kept = {kind.file: kind.labelled for kind in learned.values()}
    for name, labelled in kept.items():
        save_demonstrations(
            folder / name,
            labelled.demonstrations,
            labelled.radii,
            frame=labelled.frame,
            signals=labelled.signals,
        )
    source, skill = settings.demonstrations, settings.skill
    if source is not None:
        source = demonstrations_file(source)
    record = {
        **options,
        "policy_source": tasks[0].policy_source,
        "demonstrations_sha256": {
            name: content_hash(source or folder / name) for name in kept
        },
        "demonstrations_of": {
            task.door: learned[task.demonstrations_key].file for task in tasks
        },
        "skill_sha256": None if skill is None else content_hash(skill),
        "door_configs": {task.door: task.door_config for task in tasks},
    }
    write_json(folder / CONFIGURATION, provenance(record))


def _check_files(
    folder: Path,
    tasks: Sequence[EpisodeTask],
    demonstrations: Iterable[str],
    videos: Iterable[Path],
) -> None:
    """Raise ValueError if two files of a run have one name, or if one exists."""
    of_doors = {f"{task.door}{end}": task.door for task in tasks for end in _OF_DOOR}
    names = [CONFIGURATION, METRICS, *dict.fromkeys(demonstrations), *of_doors]
    # Some file systems do not distinguish capitals.
    count = Counter(name.casefold() for name in names)
    for name, door in of_doors.items():
        if count[name.casefold()] > 1:
            raise ValueError(
                f"door {door}: {name} would also be another file of this run; rename "
                "the door's file"
            )
    paths = (*map(folder.joinpath, names), *videos)
    if existing := [path.name for path in paths if path.exists()]:
        raise ValueError(
            f"{folder} holds earlier results ({', '.join(existing)}); remove them, or "
            "give another --out"
        )


def _demonstrations_files(tasks: Sequence[EpisodeTask]) -> dict[str, str]:
    """Return the file of demonstrations by `EpisodeTask.demonstrations_key`."""
    doors: dict[str, str] = {}
    for task in tasks:
        doors.setdefault(task.demonstrations_key, task.door)
    if len(doors) == 1:
        return dict.fromkeys(doors, FILE)
    return {key: f"{Path(FILE).stem}-{door}.npz" for key, door in doors.items()}
