"""Makes demonstrations, agents and environment of an episode from its task.

Only this module makes them, so that runs, studies and figures of one task have the same
numbers. It also reports errors in a user's policy.
"""

import contextlib
import copy
import dataclasses
import functools
import json
import math
from collections.abc import Callable, Hashable, Iterator, Sequence
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np

from gplfd_env import ENVIRONMENT_IDS
from gplfd_env.conventions.constants import Control
from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.randomization import door_randomization
from gplfd_env.spatial.se3 import handle_pose_on_arc
from gplfd_env.task.opening import DEMONSTRATED_ANGLE
from gplfd_experiments.data.teacher import (
    ForceConfig,
    Habits,
    Teacher,
    TeacherConfig,
    second,
)
from gplfd_experiments.data.teacher.motion import with_reaches
from gplfd_experiments.episodes.leading import Practice, corrected
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.rollout import rollout, rollouts
from gplfd_experiments.episodes.task import EpisodeTask
from gplfd_policies.agents.agent import Agent, as_agent, batch_agents
from gplfd_policies.agents.reaching import ReachingAgent, learn_reach, openings, reaches
from gplfd_policies.demonstrations.npz import LabelledDemonstrations, hash_of
from gplfd_policies.movements.movement import Movement
from gplfd_policies.movements.prior_mean import PosePath
from gplfd_policies.registry.catalogue import place_in_source
from gplfd_policies.registry.method import LearnedMode, Policy, TrainingInput


def demonstrations_of(task: EpisodeTask) -> LabelledDemonstrations:
    """Return the synthetic human's demonstrations for a task.

    If the hand starts in front of the handle, they also reach for it; their openings
    are those of the same task with the handle in the hand.
    """
    return _demonstrated(task.demonstrations_key)


@functools.lru_cache(maxsize=640)  # those of the protocol; up to 0.1 GB
def _demonstrated(key: str) -> LabelledDemonstrations:
    fields = json.loads(key)
    seed, per_door = fields["seed"], fields["demonstrations_per_door"]
    kind, radii = fields["demonstrated_kind"] or {}, fields["demonstrated_radii"]
    hardware = fields["demonstrated_hardware"] or [{}] * len(radii)
    doors = [
        DoorConfig(radius=radius, **(kind | parts))
        for radius, parts in zip(radii, hardware, strict=True)
    ]
    labels = tuple(np.repeat(radii, per_door).tolist())
    rng = np.random.default_rng(seed)
    if fields["taught_by"] == "second":
        angle = fields["teacher"]["angle_mean"]
        opened = second.demonstrate_doors(doors, per_door, angle, rng)
        return LabelledDemonstrations(demonstrations=opened, radii=labels)
    teacher = Teacher(
        TeacherConfig(**fields["teacher"]),
        Habits(**(fields["habits"] or {})),
        ForceConfig() if fields["demonstrated_forces"] else None,
    )
    demonstrations = teacher.demonstrate_doors(doors, per_door, rng=rng)
    if fields["start"] == "grasped":
        return LabelledDemonstrations(demonstrations=demonstrations, radii=labels)
    reaching = teacher.standard_reaches(per_door, seed=seed, doors=len(radii))
    return with_reaches(reaching, demonstrations, labels)


@functools.lru_cache(maxsize=256)
def _learned_reach(key: str) -> Movement:
    """Learn the reach of demonstrations by their key; all policies reach alike."""
    return learn_reach(reaches(_demonstrated(key)))


def demonstrations_hash(task: EpisodeTask) -> str:
    """Return a hash of the demonstrations of a task."""
    return hash_of(demonstrations_of(task).demonstrations)


Movements = dict[Hashable, tuple[object, Movement]]
"""Learned movements by the identity of what learned and the name of what they learned
from. The method is kept with each, so that no other object gets its identity."""


