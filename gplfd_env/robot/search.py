"""Where an arm stands before a door, and the posture in which it holds the handle.

Places of the closed handle, headings of door and hand, and postures are drawn evenly
(Sobol), then in rounds ever closer around the best ones. Damped least squares within
the joint limits bring the hand to the handle and along the whole motion. As in the
simulation, joints of little inertia and damping turn most. The best try follows the
whole motion, and its least product of distance from a limit and of manipulability is
greatest. The kinematics are products of exponentials, computed for all tries at once.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, Final, NamedTuple

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from gplfd_env.conventions.constants import Array, Mask
from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.hardware import GRAVITY
from gplfd_env.robot.config import BASE_RADIUS, RobotConfig, Stance, StanceGroup
from gplfd_env.robot.description import described_robot
from gplfd_env.spatial.se3 import handle_pose_on_arc

_TRIES: Final = 11  # Logarithm to base 2 of the number of tries in the first round.
# Spread of the tries of later rounds, as a share of the ranges.
_SPREADS: Final = (*np.geomspace(0.2, 0.012, 9), 0.0)
# Best tries of a round, and tries of the next round around each of them.
_BEST: Final = 16
_AROUND: Final = 16
# Share of the greatest quality that an opening needs, and at which a search ends early.
_QUALITY: Final = (0.15, 0.7)
_OPENED: Final = np.radians(np.linspace(0.0, 68.0, 16))  # What an arm follows [rad].
# Distances from the hinge that a stance may serve, the best one first [m].
_RADII: Final = (0.65, 0.5, 0.35)
# Height of the handle with a fixed base; least and greatest with a mobile one [m].
_HEIGHTS: Final = (0.85, 0.5, 1.22)
_MARGIN: Final = 0.03  # Least distance from a joint limit in the search [rad].
_CLOSE: Final = 1e-3  # Greatest error of a pose that counts as reached [m, rad].
_LOAD: Final = 0.75  # Greatest torque of the weight, as a share of the joint's limit.

UPRIGHT: Final = 2.0
"""How far the task frame's y may be from upright in the base frame [°]."""


def tilt_of(rotvec: Array) -> float:
    """Return the angle between up and y of a frame [°]."""
    up = Rotation.from_rotvec(rotvec).as_matrix()[2, 1]
    return float(np.degrees(np.arccos(np.clip(up, -1.0, 1.0))))


