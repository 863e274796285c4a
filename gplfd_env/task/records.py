"""Records of an episode: numbers of one simulation, or arrays (n,)."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gplfd_env.conventions.one_and_many import Flag, Number
from gplfd_env.doors.variation import Variation
from gplfd_env.robot.gripper import Gripper
from gplfd_env.robot.whole_body import BaseDrive, Planar
from gplfd_env.scene.closer import CloserLaw
from gplfd_env.simulation.loads import Loads
from gplfd_env.task.draw import DelayLine, NoiseSource
from gplfd_env.task.intervention import Intervention
from gplfd_env.task.observation import BaseState, DoorReading, Hand, Vector, Wrench
from gplfd_env.task.opening import OpeningMonitor
from gplfd_env.task.stages import Diagnosis

Array = NDArray[np.float64]


class Constants(NamedTuple):
    """Values that are constant during an episode: numbers, or arrays (n,)."""

    hand: Hand
    way: Number
    side: Number
    radius: Number
    hand_radius: Number
    closer: CloserLaw
    latched: Flag
    bolt_throw: Number
    turned: Number
    stopped: Flag


class Readings(NamedTuple):
    """Sensor readings without noise: numbers, or arrays (n,)."""

    time: Number
    wrench: Wrench
    hand: tuple[Number, ...]
    base: BaseState
    door: DoorReading
    latched: Flag


@dataclass(slots=True)
class Progress:
    """How far an episode has come: numbers, or arrays (n,)."""

    steps: Number
    opening: OpeningMonitor
    stage: Number
    diagnosis: Diagnosis
    grasp_point: Vector
    terms: dict[str, Number]
    simulation_error: Flag


class Companions(NamedTuple):
    """What only some episodes have; each computes with numbers of one simulation."""

    variation: Variation
    rest: Array
    noise: NoiseSource | None
    delay: DelayLine | None
    intervention: Intervention | None
    drive: BaseDrive | None
    gripper: Gripper | None


class Outside(NamedTuple):
    """What a disturbance does: numbers, or arrays (n,); zeros where there is none."""

    push_force: Number = 0.0
    person_force: Number = 0.0
    person_energy: Number = 0.0
    base_shift: Vector = (0.0, 0.0, 0.0)
    base_distance: Number = 0.0


class Demands(NamedTuple):
    """What acts in a control period besides the commands, by simulation."""

    loads: dict[int, Loads]
    base_rates: dict[int, Planar]
    gripper_widths: dict[int, float]
