"""Where an arm stands before a door, and the posture in which it holds the handle.

One deterministic search: places of the closed handle, headings of door and hand, and
postures to start from are spread evenly (Sobol); damped least squares within the joint
limits bring the hand to the handle and along the whole motion; of those that follow it,
the one is taken whose least product of distance from a limit and of manipulability is
greatest. The kinematics are a product of exponentials, computed for all tries at once.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Final, NamedTuple

import mujoco
import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation
from scipy.stats import qmc

from gplfd_env.conventions.constants import Array, Mask
from gplfd_env.doors.config import DoorConfig
from gplfd_env.robot.config import BASE_RADIUS, RobotConfig, Stance, StanceGroup
from gplfd_env.robot.description import described_robot

_TRIES: Final = 12
"""Logarithm to base 2 of the number of tries."""

_OPENED: Final = math.radians(72.0)
"""How far the arm follows the handle of an opening door [rad]."""

_ENOUGH: Final = 14
"""Number of its 16 moments that suffice if no arm follows all: up to 62°."""

_RADII: Final = (0.5, 0.65, 0.35)
"""Distances from the hinge that a stance serves, the first one in any case [m]."""

_HEIGHTS: Final = (0.85, 0.5, 1.22)
"""Height of the handle with a fixed base; least and greatest with a mobile one [m]."""

_MARGIN: Final = 0.06
"""Least distance from a joint limit in the search [rad]."""

_CLOSE: Final = 1e-3
"""Greatest error of a pose that counts as reached [m, rad]."""

UPRIGHT: Final = 2.0
"""How far the task frame's y may be from upright in the base frame [°]."""


def tilt_of(rotvec: Array) -> float:
    """Return the angle between up and y of a frame [°]."""
    up = Rotation.from_rotvec(rotvec).as_matrix()[2, 1]
    return float(np.degrees(np.arccos(np.clip(up, -1.0, 1.0))))


