"""Practice: a policy opens doors while the synthetic corrector watches it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

import numpy as np

from gplfd_env.doors.config import DoorConfig
from gplfd_experiments.data.teacher import ForceConfig, Teacher
from gplfd_experiments.episodes.leading import LedAgent, SyntheticCorrector
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_policies.agents.agent import Agent
from gplfd_policies.demonstrations.demonstration import Correction
from gplfd_policies.movements.movement import Movement
from gplfd_policies.registry.method import Method, TrainingInput

LOST: Final = "grasp_lost"
"""Episodes with this failure give no correction: the hand lost the handle."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Practice:
    """Doors opened in turn until N corrections, or a round without a correction."""

    corrections: int
    """Number N of corrections."""
    doors: Sequence[Mapping[str, Any]]
    """The doors of a round, as `DoorConfig.as_dict` gives them."""
    randomization: str | Mapping[str, Any] = "none"
    """Randomization of every opening."""
    demonstrated: bool = False
    """Whether the policy learns from new demonstrations at the corrected doors instead:
    as many as were begun in the seconds of the corrections, also with forces."""


def corrected(
    agent: Agent, seed: int, name: str, open_door: Callable[[Agent], EpisodeLog]
) -> tuple[EpisodeLog, Correction | None]:
    """Open a door with the corrector; return the log and the correction."""
    led = LedAgent(agent, SyntheticCorrector(np.random.default_rng(seed)))
    log = open_door(led)
    taken = None if log.failure == LOST else led.correction(door=name, seed=seed)
    return log, taken


def practised(
    method: Method,
    training: TrainingInput,
    practice: Practice,
    open_door: Callable[[str, DoorConfig, Agent], EpisodeLog],
) -> Movement:
    """Learn, practise, and return the movement after the corrections."""
    movement, number, taken, seconds = method.learn(training), 0, True, 0.0
    doors: list[DoorConfig] = []
    while taken and len(doors) < practice.corrections:
        taken = False
        for fields in practice.doors:
            number += 1
            name, seed = f"practice {number}", 1000 * training.seed + number
            opened = partial(open_door, name, DoorConfig(**fields))
            log, correction = corrected(method.follow(movement), seed, name, opened)
            if correction is not None:
                movement, taken = method.update(movement, correction), True
                seconds += correction.seconds
                doors.append(DoorConfig(**log.door_config))
            if len(doors) == practice.corrections:
                break
    if not practice.demonstrated:
        return movement
    teacher = Teacher(forces=ForceConfig())
    demonstrations = list(training.demonstrations)
    rngs = np.random.default_rng(training.seed).spawn(len(doors))
    for door, rng in zip(doors, rngs, strict=True):
        if seconds > 0.0:
            demonstrations.append(teacher.demonstrate(door, rng))
            seconds -= float(np.ptp(demonstrations[-1].times))
    return method.learn(replace(training, demonstrations=demonstrations))
