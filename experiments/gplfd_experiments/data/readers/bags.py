"""Bags of ROS 2 and ROS 1: poses, joint states by forward kinematics, and wrenches.

Read are MCAP and SQLite files, folders with metadata.yaml, and .bag files. The hand is
a topic of PoseStamped, TransformStamped, TFMessage (``/tf:child_frame``), Odometry, or,
with a URDF and a link, JointState. The only topic of WrenchStamped, if there is one,
becomes the force, on the clock of the poses. Stamps are those of the messages' headers.
"""

import bz2
import contextlib
import functools
import io
import os
from array import array
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

import numpy as np

from gplfd_experiments.data.raw import RawRecording
from gplfd_experiments.data.readers.selection import Selection, chosen
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.arrays.storage import DecodingBudget, decompressed, regular_file

try:
    import apsw
    import lz4.frame  # type: ignore[import-untyped]
    import rosbags.rosbag1.reader as rosbag1
    import rosbags.rosbag2.reader as rosbag2
    import rosbags.rosbag2.storage_mcap as mcap
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore
except ImportError as error:
    raise ModuleNotFoundError(
        f"bags of ROS need rosbags ({error}); in a checkout of gplfd: pip install "
        "'.[ros]', elsewhere: pip install 'gplfd[ros]'"
    ) from error

_JOINTS: Final = "sensor_msgs/msg/JointState"
_WRENCH: Final = "geometry_msgs/msg/WrenchStamped"
_TRANSFORMS: Final = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")


def _pose(message: Any) -> tuple[float, ...]:
    return _seven(message.position, message.orientation)


def _transform(message: Any) -> tuple[float, ...]:
    return _seven(message.translation, message.rotation)


def _seven(p: Any, q: Any) -> tuple[float, ...]:
    return (p.x, p.y, p.z, q.w, q.x, q.y, q.z)


POSES: Final[Mapping[str, Callable[[Any], tuple[float, ...]]]] = {
    "geometry_msgs/msg/PoseStamped": lambda message: _pose(message.pose),
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda m: _pose(m.pose.pose),
    "geometry_msgs/msg/TransformStamped": lambda m: _transform(m.transform),
    "nav_msgs/msg/Odometry": lambda message: _pose(message.pose.pose),
}
"""Types of messages that hold a pose, and how to take it."""


@functools.cache
def _messages() -> Any:
    """Return the usual messages, for bags that do not describe theirs."""
    return get_typestore(Stores.ROS2_HUMBLE)


class _BoundedReader(io.BufferedReader):
    """Reserves no more memory for a read than the file can fill."""

    def read(self, size: int | None = -1, /) -> bytes:
        """Read so many bytes, or as many as there are."""
        rest = max(0, os.fstat(self.fileno()).st_size - self.tell())
        return super().read(rest if size is None or size < 0 else min(size, rest))


class _BoundedPath(type(Path())):  # type: ignore[misc]
    """A path whose file is opened as `_BoundedReader`."""

    def open(self, mode: str = "r", *arguments: Any, **options: Any) -> Any:
        """Open the file."""
        if mode == "rb":
            return _BoundedReader(io.FileIO(self, "rb"))
        return super().open(mode, *arguments, **options)


class _BoundedStream:
    """A decompressed stream whose bytes are claimed from a budget."""

    def __init__(self, stream: Any, budget: DecodingBudget) -> None:
        self._stream, self._budget = stream, budget

    def __enter__(self) -> "_BoundedStream":
        return self

    def __exit__(self, *raised: object) -> None:
        self._stream.close()

    def read(self, size: int) -> bytes:
        """Read so many bytes, or fewer at the end."""
        content: bytes = self._stream.read(size)
        self._budget.claim(len(content), "a compressed file")
        return content