def learned(
    policy: Policy,
    training: TrainingInput,
    lesson: Hashable = None,
    movements: Movements | None = None,
) -> Callable[[], Agent]:
    """Learn a policy's movement, if it follows one, and return a factory of agents.

    Movements that another policy learned alike from the training input of this name
    are not learned again; new ones are added.
    """
    method = policy.method
    if method is None:
        return lambda: as_agent(policy.make(training))
    modes, alike = [], {} if movements is None else movements
    for numbers in method.modes(training):
        part = method.pipeline
        key = id(method.learner), id(part.align), part.beyond, lesson, numbers
        if key not in alike:
            alike[key] = method, method.learn(training.of(numbers))
        modes.append(LearnedMode(numbers, alike[key][1]))
    parts: list[Any] = [mode.movement for mode in modes]
    parts += [getattr(movement, "forces", None) for movement in parts]
    # A copy takes a tenth of the time of another agent; what was learned is shared.
    first = functools.cache(lambda: method.follow_modes(modes))
    return lambda: copy.deepcopy(first(), {id(part): part for part in parts})


def learned_agents(
    task: EpisodeTask,
    policy: Policy,
    labelled: LabelledDemonstrations | None = None,
    movements: Movements | None = None,
) -> Callable[[], Agent]:
    """Let the policy learn for all tasks with the same `EpisodeTask.training_key`.

    It learns from the task's own demonstrations unless others are given. The agents
    first reach for the handle if the episode starts in front of it. With movements,
    those that earlier tasks learned from equal demonstrations are not learned again.
    """
    lesson = task.demonstrations_key, task.prior_radius
    movements = movements if labelled is None else None
    given, labelled = labelled, labelled or demonstrations_of(task)
    prior_mean = None
    if task.prior_radius is not None:
        # The whole arc on the phase of demonstrations that end earlier.
        angles = np.linspace(0.0, DEMONSTRATED_ANGLE, 50)
        prior_mean = PosePath(
            phases=angles / task.teacher["angle_mean"],
            poses=handle_pose_on_arc(task.prior_radius, angles),
        )
    reach = None
    if task.start == "approach":
        key = task.demonstrations_key
        reach = learn_reach(reaches(given)) if given else _learned_reach(key)
    training = TrainingInput(
        demonstrations=openings(labelled), seed=task.seed, prior_mean=prior_mean
    )
    if task.practice is None:
        make = learned(policy, training, lesson, movements)
    else:
        make = _practised(task, policy, training)
    perception = door_randomization(task.randomization).perception
    return make if reach is None else lambda: ReachingAgent(reach, make(), perception)


def _practised(
    task: EpisodeTask, policy: Policy, training: TrainingInput
) -> Callable[[], Agent]:
    """Learn, collect corrections at other doors, and return a factory of agents."""
    method, practice = policy.method, Practice(**(task.practice or {}))
    if method is None:
        raise ValueError(f"policy {task.policy!r} learns no movement to be corrected")
    movement, number, taken, seconds = method.learn(training), 0, True, 0.0
    draws: Any = {"randomization": practice.randomization, "disturbance": "none"}
    doors: list[DoorConfig] = []
    while taken and len(doors) < practice.corrections:
        taken = False
        for fields in practice.doors:
            number += 1
            name, seed = f"practice {number}", 1000 * training.seed + number
            config = DoorConfig(**fields).as_dict()
            other = dataclasses.replace(task, door=name, door_config=config, **draws)
            opened = functools.partial(open_watched, other)
            log, correction = corrected(method.follow(movement), seed, name, opened)
            if correction is not None:
                movement, taken = method.update(movement, correction), True
                seconds += correction.seconds
                doors.append(log.config)
            if len(doors) == practice.corrections:
                break
    if practice.demonstrated:
        teacher = Teacher(forces=ForceConfig())
        demonstrations = list(training.demonstrations)
        rngs = np.random.default_rng(training.seed).spawn(len(doors))
        for door, rng in zip(doors, rngs, strict=True):
            if seconds > 0.0:
                demonstrations.append(teacher.demonstrate(door, rng))
                seconds -= float(np.ptp(demonstrations[-1].times))
        again = dataclasses.replace(training, demonstrations=demonstrations)
        movement = method.learn(again)
    return lambda: method.follow(movement)


