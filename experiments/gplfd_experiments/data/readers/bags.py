"""Bags of ROS 2 and ROS 1: poses, transforms ``/tf:child_frame`` and wrenches.

Poses may be those of a URDF's link in joint states. ``/hand:frame`` selects one of
several frames or publishers in a topic.
"""

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple
from urllib.parse import quote

import numpy as np
from scipy.spatial.transform import Rotation

from gplfd_experiments.data.raw import RawRecording, chosen, restarts
from gplfd_experiments.data.settings import ImportSettings
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.files.libraries import optional_libraries
from gplfd_policies.arrays.records import interpolated
from gplfd_policies.arrays.storage import regular_file

_JOINTS: Final = "sensor_msgs/msg/JointState"
_WRENCH: Final = "geometry_msgs/msg/WrenchStamped"
_MOVING: Final = (
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
    "geometry_msgs/msg/TransformStamped",
    "nav_msgs/msg/Odometry",
    "tf2_msgs/msg/TFMessage",
    "tf/msg/tfMessage",
    _JOINTS,
)
"""Types of messages that say where something is."""
_BEYOND: Final = 1.5  # Largest angle of a joint in radians, per limit of its URDF.


class _Address(type(Path())):  # type: ignore[misc]
    """A path that rosbags writes into an address of SQLite, where % and # are codes."""

    def __format__(self, spec: str) -> str:
        return quote(str(self))


class _Message(NamedTuple):
    """A message with its stamp and time of logging [ns]."""

    stamp: int
    logged: int
    source: tuple[str, ...]  # Child frame, if any, frame, and publisher, if recorded.
    content: Any
    of_many: bool  # Whether it is one of many transforms.


def _row(message: Any) -> tuple[float, ...]:
    """Return position [m] and quaternion, scalar first; or force [N], torque [N m]."""
    if hasattr(message, "wrench"):
        f, m = message.wrench.force, message.wrench.torque
        return (f.x, f.y, f.z, m.x, m.y, m.z)
    while hasattr(message, "pose"):
        message = message.pose
    if hasattr(message, "transform"):
        p, q = message.transform.translation, message.transform.rotation
    else:
        p, q = message.position, message.orientation
    return (p.x, p.y, p.z, q.w, q.x, q.y, q.z)


def _clock(messages: Sequence[_Message]) -> tuple[FloatArray, int]:
    """Return times since the first [s], (N,), and the first, of stamps or logs [ns]."""
    stamps, logged = np.array([message[:2] for message in messages], dtype=np.int64).T
    clock = stamps if stamps.any() else logged
    return np.asarray((clock - clock[0]) * 1e-9), int(clock[0])


def _of_one_source(
    messages: list[_Message], topic: str, wanted: list[str], option: str
) -> list[_Message]:
    """Return the messages of the only source that begins with the wanted parts."""
    if not messages:
        raise ValueError(f"topic {topic} has no pose")
    sources = {message.source for message in messages}
    matching = {part for part in sources if part[: len(wanted)] == tuple(wanted)}
    # A single transform may be of anything.
    if len(matching) == 1 and (wanted or not messages[0].of_many):
        return [message for message in messages if message.source in matching]
    listed = ", ".join(sorted(":".join(source) for source in matching or sources)[:30])
    problem = "say which frame" if matching else f"no frame {':'.join(wanted)!r}"
    raise ValueError(
        f"topic {topic} has several frames or publishers; {problem}: "
        f"{option} {topic}:FRAME, of {listed}"
    )


