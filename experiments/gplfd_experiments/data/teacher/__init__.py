"""A synthetic human who opens doors in a motion-capture suit.

It replaces the recordings of Arduengo et al., arXiv:2002.09979, Section IV-A. Not
modelled: release of the handle, a rotation between the axes of suit and door, magnetic
disturbance, and habits that persist across demonstrations.
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_env.doors.motion import end_angle
from gplfd_env.task.opening import DEMONSTRATED_ANGLE
from gplfd_env.validation.fields import Quantities, quantity
from gplfd_experiments.data.teacher import motion
from gplfd_experiments.data.teacher.forces import ForceConfig, hand_wrenches
from gplfd_experiments.data.teacher.motion import (
    DEMONSTRATED_RADII,
    MESSY,
    ROOM_RADII,
    TIDY,
    Habits,
    doors_like,
)
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.demonstrations.demonstration import Demonstration

__all__ = [
    "DEMONSTRATED_RADII",
    "MESSY",
    "ROOM_RADII",
    "TIDY",
    "ForceConfig",
    "Habits",
    "Teacher",
    "TeacherConfig",
    "doors_like",
    "standard_teacher",
]
_DEGREE: Final = math.radians(1.0)
_BEFORE_STOP: Final = _DEGREE  # A leaf without a hinge is opened so far [rad].


@dataclass(frozen=True, kw_only=True, slots=True)
class TeacherConfig(Quantities):
    """Motion of the synthetic human and measurement by the suit."""

    duration_mean: float = quantity(6.0, unit="s", low=0.5, high=60.0)
    """Mean duration of an opening."""
    duration_std: float = quantity(0.8, unit="s", low=0.0, high=20.0)
    """Standard deviation of the duration; no opening is shorter than half the mean."""
    angle_mean: float = quantity(DEMONSTRATED_ANGLE, unit="rad", low=0.1, high=2.5)
    """Mean final door angle."""
    angle_std: float = quantity(_DEGREE, unit="rad", low=0.0, high=0.5)
    """Standard deviation of the final door angle."""
    timing_std: float = quantity(0.25, low=0.0, high=1.0)
    """Unevenness of the timing, always forwards: standard deviation of the log of the
    local speed-up."""
    wobble_position_std: float = quantity(0.002, unit="m", low=0.0, high=1.0)
    wobble_rotation_std: float = quantity(_DEGREE, unit="rad", low=0.0, high=1.0)
    """Hand moving and turning on the bar: standard deviation per axis."""
    wobble_time: float = quantity(1.0, unit="s", low=0.05, high=60.0)
    """Correlation time of the wobble."""
    grasp_offset_std: float = quantity(0.01, unit="m", low=0.0, high=1.0)
    """Sensor's place on the hand relative to the bar, constant in a demonstration:
    standard deviation per axis."""
    vertical_drift_std: float = quantity(0.001, unit="m/s", low=0.0, high=1.0)
    """Suit's height drift: standard deviation of its rate."""
    sampling_rate: float = quantity(60.0, unit="Hz", low=10.0, high=1000.0)
    """Suit's sampling rate."""
    noise_position_std: float = quantity(0.001, unit="m", low=0.0, high=1.0)
    noise_rotation_std: float = quantity(0.3 * _DEGREE, unit="rad", low=0.0, high=1.0)
    """Suit's noise after its filters: standard deviation per axis."""
    noise_bandwidth: float = quantity(1.0, unit="Hz", low=0.1, high=500.0)
    """Cut-off frequency of the suit's noise. The sensor fusion follows its smooth
    gyroscopes at short times, and what remains is corrected over about a second."""


def standard_teacher() -> dict[str, float]:
    """Return the fields of the standard `TeacherConfig`."""
    return dataclasses.asdict(TeacherConfig())