class _Arm(NamedTuple):
    """An arm with the lift at zero: screws of its joints in the zero posture."""

    axes: Array  # (n, 3)
    anchors: Array  # (n, 3) [m]
    place: Array  # Grasped point (3,) [m].
    frame: Array  # Axes of the grasp frame (3, 3).
    low: Array  # Limits (n,) [rad].
    high: Array
    mobility: Array  # Inverse of inertia, damping and friction in 4 s (n,).
    masses: Array  # Of the links, each with what is fixed to it (n,) [kg].
    moments: Array  # These times their centres (n, 3) [kg m].
    efforts: Array  # Limits (n,) [N m].
    lift: Array  # Range of the lift (2,) [m].

    @classmethod
    @lru_cache(maxsize=8)
    def of(cls, robot: RobotConfig) -> "_Arm":
        model = described_robot(robot).compile()
        data = mujoco.MjData(model)
        data.qpos[:] = 0.0
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        joints = [model.joint(name).id for name in robot.arm]
        moved, axes = model.jnt_dofadr[joints], data.body(robot.tool).xmat.reshape(3, 3)
        low, high = model.jnt_range[joints].T
        # A joint without limits need not turn by more than half a turn.
        wide = (low < -math.pi) & (high > math.pi)
        bodies = model.jnt_bodyid[joints]
        beyond = model.body_subtreemass[bodies]
        moments = beyond[:, None] * data.subtree_com[bodies]
        # An opening takes seconds: damping and dry friction count more than inertia.
        damping, friction = model.dof_damping[moved], model.dof_frictionloss[moved]
        inertia = model.dof_M0[moved] + robot.armature + 4.0 * damping + 16.0 * friction
        return cls(
            data.xaxis[joints],
            data.xanchor[joints],
            data.body(robot.tool).xpos + axes @ robot.grasp_point,
            axes @ robot.grasp_axes,
            np.where(wide, -math.pi, low),
            np.where(wide, math.pi, high),
            1.0 / inertia,
            -np.diff(beyond, append=0.0),
            -np.diff(moments, axis=0, append=np.zeros((1, 3))),
            model.jnt_actfrcrange[joints, 1],
            model.joint(robot.lift).range,
        )

    def hand(self, postures: Array) -> tuple[Array, Array, Array, Array]:
        """Return places (B, 3), frames (B, 3, 3), Jacobians (B, 6, n), loads (B, n).

        A load is the torque of the weight as a share of the joint's limit.
        """
        turn, shift = np.tile(np.eye(3), (len(postures), 1, 1)), np.zeros(3)
        axes, anchors, moments = [], [], []
        for joint, angles in enumerate(postures.T):
            axes.append(turn @ self.axes[joint])
            anchors.append(turn @ self.anchors[joint] + shift)
            rotvecs = angles[:, None] * self.axes[joint]
            turn = turn @ Rotation.from_rotvec(rotvecs).as_matrix()
            shift = anchors[-1] - turn @ self.anchors[joint]
            moments.append(turn @ self.moments[joint] + self.masses[joint] * shift)
        places = turn @ self.place + shift
        around, at = np.stack(axes, 1), np.stack(anchors, 1)
        columns = [np.cross(around, places[:, None] - at), around]
        beyond = np.cumsum(self.masses[::-1])[::-1, None]
        levers = np.cumsum(np.stack(moments, 1)[:, ::-1], 1)[:, ::-1] - beyond * at
        x, y, _ = np.moveaxis(GRAVITY * levers, 2, 0)
        loads = np.abs(around[..., 1] * x - around[..., 0] * y) / self.efforts
        jacobians = np.concatenate(columns, 2).swapaxes(1, 2)
        return places, turn @ self.frame, jacobians, loads

    def reach(
        self, postures: Array, places: Array, frames: Array, steps: int
    ) -> tuple[Array, Array, Array]:
        """Bring hands to poses; return postures, greatest errors, qualities (B,).

        A quality, from 0 to 1, is the product of three shares: of 0.5 rad, the distance
        from the nearest joint limit; of 0.15 m/rad, the least singular value of the
        Jacobian, with a lever of 0.3 m for rotations; of half the joints' efforts, what
        the weight leaves. A load above `_LOAD` counts as an error.
        """
        low, high = self.low + _MARGIN, self.high - _MARGIN
        for step in range(steps + 1):
            at, axes, jacobian, loads = self.hand(postures)
            turns = Rotation.from_matrix(frames @ axes.swapaxes(1, 2)).as_rotvec()
            errors = np.concatenate([places - at, turns], 1)
            if step == steps or np.abs(errors).max() < _CLOSE / 10:
                break
            pulled = self.mobility[:, None] * jacobian.swapaxes(1, 2)
            damped = jacobian @ pulled + 1e-4 * self.mobility.mean() * np.eye(6)
            pull = np.linalg.solve(damped, np.clip(errors, -0.2, 0.2)[..., None])
            postures = np.clip(postures + (pulled @ pull)[..., 0], low, high)
        scaled = jacobian * np.array([1, 1, 1, 0.3, 0.3, 0.3])[:, None]
        most = loads.max(1)
        strengths = np.linalg.svd(scaled, compute_uv=False)[:, -1]
        ends = np.minimum(postures - self.low, self.high - postures).min(1)
        shares = np.array([ends / 0.5, strengths / 0.15, (1.0 - most) / 0.5])
        missed = np.abs(errors).max(1) + np.maximum(most - _LOAD, 0.0)
        return postures, missed, shares.clip(0.0, 1.0).prod(0)