class _Chain(NamedTuple):
    """An arm with the lift at zero: screws of its joints in the zero posture."""

    names: tuple[str, ...]
    axes: Array  # (n, 3)
    anchors: Array  # (n, 3) [m]
    place: Array  # Grasped point (3,) [m].
    frame: Array  # Axes of the grasp frame (3, 3).
    low: Array  # Limits (n,) [rad].
    high: Array
    lift: tuple[float, float]  # Range of the lift [m].

    @classmethod
    def of(cls, robot: RobotConfig) -> "_Chain":
        model = described_robot(robot).compile()
        data = mujoco.MjData(model)
        data.qpos[:] = 0.0
        mujoco.mj_kinematics(model, data)
        joints = [model.joint(name).id for name in robot.arm]
        axes = data.body(robot.tool).xmat.reshape(3, 3)
        low, high = model.jnt_range[joints].T
        # A joint without limits need not turn by more than half a turn.
        wide = (low < -math.pi) & (high > math.pi)
        return cls(
            robot.arm,
            data.xaxis[joints],
            data.xanchor[joints],
            data.body(robot.tool).xpos + axes @ robot.grasp_point,
            axes @ robot.grasp_axes,
            np.where(wide, -math.pi, low),
            np.where(wide, math.pi, high),
            tuple(model.joint(robot.lift).range.tolist()),
        )

    def hand(self, postures: Array) -> tuple[Array, Array, Array]:
        """Return places (B, 3), frames (B, 3, 3), Jacobians (B, 6, n) of the hand."""
        turn, shift = np.tile(np.eye(3), (len(postures), 1, 1)), 0.0
        axes, anchors = [], []
        for angles, axis, anchor in zip(
            postures.T, self.axes, self.anchors, strict=True
        ):
            axes.append(turn @ axis)
            anchors.append(turn @ anchor + shift)
            turn = turn @ Rotation.from_rotvec(angles[:, None] * axis).as_matrix()
            shift = anchors[-1] - turn @ anchor
        places = turn @ self.place + shift
        around, at = np.stack(axes, 1), np.stack(anchors, 1)
        columns = [np.cross(around, places[:, None] - at), around]
        return places, turn @ self.frame, np.concatenate(columns, 2).swapaxes(1, 2)

    def reached(
        self, postures: Array, places: Array, frames: Array, steps: int
    ) -> tuple[Array, Array, Array]:
        """Bring hands to poses; return postures, errors (B, 6), manipulability (B,).

        The last is the least singular value of the Jacobian, with a lever of 0.3 m
        for rotations [m/rad].
        """
        low, high = self.low + _MARGIN, self.high - _MARGIN
        for step in range(steps + 1):
            at, axes, jacobian = self.hand(postures)
            turns = Rotation.from_matrix(frames @ axes.swapaxes(1, 2)).as_rotvec()
            errors = np.concatenate([places - at, turns], 1)
            if step == steps or np.abs(errors).max() < _CLOSE / 10:
                break
            transposed = jacobian.swapaxes(1, 2)
            damped = jacobian @ transposed + 1e-4 * np.eye(6)
            pull = np.linalg.solve(damped, np.clip(errors, -0.2, 0.2)[..., None])
            postures = np.clip(postures + (transposed @ pull)[..., 0], low, high)
        scaled = jacobian * np.array([1, 1, 1, 0.3, 0.3, 0.3])[:, None]
        strength = np.linalg.svd(scaled, compute_uv=False)[:, -1]
        return postures, errors, strength

    def follow(
        self,
        tries: "_Tries",
        path: Array,
        what: Sequence[str],
        enough: int = 99,
    ) -> tuple[npt.NDArray[np.intp], Array]:
        """Follow a path of the hand in the task frame, (T, 6) [m, rad].

        Returns the indices of the tries that follow it, or at least `enough` poses of
        it if none follows all, and their scores. Raises a
        ValueError that says where and why all others fail if there is none.
        """
        rows, postures = np.arange(len(tries.yaws), dtype=np.intp), tries.postures
        scores = np.full(len(rows), np.inf)
        for number, (pose, moment) in enumerate(zip(path, what, strict=True)):
            places, frames = tries.poses(pose)
            if number == 0:
                # The hands that are near after some steps can reach the handle.
                postures, errors, _ = self.reached(postures, places, frames, 12)
                rows = np.linalg.norm(errors, axis=1).argsort(kind="stable")[:1024]
                postures, scores = postures[rows], scores[rows]
            tried, errors, strength = self.reached(
                postures, places[rows], frames[rows], 40 if number == 0 else 12
            )
            good = np.abs(errors).max(1) < _CLOSE
            if not good.any() and number >= enough:
                break
            if not good.any():
                row = int(np.linalg.norm(errors, axis=1).argmin())
                away, turn = np.split(errors[row], 2)
                raise ValueError(
                    f"{self._hindrance(tried[row])} {moment}, where the hand stays "
                    f"{away.round(2).tolist()} m of the base's axes and "
                    f"{math.degrees(np.linalg.norm(turn)):.0f}° away"
                )
            margin = np.minimum(tried - self.low, self.high - tried).min(1)
            score = np.minimum(margin, 0.5) * np.minimum(strength, 0.15)
            rows, postures = rows[good], tried[good]
            scores = np.minimum(scores, score)[good]
            if number == 0:
                tries.postures[rows] = postures
        return rows, scores

    def _hindrance(self, posture: Array) -> str:
        ends = np.minimum(posture - self.low, self.high - posture) < 1.01 * _MARGIN
        names = [name for name, end in zip(self.names, ends, strict=True) if end]
        if not names:
            return "the arm is too short"
        return f"{' and '.join(names)} {'is' if len(names) == 1 else 'are'} at a limit"