@dataclass(frozen=True, slots=True)
class Teacher:
    """Demonstrates doors; without a `ForceConfig`, it records no forces."""

    config: TeacherConfig = TeacherConfig()
    habits: Habits = TIDY
    forces: ForceConfig | None = None

    def demonstrate(
        self, door: float | DoorConfig, rng: np.random.Generator
    ) -> Demonstration:
        """Open one door and return the recording of the suit.

        The door may be the radius of one with a bar [m]. The poses [m, rad] are in the
        task frame and relative to the first sample, rotations in door axes. No effect's
        draws depend on those of another.

        Raises:
            ValueError: No door has such a radius.
        """
        door = door if isinstance(door, DoorConfig) else DoorConfig(radius=door)
        motion_rng, timing_rng, hand_rng, suit_rng, habit_rng, press_rng = rng.spawn(6)
        config = self.config
        longer, further = motion_rng.standard_normal(2)
        opening = config.duration_mean + config.duration_std * float(longer)
        opening = max(opening, 0.5 * config.duration_mean)
        final_angle = config.angle_mean + config.angle_std * float(further)
        if door.motion != "hinged":
            final_angle = min(final_angle, end_angle(door) - _BEFORE_STOP)
        press = motion.draw_press(door, press_rng)
        lasting = motion.duration(press, opening)
        rate, tidy = config.sampling_rate, self.habits == TIDY
        if tidy:
            times = np.arange(math.ceil(lasting * rate) + 1) / rate
            clock, back = times / lasting, np.zeros(times.size)
        else:
            times, clock, back = motion.irregular_timing(
                self.habits, lasting, rate, habit_rng
            )
        progress = motion.uneven_timing(clock, config.timing_std, timing_rng)
        share, opened = motion.press_and_opening(progress, press, opening)
        angles = np.maximum(final_angle * motion.minimum_jerk(opened) - back, 0.0)
        turns = motion.handle_angles(press, share, angles)
        # The sensor on the hand is off the bar's centre and moves slightly on it.
        path = DoorGeometry.of(door).easy_hand_poses(angles, turns)
        handle = Rotation.from_rotvec(path[:, 3:])
        offset = config.grasp_offset_std * hand_rng.standard_normal(3)
        wobble = motion.smooth_functions(times, config.wobble_time, 6, hand_rng)
        slip = offset + config.wobble_position_std * wobble[:, :3]
        turn = Rotation.from_rotvec(config.wobble_rotation_std * wobble[:, 3:])
        positions, rotations = path[:, :3] + handle.apply(slip), handle * turn
        poses = self._measured(times, positions, rotations, suit_rng, origin=0)
        wrenches = None
        if self.forces is not None:
            (force_rng,) = press_rng.spawn(1)
            wrenches = hand_wrenches(
                self.forces, door, times, angles, turns, positions, force_rng
            )
        if tidy:
            return Demonstration(times=times, poses=poses, wrenches=wrenches)
        kept, poses = motion.lose_samples(self.habits, poses, habit_rng)
        wrenches = None if wrenches is None else wrenches[kept]
        return Demonstration(times=times[kept], poses=poses[kept], wrenches=wrenches)

    def demonstrate_doors(
        self,
        doors: Sequence[float | DoorConfig],
        per_door: int = 2,
        *,
        rng: np.random.Generator,
    ) -> tuple[Demonstration, ...]:
        """Open each door several times, in the given order of doors.

        More doors at the end or more demonstrations per door do not change the others.
        """
        if len(doors) == 0 or per_door < 1:
            raise ValueError(f"{len(doors)} doors, per_door = {per_door}: both from 1")
        return tuple(
            self.demonstrate(door, demonstration_rng)
            for door, door_rng in zip(doors, rng.spawn(len(doors)), strict=True)
            for demonstration_rng in door_rng.spawn(per_door)
        )

    def standard_demonstrations(
        self, per_door: int = 2, *, seed: int, like: DoorConfig | None = None
    ) -> tuple[Demonstration, ...]:
        """Return demonstrations at three doors of the kind of one, by default a bar."""
        doors = doors_like(DoorConfig() if like is None else like)
        return self.demonstrate_doors(doors, per_door, rng=np.random.default_rng(seed))

    def standard_reaches(
        self, per_door: int = 2, *, seed: int, doors: int = len(DEMONSTRATED_RADII)
    ) -> tuple[Demonstration, ...]:
        """Reach for the handles of a number of doors; openings draw the same."""
        *_, rng = np.random.default_rng(seed).spawn(doors + 1)
        return tuple(map(self.demonstrate_reach, rng.spawn(doors * per_door)))

    def demonstrate_reach(self, rng: np.random.Generator) -> Demonstration:
        """Reach for a handle, grasp it, and return the recording of the suit.

        Times [s] end at 0, and the poses [m, rad], door axes, are relative to the last
        sample, from which the recording of `demonstrate` continues.
        """
        motion_rng, suit_rng = rng.spawn(2)
        rate, uneven = self.config.sampling_rate, self.config.timing_std
        times, positions, rotations = motion.reach_motion(rate, uneven, motion_rng)
        poses = self._measured(times, positions, rotations, suit_rng, origin=-1)
        return Demonstration(times=times, poses=poses)

    def _measured(
        self,
        times: FloatArray,
        positions: FloatArray,
        rotations: Rotation,
        rng: np.random.Generator,
        *,
        origin: int,
    ) -> FloatArray:
        """Return the measurement of the suit, (N, 6) [m, rad], relative to a sample."""
        config = self.config
        drift_rate = config.vertical_drift_std * rng.standard_normal()
        noise = motion.coloured_noise(
            times.size, config.noise_bandwidth / config.sampling_rate, 6, rng
        )
        measured = positions + config.noise_position_std * noise[:, :3]
        measured[:, 1] += drift_rate * times
        error = Rotation.from_rotvec(config.noise_rotation_std * noise[:, 3:])
        turned = error * rotations
        relative = turned * turned[origin].inv()
        return np.hstack([measured - measured[origin], relative.as_rotvec()])
