"""A run: learn once, open some doors, and keep numbers and recordings in a folder."""

import contextlib
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import gymnasium as gym

from gplfd.experiments.arguments import check_circumstances, check_folder, check_least
from gplfd.experiments.datasets.npz import (
    FILE,
    LabelledDemonstrations,
    demonstrations_file,
    load_demonstrations,
    save_demonstrations,
)
from gplfd.experiments.datasets.reaching import openings, reaches, taught
from gplfd.experiments.episodes.agents import learned, reported_errors
from gplfd.experiments.episodes.doors import named_doors, reset_seed
from gplfd.experiments.episodes.log import EpisodeLog
from gplfd.experiments.episodes.metrics import EpisodeMetrics, episode_metrics
from gplfd.experiments.episodes.rollout import Progress, rollout
from gplfd.experiments.files.plain_data import entry, read_json, write_json
from gplfd.experiments.files.provenance import content_hash, provenance
from gplfd.experiments.progress import LOG, progress_bar
from gplfd.experiments.recording import record_episode
from gplfd.experiments.recording.tiago_meshes import TiagoLooks, tiago_looks
from gplfd.experiments.recording.video import check_video, video_paths, write_video
from gplfd.experiments.skills import skill_method
from gplfd.experiments.study.sources import source_of
from gplfd.policies.agent import Agent
from gplfd.policies.demonstrations import Demonstration
from gplfd.policies.method import TrainingInput
from gplfd.policies.policy import Policy
from gplfd.policies.reaching import ReachingAgent, learn_reach
from gplfd.policies.registry import policy_named
from gplfd.policies.skill import load_skill
from gplfd_env import ENVIRONMENT_IDS
from gplfd_env.config import DoorConfig
from gplfd_env.scene import build_scene
from gplfd_env.stance import base_for
from gplfd_env.task import Start

CONFIGURATION: Final = "run.json"
METRICS: Final = "metrics.json"


@dataclass(frozen=True, kw_only=True, slots=True)
class _Run:
    """A run that is ready: checked and learned."""

    folder: Path
    name: str
    """Name of the policy."""
    policy: Policy
    seed: int
    configs: Mapping[str, DoorConfig]
    randomization: str
    disturbance: str
    start: Start
    shown: LabelledDemonstrations
    """What the policy learned from."""
    agents: Mapping[str, Agent]
    """By door."""
    looks: TiagoLooks | None
    videos: Mapping[str, Path]
    """File of each door's video; empty if none are wanted."""


