"""Writers of a commanded path, bit for bit, as CSV, TUM, JSON ("about" it), bag."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.files.folders import complete_folder
from gplfd_experiments.files.libraries import optional_libraries
from gplfd_experiments.files.plain_data import stamp, write_json
from gplfd_policies.agents.commanded_path import CommandedPath
from gplfd_policies.arrays.storage import complete_or_absent

KIND: Final = "a gplfd commanded path"
_TOPICS: Final = ("/target_pose", "/target_stiffness")
"""Topics of crisp_controllers; it reads the second since its pull request 46."""
_UNITS: Final = {
    "std": ("m", "rad"),
    "stiffness": ("N/m", "N m/rad"),
    "damping": ("N s/m", "N m s/rad"),
    "margin": ("N/(m s)", "N m/(rad s)"),
}


def states_of(poses: FloatArray) -> FloatArray:
    """Return poses [m, rad], (N, 6), as positions and quaternions, scalar last."""
    states = np.hstack([poses[:, :3], Rotation.from_rotvec(poses[:, 3:]).as_quat()])
    flips = np.sum(states[1:, 3:] * states[:-1, 3:], axis=1) < 0.0
    states[1:, 3:] *= np.cumprod(np.where(flips, -1.0, 1.0))[:, None]
    return states


def write_csv(file: Path, path: CommandedPath, about: Mapping[str, Any]) -> None:
    """Write a table with comments and a header that names units."""
    heads = ["time [s]", "x [m]", "y [m]", "z [m]", "qx", "qy", "qz", "qw"]
    heads += [f"path_{axis} [m]" for axis in "xyz"]
    for name, units in _UNITS.items():
        for prefix, unit in zip(("", "r"), units, strict=True):
            heads += [f"{name}_{prefix}{axis} [{unit}]" for axis in "xyz"]
    frame, more = about["frame"], [getattr(path, name) for name in _UNITS]
    comments = [f"# {KIND}", f"# frame {frame['name']}: {frame['axes']}"]
    columns = [path.times[:, None], states_of(path.poses), path.path[:, :3], *more]
    _write(file, [*comments, ",".join(heads)], np.hstack(columns), ",")


def write_tum(file: Path, path: CommandedPath, about: Mapping[str, Any]) -> None:
    """Write set-points as a trajectory of TUM."""
    columns = np.hstack([path.times[:, None], states_of(path.poses)])
    _write(file, ["# timestamp x y z qx qy qz qw"], columns, " ")


def _write(file: Path, head: list[str], rows: np.ndarray, separator: str) -> None:
    lines = [*head, *(separator.join(map(repr, row)) for row in rows.tolist()), ""]
    with complete_or_absent(file) as temporary:
        temporary.write_text("\n".join(lines), encoding="utf-8", newline="\n")


def write_everything(file: Path, path: CommandedPath, about: Mapping[str, Any]) -> None:
    """Write JSON with frame, units and origin."""
    states = states_of(path.poses)
    samples = {
        "time": path.times.tolist(),
        "position": states[:, :3].tolist(),
        "quaternion_xyzw": states[:, 3:].tolist(),
        "path_position": path.path[:, :3].tolist(),
        **{name: getattr(path, name).tolist() for name in _UNITS},
    }
    units = {"time": "s", "position": "m", "path_position": "m"} | _UNITS
    entries = {**stamp(KIND, 1), **about, "units": units, "samples": samples}
    write_json(file, entries, indent=None)


def bag_library() -> Any:
    """Return rosbags; raise ModuleNotFoundError without it."""
    with optional_libraries("ROS bags need rosbags", "ros"):
        import rosbags.rosbag2
        import rosbags.typesys
    return rosbags


def write_bag(folder: Path, path: CommandedPath, about: Mapping[str, Any]) -> None:
    """Write a ROS 2 bag in SQLite; raise ModuleNotFoundError without rosbags."""
    rosbags = bag_library()
    types, ros2 = rosbags.typesys, rosbags.rosbag2
    store = types.get_typestore(types.Stores.ROS2_HUMBLE)
    kinds = "geometry_msgs/msg/PoseStamped", "std_msgs/msg/Float64MultiArray"

    def message(kind: str, *parts: Any) -> Any:
        return store.types[kind](*parts)

    layout = message("std_msgs/msg/MultiArrayLayout", [], 0)
    rows = zip(path.times, states_of(path.poses).tolist(), path.stiffness, strict=True)
    with (
        complete_folder(folder) as made,
        ros2.Writer(made, version=9, storage_plugin=ros2.StoragePlugin.SQLITE3) as bag,
    ):
        topics = [
            bag.add_connection(name, kind, typestore=store)
            for name, kind in zip(_TOPICS, kinds, strict=True)
        ]
        for seconds, state, k in rows:
            at = round(1e9 * float(seconds))
            time = message("builtin_interfaces/msg/Time", *divmod(at, 10**9))
            header = message("std_msgs/msg/Header", time, about["frame"]["name"])
            point = message("geometry_msgs/msg/Point", *state[:3])
            turn = message("geometry_msgs/msg/Quaternion", *state[3:])
            pose = message("geometry_msgs/msg/Pose", point, turn)
            contents = message(kinds[0], header, pose), message(kinds[1], layout, k)
            for topic, content in zip(topics, contents, strict=True):
                bag.write(topic, at, store.serialize_cdr(content, topic.msgtype))


COMMAND_WRITERS: Final = dict(
    csv=write_csv, tum=write_tum, bag=write_bag, json=write_everything
)
"""Writers by format; its name is also the suffix."""
