"""Conversion of MuJoCo's sensors to observations and privileged readings.

Every number is sampled in the last physics step, 2 ms before ``time``, like the
readings of a real controller. Readings are numbers for one simulation, or arrays (n,).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, Final, NamedTuple

import mujoco
import numpy as np
from gymnasium import spaces

from gplfd_env.conventions.constants import GRIPPER_WIDTH, Array, Control
from gplfd_env.conventions.one_and_many import (
    Flag,
    Number,
    anywhere,
    atan2,
    cos,
    sin,
    sqrt,
    where,
)
from gplfd_env.doors.config import DoorConfig, Handle, Swing
from gplfd_env.doors.motion import LeafPath
from gplfd_env.robot.config import RobotConfig
from gplfd_env.robot.mobile_base import BASE_JOINTS
from gplfd_env.robot.model import WRENCH_LIMITS, Hold
from gplfd_env.scene.build import GRASP_KEY, build_scene
from gplfd_env.simulation.command import Command

Observation = dict[str, Array]
Triple = tuple[Number, Number, Number]
Wrench = tuple[Number, Number, Number, Number, Number, Number]
Values = Any
"""Sensor values: a list for one simulation, or an array (number, n)."""

# Range of the measured width [m], at whose ends the sensor saturates.
_WIDTHS: Final = (-0.01, GRIPPER_WIDTH + 0.01)
# Slice of a door's readings: whether right and left finger touch the handle.
_TOUCHING: Final = slice(17, 19)


def observation_space(
    command: Command, robot: RobotConfig
) -> spaces.Space[Observation]:
    """Return the observation space; units and frames in docs/environment.md."""

    def box(*blocks: tuple[float, int]) -> spaces.Box:
        high = np.concatenate([np.full(size, limit) for limit, size in blocks])
        return spaces.Box(-high, high, dtype=np.float64)

    # The wrist sensor saturates per sensor axis, and its weight compensation and the
    # shift of the moment to the hand add to that.
    force, torque = 2 * WRENCH_LIMITS[0], 2 * WRENCH_LIMITS[0] + 2 * WRENCH_LIMITS[1]
    entries: dict[str, spaces.Space[Any]] = {
        "ee_pose": box((3.0, 3), (np.pi, 3)),
        "ee_twist": box((1e4, 6)),
        "wrench": box((force, 3), (torque, 3)),
        "joint_pos": box((10.0, len(robot.arm))),
        "joint_vel": box((1e4, len(robot.arm))),
        "time": spaces.Box(0.0, 1e6, (1,), np.float64),
    }
    if command.drives:
        entries["base_pose"] = box((100.0, 2), (1e3, 1))
        entries["base_velocity"] = box((1e4, 3))
    if command.grips:
        entries["gripper_width"] = spaces.Box(*_WIDTHS, (1,), np.float64)
        entries["grasped"] = spaces.Box(0.0, 1.0, (1,), np.float64)
    space: spaces.Space[Any] = spaces.Dict(entries)
    return space


@dataclass(frozen=True, kw_only=True, slots=True)
class Sensors:
    """Converts a sensor array to the observation and to privileged readings.

    `hand` is the body carried by the wrist sensor. The slices give positions in the
    array: `wrist` is force, torque and the sensor's three axes; `door` goes from the
    hinge angle to the torque at its stop, followed by handle and bolt if there are any;
    `odometry` is pose and rate of a mobile base; `finger` is a movable finger. The
    torque at the hinge's own limit, at the index `hinge_end`, is added.
    """

    hand: Hand
    ee_pose: slice
    ee_twist: slice
    joint_pos: slice
    joint_vel: slice
    arm_limits: tuple[tuple[float, float], ...]
    wrist: slice
    door: slice
    odometry: slice | None
    hinge_end: int | None
    finger: slice | None

    @classmethod
    @cache
    def of(
        cls,
        grasp: Hold,
        control: Control,
        robot: RobotConfig,
        handle: Handle = "bar",
        swing: Swing = "pull",
        *,
        level: bool = False,
    ) -> Sensors:
        """Resolve sensor addresses and the hand's weight, the same for many doors."""
        door = DoorConfig(handle=handle, swing=swing)
        if level:
            door = DoorConfig(motion="flap", hinge_side="bottom")
        model = build_scene(door, grasp, control=control, robot=robot)
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, GRASP_KEY)
        mujoco.mj_forward(model, data)
        root, drives = model.body(robot.sensor).id, robot.base == "mobile"
        joints = len(robot.arm)
        sensor = data.site("wrist_ft")
        axes = sensor.xmat.reshape(3, 3)
        com = axes.T @ (data.subtree_com[root] - sensor.xpos)
        offset = axes.T @ (data.site("hand").xpos - sensor.xpos)
        weight = float(model.body_subtreemass[root] * -model.opt.gravity[2])
        return cls(
            hand=Hand(weight, tuple(com.tolist()), tuple(offset.tolist())),
            ee_pose=_span(model, "hand_x", 6),
            ee_twist=_span(model, "hand_linvel", 6),
            joint_pos=_span(model, f"{robot.arm[0]}_pos", joints),
            joint_vel=_span(model, f"{robot.arm[0]}_vel", joints),
            arm_limits=tuple(tuple(model.joint(x).range.tolist()) for x in robot.arm),
            wrist=_span(model, "wrist_force", 15),
            door=slice(int(model.sensor("hinge_angle").adr[0]), None),
            odometry=_span(model, f"{BASE_JOINTS[0]}_pos", 6) if drives else None,
            hinge_end=int(model.sensor("hinge_end").adr[0]) if drives else None,
            finger=_span(model, "finger", 1) if grasp == "gripper" else None,
        )

    def observation(
        self, sensordata: Array, wrench: Array, time: Array, command: Command
    ) -> Observation:
        """Return the observation of one or n simulations, as new arrays."""
        observation = {
            "ee_pose": sensordata[..., self.ee_pose].copy(),
            "ee_twist": sensordata[..., self.ee_twist].copy(),
            "wrench": wrench,
            "joint_pos": sensordata[..., self.joint_pos].copy(),
            "joint_vel": sensordata[..., self.joint_vel].copy(),
            "time": time,
        }
        if command.drives and self.odometry is not None:
            base = sensordata[..., self.odometry]
            observation["base_pose"] = base[..., :3].copy()
            observation["base_velocity"] = base[..., 3:].copy()
        if command.grips and self.finger is not None:
            touching = sensordata[..., self.door][..., _TOUCHING] > 0.0
            width = 2.0 * sensordata[..., self.finger]
            observation["gripper_width"] = width.clip(*_WIDTHS)
            observation["grasped"] = touching.all(axis=-1, keepdims=True).astype(float)
        return observation

    def wrench(self, values: Values) -> Wrench:
        """Return the wrench of the environment on the hand [N, N m].

        It is in the task frame, about the hand point, gravity compensated. MuJoCo
        reports the wrench f_s, τ_s of the wrist on the hand; at rest f_s + F + W = 0
        and τ_s + τ + c × W = 0, so F = -f_s - W and, about the hand point at o,
        τ = -τ_s - c × W - o × F.
        """
        fx, fy, fz, tx, ty, tz, *axes = values[self.wrist]
        ax, ay, az, bx, by, bz, cx, cy, cz = axes
        weight, com, offset = self.hand
        force_x = -(ax * fx + bx * fy + cx * fz)
        force_y = -(ay * fx + by * fy + cy * fz) + weight
        force_z = -(az * fx + bz * fy + cz * fz)
        px, py, pz = com
        com_x = ax * px + bx * py + cx * pz
        com_z = az * px + bz * py + cz * pz
        px, py, pz = offset
        arm_x = ax * px + bx * py + cx * pz
        arm_y = ay * px + by * py + cy * pz
        arm_z = az * px + bz * py + cz * pz
        torque_x = -(ax * tx + bx * ty + cx * tz) - com_z * weight
        torque_y = -(ay * tx + by * ty + cy * tz)
        torque_z = -(az * tx + bz * ty + cz * tz) + com_x * weight
        torque_x = torque_x - (arm_y * force_z - arm_z * force_y)
        torque_y = torque_y - (arm_z * force_x - arm_x * force_z)
        torque_z = torque_z - (arm_x * force_y - arm_y * force_x)
        return force_x, force_y, force_z, torque_x, torque_y, torque_z

    def door_reading(self, values: Values, path: LeafPath) -> DoorReading:
        """Return the privileged readings of door and grasp."""
        reading = values[self.door]
        angle, velocity, hx, hy, hz, ox, oy, oz = reading[:8]
        tx, ty, tz, ux, uy, uz, rx, ry, rz = reading[8:17]
        right, left, fx, fy, fz, limit, *turning = reading[17:]
        if self.hinge_end is not None:
            limit = limit + values[self.hinge_end]
        handle_angle, bolt = (*turning, 0.0, 0.0)[:2]
        normal = path.swing_sign * (tx * fx + ty * fy + tz * fz)
        vertical = ux * fx + uy * fy + uz * fz
        outwards = path.hinge_sign * (rx * fx + ry * fy + rz * fz)
        tangential, radial = path.split(angle, normal, outwards)
        return DoorReading(
            angle,
            velocity,
            (hx, hy, hz),
            (ox, oy, oz),
            Forces(tangential, vertical, radial),
            (right > 0.0) & (left > 0.0),
            ((tx, ty, tz), (ux, uy, uz), (rx, ry, rz)),
            # A closed door rests at the other end of the hinge's range.
            where(angle > 0.0, limit, 0.0),
            handle_angle,
            bolt,
        )