class _Tries(NamedTuple):
    """Places and postures to try; handles in the base frame with the lift at zero."""

    handles: Array  # (B, 3) [m]
    yaws: Array  # Heading into the door (B,) [rad].
    grasp_yaws: Array  # Yaw of the hand on the handle (B,) [rad].
    rolls: Array  # (B,) [rad]
    postures: Array  # (B, n) [rad]

    def poses(self, pose: Array) -> tuple[Array, Array]:
        """Return places (B, 3) and grasp frames (B, 3, 3) at a pose in the task frame.

        The frames are those of `gplfd_env.robot.placement`.
        """
        zero, one = np.zeros_like(self.yaws), np.ones_like(self.yaws)
        up = np.stack([zero, zero, one], 1)
        pull = -np.stack([np.cos(self.yaws), np.sin(self.yaws), zero], 1)
        task = np.stack([pull, up, np.cross(pull, up)], 2)
        heading = self.yaws + self.grasp_yaws
        ahead = np.stack([np.cos(heading), np.sin(heading), zero], 1)
        roll = Rotation.from_rotvec(self.rolls[:, None] * ahead).as_matrix()
        held = roll @ np.stack([np.cross(ahead, up), up, -ahead], 2)
        turn = task @ Rotation.from_rotvec(pose[3:]).as_matrix() @ task.swapaxes(1, 2)
        return self.handles + task @ pose[:3], turn @ held

    def stance(self, row: int, radius: float, height: float) -> Stance:
        """Return a try as a stance."""
        x, y, z = self.handles[row].tolist()
        return Stance(
            handle_xy_w=(x, y),
            door_yaw=float(self.yaws[row]),
            grasp_yaw=float(self.grasp_yaws[row]),
            roll=float(self.rolls[row]),
            below_handle=z,
            closed_posture=tuple(self.postures[row].tolist()),
            radius=radius,
            height=height,
        )


def _spread(chain: _Chain, group: StanceGroup) -> _Tries:
    """Return tries that are spread over the places that the arm may reach."""
    points = qmc.Sobol(6 + len(chain.names), scramble=False).random_base2(_TRIES).T
    x, y, z = chain.anchors[0]
    links = np.diff([*chain.anchors, chain.place], axis=0)
    reach = float(np.linalg.norm(links, axis=1).sum())
    lowest, highest = chain.lift
    middle, least, most = _HEIGHTS
    bounds = (middle - highest, middle - lowest)
    if group.base == "mobile":
        bounds = (most - highest, least - lowest)
    low, high = max(z - 0.5 * reach, bounds[0]), min(z + 0.6 * reach, bounds[1])
    bearing = (2.0 * points[0] - 1.0) * 2.0
    away = (0.2 + 0.7 * points[1]) * reach
    handles = [
        x + away * np.cos(bearing),
        y + away * np.sin(bearing),
        low + points[2] * (high - low),
    ]
    bar = group.held == "bar"
    flipped = (points[5] < 0.5) * math.pi
    return _Tries(
        handles=np.stack(handles, 1),
        yaws=bearing + (2.0 * points[3] - 1.0) * 1.3,
        grasp_yaws=(2.0 * points[4] - 1.0) * (0.7 if bar else 0.0),
        rolls=flipped if bar else flipped - math.pi / 2,
        postures=chain.low + points[6:].T * (chain.high - chain.low),
    )


def _clear(tries: _Tries, group: StanceGroup, radius: float) -> Mask:
    """Return whether the base is clear of the closed door and of the opening leaf."""
    cosine, sine = np.cos(tries.yaws), np.sin(tries.yaws)
    x, y = tries.handles[:, :2].T
    # The base in the task frame: in front of the door, and to the left.
    ahead, left = cosine * x + sine * y, sine * x - cosine * y
    clear: Mask = ahead > BASE_RADIUS
    if group.swing == "pull":
        away = left + radius if group.hinge_side == "right" else radius - left
        for angle in np.linspace(0.0, _OPENED, 10):
            along = ahead * math.sin(angle) + away * math.cos(angle)
            along = np.clip(along, 0.0, radius + 0.07)
            from_leaf = np.hypot(
                ahead - along * math.sin(angle), away - along * math.cos(angle)
            )
            clear &= from_leaf > BASE_RADIUS
    return clear


def _opening(group: StanceGroup, radius: float) -> tuple[Array, list[str]]:
    """Return the path of the hand as a door opens, and names of its moments."""
    side = -1.0 if group.hinge_side == "left" else 1.0
    way = 1.0 if group.swing == "pull" else -1.0
    angles = np.linspace(0.0, _OPENED, 16)
    path = np.zeros((len(angles), 6))
    path[:, 0] = way * radius * np.sin(angles)
    path[:, 2] = -side * radius * (1.0 - np.cos(angles))
    path[:, 4] = side * way * angles
    names = [f"at {a:.0f}° of a door of {radius:g} m" for a in np.degrees(angles)]
    return path, ["at the closed handle", *names[1:]]