class _Tries(NamedTuple):
    """Places and postures to try; handles in the base frame with the lift at zero."""

    handles: Array  # (B, 3) [m]
    yaws: Array  # Heading into the door (B,) [rad].
    grasp_yaws: Array  # Yaw of the hand on the handle (B,) [rad].
    rolls: Array  # (B,) [rad]
    postures: Array  # (B, n) [rad]

    @classmethod
    def spread(cls, arm: _Arm, group: StanceGroup, points: Array) -> "_Tries":
        """Return tries for points of the unit cube, (B, 6 + n)."""
        (x, y, z), shares, (lowest, highest) = arm.anchors[0], points.T, arm.lift
        links = np.diff([*arm.anchors, arm.place], axis=0)
        reach = float(np.linalg.norm(links, axis=1).sum())
        middle, least, most = _HEIGHTS
        bounds = (middle - highest, middle - lowest)
        if group.base == "mobile":
            bounds = (most - highest, least - lowest)
        low, high = max(z - 0.5 * reach, bounds[0]), min(z + 0.6 * reach, bounds[1])
        bearing, away = 4.0 * shares[0] - 2.0, (0.2 + 0.7 * shares[1]) * reach
        places = x + away * np.cos(bearing), y + away * np.sin(bearing)
        bar, flipped = group.held == "bar", (shares[5] < 0.5) * math.pi
        return cls(
            handles=np.stack([*places, low + shares[2] * (high - low)], 1),
            yaws=bearing + (2.0 * shares[3] - 1.0) * 1.3,
            grasp_yaws=(2.0 * shares[4] - 1.0) * (1.2 if bar else 0.0),
            rolls=flipped if bar else flipped - math.pi / 2,
            postures=arm.low + shares[6:].T * (arm.high - arm.low),
        )

    def poses(self, pose: Array) -> tuple[Array, Array]:
        """Return places (B, 3) and grasp frames (B, 3, 3) at a pose in the task frame.

        The frames are those of `gplfd_env.robot.placement`.
        """
        zero, up = np.zeros_like(self.yaws), np.tile([0.0, 0.0, 1.0], (len(self[0]), 1))
        pull = -np.stack([np.cos(self.yaws), np.sin(self.yaws), zero], 1)
        task = np.stack([pull, up, np.cross(pull, up)], 2)
        heading = self.yaws + self.grasp_yaws
        ahead = np.stack([np.cos(heading), np.sin(heading), zero], 1)
        roll = Rotation.from_rotvec(self.rolls[:, None] * ahead).as_matrix()
        held = roll @ np.stack([np.cross(ahead, up), up, -ahead], 2)
        turn = task @ Rotation.from_rotvec(pose[3:]).as_matrix() @ task.swapaxes(1, 2)
        return self.handles + task @ pose[:3], turn @ held

    def clear(self, group: StanceGroup, radius: float) -> Mask:
        """Return whether the base is clear of the closed door and the opening leaf."""
        cosine, sine = np.cos(self.yaws), np.sin(self.yaws)
        x, y = self.handles[:, :2].T
        # The base in the task frame: in front of the door, and away from the hinge.
        ahead, left = cosine * x + sine * y, sine * x - cosine * y
        if group.base == "mobile":  # It keeps its distance from the leaf.
            return np.asarray(ahead > BASE_RADIUS + 0.1)
        clear: Mask = ahead > BASE_RADIUS
        away = left + radius if group.hinge_side == "right" else radius - left
        for angle in _OPENED if group.swing == "pull" else ():
            along = ahead * math.sin(angle) + away * math.cos(angle)
            along = np.clip(along, 0.0, radius + 0.07)
            x, y = ahead - along * math.sin(angle), away - along * math.cos(angle)
            clear &= np.hypot(x, y) > BASE_RADIUS
        return clear

    def follow(self, arm: _Arm, path: Array) -> tuple[Array, Array, Array]:
        """Let the hands follow a path in the task frame, (T, 6) [m, rad].

        Returns scores (B,), first and last postures (B, n) [rad]. A score is the number
        of poses that are reached; its fraction is the least quality, or the nearness
        to the first pose that is missed.
        """
        rows, postures = np.arange(len(self.yaws)), self.postures.copy()
        scores, fractions, first = np.zeros(len(rows)), np.ones(len(rows)), postures
        for number, pose in enumerate(path):
            places, frames = self.poses(pose)
            postures[rows], errors, qualities = arm.reach(
                postures[rows], places[rows], frames[rows], 8 if number else 30
            )
            missed = errors >= _CLOSE
            nearness = 1.0 - np.minimum(errors, 1.0)
            least = np.minimum(fractions[rows], qualities)
            fractions[rows] = np.where(missed, nearness, least)
            rows = rows[~missed]
            scores[rows] += 1.0
            first = postures.copy() if number == 0 else first
            if not len(rows):
                break
        return scores + 0.99 * fractions, first, postures

    def stance(self, row: int, radius: float, height: float) -> Stance:
        """Return a try as a stance."""
        (x, y, z), yaw, grasp_yaw, roll, posture = (v[row].tolist() for v in self)
        held: Any = {"grasp_yaw": grasp_yaw, "roll": roll}
        held["closed_posture"] = tuple(posture)
        within = {"below_handle": z, "radius": radius, "height": height}
        return Stance(handle_xy_w=(x, y), door_yaw=yaw, **held, **within)


