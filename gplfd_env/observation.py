"""From MuJoCo's sensor array to the observation: slices and a few scalar operations.

Every number is sampled by MuJoCo's sensors in the last physics step, 2 ms before
``time``, like the readings of a real controller.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from gplfd_env.placement import ARM_JOINTS
from gplfd_env.robot import HAND_BODIES, WRENCH_LIMITS
from gplfd_env.scene import GRASP_KEY

Array = NDArray[np.float64]
Observation = dict[str, Array]

_POSE_LIMIT: Final = (3.0, np.pi)
_TWIST_LIMIT: Final = (1.0e4, 1.0e4)
_JOINT_LIMITS: Final = (10.0, 1.0e4)
_TIME_LIMIT: Final = 1.0e6


def observation_space() -> spaces.Space[Observation]:
    """Return the observation space; units and frames in docs/environment.md."""

    def box(*blocks: tuple[float, int]) -> spaces.Box:
        high = np.concatenate([np.full(size, limit) for limit, size in blocks])
        return spaces.Box(-high, high, dtype=np.float64)

    # The wrist sensor saturates per sensor axis, and its weight compensation and the
    # shift of the moment to the hand add to that.
    force, torque = 2 * WRENCH_LIMITS[0], 2 * WRENCH_LIMITS[0] + 2 * WRENCH_LIMITS[1]
    space: spaces.Space[Any] = spaces.Dict(
        {
            "ee_pose": box((_POSE_LIMIT[0], 3), (_POSE_LIMIT[1], 3)),
            "ee_twist": box((_TWIST_LIMIT[0], 3), (_TWIST_LIMIT[1], 3)),
            "wrench": box((force, 3), (torque, 3)),
            "joint_pos": box((_JOINT_LIMITS[0], 7)),
            "joint_vel": box((_JOINT_LIMITS[1], 7)),
            "time": spaces.Box(0.0, _TIME_LIMIT, shape=(1,), dtype=np.float64),
        }
    )
    return space


@dataclass(frozen=True, kw_only=True, slots=True)
class Reader:
    """Turns a sensor array into the observation and into the privileged readings.

    Attributes:
        hand_weight: Weight of everything beyond the wrist sensor [N].
        hand_com: Its centre of mass from the wrist sensor, in the hand's axes [m].
        hand_offset: The hand point from the wrist sensor, in the hand's axes [m].
    """

    hand_weight: float
    hand_com: tuple[float, float, float]
    hand_offset: tuple[float, float, float]
    _ee_pose: slice
    _ee_twist: slice
    _joint_pos: slice
    _joint_vel: slice
    _wrist: slice
    _door: slice

    @classmethod
    def of(cls, model: mujoco.MjModel) -> Reader:
        """Resolve sensor addresses and the hand's weight, once per model."""
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, GRASP_KEY)
        mujoco.mj_forward(model, data)
        root = model.body(HAND_BODIES[0]).id
        sensor = data.site("wrist_ft")
        axes = sensor.xmat.reshape(3, 3)
        com = axes.T @ (data.subtree_com[root] - sensor.xpos)
        offset = axes.T @ (data.site("hand").xpos - sensor.xpos)
        return cls(
            hand_weight=float(model.body_subtreemass[root] * -model.opt.gravity[2]),
            hand_com=tuple(com.tolist()),
            hand_offset=tuple(offset.tolist()),
            _ee_pose=_span(model, "hand_x", "hand_rotvec"),
            _ee_twist=_span(model, "hand_linvel", "hand_angvel"),
            _joint_pos=_span(model, f"{ARM_JOINTS[0]}_pos", f"{ARM_JOINTS[-1]}_pos"),
            _joint_vel=_span(model, f"{ARM_JOINTS[0]}_vel", f"{ARM_JOINTS[-1]}_vel"),
            _wrist=_span(model, "wrist_force", "wrist_zaxis"),
            _door=_span(model, "hinge_angle", "bar_force"),
        )

    def observation(self, sensordata: Array, time: float) -> Observation:
        """Return the observation as fresh arrays.

        Args:
            sensordata: MuJoCo's ``data.sensordata``.
            time: Time since the reset [s].
        """
        return {
            "ee_pose": sensordata[self._ee_pose].copy(),
            "ee_twist": sensordata[self._ee_twist].copy(),
            "wrench": self.wrench(sensordata),
            "joint_pos": sensordata[self._joint_pos].copy(),
            "joint_vel": sensordata[self._joint_vel].copy(),
            "time": np.array([time]),
        }

    def wrench(self, sensordata: Array) -> Array:
        """Return the wrench of the environment on the hand, (6,) [N, N m].

        Task frame, moment about the hand point, gravity compensated. MuJoCo reports
        what the wrist exerts on the hand, f_s and τ_s; at rest f_s + F + W = 0 and
        τ_s + τ + c × W = 0, so F = -f_s - W and, about the hand point at o,
        τ = -τ_s - c × W - o × F.
        """
        # Scalars instead of arrays: at this size NumPy's overhead is ten times the
        # arithmetic, and the same operations vectorise bit for bit.
        fx, fy, fz, tx, ty, tz, *axes = sensordata[self._wrist].tolist()
        ax, ay, az, bx, by, bz, cx, cy, cz = axes
        weight = self.hand_weight
        force_x = -(ax * fx + bx * fy + cx * fz)
        force_y = -(ay * fx + by * fy + cy * fz) + weight
        force_z = -(az * fx + bz * fy + cz * fz)
        px, py, pz = self.hand_com
        com_x = ax * px + bx * py + cx * pz
        com_z = az * px + bz * py + cz * pz
        px, py, pz = self.hand_offset
        arm_x = ax * px + bx * py + cx * pz
        arm_y = ay * px + by * py + cy * pz
        arm_z = az * px + bz * py + cz * pz
        torque_x = -(ax * tx + bx * ty + cx * tz) - com_z * weight
        torque_y = -(ay * tx + by * ty + cy * tz)
        torque_z = -(az * tx + bz * ty + cz * tz) + com_x * weight
        return np.array(
            [
                force_x,
                force_y,
                force_z,
                torque_x - (arm_y * force_z - arm_z * force_y),
                torque_y - (arm_z * force_x - arm_x * force_z),
                torque_z - (arm_x * force_y - arm_y * force_x),
            ]
        )

    def door(self, sensordata: Array) -> DoorReading:
        """Return the privileged readings of door and grasp."""
        reading = sensordata[self._door].tolist()
        angle, velocity, hx, hy, hz, ox, oy, oz = reading[:8]
        tx, ty, tz, ux, uy, uz, rx, ry, rz = reading[8:17]
        right, left, fx, fy, fz = reading[17:]
        return DoorReading(
            angle=angle,
            velocity=velocity,
            handle_pose=(hx, hy, hz, 0.0, angle, 0.0),
            hand_on_handle=(ox, oy, oz),
            force_tangential=tx * fx + ty * fy + tz * fz,
            force_vertical=ux * fx + uy * fy + uz * fz,
            force_radial=rx * fx + ry * fy + rz * fz,
            grasped=right > 0.0 and left > 0.0,
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class DoorReading:
    """What a perfect observer of the door would know.

    Attributes:
        angle: Opening angle [rad].
        velocity: Its rate [rad/s].
        handle_pose: The handle's pose in the task frame [m, rad].
        hand_on_handle: The hand point in the handle's frame [m].
        force_tangential: Force of the hand on the bar along the opening motion [N].
        force_vertical: The same, upwards [N].
        force_radial: The same, away from the hinge [N].
        grasped: Both finger pads touch the bar.
    """

    angle: float
    velocity: float
    handle_pose: tuple[float, float, float, float, float, float]
    hand_on_handle: tuple[float, float, float]
    force_tangential: float
    force_vertical: float
    force_radial: float
    grasped: bool


def _span(model: mujoco.MjModel, first: str, last: str) -> slice:
    """Return the stretch of the sensor array from one sensor to another."""
    start, end = model.sensor(first), model.sensor(last)
    return slice(int(start.adr[0]), int(end.adr[0] + end.dim[0]))
