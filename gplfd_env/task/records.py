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
    """Values that are constant during an episode: numbers, or arrays (n,).

    Attributes:
        hand: Mass beyond the wrist sensor.
        way: `DoorConfig.way`; likewise `side`, `radius` and `hand_radius`.
        closer: Law of the door closer.
        latched: Whether it has a bolt; `bolt_throw` is how far it stands out [m].
        turned: Angle from which the handle counts as turned [rad].
        stopped: A disturbance stops the door.
    """

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
    """Sensor readings without noise: numbers, or arrays (n,).

    Attributes:
        time: Since the reset [s].
        wrench: On the hand [N, N m].
        hand: Its pose where a gripper opens and closes [m, rad].
        base: Pose and rate of the base.
        door: Privileged readings of door and grasp.
        latched: The bolt holds the door.
    """

    time: Number
    wrench: Wrench
    hand: tuple[Number, ...]
    base: BaseState
    door: DoorReading
    latched: Flag


@dataclass(slots=True)
class Progress:
    """How far an episode has come: numbers, or arrays (n,).

    Attributes:
        steps: Control periods so far.
        opening: Success and failure.
        stage: The furthest stage, a place in `gplfd_env.task.stages.STAGES`.
        diagnosis: What may be behind a failure.
        grasp_point: Where the hand took hold, in the handle's frame [m].
        terms: Of the last step's reward.
        simulation_error: MuJoCo has reset a diverged state.
    """

    steps: Number
    opening: OpeningMonitor
    stage: Number
    diagnosis: Diagnosis
    grasp_point: Vector
    terms: dict[str, Number]
    simulation_error: Flag


class Companions(NamedTuple):
    """What only some episodes have; each computes with the numbers of one simulation.

    Attributes:
        variation: The door and what is around it.
        rest: The action that holds the hand where it begins.
        noise: Of the sensors.
        delay: Of commands.
        intervention: What happens from outside.
        drive: Of a base that moves.
        gripper: That opens and closes.
    """

    variation: Variation
    rest: Array
    noise: NoiseSource | None
    delay: DelayLine | None
    intervention: Intervention | None
    drive: BaseDrive | None
    gripper: Gripper | None


class Outside(NamedTuple):
    """What a disturbance does: numbers, or arrays (n,); zeros where there is none.

    Attributes:
        push_force: Of the last period's push [N].
        person_force: Greatest force between a person and robot or door in the last
            period [N].
        person_energy: Work done on the person since the reset [J].
        base_shift: Displacement of the base so far, task frame [m].
        base_distance: Its magnitude [m].
    """

    push_force: Number = 0.0
    person_force: Number = 0.0
    person_energy: Number = 0.0
    base_shift: Vector = (0.0, 0.0, 0.0)
    base_distance: Number = 0.0


class Demands(NamedTuple):
    """What acts in a control period besides the commands, by simulation.

    Attributes:
        loads: From outside, where there is ever anything.
        base_rates: Commanded rates of bases that move.
        gripper_widths: Commanded widths of grippers that open and close [m].
    """

    loads: dict[int, Loads]
    base_rates: dict[int, Planar]
    gripper_widths: dict[int, float]
