"""Records of an episode: numbers of one simulation, or arrays (n,)."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gplfd_env.conventions.one_and_many import Flag, Number
from gplfd_env.doors.variation import Variation
from gplfd_env.robot.gripper import Gripper
from gplfd_env.robot.whole_body import BaseDrive
from gplfd_env.scene.closer import CloserLaw
from gplfd_env.task.draw import DelayLine, NoiseSource
from gplfd_env.task.intervention import Intervention
from gplfd_env.task.observation import BaseState, DoorReading, Hand, Vector, Wrench
from gplfd_env.task.opening import OpeningMonitor
from gplfd_env.task.stages import Diagnosis

Array = NDArray[np.float64]


class Constants(NamedTuple):
    """Values that are constant during an episode: numbers, or arrays (n,)."""

    hand: Hand
    way: Number  # `DoorConfig.way`; likewise the next three.
    side: Number
    radius: Number
    hand_radius: Number
    closer: CloserLaw
    latched: Flag  # It has a bolt,
    bolt_throw: Number  # which stands out by this [m].
    turned: Number  # Angle from which the handle counts as turned [rad].
    stopped: Flag  # A disturbance stops the door.


class Readings(NamedTuple):
    """Sensor readings without noise: numbers, or arrays (n,)."""

    time: Number  # Since the reset [s].
    wrench: Wrench  # On the hand [N, N m].
    hand: tuple[Number, ...]  # Its pose where a gripper opens and closes [m, rad].
    base: BaseState
    door: DoorReading
    latched: Flag  # The bolt holds the door.


@dataclass(slots=True)
class Progress:
    """How far an episode has come: numbers, or arrays (n,)."""

    steps: Number  # Control periods so far.
    opening: OpeningMonitor
    stage: Number  # The furthest one, a place in `gplfd_env.task.stages.STAGES`.
    diagnosis: Diagnosis
    grasp_point: Vector  # Where the hand took hold, in the handle's frame [m].
    terms: dict[str, Number]  # Of the last step's reward.
    simulation_error: Flag  # MuJoCo has reset a diverged state.


class Companions(NamedTuple):
    """What only some episodes have; each computes with numbers of one simulation."""

    variation: Variation
    rest: Array  # The action that holds the hand where it begins.
    noise: NoiseSource | None
    delay: DelayLine | None
    intervention: Intervention | None
    drive: BaseDrive | None
    gripper: Gripper | None


class Outside(NamedTuple):
    """What a disturbance does, see `Intervention`: numbers, or arrays (n,)."""

    push_force: Number = 0.0
    person_force: Number = 0.0
    person_energy: Number = 0.0
    base_shift: Vector = (0.0, 0.0, 0.0)
    base_distance: Number = 0.0
