"""One episode: its circumstances, its progress, its outcome."""

import math
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from gplfd_env.conventions.constants import CONTROL_PERIOD, GRIPPER_WIDTH
from gplfd_env.robot.gripper import Gripper
from gplfd_env.robot.placement import hand_position_w
from gplfd_env.robot.whole_body import BaseDrive, Planar
from gplfd_env.scene.closer import CloserLaw
from gplfd_env.scene.latch import latch_holds
from gplfd_env.simulation.loads import Loads, Vector
from gplfd_env.task.draw import Drawn
from gplfd_env.task.info import distance, handle_rotation
from gplfd_env.task.intervention import Intervention
from gplfd_env.task.observation import DoorReading, Observation, Reader
from gplfd_env.task.opening import OpeningMonitor, reward_terms, sparse_reward_terms
from gplfd_env.task.stages import STAGES, Capability, Hindrance

Array = NDArray[np.float64]
Reward = Literal["dense", "sparse"]

REWARDS: Final = {"dense": reward_terms, "sparse": sparse_reward_terms}
"""Terms of the reward, by its name."""


_CLOSED: Final = [0.0] * 6
"""Pose of a hand that holds the closed handle."""


class Episode:
    """What an environment keeps of one simulation besides the simulator's state.

    Args:
        drawn: Its circumstances.
        reader: Reads the simulation's sensors.
        reward: A key of `REWARDS`.
        values: Sensor array of the simulation at rest.
        rest: The action that holds the hand where it begins.

    Attributes:
        variation: The door and what is around it.
        reader: What reads its sensors.
        steps: Control periods so far.
        terms: Of the last step's reward.
        time: Of the last readings, since the reset [s].
        wrench: Their wrench on the hand, without noise [N, N m].
        simulation_error: MuJoCo has reset a diverged state.
    """

    def __init__(
        self,
        drawn: Drawn,
        reader: Reader,
        reward: Reward,
        values: list[float],
        rest: Array,
    ) -> None:
        self.variation, self._noise, self._delay = drawn
        self.reader, self._terms, self._rest = reader, REWARDS[reward], rest
        disturbed = not self.variation.disturbance.idle
        self._intervention = Intervention(self.variation) if disturbed else None
        door, placement = self.variation.door, self.variation.placement
        self._signs, self._closer = (door.way, door.side), CloserLaw(door)
        self._drive: BaseDrive | None = None
        if reader.odometry is not None:
            x, y, _ = hand_position_w(door, placement, "mobile").tolist()
            self._drive = BaseDrive((x, y), door)
        holds = self.variation.standoff is None
        self._gripper: Gripper | None = None
        if reader.finger is not None:
            self._gripper = Gripper(door, 0.0 if holds else GRIPPER_WIDTH)
        self.steps = 0
        self.simulation_error = False
        self._sense(values)
        self._monitor = OpeningMonitor(CONTROL_PERIOD, taken=holds)
        self._capability = Capability(door)
        self._hindrance = Hindrance(reader.arm_limits)
        self._capability.update(self._reading, latched=self._latched, held=False)
        self._grasp_point = self._reading.hand_on_handle
        self.terms = self._terms(0.0, 0.0, False)

    def loads(self) -> Loads | None:
        """Return what acts from outside in the next period; None if nothing ever."""
        if self._intervention is None:
            return None
        slip = 0.0
        if self._monitor.taken:
            slip = self._reading.hand_on_handle[0] - self._grasp_point[0]
        return self._intervention.loads(self.time, self._reading, slip)

    def due(self, command: Array) -> Array:
        """Put a command in and return the one that reaches the servo now."""
        if self._delay is not None:
            command = self._delay.pass_on(command, self._rest)
        if self._intervention is not None:
            # The robot means its own frame, which has moved with the base.
            command = command.copy()
            command[:3] += self._intervention.base_shift
        return command

    def drive(self, command: Array, *, obeys: bool) -> Planar | None:
        """Return the rate of the base in the next period; None if it does not move.

        Args:
            command: What `due` gave.
            obeys: Whether its last three entries are the base's twist.
        """
        if self._drive is None:
            return None
        pose, _ = self._base
        if obeys:
            self._drive.obey(command[-3:].tolist(), pose)
        elif self._has_grasped:
            self._drive.follow(command[:6].tolist(), pose)
        else:
            # Reaching is the arm's matter: the base stands right for the grasp.
            self._drive.follow(_CLOSED, pose)
        return self._drive.rate

    def grip(self, command: Array, *, obeys: bool) -> float | None:
        """Return the gripper's width in the next period [m]; None if it stays.

        Args:
            command: What `due` gave.
            obeys: Whether its last entry is that width.
        """
        if self._gripper is None:
            return None
        if obeys:
            self._gripper.obey(float(command[-1]))
        else:
            self._gripper.close_at_handle(self._hand, taken=self._monitor.taken)
        return self._gripper.width

    def advance(self, values: list[float]) -> None:
        """Take in the sensor array after one control period."""
        self.steps += 1
        before = self._reading.angle
        self._sense(values)
        reading, drive = self._reading, self._drive
        if drive is not None:
            drive.note(self._base[1])
        monitor, latched = self._monitor, self._latched
        had = monitor.taken
        monitor.update(
            reading.angle,
            reading.grasped,
            reading.handle_angle,
            latched=latched,
            blocked=drive is not None and drive.blocked,
            opened=self._gripper is not None and self._gripper.opened,
        )
        if monitor.taken and not had:
            self._grasp_point = reading.hand_on_handle
        self._capability.update(reading, latched=latched, held=monitor.success)
        joints = values[self.reader.joint_pos]
        stalled = monitor.failure in ("stalled", "not_grasped")
        self._hindrance.update(reading, joints, stalled=stalled)
        gain = reading.angle - before
        self.terms = self._terms(gain, reading.forces[2], monitor.success)

    def break_off(self) -> None:
        """Take in that the simulation has diverged; all readings stay the last good."""
        self.steps += 1
        self.simulation_error = True
        self.terms = self._terms(0.0, 0.0, False)

    def stand_still(self) -> None:
        """Take in that an ended episode was not stepped: it earns nothing more."""
        self.terms = self._terms(0.0, 0.0, False)

    def falsify(self, observation: Observation, row: Any = ...) -> None:
        """Give an observation its noise and the error of a moved base, in place.

        Args:
            observation: Of this simulation or of many.
            row: Which of many.
        """
        if self._intervention is not None:
            observation["ee_pose"][row][..., :3] -= self._intervention.base_shift
            observation["ee_twist"][row][..., :3] -= self._intervention.base_velocity
        if self._blur is not None:
            observation["ee_pose"][row] += self._blur[:6]
            observation["wrench"][row] += self._blur[6:]

    def _sense(self, values: list[float]) -> None:
        self.time = self.steps * CONTROL_PERIOD
        self.wrench = self.reader.wrench(values)
        self._reading: DoorReading = self.reader.door_reading(values, *self._signs)
        self._base = self.reader.base_state(values)
        self._hand = values[self.reader.ee_pose]
        self._blur = None if self._noise is None else self._noise.draw()

    @property
    def _has_grasped(self) -> bool:
        """Whether the hand has ever held the handle."""
        return self.variation.standoff is None or self._capability.level > 0

    @property
    def _latched(self) -> bool:
        """Whether the bolt holds the door."""
        reading = self._reading
        return latch_holds(self.variation.door, reading.angle, reading.bolt)

    @property
    def takes_commands_as_given(self) -> bool:
        """Whether `due` always returns the command that it is given."""
        return self._delay is None and self._intervention is None

    @property
    def _outside(self) -> tuple[float, float, float, float, float, Vector]:
        """What came from outside, in the order of `NUMBERS`, and the base's shift."""
        outside = self._intervention
        if outside is None:
            return 0.0, 0.0, 0.0, 0.0, 0.0, (0.0, 0.0, 0.0)
        # A door may also reach the end of its hinge: that is no disturbance.
        blocked = self.variation.disturbance.stop is not None
        torque = self._reading.stop_torque if blocked else 0.0
        return (
            outside.push_force,
            outside.person_force,
            outside.person_energy,
            math.hypot(*outside.base_shift),
            torque / self.variation.door.hand_radius,
            outside.base_shift,
        )

    @property
    def _slip(self) -> float:
        """Distance of the hand from where it took hold of the handle [m]."""
        if not self._monitor.taken:
            return 0.0
        return distance(self._reading.hand_on_handle, self._grasp_point)

    @property
    def reward(self) -> float:
        """Of the last step: the sum of its terms."""
        return sum(self.terms.values())

    @property
    def failure(self) -> str:
        """What has gone wrong: see `OpeningMonitor`; or ``"simulation_error"``."""
        return "simulation_error" if self.simulation_error else self._monitor.failure

    @property
    def reason(self) -> str:
        """Why it fails: see `gplfd_env.task.stages.Hindrance.reason`."""
        return self._hindrance.reason(self.failure)

    @property
    def stage(self) -> str:
        """The furthest stage that it has reached, one of `STAGES`."""
        return STAGES[self._capability.level]

    @property
    def terminated(self) -> bool:
        """The task has ended, in success or with the grasp lost."""
        ended = self._monitor.success or self._monitor.failure == "grasp_lost"
        return ended and not self.simulation_error

    @property
    def row(self) -> tuple[float, ...]:
        """The info in numbers, in the order of `gplfd_env.task.info`.

        `NUMBERS`, the handle's pose (6), the base's pose and rate (3 each), `FLAGS`.
        """
        reading, monitor, outside = self._reading, self._monitor, self._outside
        tangential, vertical, radial = reading.forces
        x, y, z = reading.handle_position
        *measured, (dx, dy, dz) = outside
        return (
            reading.angle,
            reading.velocity,
            self.variation.door.radius,
            self._slip,
            tangential,
            radial,
            vertical,
            *measured,
            reading.handle_angle,
            reading.bolt,
            self._closer.torque(reading.angle, reading.velocity),
            self._capability.level,
            x - dx,
            y - dy,
            z - dz,
            *handle_rotation(*self._signs, reading),
            *self._base[0],
            *self._base[1],
            monitor.success,
            monitor.success,
            reading.grasped,
            self.simulation_error,
        )