def read(path: Path, settings: ImportSettings) -> list[RawRecording]:
    """Read the motion of a topic, and the wrenches of another."""
    with optional_libraries("ROS bags need rosbags", "ros"):
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    notes: list[str] = []
    received: defaultdict[str | None, list[_Message]] = defaultdict(list)
    # With message types for bags without type descriptions.
    usual_types = get_typestore(Stores.ROS2_HUMBLE)
    with AnyReader([_Address(path)], default_typestore=usual_types) as bag:
        # The topic of the hand, and its source if the topic has several.
        kinds = {connection.topic: connection.msgtype for connection in bag.connections}
        moving = {name: kind for name, kind in kinds.items() if kind in _MOVING}
        if not moving:
            listed = ", ".join(map(" of ".join, kinds.items())) or "none"
            raise ValueError(f"it has no topic of poses or joints, but {listed}")
        wanted, *parts = (settings.body or "").split(":")
        topic, kind = chosen(wanted or None, moving, "topic", file=path.name)
        forces = {name: name for name, kind in kinds.items() if kind == _WRENCH}
        wanted, *force_parts = (settings.wrench or "").split(":")
        force = forces.get(wanted) or next(iter(forces), None)
        if wanted and wanted not in forces:
            chosen(wanted, forces, "force topic", file=path.name)
        elif not wanted and len(forces) > 1:
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
                head, child = item.header, getattr(item, "child_frame_id", None)
                source = [frame.strip("/") for frame in (child, head.frame_id) if frame]
                source += [publisher] if publisher else []
                stamp = int(head.stamp.sec) * 10**9 + int(head.stamp.nanosec)
                received[connection.topic].append(
                    _Message(stamp, logged, tuple(source), item, item is not message)
                )
    if kind == _JOINTS:
        track, poses = _poses_of_link(received[topic], parts, settings, notes)
    else:
        track = _of_one_source(received[topic], topic, parts, "--body")
        poses = np.array([_row(message.content) for message in track])
    times, begin = _clock(track)
    wrenches = None
    if received[force]:
        felt = _of_one_source(received[force], str(force), force_parts, "--wrench")
        same = felt[0].content.header.frame_id == track[0].content.header.frame_id
        if same and settings.force_axes == "hand" and kind != _JOINTS:
            notes.append("forces have the frame of the poses: --force-axes recorded?")
        clock, first = _clock(felt)
        if restarts(times) or restarts(clock):
            notes.append("forces left out: the clock restarts; cut the bag there")
        else:
            # At the times of the poses; missing if none was recorded close to a pose.
            rows = np.array([_row(message.content) for message in felt])
            order = np.argsort(clock, kind="stable")
            clock = clock[order] + (first - begin) * 1e-9
            wrenches = interpolated(times, clock, rows[order])
            padded = np.concatenate([[-np.inf], clock, [np.inf]])
            after = np.searchsorted(clock, times) + 1
            nearest = np.minimum(times - padded[after - 1], padded[after] - times)
            steps = [np.median(np.diff(t)) for t in (times, clock) if len(t) > 1]
            wrenches[nearest > max(steps, default=0.0)] = np.nan
    name, positions, turned = ":".join([topic, *parts]), poses[:, :3], poses[:, 3:]
    label = f"{path.name}: {name}"
    motion = RawRecording(label, positions, "m", times, turned, wrenches=wrenches)
    return [replace(motion, notes=tuple(notes))]


def _poses_of_link(
    messages: list[_Message],
    wanted: list[str],
    settings: ImportSettings,
    notes: list[str],
) -> tuple[list[_Message], FloatArray]:
    """Return the poses of a robot's link, from when each of its joints was seen."""
    urdf, link = settings.urdf, settings.link
    if urdf is None or link is None:
        raise ValueError("joint states need the robot, --urdf FILE --link NAME")
    import yourdfpy

    regular_file(urdf, "a URDF file (--urdf)")
    robot = yourdfpy.URDF.load(str(urdf), load_meshes=False)
    chosen(link, robot.link_map, "link", file=urdf.name)
    joints = {joint.child: joint for joint in robot.robot.joints}
    chain, limits, below = set[str](), dict[str, float](), link
    while joint := joints.pop(below, None):
        below = joint.parent
        if joint.type in ("revolute", "continuous", "prismatic"):
            chain.add(joint.mimic.joint if joint.mimic else joint.name)
        if joint.type == "revolute" and joint.limit:
            ends = joint.limit.lower or 0.0, joint.limit.upper or 0.0
            limits[joint.name] = _BEYOND * max(map(abs, ends))
    positions, beyond = dict[str, float](), set[str]()
    sources: defaultdict[str, set[str]] = defaultdict(set)
    track, rows = list[_Message](), list[FloatArray]()
    for message in messages:
        if message.source[: len(wanted)] != tuple(wanted):
            continue
        names, values = message.content.name, message.content.position
        if len(values) not in (0, len(names)):
            number = f"{len(names)} names and {len(values)} positions"
            raise ValueError(f"a joint state has {number}")
        seen = {n: v for n, v in zip(names, values, strict=False) if n in chain}
        for name in seen:
            sources[name].add(":".join(message.source))
        positions.update(seen)
        beyond |= {n for n, v in seen.items() if abs(v) > limits.get(n, math.inf)}
        # Messages without these joints are of other parts, or of other robots.
        if seen and len(positions) == len(chain):
            robot.update_cfg(positions)
            matrix = robot.get_transform(link)
            turned = Rotation.from_matrix(matrix[:3, :3]).as_quat(scalar_first=True)
            track.append(message)
            rows.append(np.concatenate([matrix[:3, 3], turned]))
    if not any(len(message.content.position) for message in messages):
        raise ValueError("joint states have no positions")
    if not track:
        names = sorted({name for message in messages for name in message.content.name})
        raise ValueError(
            f"no joint state has {', '.join(sorted(chain - sources.keys()))!s:.200}, "
            f"which move {link} of {urdf.name}; they have {', '.join(names)!s:.200}"
        )
    if beyond:
        notes.append(
            f"joints {', '.join(sorted(beyond))} go far beyond their limits in "
            f"{urdf.name}: are they in degrees? a joint state is in radians"
        )
    for name, several in sources.items():
        if len(several) > 1:
            raise ValueError(
                f"the frames or publishers {', '.join(sorted(several))} have joint "
                f"{name}; say which: --body TOPIC:FRAME"
            )
    return track, np.array(rows)
