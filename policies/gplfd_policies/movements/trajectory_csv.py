"""A trajectory as a table that any robot's program can read."""

import csv
import math
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float

from gplfd_policies.arrays.storage import complete_or_absent

COLUMNS: Final = (
    "time [s],x [m],y [m],z [m],qx,qy,qz,qw,std_x [m],std_y [m],std_z [m],"
    "std_rx [rad],std_ry [rad],std_rz [rad]"
)
"""First line of the table: quantities and their units."""

ABOUT: Final = """\
# A trajectory of the hand by gplfd, version 1.
# Frame: as demonstrated. On doors: origin at the closed handle, x pulls, y up, z = x
# cross y; orientations are relative to that of the hand at the closed door.
# qx, qy, qz, qw is a unit quaternion, the scalar last, its sign continuous in time.
# std_x to std_rz are standard deviations of a repetition of the task: of the position
# and of the rotation vector; nan where the method has none.
"""
"""Lines before the table."""


def write_csv(
    path: str | Path,
    times: Float[np.ndarray, " M"],
    poses: Float[np.ndarray, "M 6"],
    stds: Float[np.ndarray, "M 6"],
) -> None:
    """Write times [s], poses and standard deviations, complete or not at all.

    Raises:
        ValueError: The times do not increase strictly, or a pose is not finite.
        OSError: The file cannot be written.
    """
    if not (np.diff(times) > 0.0).all():
        raise ValueError(f"the times of a table must increase strictly, got {times}")
    if not np.isfinite(poses).all():
        raise ValueError("the poses of a table must be finite; found NaN or infinity")
    rotvecs = poses[:, 3:]
    # Continuous as the rotation vectors are, without a look at neighbouring samples.
    half = 0.5 * np.linalg.norm(rotvecs, axis=1, keepdims=True)
    quaternions = np.hstack([0.5 * np.sinc(half / math.pi) * rotvecs, np.cos(half)])
    table = np.hstack([times[:, None], poses[:, :3], quaternions, stds])
    with (
        complete_or_absent(path) as temporary,
        temporary.open("w", encoding="utf-8", newline="") as file,
    ):
        file.write(f"{ABOUT}{COLUMNS}\n")
        csv.writer(file, lineterminator="\n").writerows(table.tolist())