def open_watched(task: EpisodeTask, agent: Agent) -> EpisodeLog:
    """Open a door once with a leader of the hand, in twice the usual time."""
    with contextlib.closing(
        make_environment(task, agent.control, max_episode_steps=3000)
    ) as env:
        return rollout(
            env,
            agent,
            policy=task.policy,
            door=task.door,
            seed=task.reset_seed,
            forecast_period=math.inf,
        )


def make_environment(task: EpisodeTask, control: Control, **arguments: Any) -> gym.Env:
    """Return the environment of a task; reset it with `EpisodeTask.reset_seed`.

    Other arguments are those of `gymnasium.make`, such as ``max_episode_steps``.
    """
    return gym.make(
        ENVIRONMENT_IDS[control],
        **_circumstances(task),
        base=task.base,
        robot=task.robot,
        start=task.start,
        **arguments,
    )


def model_of(task: EpisodeTask, control: Control = "pose") -> mujoco.MjModel:
    """Return the model of the scene of a task's episode."""
    with contextlib.closing(make_environment(task, control)) as env:
        env.reset(seed=task.reset_seed)
        return env.unwrapped.model  # type: ignore[attr-defined]


def open_together(
    tasks: Sequence[EpisodeTask], agents: Sequence[Agent], **options: Any
) -> Iterator[EpisodeLog]:
    """Open the doors of tasks of one robot, base and start in lockstep.

    There is an agent and a log per task. A log is made when it is taken. The options
    are those of `rollouts`; by default, no forecasts are taken.
    """
    rows = [_circumstances(task) for task in tasks]
    varied: dict[str, Any] = {name: [row[name] for row in rows] for name in rows[0]}
    together, first = batch_agents(agents), tasks[0]
    envs: Any = gym.make_vec(
        ENVIRONMENT_IDS[together.control],
        num_envs=len(tasks),
        base=first.base,
        robot=first.robot,
        start=first.start,
        **varied,
        autoreset_mode="Disabled",
        num_threads=1,
    )
    with contextlib.closing(envs):
        return rollouts(
            envs,
            together,
            policies=[task.policy for task in tasks],
            doors=[task.door for task in tasks],
            seeds=[task.reset_seed for task in tasks],
            **{"forecast_period": None, **options},
        )


def _circumstances(task: EpisodeTask) -> dict[str, Any]:
    return {
        "door": dict(task.door_config),
        "randomization": task.randomization,
        "disturbance": task.disturbance,
    }


def place_in_policy(error: BaseException, policy: Policy) -> str:
    """Return file, line and function of the user's code that raised an error, or ""."""
    return place_in_source(policy.origin, error) if policy.origin else ""


class PolicyError(ValueError):
    """The user's policy raised an error, in learning or acting."""


@contextlib.contextmanager
def reported_errors(
    name: str, policy: Policy, *, acting: bool = False
) -> Iterator[None]:
    """Replace an error of the user's policy by one that states its location.

    While the policy is acting, a value that it must not return is its error, too.
    """
    try:
        yield
    # BaseException: the user's code runs here and may raise anything.
    except BaseException as error:
        place = place_in_policy(error, policy)
        built_in = policy.origin is None or policy.origin.kind == "built-in"
        # Errors of files and arguments are clear by themselves.
        clear = OSError if acting else (OSError, ValueError)
        interrupted = isinstance(error, KeyboardInterrupt)
        if built_in or interrupted or (not place and isinstance(error, clear)):
            raise
        raise PolicyError(
            f"policy {name!r} failed with {type(error).__name__}: {error}"
            + (f" ({place})" if place else "")
        ) from error