def _search(
    robot: RobotConfig,
    group: StanceGroup,
    path: Array,
    moments: Sequence[str],
    *,
    least: float,
    radius: float = 0.0,
    place: Array | None = None,
    yaw: float = 0.0,
) -> tuple[_Tries, Array]:
    """Return the best tries that follow a path of the hand, and their scores.

    With a `radius` [m] the base is clear of the leaf; with a `place` (3,) [m] the
    handle is there, with the heading `yaw` [rad] into the door. If no
    score reaches `least`, raises a ValueError that says where and why the best one
    ends.
    """
    from scipy.stats import qmc  # which takes a second to import

    arm, rng = _Arm.of(robot), np.random.default_rng(0)
    points = qmc.Sobol(6 + len(arm.axes), scramble=False).random_base2(_TRIES)
    for spread in _SPREADS:
        tries = _Tries.spread(arm, group, points)
        if place is not None:
            tries = tries._replace(
                handles=np.tile(place, (len(points), 1)), yaws=np.full(len(points), yaw)
            )
        if radius:
            kept = tries.clear(group, radius)
            points, tries = points[kept], _Tries(*(values[kept] for values in tries))
        scores, first, last = tries.follow(arm, path)
        best = scores.argsort(kind="stable")[::-1][:_BEST]
        if not spread or scores[best[0]] > len(path) + _QUALITY[1]:
            break
        # The next round starts from the postures that were reached.
        points[:, 6:] = (first - arm.low) / (arm.high - arm.low)
        around = points[best].repeat(_AROUND, axis=0)
        around += spread * rng.standard_normal(around.shape)
        points = np.clip(np.vstack([points[best], around]), 0.0, 1.0)
    if scores[best[0]] < least:
        number, end = min(int(scores[best[0]]), len(path) - 1), last[best[0]]
        places, _, _, loads = arm.hand(end[None])
        away = tries.poses(path[number])[0][best[0]] - places[0]
        causes = {
            "too heavy for its effort": loads[0] > _LOAD,
            "at a limit": np.minimum(end - arm.low, arm.high - end) < 0.1,
            "stretched": end == end,
        }
        cause, joints = next(item for item in causes.items() if item[1].any())
        text = f"{moments[number]} {' and '.join(np.array(robot.arm)[joints])} {cause}"
        if np.linalg.norm(away) > 0.005:
            away = away.round(2) + 0.0  # not -0.0
            text += f"; the hand stays {away.tolist()} m away, in the base's axes"
        raise ValueError(text)
    tries = tries._replace(postures=first)
    return _Tries(*(values[best] for values in tries)), scores[best]


