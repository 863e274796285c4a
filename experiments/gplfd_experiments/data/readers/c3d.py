"""C3D files of optical motion capture: a marker, or the rigid body of several."""

import math
import struct
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from gplfd_experiments.data.raw import RawRecording, chosen
from gplfd_experiments.data.settings import ImportSettings
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.files.libraries import optional_libraries

with optional_libraries("C3D files need ezc3d", "c3d"):
    import ezc3d

_UNITS: Final = {"mm": "mm", "m": "m", "cm": "cm", "in": "in", "meters": "m"}
_TRIAL: Final = "ACTUAL_END_FIELD", "ACTUAL_START_FIELD"
_UNCOUNTED: Final = 2**16 - 1  # Last frame in the header of a longer file.
_RIGID: Final = 0.01
"""Distances of markers on a rigid body are constant to this share of its size."""
_MOSTLY: Final = 0.5  # Share of the frames with all markers in which this must be true.


def read(path: Path, settings: ImportSettings) -> list[RawRecording]:
    """Read the motion of a marker (positions only) or of a rigid body.

    The body is given by its markers, ``--body A,B,C``: its origin is their mean, its
    axes are those of the file at the first sample that has them all.
    """
    file = ezc3d.c3d(str(path))
    points, parameters = file["data"]["points"], file["parameters"]["POINT"]
    rate, count = float(file["header"]["points"]["frame_rate"]), points.shape[2]
    # ezc3d corrects the number of frames of a cut file.
    with path.open("rb") as stream:
        first, last = struct.unpack_from("<HH", stream.read(10), 6)
    if not 0.0 < rate < math.inf or (last < _UNCOUNTED and count <= last - first):
        raise ValueError(
            f"it says it has {last - first + 1} frames at {rate:g} Hz, and has {count}:"
            " it is cut"
        )
    notes = []
    trial = file["parameters"].get("TRIAL", {})
    fields = [trial.get(name, {}).get("value", ()) for name in _TRIAL]
    ends = [int(low) + 65536 * int(high) for low, high in filter(len, fields)]
    if len(ends) == 2 and ends[0] - ends[1] >= count:
        notes.append(
            f"only {count} of its {ends[0] - ends[1] + 1} frames are read, which its "
            "header counts; export it in parts"
        )
    markers = points[:3].transpose(2, 1, 0)
    # Programs that cannot write a missing marker write zeros.
    markers = np.where((markers == 0.0).all(axis=2, keepdims=True), np.nan, markers)
    # Markers by their labels; by numbers if labels are missing.
    labels: list[str] = []
    for number in ("", *map(str, range(2, 20))):
        labels += parameters.get(f"LABELS{number}", {}).get("value", [])
    labels += map(str, range(len(labels) + 1, points.shape[1] + 1))
    places = {label.strip(): at for at, label in enumerate(labels[: points.shape[1]])}
    body, quaternions = settings.body, None
    if body is not None and "," in body and body not in places:
        names = [name.strip() for name in body.split(",")]
        columns = [chosen(name, places, "marker", file=path.name)[1] for name in names]
        positions, quaternions = _rigid_body(markers[:, columns], names)
    else:
        body, place = chosen(body, places, "marker", file=path.name)
        positions = markers[:, place]
    unit = "".join(parameters.get("UNITS", {}).get("value", [])[:1]).strip().lower()
    if unit and unit not in _UNITS and settings.units is None:
        raise ValueError(
            f"POINT:UNITS is {unit!r:.40}, known are {', '.join(_UNITS)}; say --units"
        )
    name, times = f"{path.name}: {body}", np.arange(count) / rate
    motion = RawRecording(name, positions, _UNITS.get(unit), times, quaternions)
    return [replace(motion, notes=tuple(notes))]


def _rigid_body(markers: FloatArray, names: list[str]) -> tuple[FloatArray, FloatArray]:
    """Return mean and orientation of markers, (N, M, 3), by Kabsch's method."""
    seen = np.isfinite(markers).all(axis=(1, 2))
    means = markers.mean(axis=1)
    arms = markers - means[:, None]
    shape = arms[np.argmax(seen)]
    quaternions = np.full((len(markers), 4), np.nan)
    problem = "no frame has all of them"
    if len(set(names)) < 3:
        problem = "it needs three"
    elif seen.any():
        size = np.linalg.svd(shape, compute_uv=False)
        for frame in np.flatnonzero(seen):
            rotation, distance = Rotation.align_vectors(arms[frame], shape)
            if distance <= math.sqrt(len(names)) * _RIGID * size[0]:
                quaternions[frame] = rotation.as_quat(scalar_first=True)
        rigid, complete = np.isfinite(quaternions[:, 0]).sum(), seen.sum()
        if size[1] >= 1e-3 * size[0] and rigid >= _MOSTLY * complete:
            return means, quaternions
        problem = (
            f"they lie on a line, or keep their distances to {_RIGID:.0%} in only "
            f"{rigid} of {complete} frames"
        )
    raise ValueError(
        f"the markers {', '.join(names)} are on no rigid body: {problem}; choose other "
        "markers, or one for positions alone"
    )
