"""A run: learn once, open doors, and store metrics and recordings in a folder."""

import contextlib
import math
import time
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from logging import DEBUG
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple

from gplfd_env.conventions.constants import Start
from gplfd_env.doors.config import DoorConfig
from gplfd_env.scene.build import build_scene
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
from gplfd_experiments.episodes.metrics import (
    EpisodeMetrics,
    FailedEpisode,
    episode_metrics,
)
from gplfd_experiments.episodes.rollout import Progress, rollout
from gplfd_experiments.episodes.task import EpisodeTask, episode_task, named_doors
from gplfd_experiments.files.plain_data import entry, read_json, write_json
from gplfd_experiments.files.provenance import content_hash, provenance
from gplfd_experiments.recording import record_episode
from gplfd_experiments.recording.tiago_meshes import BodyMeshes, tiago_looks
from gplfd_experiments.recording.video import (
    STANDARD,
    check_video,
    video_paths,
    write_video,
)
from gplfd_experiments.studies.sources import source_of
from gplfd_policies.agents.agent import Agent
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.demonstrations.npz import (
    FILE,
    LabelledDemonstrations,
    demonstrations_file,
    load_demonstrations,
    save_demonstrations,
)
from gplfd_policies.registry.catalogue import policy_named
from gplfd_policies.registry.policy import Policy
from gplfd_policies.registry.skill_files import method_and_skill

CONFIGURATION: Final = "run.json"
METRICS: Final = "metrics.json"


class _Learned(NamedTuple):
    """Learned agents for a kind of doors."""

    shown: LabelledDemonstrations
    make: Callable[[], Agent]
    file: str
    """Name of the file of these demonstrations in the run."""


def open_doors(
    doors: Sequence[str],
    folder: Path,
    *,
    policy: str,
    seed: int,
    demonstrations: Path | int,
    demonstrated_forces: bool,
    skill: Path | None,
    randomization: str,
    disturbance: str,
    start: Start,
    robot: str,
    looks: Literal["primitives", "tiago"],
    options: Mapping[str, Any],
    video: Path | None = None,
) -> tuple[EpisodeMetrics | FailedEpisode, ...]:
    """Learn, open each door once, and write everything.

    Doors of several kinds are opened by several agents. Each learns from demonstrations
    of its kind. ``demonstrations`` is their number per door, with wrenches if
    ``demonstrated_forces``, or a file. If the policy raises an error in acting, the
    door counts as not opened and the other doors are still opened. Nothing is written
    before the first episode has ended; then files of an earlier run in the folder are
    removed.
    """
    check_least("--seed", seed, 0)
    check_circumstances(randomization, disturbance, start)
    chosen = policy_named(policy)
    per_door = 2 if isinstance(demonstrations, Path) else demonstrations
    check_least("--demonstrations-per-door", per_door, 1)
    tasks = [
        episode_task(
            door,
            config,
            policy=policy,
            policy_source=source_of(chosen),
            seed=seed,
            demonstrations_per_door=per_door,
            demonstrated_forces=demonstrated_forces,
            randomization=randomization,
            disturbance=disturbance,
            start=start,
            robot=robot,
        )
        for door, config in named_doors(doors, start=start, robot=robot).items()
    ]
    videos = {} if video is None else video_paths(video, [one.door for one in tasks])
    if videos:
        check_video()
    check_folder(folder)
    earlier = _files_of_earlier_run(folder)
    shapes = None
    if looks == "tiago":
        if robot != "tiago-like":
            raise ValueError(f"--looks tiago is not for --robot {robot}")
        scene = build_scene(DoorConfig())
        shapes = tiago_looks([scene.body(index).name for index in range(scene.nbody)])
    if skill is not None and start == "approach":
        raise ValueError(
            "--skill contains no reaching: omit it to learn reaching as well, or omit "
            "--start approach"
        )
    if skill is not None or isinstance(demonstrations, Path):
        # There is only one set of demonstrations or skill.
        option = "--skill" if skill is not None else "--demonstrations"
        if demonstrated_forces:
            raise ValueError(
                "--demonstrated-forces applies to demonstrations of the synthetic "
                f"human: omit it, or omit {option}"
            )
        first, *others = (
            (task.door, {"motion": "hinged"} | DoorConfig(**task.door_config).kind)
            for task in tasks
        )
        for door, kind in others:
            if differ := [name for name in kind if kind[name] != first[1][name]]:
                raise ValueError(
                    f"doors {first[0]} and {door} are of two kinds (they differ in "
                    f"{', '.join(differ)}), but {option} contains one kind; use two "
                    f"runs, or omit {option}"
                )

    started = time.perf_counter()
    with reported_errors(policy, chosen):
        learned = _learn(tasks, chosen, demonstrations, skill)
        agents = {task.door: learned[task.demonstrations_key].make() for task in tasks}
    LOG.info("ready to act (%.1f s)", time.perf_counter() - started)

    kept = {one.file: one.shown for one in learned.values()}
    if FILE not in kept:
        earlier.append(folder / FILE)  # by an earlier run with one kind of doors

    @cache
    def begin() -> None:
        """Replace an earlier run, once the first door was opened."""
        for file in earlier:
            file.unlink(missing_ok=True)
        LOG.info("writing to %s", folder)
        given = None
        if isinstance(demonstrations, Path):
            given = demonstrations_file(demonstrations)
        for name, shown in kept.items():
            save_demonstrations(
                folder / name,
                shown.demonstrations,
                shown.radii,
                frame=shown.frame,
                signals=shown.signals,
            )
        record = {
            **options,
            "policy_source": tasks[0].policy_source,
            "demonstrations_sha256": {
                name: content_hash(given or folder / name) for name in kept
            },
            "demonstrations_of": {
                task.door: learned[task.demonstrations_key].file for task in tasks
            },
            "skill_sha256": None if skill is None else content_hash(skill),
            "door_configs": {task.door: task.door_config for task in tasks},
        }
        write_json(folder / CONFIGURATION, provenance(record))

    metrics: list[EpisodeMetrics | FailedEpisode] = []
    for task in tasks:
        name, agent = task.door, agents[task.door]
        shown = learned[task.demonstrations_key].shown
        try:
            video = videos.get(name)
            metrics.append(
                _open(task, agent, shown, chosen, begin, folder, shapes, video)
            )
        except PolicyError as error:
            begin()
            LOG.error("%s: %s", name, error, exc_info=LOG.isEnabledFor(DEBUG))
            radius = task.door_config["radius"]
            metrics.append(
                FailedEpisode(
                    policy=policy, door=name, radius=radius, seed=seed, error=str(error)
                )
            )
        write_json(folder / METRICS, [each.as_json() for each in metrics])

    opened = [each.door for each in metrics if isinstance(each, EpisodeMetrics)]
    names = {CONFIGURATION, METRICS, *kept}
    names |= {f"{door}{end}" for door in opened for end in (".npz", ".rrd")}
    if gone := sorted(name for name in names if not (folder / name).is_file()):
        raise FileNotFoundError(
            f"files of this run were deleted from {folder} while it went on: "
            f"{', '.join(gone)}; run it again"
        )
    return tuple(metrics)