def open_doors(
    doors: Sequence[str],
    folder: Path,
    *,
    policy: str,
    seed: int,
    demonstrations: Path | int,
    skill: Path | None,
    randomization: str,
    disturbance: str,
    start: Start,
    looks: Literal["primitives", "tiago"],
    options: Mapping[str, Any],
    video: Path | None = None,
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
        skill: A file of a skill to follow instead of learning, or None.
        randomization: Name of what the environment draws anew.
        disturbance: Name of what happens from outside.
        start: What episodes begin with. Before the handle, reaching for it is learned
            from the same demonstrations.
        looks: How recordings draw the robot.
        options: The command's, for the record; JSON-able.
        video: File of the video, see `gplfd.experiments.recording.video`; None for no
            videos.

    Raises:
        ValueError: An argument or a file is wrong, or the user's policy failed.
        OSError: A file cannot be read or written.
        ModuleNotFoundError: The meshes that are to be drawn, or the encoder of videos,
            are not installed.
    """
    check_least("--seed", seed, 0)
    configs = named_doors(doors)
    like = _of_one_kind(configs)
    videos = {} if video is None else video_paths(video, list(configs))
    if videos:
        check_video()
    check_circumstances(randomization, disturbance)
    chosen = policy_named(policy)
    check_folder(folder)
    earlier = _files_of_earlier_run(folder)
    drawn = _looks(looks)
    if skill is not None and start == "approach":
        raise ValueError(
            "--skill is of opening alone: leave it out to learn reaching, too, or "
            "leave out --start approach"
        )
    started = time.perf_counter()
    with reported_errors(policy, chosen):
        if skill is None:
            shown = _demonstrations(demonstrations, seed, like, start)
            make = _learn(chosen, shown, seed, start)
        else:
            shown, make = _load(policy, skill)
        agents = {door: make() for door in configs}
    LOG.info("ready to act (%.1f s)", time.perf_counter() - started)
    run = _Run(
        folder=folder,
        name=policy,
        policy=chosen,
        seed=seed,
        configs=configs,
        randomization=randomization,
        disturbance=disturbance,
        start=start,
        shown=shown,
        agents=agents,
        looks=drawn,
        videos=videos,
    )
    for file in earlier:
        file.unlink(missing_ok=True)
    _write_inputs(run, demonstrations, skill, options)
    metrics: list[EpisodeMetrics] = []
    for door in configs:
        metrics.append(_open(run, door))
        write_json(folder / METRICS, [one.as_json() for one in metrics])
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
        config = entry(read_json(configuration), "config", dict[str, Any])
        doors = entry(config, "door_configs", dict[str, Any])
    except ValueError as error:
        raise ValueError(
            f"{configuration} does not say what was written beside it ({error}); "
            "choose another --out"
        ) from error
    names = [f"{door}{end}" for door in doors for end in (".npz", ".rrd")]
    # A name that leads elsewhere is not one that a run wrote.
    own = [name for name in names if Path(name).name == name]
    return [folder / name for name in (METRICS, *own)]


def _looks(looks: Literal["primitives", "tiago"]) -> TiagoLooks | None:
    if looks == "primitives":
        return None
    robot = build_scene(DoorConfig())
    return tiago_looks([robot.body(index).name for index in range(robot.nbody)])


def _of_one_kind(configs: Mapping[str, DoorConfig]) -> DoorConfig:
    """Return the first of some doors that are all opened by one kind of motion.

    Raises:
        ValueError: They are of several kinds: what opens one does not open another.
    """
    (name, first), *others = configs.items()
    for other, config in others:
        if config.kind != first.kind:
            differ = ", ".join(k for k in first.kind if config.kind[k] != first.kind[k])
            raise ValueError(
                f"doors {name} and {other} are of two kinds (they differ in {differ}), "
                "and what is learned on one does not open the other; give them to two "
                "runs"
            )
    return first


def _demonstrations(
    given: Path | int, seed: int, like: DoorConfig, start: Start
) -> LabelledDemonstrations:
    if isinstance(given, Path):
        return load_demonstrations(given)
    check_least("--demonstrations-per-door", given, 1)
    return taught(given, seed=seed, like=like, start=start)


def _learn(
    policy: Policy, shown: LabelledDemonstrations, seed: int, start: Start
) -> Callable[[], Agent]:
    if policy.kind != "reference":
        LOG.info("learning from %d demonstrations", len(shown.demonstrations))
    reach = learn_reach(reaches(shown)) if start == "approach" else None
    training = TrainingInput(demonstrations=openings(shown), seed=seed)
    make = learned(policy, training)
    return make if reach is None else lambda: ReachingAgent(reach, make())


def _load(
    policy: str, file: Path
) -> tuple[LabelledDemonstrations, Callable[[], Agent]]:
    method, skill = skill_method(policy), load_skill(file)
    if (method.beyond > 0.0) != (skill.aligned.end < 1.0):
        goes = "goes on where demonstrations end"
        raise ValueError(
            f"policy {policy!r} {goes if method.beyond > 0.0 else 'ends there'}, and "
            f"the skill in {file} was learned by one that does not; learn it again "
            f"with  gplfd learn --policy {policy}"
        )
    aligned = skill.aligned.demonstrated
    times = aligned.duration * aligned.times
    shown = [Demonstration(times=times, poses=poses) for poses in aligned.poses]
    return (
        LabelledDemonstrations(
            demonstrations=tuple(shown), radii=tuple(None for _ in shown)
        ),
        lambda: method.follow(skill),
    )


def _write_inputs(
    run: _Run,
    demonstrations: Path | int,
    skill: Path | None,
    options: Mapping[str, Any],
) -> None:
    LOG.info("writing to %s", run.folder)
    kept = run.folder / FILE
    shown = run.shown
    save_demonstrations(
        kept,
        shown.demonstrations,
        shown.radii,
        frame=shown.frame,
        signals=shown.signals,
    )
    given = (
        demonstrations_file(demonstrations)
        if isinstance(demonstrations, Path)
        else kept
    )
    record = {
        **options,
        "policy_source": source_of(run.policy),
        "demonstrations_sha256": content_hash(given),
        "skill_sha256": None if skill is None else content_hash(skill),
        "door_configs": {
            door: config.as_dict() for door, config in run.configs.items()
        },
    }
    write_json(run.folder / CONFIGURATION, provenance(record))


def _open(run: _Run, door: str) -> EpisodeMetrics:
    """Open a door, write its log and recording, and return its metrics."""
    started = time.perf_counter()
    env = gym.make(
        ENVIRONMENT_IDS[run.agents[door].control],
        door=run.configs[door],
        randomization=run.randomization,
        disturbance=run.disturbance,
        base=base_for(run.configs[door]),
        start=run.start,
    )
    with contextlib.closing(env):
        with reported_errors(run.name, run.policy):
            log = _watched_rollout(env, run, door)
        log.save(run.folder / f"{door}.npz")
        record_episode(
            run.folder / f"{door}.rrd",
            log,
            env.unwrapped.model,  # type: ignore[attr-defined]
            run.shown.demonstrations,
            run.looks,
        )
        if door in run.videos:
            write_video(run.videos[door], log, env.unwrapped.model)  # type: ignore[attr-defined]
    metrics = episode_metrics(log)
    LOG.info(
        "%s: %s, %.1f deg in %.1f s (%.1f s)",
        door,
        "opened" if metrics.success else f"not opened ({metrics.failure})",
        metrics.final_angle_deg,
        metrics.duration,
        time.perf_counter() - started,
    )
    return metrics


def _watched_rollout(env: gym.Env[Any, Any], run: _Run, door: str) -> EpisodeLog:
    """Run the episode behind a progress bar and return its log."""
    drawn = not run.randomization == run.disturbance == "none"
    with progress_bar(desc=door, unit=" s simulated") as bar:

        def show(progress: Progress) -> None:
            angle = math.degrees(progress.door_angle)
            bar.set_postfix_str(f"door at {angle:.0f} deg", refresh=False)
            bar.update(progress.time - bar.n)

        return rollout(
            env,
            run.agents[door],
            policy=run.name,
            door=door,
            seed=reset_seed(run.seed, door, drawn=drawn),
            on_step=show,
        )