@contextlib.contextmanager
def _bounded_decompression(size: int) -> Iterator[None]:
    """Let rosbags decompress to no more than a `DecodingBudget` of these bytes.

    rosbags decompresses chunks, messages and files without limit. So its functions are
    replaced while a bag is read, which is all that uses them in this program.
    """
    budget = DecodingBudget(size)
    zstd = vars(rosbag2)["zstd"]

    def chunk(make: Callable[[], Any]) -> Callable[[bytes, int], bytes]:
        return lambda data, claimed: decompressed(data, make, budget, "a chunk")

    def stored(data: bytes, claimed: int) -> bytes:
        # An index may name one chunk many times.
        budget.claim(len(data), "a chunk")
        return data

    def ros1(make: Callable[[], Any]) -> Callable[[bytes], bytes]:
        # Where topics interleave, one chunk is decompressed many times and dropped
        # again: each has the whole budget.
        return lambda data: decompressed(data, make, DecodingBudget(size), "a chunk")

    def limit_values(connection: Any) -> None:
        # A generated column holds values that are not in the file.
        connection.limit(apsw.SQLITE_LIMIT_LENGTH, min(budget.left, 2**31 - 1))

    replaced: list[tuple[Any, str, Any]] = [
        (
            mcap,
            "DECOMPRESSORS",
            {
                "": stored,
                "lz4": chunk(lz4.frame.LZ4FrameDecompressor),
                "zstd": chunk(zstd.ZstdDecompressor),
            },
        ),
        (
            rosbag1,
            "decompressors",
            {
                **rosbag1.decompressors,
                "bz2": ros1(bz2.BZ2Decompressor),
                "lz4": ros1(lz4.frame.LZ4FrameDecompressor),
            },
        ),
        (
            rosbag2,
            "zstd",
            SimpleNamespace(
                decompress=lambda data: decompressed(
                    data, zstd.ZstdDecompressor, budget, "a message"
                ),
                open=lambda file, mode: _BoundedStream(zstd.open(file, mode), budget),
            ),
        ),
        (apsw, "connection_hooks", [*apsw.connection_hooks, limit_values]),
    ]
    originals = [(owner, name, getattr(owner, name)) for owner, name, _ in replaced]
    try:
        for owner, name, ours in replaced:
            setattr(owner, name, ours)
        yield
    finally:
        for owner, name, original in originals:
            setattr(owner, name, original)


def _checked_size(path: Path) -> int:
    """Return the size of a bag, whose files must all be regular files [bytes]."""
    files = path.iterdir() if path.is_dir() else [path]
    return sum(regular_file(file).stat().st_size for file in files if not file.is_dir())


@dataclass(frozen=True, slots=True)
class _Track:
    """Rows of numbers with their stamps [ns]."""

    stamps: "array[int]" = field(default_factory=lambda: array("q"))
    values: "array[float]" = field(default_factory=lambda: array("d"))

    def add(self, stamp: int, row: tuple[float, ...]) -> None:
        """Add a row."""
        self.stamps.append(stamp)
        self.values.extend(row)

    def times(self) -> tuple[int, FloatArray]:
        """Return the first stamp [ns], and all since then [s]."""
        stamps = np.frombuffer(self.stamps, dtype=np.int64)
        first = int(stamps[0]) if len(stamps) else 0
        return first, np.asarray((stamps - first) * 1e-9)

    def rows(self) -> FloatArray:
        """Return the rows, (N, d)."""
        values = np.frombuffer(self.values)
        return values.reshape(len(self.stamps), -1)