def _files_of_earlier_run(folder: Path) -> list[Path]:
    """Return the files of an earlier run in the folder."""
    configuration = folder / CONFIGURATION
    if not configuration.exists():
        return []
    try:
        config = entry(read_json(configuration), "config", dict[str, Any])
        doors = entry(config, "door_configs", dict[str, Any])
    except ValueError as error:
        raise ValueError(
            f"{configuration} does not list the files of its run ({error}); "
            "choose another --out"
        ) from error
    names = [f"{door}{end}" for door in doors for end in (".npz", ".rrd")]
    names += [_kept_demonstrations(door) for door in doors]
    # A run does not write names outside the folder.
    own = [name for name in names if Path(name).name == name]
    return [folder / name for name in (METRICS, *own)]


def _kept_demonstrations(door: str) -> str:
    """Return the file of the demonstrations of one of several kinds of doors."""
    return f"{Path(FILE).stem}-{door}.npz"


def _learn(
    tasks: Sequence[EpisodeTask],
    policy: Policy,
    demonstrations: Path | int,
    skill: Path | None,
) -> dict[str, _Learned]:
    """Learn once per kind of doors.

    Returns learned agents by `EpisodeTask.demonstrations_key`.
    """
    kinds: dict[str, list[EpisodeTask]] = {}
    for task in tasks:
        kinds.setdefault(task.demonstrations_key, []).append(task)
    learned: dict[str, _Learned] = {}
    for shown, (first, *others) in kinds.items():
        file = FILE if len(kinds) == 1 else _kept_demonstrations(first.door)
        if skill is not None:
            method, followed = method_and_skill(first.policy, skill)
            aligned = followed.aligned.demonstrated
            times = aligned.duration * aligned.times
            # The skill contains the forces, if any.
            motions = [Demonstration(times=times, poses=one) for one in aligned.poses]
            given = LabelledDemonstrations(
                demonstrations=tuple(motions), radii=(None,) * len(motions)
            )
            learned[shown] = _Learned(given, partial(method.follow, followed), file)
            continue
        if isinstance(demonstrations, Path):
            given = load_demonstrations(demonstrations)
        else:
            given = demonstrations_of(first)
        if policy.kind != "reference":
            doors = ", ".join(task.door for task in (first, *others))
            number = len(given.demonstrations)
            LOG.info(f"learning from {number} demonstrations for {doors}")
        learned[shown] = _Learned(given, learned_agents(first, policy, given), file)
    return learned


def _open(
    task: EpisodeTask,
    agent: Agent,
    shown: LabelledDemonstrations,
    policy: Policy,
    begin: Callable[[], None],
    folder: Path,
    looks: BodyMeshes | None,
    video: Path | None,
) -> EpisodeMetrics:
    """Open a door, write its log, recording and video, and return its metrics."""
    started = time.perf_counter()
    name = task.door
    LOG.debug("%s: opening it with %s", name, task.policy)
    with (
        contextlib.closing(make_environment(task, agent.control)) as env,
        progress_bar(desc=name, unit=" s simulated") as bar,
        reported_errors(task.policy, policy, acting=True),
    ):

        def show(progress: Progress) -> None:
            angle = math.degrees(progress.door_angle)
            bar.set_postfix_str(f"door at {angle:.0f} deg", refresh=False)
            bar.update(progress.time - bar.n)

        log = rollout(
            env,
            agent,
            policy=task.policy,
            door=name,
            seed=task.reset_seed,
            on_step=show,
        )
        model = env.unwrapped.model  # type: ignore[attr-defined]
    begin()
    log.save(folder / f"{name}.npz")
    record_episode(folder / f"{name}.rrd", log, model, shown.demonstrations, looks)
    if video is not None:
        number = write_video(video, log, model, STANDARD)
        seconds = number / STANDARD.rate
        LOG.info("wrote %s (%d pictures, %.1f s)", video, number, seconds)
    metrics = episode_metrics(log)
    ended = "opened"
    if not metrics.success:
        ended = f"not opened ({why_closed(metrics.failure, metrics.reason)})"
    angle = round(metrics.final_angle_deg, 1) + 0.0  # not -0.0
    seconds = time.perf_counter() - started
    duration = f"{metrics.duration:.1f} s ({seconds:.1f} s)"
    LOG.info(f"{name}: {ended}, {angle:.1f} deg in {duration}")
    return metrics