class Forces(NamedTuple):
    """Force of hand on handle [N]; the second is along the hinge of a flap."""

    tangential: Number
    vertical: Number
    radial: Number


class BaseState(NamedTuple):
    """Pose and rate of the base [m, rad], [m/s, rad/s]."""

    pose: Triple
    velocity: Triple


AT_REST: Final = BaseState((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


class DoorReading(NamedTuple):
    """Privileged readings of door and grasp."""

    angle: Number  # Opening angle [rad].
    velocity: Number  # Rate of the opening angle [rad/s].
    handle_position: Triple  # Position of the handle in the task frame [m].
    hand_on_handle: Triple  # Position of the hand in the handle's frame [m].
    forces: Forces
    grasped: Flag  # Both fingers touch the handle.
    axes: tuple[Triple, Triple, Triple]  # Axes of the moving frame, world frame.
    stop_torque: Number  # Torque of the leaf against a stop [N m].
    handle_angle: Number  # Angle of a handle that turns [rad]; else 0.
    bolt: Number  # Retraction of the bolt [m]; 0 without a latch.

    def handle_rotation(self, path: LeafPath) -> Triple:
        """Return the handle's rotation vector: its own turn, then the leaf's [rad]."""
        about_up = path.upright * self.angle
        turned = self.handle_angle != 0.0
        level = where(path.level != 0.0, path.level * self.angle, 0.0)
        if not anywhere(turned):
            return 0.0, about_up, level
        turn = -path.hinge_sign * self.handle_angle
        # Quaternion product: rotation about y times rotation about x.
        cy, sy = cos(0.5 * about_up), sin(0.5 * about_up)
        cx, sx = cos(0.5 * turn), sin(0.5 * turn)
        x, y, z = cy * sx, sy * cx, -sy * sx
        length = sqrt(x * x + y * y + z * z)
        nonzero = length > 0.0
        scale = 2.0 * atan2(length, cy * cx) / where(nonzero, length, 1.0)
        scale = where(nonzero, scale, 2.0)
        y = where(turned, scale * y, about_up)
        return where(turned, scale * x, 0.0), y, where(turned, scale * z, level)


class Hand(NamedTuple):
    """Weight [N] beyond the wrist sensor; centre of mass and hand point from it [m]."""

    weight: Number
    com: Triple
    offset: Triple


def _span(model: mujoco.MjModel, first: str, size: int) -> slice:
    """Return a slice of the sensor array that begins with a sensor."""
    start = int(model.sensor(first).adr[0])
    return slice(start, start + size)