def at_frame(
    robot: RobotConfig, door: DoorConfig, task: Array, path: Array, times: Array
) -> RobotConfig:
    """Return a robot with a fixed base, placed so that the task frame has a pose.

    The pose (6,) [m, rad] is in the frame of the arm's root link on its stand, whose
    lift is computed, or of the root of a robot without a stand; the handle of `door` is
    then as high as the task frame. The hand must reach the `path` (T, 6) [m, rad] in
    the task frame; posture and yaw of the hand are searched. Messages contain the
    `times` (T,) [s]. Raises a ValueError if y of the task frame is not upright, or the
    lift or the arm does not reach.
    """
    place, axes = np.array(task[:3]), Rotation.from_rotvec(task[3:]).as_matrix()
    if not (np.isfinite(place).all() and tilt_of(task[3:]) <= UPRIGHT):
        tilt = f"{UPRIGHT:.0f}°; it points to {axes[:, 1].tolist()}"
        raise ValueError(f"y of the task frame must be finite, and upright to {tilt}")
    robot = robot.on("fixed")
    group, (lowest, highest) = StanceGroup.of(door, "fixed"), _Arm.of(robot).lift
    if not robot.stand:
        usual = robot.stance(door).below_handle
        place[2] -= min(max(place[2] - usual, lowest), highest)
    elif not lowest <= door.handle_height - place[2] <= highest:
        raise ValueError(
            f"the task frame is {place[2]:.2f} m above the base and the handle "
            f"{door.handle_height:g} m above the floor, but the stand lifts the base "
            f"from {lowest:g} to {highest:g} m; give a door with another handle_height"
        )
    yaw = math.atan2(-axes[1, 0], -axes[0, 0])
    moments = [f"at {time:.2f} s" for time in times]
    try:
        args, least = (robot, group, path, moments), len(path)
        tries, _ = _search(*args, least=least, place=place, yaw=yaw)
    except ValueError as error:
        raise ValueError(
            f"the arm of {robot.name} does not reach the path with the handle at "
            f"{np.round(task[:3], 3).tolist()} m in the base frame: {error}; move "
            "the base by that, and give the pose of the task frame from there"
        ) from None
    stance = tries.stance(0, math.inf, math.inf)
    return replace(robot, stances=((group, stance),))


@lru_cache(maxsize=64)
def searched_stance(robot: RobotConfig, group: StanceGroup) -> Stance | str:
    """Return the best stance of a robot for a group of doors, or why there is none.

    With a fixed base the arm follows the whole opening; with a mobile one, which
    follows the hand, it turns the hand by 30° to both sides and moves it by 10 cm.
    """
    radii: tuple[float, ...] = _RADII
    arm, height = _Arm.of(robot), _HEIGHTS[2]
    if group.base == "mobile":
        moved = np.zeros((9, 6))
        moved[:7, 4] = 0.0, 0.25, 0.5, 0.25, 0.0, -0.25, -0.5
        moved[7:, 0] = 0.1, -0.1
        paths, radii = moved[None], (1.05,)
    else:
        side = -1.0 if group.hinge_side == "left" else 1.0
        way = 1.0 if group.swing == "pull" else -1.0
        arcs = handle_pose_on_arc(np.reshape(radii, (-1, 1)), _OPENED)
        paths = arcs * [way, 1.0, side, 1.0, side * way, 1.0]
    for number, (path, radius) in enumerate(zip(paths, radii, strict=True)):
        moments = ["at the handle"] * len(path)
        if group.base == "fixed":
            degrees = np.degrees(_OPENED)
            moments = [f"at {x:.0f}° of a door of {radius:g} m" for x in degrees]
        least = len(path) + _QUALITY[0]
        try:
            args = robot, group, path, moments
            tries, scores = _search(*args, least=least, radius=radius)
        except ValueError as error:
            reason = str(error)
            continue
        for nearer in paths[number + 1 :]:
            scores = scores + tries.follow(arm, nearer)[0]
        best = int(scores.argmax())
        if group.base == "fixed":
            height = min(height, float(tries.handles[best, 2] + arm.lift[1]))
        return tries.stance(best, radius, height)
    return reason
