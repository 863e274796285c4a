"""Demonstrations as a data set of LeRobot, version 3: parquet files, no videos.

The layout is that of LeRobot's own writer. ``observation.state`` is position and
quaternion, ``action`` what it is to become, both in float32 as LeRobot's are. Pictures
stand in the table as PNG files, LeRobot's kind "image".
"""

import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow
import pyarrow.parquet
from PIL import Image

from gplfd_experiments.data.readers.lerobot import INFO, STATE
from gplfd_experiments.data.writers.rows import Rows
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.files.folders import complete_folder
from gplfd_experiments.files.plain_data import write_json

_NAMES: Final = ("x", "y", "z", "qx", "qy", "qz", "qw")
_PICTURES: Final = "observation.images."
_LOOKED_AT: Final = 50
"""Pictures from which the range of colours is told."""
_FILE: Final = "chunk-000/file-000.parquet"


@dataclass(frozen=True, slots=True)
class _Pictures:
    """A column of pictures."""

    files: Sequence[bytes]
    """PNG files, one per row."""

    def __len__(self) -> int:
        return len(self.files)

    def colours(self) -> FloatArray:
        """Return red, green and blue from 0 to 1 of some of the pictures, (N, 3)."""
        some = self.files[:: max(1, len(self.files) // _LOOKED_AT)]
        pixels = [np.asarray(_opened(file)).reshape(-1, 3) for file in some]
        return np.concatenate(pixels) / 255.0

    def feature(self) -> dict[str, Any]:
        """Return what LeRobot wants to know of them."""
        width, height = _opened(self.files[0]).size
        return {
            "dtype": "image",
            "shape": [height, width, 3],
            "names": ["height", "width", "channels"],
        }


def _opened(file: bytes) -> Image.Image:
    return Image.open(io.BytesIO(file))


def write(path: Path, demonstrations: Sequence[Rows]) -> None:
    """Write a data set.

    Raises:
        ValueError: The samples per second are no whole number, as LeRobot has it.
        OSError: It cannot be written.
    """
    rate = round(demonstrations[0].rate)
    if any(abs(one.rate / max(rate, 1) - 1.0) > 0.01 for one in demonstrations):
        raise ValueError(
            f"LeRobot counts whole samples per second, got {demonstrations[0].rate:.4g}"
            "; import the recordings with --rate 100"
        )
    columns = _columns(demonstrations, rate)
    with complete_folder(path) as written:
        for folder in ("meta/episodes/chunk-000", "data/chunk-000"):
            (written / folder).mkdir(parents=True)
        _write_table(written / "data" / _FILE, columns)
        _write_table(written / "meta/episodes" / _FILE, _episodes(demonstrations))
        tasks = {"task_index": np.array([0]), "task": [demonstrations[0].task]}
        _write_table(written / "meta/tasks.parquet", tasks, index="task")
        write_json(written / "meta/stats.json", _statistics(columns))
        write_json(written / INFO, _info(demonstrations, columns, rate), indent=4)


def _columns(demonstrations: Sequence[Rows], rate: int) -> dict[str, Any]:
    """Return the columns of all samples, one episode after the other."""
    lengths = [len(one.states) for one in demonstrations]
    frames = np.concatenate([np.arange(length) for length in lengths])
    columns: dict[str, Any] = {
        STATE: np.vstack([one.states for one in demonstrations]),
        "action": np.vstack([one.actions for one in demonstrations]),
    }
    for name in sorted({name for one in demonstrations for name in one.signals}):
        parts = [one.signals.get(name) for one in demonstrations]
        if all(part is not None for part in parts):
            columns[f"observation.{name}"] = np.vstack(
                [p for p in parts if p is not None]
            )
    columns = {name: array.astype(np.float32) for name, array in columns.items()}
    for camera in demonstrations[0].pictures:
        files = [file for one in demonstrations for file in one.pictures[camera]]
        columns[f"{_PICTURES}{camera}"] = _Pictures(files)
    return columns | {
        "timestamp": (frames / rate).astype(np.float32),
        "frame_index": frames,
        "episode_index": np.repeat(np.arange(len(lengths)), lengths),
        "index": np.arange(len(frames)),
        "task_index": np.zeros(len(frames), dtype=np.int64),
    }


def _episodes(demonstrations: Sequence[Rows]) -> dict[str, Any]:
    """Return where each episode stands."""
    lengths = np.array([len(one.states) for one in demonstrations])
    ends = np.cumsum(lengths)
    zeros = np.zeros(len(lengths), dtype=np.int64)
    return {
        "episode_index": np.arange(len(lengths)),
        "tasks": [[one.task] for one in demonstrations],
        "length": lengths,
        "data/chunk_index": zeros,
        "data/file_index": zeros,
        "dataset_from_index": ends - lengths,
        "dataset_to_index": ends,
        "meta/episodes/chunk_index": zeros,
        "meta/episodes/file_index": zeros,
    }


def _write_table(path: Path, columns: Mapping[str, Any], index: str = "") -> None:
    """Write a parquet file; the named column is pandas' index."""
    arrays = {name: _array(column) for name, column in columns.items()}
    table = pyarrow.table(arrays)
    if index:
        table = table.replace_schema_metadata({"pandas": _indexed_by(index, table)})
    pyarrow.parquet.write_table(table, path)


def _array(column: Any) -> Any:
    """Return a column as Arrow's."""
    if isinstance(column, _Pictures):
        kind = pyarrow.struct([("bytes", pyarrow.binary()), ("path", pyarrow.string())])
        files = [{"bytes": file, "path": None} for file in column.files]
        return pyarrow.array(files, kind)
    if getattr(column, "ndim", 1) == 1:
        return pyarrow.array(column)
    flat = pyarrow.array(np.ascontiguousarray(column).ravel())
    return pyarrow.FixedSizeListArray.from_arrays(flat, column.shape[1])


def _indexed_by(index: str, table: Any) -> str:
    """Return what tells pandas that a column is the index."""
    types = {"int64": "int64", "string": "unicode"}
    columns = [
        {
            "name": field.name,
            "field_name": field.name,
            "pandas_type": types[str(field.type)],
            "numpy_type": "int64" if str(field.type) == "int64" else "object",
            "metadata": None,
        }
        for field in table.schema
    ]
    return json.dumps(
        {"index_columns": [index], "columns": columns, "column_indexes": []}
    )


def _statistics(columns: Mapping[str, Any]) -> dict[str, Any]:
    """Return what LeRobot normalises by."""
    found = {}
    for name, column in columns.items():
        if isinstance(column, _Pictures):
            table = column.colours()[:, :, None, None]
        else:
            table = np.asarray(column, dtype=np.float64).reshape(len(column), -1)
        found[name] = {
            statistic: getattr(table, statistic)(axis=0).tolist()
            for statistic in ("min", "max", "mean", "std")
        } | {"count": [len(column)]}
    return found


def _info(
    demonstrations: Sequence[Rows], columns: Mapping[str, Any], rate: int
) -> dict[str, Any]:
    """Return what describes the data set."""
    features = {
        name: column.feature()
        if isinstance(column, _Pictures)
        else {
            "dtype": str(column.dtype),
            "shape": [column.shape[1] if column.ndim == 2 else 1],
            "names": list(_NAMES) if name in (STATE, "action") else None,
        }
        for name, column in columns.items()
    }
    return {
        "codebase_version": "v3.0",
        "robot_type": None,
        "total_episodes": len(demonstrations),
        "total_frames": len(columns["index"]),
        "total_tasks": 1,
        "chunks_size": 1000,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": rate,
        "splits": {"train": f"0:{len(demonstrations)}"},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": None,
        "features": features,
    }
