"""Bags of ROS 2 and ROS 1: poses, joint states by forward kinematics, and wrenches.

The hand is a topic of poses, transforms (``/tf:child_frame``) or, with a URDF and a
link, joint states. A topic of WrenchStamped, the only one or ``--wrench``, gives the
forces, on the clock of the hand.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from gplfd_experiments.data.raw import RawRecording, chosen
from gplfd_experiments.data.settings import ImportSettings
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.files.libraries import optional_libraries
from gplfd_policies.arrays.resolution import interpolated
from gplfd_policies.arrays.storage import regular_file

with optional_libraries("ROS bags need rosbags", "ros"):
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

_JOINTS: Final = "sensor_msgs/msg/JointState"
_WRENCH: Final = "geometry_msgs/msg/WrenchStamped"
_TRANSFORMS: Final = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
_POSES: Final = (
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/TransformStamped",
    "nav_msgs/msg/Odometry",
)
"""Message types that contain a pose."""

_Row = tuple[float, ...]
"""Position [m] and quaternion, the scalar first; or force [N] and torque [N m]."""
_Track = list[tuple[int, _Row]]
"""Rows with their stamps [ns]."""


def _stamp(message: Any, logged: int) -> int:
    """Return the stamp of a message, or else the time of logging [ns]."""
    stamp = message.header.stamp
    return int(stamp.sec) * 10**9 + int(stamp.nanosec) or logged


def _arrays(track: _Track) -> tuple[FloatArray, FloatArray]:
    """Return the times since the first stamp [s], (N,), and the rows, (N, d)."""
    stamps = np.array([stamp for stamp, _ in track], dtype=np.int64)
    return np.asarray((stamps - stamps[0]) * 1e-9), np.array([row for _, row in track])


def _pose(message: Any) -> _Row:
    """Return the pose in a message with any nesting of messages."""
    while hasattr(message, "pose"):
        message = message.pose
    if hasattr(message, "transform"):
        p, q = message.transform.translation, message.transform.rotation
    else:
        p, q = message.position, message.orientation
    return (p.x, p.y, p.z, q.w, q.x, q.y, q.z)


def read(path: Path, settings: ImportSettings) -> list[RawRecording]:
    """Read the motion of a topic, and the wrenches of another."""
    hand: _Track = []
    wrench: _Track = []
    frames: set[str] = set()
    # With message types for bags without type descriptions.
    usual_types = get_typestore(Stores.ROS2_HUMBLE)
    with AnyReader([path], default_typestore=usual_types) as bag:
        # The topic of the hand, and its frame if the topic has several.
        topics = {
            connection.topic: connection.msgtype for connection in bag.connections
        }
        known = {*_POSES, _JOINTS, *_TRANSFORMS}
        moving = {name: kind for name, kind in topics.items() if kind in known}
        if not moving:
            listed = ", ".join(f"{name} ({kind})" for name, kind in topics.items())
            raise ValueError(
                f"it has no topic of poses or joints, but {listed or 'none'}"
            )
        wanted, child = settings.body, None
        if wanted is not None and wanted not in moving and ":" in wanted:
            wanted, child = wanted.rsplit(":", 1)
        topic, kind = chosen(wanted, moving, "topic", file=path.name)
        forces = {name: kind for name, kind in topics.items() if kind == _WRENCH}
        force, notes = next(iter(forces), None), []
        if settings.wrench is not None:
            force, _ = chosen(settings.wrench, forces, "force topic", file=path.name)
        elif len(forces) > 1:
            force = None
            notes.append(f"forces left out: choose with --wrench: {', '.join(forces)}")
        take: Callable[[Any], _Row] = _pose
        if kind == _JOINTS:
            take = _forward_kinematics(settings.urdf, settings.link)
        needed = [c for c in bag.connections if c.topic in (topic, force)]
        for connection, logged, content in bag.messages(needed):
            message: Any = bag.deserialize(content, connection.msgtype)
            if connection.topic != topic:
                f, t = message.wrench.force, message.wrench.torque
                row = (f.x, f.y, f.z, t.x, t.y, t.z)
                wrench.append((_stamp(message, logged), row))
            elif kind not in _TRANSFORMS:
                hand.append((_stamp(message, logged), take(message)))
            else:
                for transform in message.transforms:
                    frames.add(transform.child_frame_id)
                    if transform.child_frame_id == child:
                        hand.append((_stamp(transform, logged), _pose(transform)))
    if not hand:
        if not frames:
            raise ValueError(f"topic {topic} has no pose")
        problem = (
            f"topic {topic} has no frame {child!r}" if child else "say which frame"
        )
        listed = ", ".join(sorted(frames)[:30])
        raise ValueError(f"{problem}: --body {topic}:FRAME, of {listed}")
    times, poses = _arrays(hand)
    wrenches = None
    if wrench:
        # At the times of the poses; missing if no wrench was recorded close to a pose.
        clock, rows = _arrays(wrench)
        order = np.argsort(clock, kind="stable")
        clock = clock[order] + (wrench[0][0] - hand[0][0]) * 1e-9
        wrenches = interpolated(times, clock, rows[order])
        padded = np.concatenate([[-np.inf], clock, [np.inf]])
        after = np.searchsorted(clock, times) + 1
        nearest = np.minimum(times - padded[after - 1], padded[after] - times)
        steps = [np.median(np.diff(t)) for t in (times, clock) if len(t) > 1]
        wrenches[nearest > max(steps, default=0.0)] = np.nan
    return [
        RawRecording(
            name=f"{path.name}: {topic}{f':{child}' if child else ''}",
            times=times,
            positions=poses[:, :3],
            unit="m",
            quaternions=poses[:, 3:],
            wrenches=wrenches,
            notes=tuple(notes),
        )
    ]


def _forward_kinematics(urdf: Path | None, link: str | None) -> Callable[[Any], _Row]:
    """Return a function from a joint state to the pose of a robot's link.

    Joints that are not in a message keep their last position, initially zero.
    """
    if urdf is None or link is None:
        raise ValueError(
            "joint states need the robot and its hand: --urdf FILE --link NAME"
        )
    import yourdfpy

    regular_file(urdf, "a URDF file (--urdf)")
    robot = yourdfpy.URDF.load(str(urdf), load_meshes=False)
    chosen(link, robot.link_map, "link", file=urdf.name)
    positions = dict.fromkeys(robot.actuated_joint_names, 0.0)

    def pose(message: Any) -> _Row:
        known = dict(zip(message.name, message.position, strict=True))
        if not known.keys() & positions.keys():
            raise ValueError(
                f"a joint state names {', '.join(known)!s:.100}, and {urdf.name} has "
                f"{', '.join(positions)!s:.200}"
            )
        positions.update({name: known[name] for name in known if name in positions})
        robot.update_cfg(positions)
        matrix = robot.get_transform(link)
        quaternion = Rotation.from_matrix(matrix[:3, :3]).as_quat(scalar_first=True)
        return (*map(float, matrix[:3, 3]), *map(float, quaternion))

    return pose
