"""LeRobot data sets, version 3: one motion per episode, from parquet files.

The hand is a feature of the data set, by default ``observation.state``. The names of
its numbers are in the data set, or given by ``--columns``. Forces and moments are the
six numbers of ``observation.force`` or of another feature.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from gplfd_experiments.data.raw import OBSERVED, RawRecording, Selection, chosen
from gplfd_experiments.data.readers.tables import FORCE, named_columns, recording
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.files.libraries import optional_libraries
from gplfd_experiments.files.plain_data import entry, read_json

with optional_libraries("LeRobot's data sets need pyarrow", "lerobot"):
    import pyarrow.parquet as parquet

INFO: Final = "meta/info.json"
STATE: Final = "observation.state"
WRENCH: Final = "observation.force"
AS_OBSERVED: Final = {"wrench": "of the environment on the hand, axes of the state"}
"""Entry ``info`` of the feature of wrenches that gplfd writes."""
_VERSION: Final = "v3."


def read(path: Path, selection: Selection) -> list[RawRecording]:
    """Read every episode of a data set."""
    info = read_json(path / INFO)
    version = entry(info, "codebase_version", str)
    if not version.startswith(_VERSION):
        raise ValueError(
            f"it has version {version:.20}, but only {_VERSION}x can be read; convert "
            "it with LeRobot's own script convert_dataset_v21_to_v30"
        )
    vectors = {
        name: feature
        for name, feature in entry(info, "features", dict[str, Any]).items()
        if isinstance(feature, dict)
        and str(feature.get("dtype", "")).startswith("float")
    }
    name, feature = chosen(
        selection.body or STATE, vectors, "feature of numbers", file=path.name
    )
    # The names of its numbers: a list, or lists by group.
    names = feature.get("names")
    if isinstance(names, dict):
        names = [column for group in names.values() for column in group]
    if not selection.columns and not isinstance(names, list):
        raise ValueError(
            "its numbers have no names; give them in their order: --columns x,y,z,..."
        )
    heads = selection.columns or list(map(str, names))
    places = named_columns(heads, "--columns" if selection.columns else f"{name!r}")
    force, sensor = selection.wrench, None
    if vectors.get(WRENCH, {}).get("shape") == [len(FORCE)]:
        force = force or WRENCH
    if force is not None:
        _, wrench = chosen(force, vectors, "feature of numbers", file=path.name)
        sensor = OBSERVED if wrench.get("info") == AS_OBSERVED else None
    rate = float(entry(info, "fps", float))
    if not 0.0 < rate < 1e6:
        raise ValueError(f"fps is {rate}")
    files = sorted((path / "data").glob("*/*.parquet"))
    if not files:
        raise ValueError("there is no parquet file in its folder data")
    # Episode, frame and feature of every row, in order.
    wanted = ("episode_index", "frame_index", name, *([force] if force else []))
    parts = []
    for file in files:
        table = parquet.read_table(file, columns=sorted(set(wanted)), partitioning=None)
        numbers = [_rows(table[column].combine_chunks()) for column in wanted[2:]]
        indices = [table[index].to_numpy() for index in wanted[:2]]
        parts.append((*indices, *numbers))
    episodes, frames, values, *wrenches = map(np.concatenate, zip(*parts, strict=True))
    episodes, frames = episodes.astype(np.int64), frames.astype(np.float64)
    if values.shape[1] != len(heads):
        raise ValueError(
            f"{name} has {values.shape[1]} numbers, and {len(heads)} names"
        )
    if wrenches and wrenches[0].shape[1] != len(FORCE):
        raise ValueError(
            f"{force} has {wrenches[0].shape[1]} numbers, not {', '.join(FORCE)}"
        )
    # The times are those of the frames, in seconds.
    seconds = replace(selection, time_unit="s")
    recordings = []
    order = np.argsort(episodes, kind="stable")
    starts = np.flatnonzero(np.diff(episodes[order])) + 1
    for rows in np.split(order, starts):
        columns = {
            key: (values[rows, place], unit) for key, (place, unit) in places.items()
        }
        columns["t"] = (frames[rows] / rate, "s")
        for wrench in wrenches:
            columns |= {key: (wrench[rows, at], None) for at, key in enumerate(FORCE)}
        label = f"{path.name}: episode {episodes[rows[0]]}"
        recordings.append(replace(recording(label, columns, seconds), sensor=sensor))
    return recordings


def _rows(lists: Any) -> FloatArray:
    """Return lists of equal length as rows."""
    flat = lists.flatten().to_numpy(zero_copy_only=False)
    if lists.null_count or len(lists) == 0 or len(flat) % len(lists):
        raise ValueError("a row lacks numbers")
    rows = np.asarray(flat, dtype=np.float64).reshape(len(lists), -1)
    if len(lists[0]) != rows.shape[1]:
        raise ValueError("its rows differ in length")
    return rows