def at_frame(
    robot: RobotConfig, door: DoorConfig, task: Array, path: Array, times: Array
) -> RobotConfig:
    """Return a robot with a fixed base, placed so that the task frame has a pose.

    The posture and the yaw of the hand on the handle are searched. On a stand the base
    frame is that of the arm's root link, and the lift is computed; otherwise it is the
    frame of the robot's root.

    Args:
        robot: The robot.
        door: The closed door; for a robot without a stand, its handle is as high as the
            task frame.
        task: Pose of the task frame in the base frame, (6,) [m, rad].
        path: Poses of the hand in the task frame that must be reached, (T, 6) [m, rad].
        times: Times of the poses, (T,) [s], for messages.

    Raises:
        ValueError: y of the task frame is not upright, or the lift or the arm does not
            reach.
    """
    place, axes = np.array(task[:3]), Rotation.from_rotvec(task[3:]).as_matrix()
    if not (np.isfinite(place).all() and tilt_of(task[3:]) <= UPRIGHT):
        raise ValueError(
            "the task frame must be finite, and its y upright in the base frame to "
            f"{UPRIGHT:.0f}°; it points to {axes[:, 1].tolist()}"
        )
    robot = robot.on("fixed")
    group, chain = StanceGroup.of(door, "fixed"), _Chain.of(robot)
    lowest, highest = chain.lift
    if robot.stand:
        lift = door.handle_height - place[2]
        if not lowest <= lift <= highest:
            raise ValueError(
                f"the task frame is {place[2]:.2f} m above the base and the handle "
                f"{door.handle_height:g} m above the floor, but the stand lifts the "
                f"base from {lowest:g} to {highest:g} m; give a door with another "
                "handle_height"
            )
    else:
        usual = robot.stance(door).below_handle
        place[2] -= min(max(place[2] - usual, lowest), highest)
    tries = _spread(chain, group)
    tries = tries._replace(
        handles=np.tile(place, (len(tries.yaws), 1)),
        yaws=np.full_like(tries.yaws, math.atan2(-axes[1, 0], -axes[0, 0])),
    )
    try:
        moments = [f"at {time:.2f} s" for time in times]
        rows, scores = chain.follow(tries, path, moments)
    except ValueError as error:
        raise ValueError(
            f"the arm of {robot.name} does not reach the path with the handle at "
            f"{np.round(task[:3], 3).tolist()} m in the base frame: {error}; move the "
            "base by that, and give the pose of the task frame from there"
        ) from None
    stance = tries.stance(int(rows[scores.argmax()]), math.inf, math.inf)
    return replace(robot, stances=((group, stance),))


@lru_cache(maxsize=64)
def searched_stance(robot: RobotConfig, group: StanceGroup) -> Stance:
    """Return the best stance of a robot for a group of doors.

    With a fixed base the arm follows the whole opening; with a mobile one, which
    follows the hand, it turns the hand by 30° to both sides. Raises a ValueError if
    there is no such stance.
    """
    chain = _Chain.of(robot)
    tries = _spread(chain, group)
    top = _HEIGHTS[2]
    try:
        if group.base == "mobile":
            turned = np.zeros((7, 6))
            turned[:, 4] = [0.0, 0.25, 0.5, 0.25, 0.0, -0.25, -0.5]
            rows, scores = chain.follow(tries, turned, ["at the handle"] * 7)
            return tries.stance(int(rows[scores.argmax()]), 1.05, top)
        first, *others = _RADII
        kept = np.flatnonzero(_clear(tries, group, max(_RADII)))
        tries = _Tries(*(values[kept] for values in tries))
        rows, scores = chain.follow(tries, *_opening(group, first), _ENOUGH)
    except ValueError as error:
        raise ValueError(
            f"no stance was found in which the arm of {robot.name} opens a door with "
            f"handle={group.held!r}, swing={group.swing!r}, "
            f"hinge_side={group.hinge_side!r} on a {group.base} base: {error}; in a "
            ".json give home, joint positions that hold the handle, or another tool"
        ) from None
    radius = first
    for other in others:
        few = _Tries(*(values[rows] for values in tries))
        try:
            also, more = chain.follow(few, *_opening(group, other), _ENOUGH)
        except ValueError:
            continue
        rows, scores = rows[also], np.minimum(scores[also], more)
        radius = max(radius, other)
    best = int(rows[scores.argmax()])
    height = min(top, float(tries.handles[best, 2]) + chain.lift[1])
    return tries.stance(best, radius, height)