def read(path: Path, selection: Selection) -> list[RawRecording]:
    """Read the motion of a topic.

    Raises:
        ValueError: The bag is damaged, has no such topic, or joint states come without
            a URDF.
    """
    with (
        _bounded_decompression(_checked_size(path)),
        AnyReader([_BoundedPath(path)], default_typestore=_messages()) as bag,
    ):
        topics = {one.topic: one.msgtype for one in bag.connections}
        topic, child = _topic(selection, topics, path.name)
        forces = [name for name, kind in topics.items() if kind == _WRENCH]
        force = forces[0] if len(forces) == 1 else None
        hand, wrench = _Track(), _Track()
        frames: set[str] = set()
        row = _row_of(topics[topic], child, selection, frames)
        wanted = [one for one in bag.connections if one.topic in (topic, force)]
        for connection, logged, content in bag.messages(wanted):
            message = bag.deserialize(content, connection.msgtype)
            if connection.topic == topic:
                row(hand, message, logged)
            else:
                wrench.add(_stamp(message, logged), _wrench(message))
    if not hand.stamps:
        raise ValueError(_none_of(topic, child, frames))
    first, times = hand.times()
    poses = hand.rows()
    return [
        RawRecording(
            name=f"{path.name}: {topic}{f':{child}' if child else ''}",
            times=times,
            positions=poses[:, :3],
            unit="m",
            quaternions=poses[:, 3:],
            signals=_forces(wrench, first, times),
        )
    ]


def _topic(
    selection: Selection, topics: dict[str, str], file: str
) -> tuple[str, str | None]:
    """Return the topic of the hand, and the frame in it where it has several."""
    known = set(POSES) | {_JOINTS} | set(_TRANSFORMS)
    moving = {name: kind for name, kind in topics.items() if kind in known}
    if not moving:
        listed = ", ".join(f"{name} ({kind})" for name, kind in topics.items())
        raise ValueError(f"it has no topic of poses or joints, but {listed or 'none'}")
    wanted, child = selection.body, None
    if wanted is not None and wanted not in moving and ":" in wanted:
        wanted, child = wanted.rsplit(":", 1)
    topic, _ = chosen(wanted, moving, "topic", file=file)
    return topic, child


def _none_of(topic: str, child: str | None, frames: set[str]) -> str:
    """Return why there is no pose of a topic."""
    if not frames:
        return f"topic {topic} has no pose"
    listed = ", ".join(sorted(frames)[:30])
    problem = f"topic {topic} has no frame {child!r}" if child else "say which frame"
    return f"{problem}: --body {topic}:FRAME, of {listed}"


def _row_of(
    kind: str, child: str | None, selection: Selection, frames: set[str]
) -> Callable[[_Track, Any, int], None]:
    """Return what adds a message's poses to a track, and to the frames their names."""
    if kind in _TRANSFORMS:

        def add_transforms(track: _Track, message: Any, logged: int) -> None:
            for one in message.transforms:
                frames.add(one.child_frame_id)
                if one.child_frame_id == child:
                    track.add(_stamp(one, logged), _transform(one.transform))

        return add_transforms
    take = _kinematics(selection) if kind == _JOINTS else POSES[kind]

    def add_pose(track: _Track, message: Any, logged: int) -> None:
        track.add(_stamp(message, logged), take(message))

    return add_pose


def _kinematics(selection: Selection) -> Callable[[Any], tuple[float, ...]]:
    """Return what makes a pose of joint positions."""
    if selection.urdf is None or selection.link is None:
        raise ValueError(
            "joint states need the robot and its hand: --urdf FILE --link NAME"
        )
    from gplfd_experiments.data.readers.forward_kinematics import hand_of

    return hand_of(selection.urdf, selection.link)


def _stamp(message: Any, logged: int) -> int:
    """Return a message's stamp [ns], or when it was logged if it has none."""
    stamp = message.header.stamp
    return int(stamp.sec) * 10**9 + int(stamp.nanosec) or logged


def _wrench(message: Any) -> tuple[float, ...]:
    f, t = message.wrench.force, message.wrench.torque
    return (f.x, f.y, f.z, t.x, t.y, t.z)


def _forces(track: _Track, first: int, times: FloatArray) -> dict[str, FloatArray]:
    """Return the force at other times."""
    if not len(track.stamps):
        return {}
    start, own = track.times()
    order = np.argsort(own, kind="stable")
    clock = own[order] + (start - first) * 1e-9
    rows = track.rows()[order]
    columns = [np.interp(times, clock, column) for column in rows.T]
    return {"force": np.column_stack(columns)}
