"""How a robot of a URDF stands before a door: at a home posture of its arm."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final, get_args

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from gplfd_env.conventions.constants import Array, Base
from gplfd_env.doors.config import Swing
from gplfd_env.robot.config import HELD, Before, RobotConfig, Stance
from gplfd_env.robot.description import described_robot

_NEAR: Final = 0.45
"""Least distance of the grasped point from the arm's root, seen from above [m]."""

_LEVEL: Final = 0.45
"""Greatest height of the grasped point above or below the arm's root [m]."""

_TILT: Final = math.radians(30.0)
"""How far the approach at the home posture may be from level [rad]."""

Grasp = Callable[[Array], tuple[Array, Array]]
"""Position (3,) [m] and axes (3, 3) of the grasp frame from joint positions [rad], in
the base frame with the lift at zero."""


def at_home(robot: RobotConfig, home: Sequence[float] | None) -> RobotConfig:
    """Return a robot that stands before every door as at its home posture [rad].

    The posture holds a bar with a level approach; None for the best of seeded random
    ones. Raises a ValueError if it does not, or if MuJoCo cannot simulate the robot.
    """
    spec = described_robot(robot)
    try:
        model = spec.compile()
    except ValueError as error:
        raise ValueError(
            f"{robot.urdf}: MuJoCo cannot simulate it: {error}; every link that moves "
            "needs a mass and an inertia"
        ) from error
    data, tool = mujoco.MjData(model), model.body(robot.tool).id
    arm = [int(model.joint(name).qposadr[0]) for name in robot.arm]
    limits = np.array([model.joint(name).range for name in robot.arm])

    def grasp(posture: Array) -> tuple[Array, Array]:
        data.qpos[arm] = posture
        mujoco.mj_kinematics(model, data)
        axes = data.xmat[tool].reshape(3, 3)
        return data.xpos[tool] + axes @ robot.grasp_point, axes @ robot.grasp_axes

    posture = np.array(_found_home(grasp, limits) if home is None else home)
    if posture.shape != (len(robot.arm),) or not np.isfinite(posture).all():
        raise ValueError(
            f"home must be {len(robot.arm)} joint positions [rad], of "
            f"{', '.join(robot.arm)}; got {home!r}"
        )
    outside = (posture < limits[:, 0]) | (posture > limits[:, 1])
    if outside.any():
        name = robot.arm[int(np.argmax(outside))]
        raise ValueError(f"home is beyond the limits of {name}; got {home!r}")
    place, frame = grasp(posture)
    if abs(frame[2, 2]) > math.sin(_TILT):
        raise ValueError(
            "home must hold a bar with the approach level; it points "
            f"{math.degrees(math.asin(-frame[2, 2])):.0f}° upwards"
        )
    turned = posture.copy()
    # A lever is held with the last joint turned by a quarter, the way that is farther
    # from its limits.
    middle = limits[-1].mean()
    turned[-1] += math.copysign(math.pi / 2, middle - turned[-1])
    found, approach = [], frame[:, 2]
    for held in HELD:
        own = posture if held == "bar" else turned
        place, frame = grasp(own)
        if frame[:, 2] @ approach < math.cos(_TILT):
            continue  # The last joint does not roll the hand: it holds bars alone.
        stance = Stance(
            handle_xy_w=(float(place[0]), float(place[1])),
            door_yaw=math.atan2(-frame[1, 2], -frame[0, 2]),
            below_handle=float(place[2]),
            closed_posture=tuple(own.tolist()),
            roll=_roll(frame),
            radius=1.05,
            height=1.22,
        )
        found += [
            (Before(base, swing, held, side), stance)
            for base in get_args(Base)
            for swing in get_args(Swing)
            for side in ("right", "left")
        ]
    return replace(robot, stances=tuple(found))


def _roll(frame: Array) -> float:
    """Return the roll of a grasp frame in quarter turns, axes as columns [rad].

    Zero if the fingers close across an upright bar, the first to the right.
    """
    approach, up = -frame[:, 2], np.array([0.0, 0.0, 1.0])
    right = np.cross(approach, up)
    turn = math.atan2(-frame[:, 0] @ up, frame[:, 0] @ right)
    return round(turn / (math.pi / 2)) * (math.pi / 2)


def _found_home(grasp: Grasp, limits: Array) -> Array:
    """Return the best of random postures with a level approach away from the base.

    The best has the largest product of its distance to joint limits and of the least
    singular value of the hand's Jacobian. Raises a ValueError if none is level.
    """
    rng = np.random.default_rng(0)
    low, high = np.maximum(limits.T[0], -math.pi), np.minimum(limits.T[1], math.pi)
    best, posture = 0.0, None
    for share in rng.uniform(0.1, 0.9, size=(2000, len(limits))):
        tried = low + share * (high - low)
        place, frame = grasp(tried)
        out = np.hypot(*place[:2])
        ahead = -frame[:2, 2] @ place[:2] > 0.8 * out
        level = abs(frame[2, 2]) < 0.15 and abs(place[2]) < _LEVEL
        # The fingers close across an upright bar.
        if not (level and ahead and out > _NEAR and abs(frame[2, 0]) < math.sqrt(0.5)):
            continue
        columns = []
        for joint in range(len(limits)):
            moved, turned = grasp(tried + 1e-4 * (np.arange(len(limits)) == joint))
            turn = Rotation.from_matrix(turned @ frame.T).as_rotvec()
            columns.append(np.concatenate([moved - place, 0.3 * turn]) / 1e-4)
        strength = np.linalg.svd(np.array(columns), compute_uv=False)[5]
        score = float(strength * np.minimum(share, 1.0 - share).min())
        if score > best:
            best, posture = score, tried
    if posture is None:
        raise ValueError(
            "no posture was found that holds a bar before the robot; give home, the "
            "positions of the arm's joints [rad]"
        )
    return np.asarray(posture)
