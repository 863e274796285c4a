"""What a skill commands, in files for robots: CSV, TUM trajectory, JSON and ROS 2 bag.

Numbers are written so that they are read back bit for bit. docs/skill-to-robot.md says
what each file contains.
"""

import csv
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from gplfd_experiments.data.writers.rows import states_of
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.files.folders import complete_folder
from gplfd_experiments.files.libraries import optional_libraries
from gplfd_experiments.files.plain_data import stamp, write_json
from gplfd_policies.agents.commanded_path import CommandedPath
from gplfd_policies.arrays.storage import complete_or_absent

KIND: Final = "a gplfd commanded path"
VERSION: Final = 1

POSE_TOPIC: Final = "/target_pose"
STIFFNESS_TOPIC: Final = "/target_stiffness"
"""Topics that crisp_controllers reads: geometry_msgs/PoseStamped, and since its pull
request 46 std_msgs/Float64MultiArray with six numbers."""

_AXES: Final = ("x", "y", "z", "rx", "ry", "rz")
_UNITS: Final = {
    "std": ("m", "rad"),
    "stiffness": ("N/m", "N m/rad"),
    "damping": ("N s/m", "N m s/rad"),
    "margin": ("N/(m s)", "N m/(rad s)"),
}


@dataclass(frozen=True, kw_only=True, slots=True)
class Commands:
    """A commanded path with what a reader of its files must know."""

    path: CommandedPath
    """The samples."""
    frame: str
    """Name of the frame: frame_id of messages."""
    axes: str
    """What that frame is, in one line."""
    about: Mapping[str, Any]
    """Whatever else JSON keeps: origin, dynamics, gripper, provenance."""

    @property
    def states(self) -> FloatArray:
        """Positions [m] and quaternions, scalar last, of the set-points, (T, 7)."""
        return states_of(self.path.poses)


def write_csv(file: Path, commands: Commands) -> None:
    """Write a table with comments and a header that names units."""
    path = commands.path
    heads = ["time [s]", "x [m]", "y [m]", "z [m]", "qx", "qy", "qz", "qw"]
    heads += [f"path_{axis} [m]" for axis in _AXES[:3]]
    for name, (linear, angular) in _UNITS.items():
        units = [linear] * 3 + [angular] * 3
        pairs = zip(_AXES, units, strict=True)
        heads += [f"{name}_{axis} [{unit}]" for axis, unit in pairs]
    arrays = [path.times[:, None], commands.states, path.path[:, :3]]
    arrays += [getattr(path, name) for name in _UNITS]
    with (
        complete_or_absent(file) as temporary,
        temporary.open("w", encoding="utf-8", newline="") as stream,
    ):
        stream.write(f"# {KIND}, version {VERSION}\n# frame: {commands.axes}\n")
        stream.write(
            "# x to qw: set-point of the hand; path_x to path_z without lead\n"
        )
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(heads)
        writer.writerows(np.hstack(arrays).tolist())


def write_tum(file: Path, commands: Commands) -> None:
    """Write set-points as a trajectory of TUM: timestamp x y z qx qy qz qw."""
    rows = np.hstack([commands.path.times[:, None], commands.states]).tolist()
    with complete_or_absent(file) as temporary:
        lines = [f"# timestamp x y z qx qy qz qw; {commands.axes}"]
        lines += [" ".join(map(repr, row)) for row in rows]
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_commands_json(file: Path, commands: Commands) -> None:
    """Write everything, with frames, units and provenance."""
    path, states = commands.path, commands.states
    samples = {
        "time": path.times,
        "position": states[:, :3],
        "quaternion_xyzw": states[:, 3:],
        "path_position": path.path[:, :3],
        **{name: getattr(path, name) for name in _UNITS},
    }
    lengths = {"time": "s", "position": "m", "path_position": "m"}
    entries = {
        **stamp(KIND, VERSION),
        "frame": {"name": commands.frame, "axes": commands.axes},
        "units": {**lengths, **_UNITS},
        **commands.about,
        "samples": {name: array.tolist() for name, array in samples.items()},
    }
    write_json(file, entries, indent=None)


def write_bag(folder: Path, commands: Commands) -> None:
    """Write a ROS 2 bag with `POSE_TOPIC` and `STIFFNESS_TOPIC`, in SQLite.

    Raises:
        ModuleNotFoundError: rosbags is not installed.
    """
    with optional_libraries("bags of ROS need rosbags", "ros"):
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)

    def message(kind: str, *parts: Any) -> Any:
        return store.types[kind.replace("/", "/msg/")](*parts)

    layout = message("std_msgs/MultiArrayLayout", [], 0)
    with (
        complete_folder(folder) as made,
        Writer(made, version=9, storage_plugin=StoragePlugin.SQLITE3) as bag,
    ):
        topics = {
            name: bag.add_connection(name, kind, typestore=store)
            for name, kind in (
                (POSE_TOPIC, "geometry_msgs/msg/PoseStamped"),
                (STIFFNESS_TOPIC, "std_msgs/msg/Float64MultiArray"),
            )
        }
        rows = zip(
            commands.path.times.tolist(),
            commands.states.tolist(),
            commands.path.stiffness,
            strict=True,
        )
        for seconds, state, stiffness in rows:
            stamped = round(1e9 * seconds)
            time = message("builtin_interfaces/Time", *divmod(stamped, 10**9))
            pose = message(
                "geometry_msgs/PoseStamped",
                message("std_msgs/Header", time, commands.frame),
                message(
                    "geometry_msgs/Pose",
                    message("geometry_msgs/Point", *state[:3]),
                    message("geometry_msgs/Quaternion", *state[3:]),
                ),
            )
            # A controller that has the stiffness first never meets it with a new pose.
            numbers = message("std_msgs/Float64MultiArray", layout, stiffness)
            for name, content in ((STIFFNESS_TOPIC, numbers), (POSE_TOPIC, pose)):
                data = store.serialize_cdr(content, topics[name].msgtype)
                bag.write(topics[name], stamped, data)


COMMAND_WRITERS: Final[Mapping[str, Callable[[Path, Commands], None]]] = (
    MappingProxyType(
        {
            "csv": write_csv,
            "tum": write_tum,
            "json": write_commands_json,
            "bag": write_bag,
        }
    )
)
"""Writers by form, which is also the suffix of what is written."""
