"""Bags of ROS 2 and ROS 1: poses, joint states by forward kinematics, and wrenches.

The hand is a topic of poses, transforms (``/tf:child_frame``) or, with a URDF and a
link, joint states. A topic of WrenchStamped, the only one or ``--wrench``, gives the
forces, on the clock of the hand. Several frames or publishers in one topic are several
sources, of which one is selected (``/hand:frame``, ``/tf:child:parent``).
"""

from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

import numpy as np
from scipy.spatial.transform import Rotation

from gplfd_experiments.data.raw import RawRecording, chosen, restarts
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
_Track = list[tuple[int, int, _Row]]
"""Rows with their stamps and times of logging [ns]."""
_Source = tuple[str, ...]
"""Child frame, if any, frame, and publisher, if recorded."""


class _Address(type(Path())):  # type: ignore[misc]
    """A path that rosbags writes into an address of SQLite, where % and # are codes."""

    def __format__(self, spec: str) -> str:
        return quote(str(self))


def _arrays(track: _Track) -> tuple[FloatArray, FloatArray, int]:
    """Return times since the first stamp [s], (N,), rows, (N, d), and this stamp [ns].

    Without stamps, the times of logging are used.
    """
    stamps, logged = np.array([times for *times, _ in track], dtype=np.int64).T
    clock = stamps if stamps.any() else logged
    times = np.asarray((clock - clock[0]) * 1e-9)
    return times, np.array([row for *_, row in track]), int(clock[0])


def _pose(message: Any) -> _Row:
    """Return the pose in a message with any nesting of messages."""
    while hasattr(message, "pose"):
        message = message.pose
    if hasattr(message, "transform"):
        p, q = message.transform.translation, message.transform.rotation
    else:
        p, q = message.position, message.orientation
    return (p.x, p.y, p.z, q.w, q.x, q.y, q.z)


def _wrench(message: Any) -> _Row:
    f, t = message.wrench.force, message.wrench.torque
    return (f.x, f.y, f.z, t.x, t.y, t.z)


def _of_one_source(
    tracks: Mapping[_Source, _Track],
    topic: str,
    wanted: list[str],
    option: str,
    *,
    named: bool = False,
) -> _Track:
    """Return the only track of a topic whose source begins with the wanted parts.

    Of transforms even the only one must be ``named``, because it may be of anything.
    """
    parts = tuple(wanted)
    matching = [source for source in tracks if source[: len(parts)] == parts]
    if len(matching) == 1 and (parts or not named):
        return tracks[matching[0]]
    if not tracks:
        raise ValueError(f"topic {topic} has no pose")
    listed = ", ".join(sorted(":".join(source) for source in matching or tracks)[:30])
    problem = "say which frame" if matching else f"no frame {':'.join(wanted)!r}"
    raise ValueError(
        f"topic {topic} has several frames or publishers; {problem}: "
        f"{option} {topic}:FRAME, of {listed}"
    )


