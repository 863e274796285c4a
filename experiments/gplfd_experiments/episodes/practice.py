"""Practice: a policy opens doors while somebody watches and corrects it."""

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
from gplfd_policies.demonstrations.correction import Correction
from gplfd_policies.movements.movement import Movement
from gplfd_policies.registry.method import Method, TrainingInput

LOST: Final = "grasp_lost"
"""Failure of an episode of which no correction is taken: the hand left the door."""

OpenLed = Callable[[int, DoorConfig, Agent], EpisodeLog]
"""Lets an agent open a door of practice, by its number, and returns the log."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Practice:
    """Doors that a policy opens one by one until it has been corrected N times.

    It ends earlier after a round in which no correction was taken.
    """

    corrections: int
    """N."""
    doors: Sequence[Mapping[str, Any]]
    """The doors of a round, as `DoorConfig.as_dict` gives them."""
    randomization: str | Mapping[str, Any] = "none"
    """What is drawn for every opening."""
    demonstrated: bool = False
    """Whether the policy learns from new demonstrations at the corrected doors in place
    of the corrections: as many as were begun in the seconds that corrections took, and
    with forces, as corrections have them."""


def corrected(
    agent: Agent, seed: int, name: str, open_door: Callable[[Agent], EpisodeLog]
) -> tuple[EpisodeLog, Correction | None]:
    """Open a door under the eyes of the synthetic corrector.

    Returns:
        The log, and the correction; None if there was none, or if the hand lost the
        handle.
    """
    led = LedAgent(agent, SyntheticCorrector(np.random.default_rng(seed)))
    log = open_door(led)
    if log.failure == LOST:
        return log, None
    return log, led.correction(door=name, seed=seed)


def practised(
    method: Method, training: TrainingInput, practice: Practice, open_led: OpenLed
) -> Movement:
    """Learn, practise, and return the movement after the corrections."""
    movement, taken, number = method.learn(training), 0, 0
    seconds, doors = 0.0, []
    while taken < practice.corrections:
        before = taken
        for given in practice.doors:
            door, number = DoorConfig(**given), number + 1
            seed = 1000 * training.seed + number
            log, correction = corrected(
                method.follow(movement),
                seed,
                f"practice {number}",
                partial(open_led, number, door),
            )
            if correction is None:
                continue
            movement = method.update(movement, correction)
            taken, seconds = taken + 1, seconds + correction.seconds
            doors.append(DoorConfig(**log.door_config))
            if taken == practice.corrections:
                break
        if taken == before:
            break
    if not practice.demonstrated:
        return movement
    teacher, left = Teacher(forces=ForceConfig()), seconds
    shown = list(training.demonstrations)
    rngs = np.random.default_rng(training.seed).spawn(len(doors))
    for door, rng in zip(doors, rngs, strict=True):
        if left <= 0.0:
            break
        shown.append(teacher.demonstrate(door, rng))
        left -= float(np.ptp(shown[-1].times))
    return method.learn(replace(training, demonstrations=shown))
