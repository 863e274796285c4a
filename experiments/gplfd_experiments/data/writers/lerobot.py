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
from gplfd_experiments.files.folders import complete_folder
from gplfd_experiments.files.plain_data import write_json

_NAMES: Final = ("x", "y", "z", "qx", "qy", "qz", "qw")
_PICTURES: Final = "observation.images."
_SAMPLED: Final = 50  # Pictures from which the statistics of colours are taken.
_FILE: Final = "chunk-000/file-000.parquet"


@dataclass(frozen=True, slots=True)
class _Numbers:
    """A column of numbers, or of vectors of them."""

    values: np.ndarray
    """One per row, (N,) or (N, d)."""
    names: Sequence[str] | None = None
    """Of a vector's components."""

    def __len__(self) -> int:
        return len(self.values)

    def arrow(self) -> Any:
        """Return the column as Arrow's."""
        if self.values.ndim == 1:
            return pyarrow.array(self.values)
        flat = pyarrow.array(np.ascontiguousarray(self.values).ravel())
        return pyarrow.FixedSizeListArray.from_arrays(flat, self.values.shape[1])

    def samples(self) -> np.ndarray:
        """Return what statistics are taken of, (N, d)."""
        return self.values.astype(np.float64).reshape(len(self), -1)

    def feature(self) -> dict[str, Any]:
        """Return what LeRobot wants to know of the column."""
        return {
            "dtype": str(self.values.dtype),
            "shape": [self.values.shape[1] if self.values.ndim == 2 else 1],
            "names": self.names and list(self.names),
        }


@dataclass(frozen=True, slots=True)
class _Pictures:
    """A column of pictures."""

    files: Sequence[bytes]
    """PNG files, one per row."""

    def __len__(self) -> int:
        return len(self.files)

    def arrow(self) -> Any:
        """Return the column as Arrow's."""
        kind = pyarrow.struct([("bytes", pyarrow.binary()), ("path", pyarrow.string())])
        return pyarrow.array([{"bytes": f, "path": None} for f in self.files], kind)

    def samples(self) -> np.ndarray:
        """Return red, green and blue from 0 to 1 of some pictures, (N, 3, 1, 1)."""
        some = self.files[:: max(1, len(self.files) // _SAMPLED)]
        pixels = [np.asarray(_opened(file)).reshape(-1, 3, 1, 1) for file in some]
        return np.concatenate(pixels) / 255.0

    def feature(self) -> dict[str, Any]:
        """Return what LeRobot wants to know of the column."""
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
    # Where each episode stands.
    lengths = np.array([len(one.states) for one in demonstrations])
    ends = np.cumsum(lengths)
    zeros = np.zeros(len(lengths), dtype=np.int64)
    episodes = {
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
    tasks = pyarrow.table({"task_index": [0], "task": [demonstrations[0].task]})
    statistics = {}
    for name, column in columns.items():
        samples = column.samples()
        statistics[name] = {
            statistic: getattr(samples, statistic)(axis=0).tolist()
            for statistic in ("min", "max", "mean", "std")
        } | {"count": [len(column)]}
    info = {
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
        "features": {name: column.feature() for name, column in columns.items()},
    }
    with complete_folder(path) as written:
        for folder in ("meta/episodes/chunk-000", "data/chunk-000"):
            (written / folder).mkdir(parents=True)
        data = pyarrow.table({name: one.arrow() for name, one in columns.items()})
        for table, file in (
            (data, f"data/{_FILE}"),
            (pyarrow.table(episodes), f"meta/episodes/{_FILE}"),
            (_indexed_by("task", tasks), "meta/tasks.parquet"),
        ):
            pyarrow.parquet.write_table(table, written / file)
        write_json(written / "meta/stats.json", statistics)
        write_json(written / INFO, info, indent=4)


def _columns(
    demonstrations: Sequence[Rows], rate: int
) -> Mapping[str, _Numbers | _Pictures]:
    """Return the columns of all samples, one episode after the other."""

    def stacked(parts: Sequence[np.ndarray], names: Any = None) -> _Numbers:
        return _Numbers(np.vstack(parts).astype(np.float32), names)

    lengths = [len(one.states) for one in demonstrations]
    frames = np.concatenate([np.arange(length) for length in lengths])
    columns: dict[str, _Numbers | _Pictures] = {
        STATE: stacked([one.states for one in demonstrations], _NAMES),
        "action": stacked([one.actions for one in demonstrations], _NAMES),
    }
    for name in sorted({name for one in demonstrations for name in one.signals}):
        if all(name in one.signals for one in demonstrations):
            parts = [one.signals[name] for one in demonstrations]
            columns[f"observation.{name}"] = stacked(parts)
    for camera in demonstrations[0].pictures:
        files = [file for one in demonstrations for file in one.pictures[camera]]
        columns[f"{_PICTURES}{camera}"] = _Pictures(files)
    return columns | {
        "timestamp": _Numbers((frames / rate).astype(np.float32)),
        "frame_index": _Numbers(frames),
        "episode_index": _Numbers(np.repeat(np.arange(len(lengths)), lengths)),
        "index": _Numbers(np.arange(len(frames))),
        "task_index": _Numbers(np.zeros(len(frames), dtype=np.int64)),
    }


def _indexed_by(index: str, table: Any) -> Any:
    """Return a table of which pandas takes a column as its index."""
    types = {"int64": ("int64", "int64"), "string": ("unicode", "object")}
    columns = [
        {
            "name": field.name,
            "field_name": field.name,
            "pandas_type": types[str(field.type)][0],
            "numpy_type": types[str(field.type)][1],
            "metadata": None,
        }
        for field in table.schema
    ]
    pandas = {"index_columns": [index], "columns": columns, "column_indexes": []}
    return table.replace_schema_metadata({"pandas": json.dumps(pandas)})