def read(path: Path, settings: ImportSettings) -> list[RawRecording]:
    """Read the motion of a topic, and the wrenches of another."""
    hands: defaultdict[_Source, _Track] = defaultdict(list)
    states: list[tuple[int, int, _Source, Any]] = []
    wrenches_of: defaultdict[_Source, _Track] = defaultdict(list)
    # With message types for bags without type descriptions.
    usual_types = get_typestore(Stores.ROS2_HUMBLE)
    with AnyReader([_Address(path)], default_typestore=usual_types) as bag:
        # The topic of the hand, and its source if the topic has several.
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
        wanted, *source_parts = (settings.body or "").split(":")
        topic, kind = chosen(wanted or None, moving, "topic", file=path.name)
        forces = {name: kind for name, kind in topics.items() if kind == _WRENCH}
        force, notes = next(iter(forces), None), list[str]()
        force_parts: list[str] = []
        if settings.wrench is not None:
            wanted, *force_parts = settings.wrench.split(":")
            force, _ = chosen(wanted, forces, "force topic", file=path.name)
        elif len(forces) > 1:
            force = None
            notes.append(f"forces left out: choose with --wrench: {', '.join(forces)}")
        needed = [c for c in bag.connections if c.topic in (topic, force)]
        names = [connection.topic for connection in needed]
        for connection, logged, content in bag.messages(needed):
            message: Any = bag.deserialize(content, connection.msgtype)
            publisher = getattr(connection.ext, "callerid", None)
            if publisher is None and names.count(connection.topic) > 1:
                publisher = f"channel {connection.id}"
            for item in getattr(message, "transforms", [message]):
                frames = (getattr(item, "child_frame_id", None), item.header.frame_id)
                source = tuple(
                    frame.strip("/") for frame in frames if frame is not None
                ) + ((publisher,) if publisher else ())
                sec, ns = item.header.stamp.sec, item.header.stamp.nanosec
                stamp = int(sec) * 10**9 + int(ns)
                if connection.topic != topic:
                    wrenches_of[source].append((stamp, logged, _wrench(item)))
                elif kind != _JOINTS:
                    hands[source].append((stamp, logged, _pose(item)))
                elif source[: len(source_parts)] == tuple(source_parts):
                    states.append((stamp, logged, source, item))
    if kind == _JOINTS:
        hand = _track_of_link(states, settings)
    else:
        named = kind in _TRANSFORMS
        hand = _of_one_source(hands, topic, source_parts, "--body", named=named)
    times, poses, begin = _arrays(hand)
    wrenches = None
    if wrenches_of:
        wrench = _of_one_source(wrenches_of, str(force), force_parts, "--wrench")
        # At the times of the poses; missing if no wrench was recorded close to a pose.
        clock, rows, first = _arrays(wrench)
        if restarts(times) or restarts(clock):
            notes.append("forces left out: the clock restarts; cut the bag there")
        else:
            order = np.argsort(clock, kind="stable")
            clock = clock[order] + (first - begin) * 1e-9
            wrenches = interpolated(times, clock, rows[order])
            padded = np.concatenate([[-np.inf], clock, [np.inf]])
            after = np.searchsorted(clock, times) + 1
            nearest = np.minimum(times - padded[after - 1], padded[after] - times)
            steps = [np.median(np.diff(t)) for t in (times, clock) if len(t) > 1]
            wrenches[nearest > max(steps, default=0.0)] = np.nan
    return [
        RawRecording(
            name=f"{path.name}: {':'.join([topic, *source_parts])}",
            times=times,
            positions=poses[:, :3],
            unit="m",
            quaternions=poses[:, 3:],
            wrenches=wrenches,
            notes=tuple(notes),
        )
    ]


def _track_of_link(
    states: list[tuple[int, int, _Source, Any]], settings: ImportSettings
) -> _Track:
    """Return the poses of a robot's link, from when each of its joints was seen."""
    urdf, link = settings.urdf, settings.link
    if urdf is None or link is None:
        raise ValueError(
            "joint states need the robot and its hand: --urdf FILE --link NAME"
        )
    import yourdfpy

    regular_file(urdf, "a URDF file (--urdf)")
    robot = yourdfpy.URDF.load(str(urdf), load_meshes=False)
    chosen(link, robot.link_map, "link", file=urdf.name)
    joints = {joint.child: joint for joint in robot.robot.joints}
    chain, below = set[str](), link
    while joint := joints.pop(below, None):
        below = joint.parent
        if joint.type in ("revolute", "continuous", "prismatic"):
            chain.add(joint.mimic.joint if joint.mimic else joint.name)
    positions: dict[str, float] = {}
    sources: defaultdict[str, set[str]] = defaultdict(set)
    track: _Track = []
    for stamp, logged, source, message in states:
        if len(message.position) not in (0, len(message.name)):
            raise ValueError(
                f"a joint state has {len(message.name)} names and "
                f"{len(message.position)} positions"
            )
        values = dict(zip(message.name, message.position, strict=False))
        values = {name: values[name] for name in chain & values.keys()}
        for name in values:
            sources[name].add(":".join(source))
        positions.update(values)
        # Messages without these joints are of other parts, or of other robots.
        if values and len(positions) == len(chain):
            robot.update_cfg(positions)
            matrix = robot.get_transform(link)
            quaternion = Rotation.from_matrix(matrix[:3, :3]).as_quat(scalar_first=True)
            track.append((stamp, logged, (*matrix[:3, 3], *quaternion)))
    if not any(len(message.position) for *_, message in states):
        raise ValueError("joint states have no positions")
    if not track:
        names = sorted({name for *_, message in states for name in message.name})
        raise ValueError(
            f"no joint state has {', '.join(sorted(chain - sources.keys()))!s:.200}, "
            f"which move {link} of {urdf.name}; they have {', '.join(names)!s:.200}"
        )
    for name, several in sources.items():
        if len(several) > 1:
            raise ValueError(
                f"the frames or publishers {', '.join(sorted(several))} have joint "
                f"{name}; say which: --body TOPIC:FRAME"
            )
    return track
