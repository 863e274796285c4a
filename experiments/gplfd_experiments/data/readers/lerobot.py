"""LeRobot data sets, version 3: one motion per episode, from parquet files.

The hand is a feature of the data set, by default ``observation.state``. The names of
its numbers are in the data set, or given by ``--columns``. Forces and moments are the
six numbers of ``observation.force`` or of another feature.
"""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from gplfd_experiments.data.raw import RawRecording, chosen
from gplfd_experiments.data.readers.tables import (
    FORCE,
    named_columns,
    recording,
    understood,
)
from gplfd_experiments.data.settings import ImportSettings
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.files.libraries import optional_libraries
from gplfd_experiments.files.plain_data import entry, read_json

with optional_libraries("LeRobot's data sets need pyarrow", "lerobot"):
    import pyarrow.parquet as parquet

INFO: Final = "meta/info.json"
STATE: Final = "observation.state"
WRENCH: Final = "observation.force"
_ORIENTED: Final = re.compile("roll|pitch|yaw|rot|quat|orient|euler|rpy")
AS_OBSERVED: Final = {"wrench": "of the environment on the hand, axes of the state"}
"""Entry ``info`` of the feature of wrenches that gplfd writes."""


def read(path: Path, settings: ImportSettings) -> list[RawRecording]:
    """Read every episode of a data set."""
    info = read_json(path / INFO)
    version = entry(info, "codebase_version", str)
    if not version.startswith("v3."):
        raise ValueError(
            f"it has version {version:.20}, but only v3.x can be read; convert it with "
            "LeRobot's own script convert_dataset_v21_to_v30"
        )
    vectors = {
        name: feature
        for name, feature in entry(info, "features", dict[str, dict[str, Any]]).items()
        if str(feature.get("dtype", "")).startswith("float")
    }

    def feature_named(name: str) -> Any:
        return chosen(name, vectors, "feature of numbers", file=path.name)[1]

    name = settings.body or STATE
    # The names of its numbers: a list, or lists by group.
    names = feature_named(name).get("names")
    if isinstance(names, dict):
        names = [column for group in names.values() for column in group]
    if not settings.columns and not isinstance(names, list):
        raise ValueError(
            "its numbers have no names; give them in their order: --columns x,y,z,..."
        )
    heads = settings.columns or list(map(str, names))
    places = named_columns(heads, "--columns" if settings.columns else f"{name!r}")
    force, observed = settings.wrench, False
    if vectors.get(WRENCH, {}).get("shape") == [len(FORCE)]:
        force = force or WRENCH
    if force is not None:
        observed = feature_named(force).get("info") == AS_OBSERVED
    unused = [head for head in heads if understood(head)[0] is None]
    unused += vectors.keys() - {name, force}
    unused = sorted(text for text in unused if _ORIENTED.search(text.lower()))
    not_used = f"{', '.join(unused)!s:.200} are not used: it has no orientation"
    rate = entry(info, "fps", float)
    files = sorted((path / "data").glob("*/*.parquet"))
    if not files or not rate > 0.0:
        raise ValueError(f"fps is {rate:g}, and {len(files)} parquet files are in data")
    # Episode, frame and feature of every row, in order.
    wanted = ("episode_index", "frame_index", name, *([force] if force else []))
    parts = []
    for file in files:
        table = parquet.read_table(file, columns=sorted(set(wanted)), partitioning=None)
        indices = [table[index].to_numpy() for index in wanted[:2]]
        parts.append((*indices, *(_rows(table[column]) for column in wanted[2:])))
    episodes, frames, values, *wrenches = map(np.concatenate, zip(*parts, strict=True))
    for source, numbers, meanings in (
        (name, values, heads),
        *((force, wrench, FORCE) for wrench in wrenches),
    ):
        if numbers.shape[1] != len(meanings):
            raise ValueError(
                f"{source} has {numbers.shape[1]} numbers, not {', '.join(meanings)}"
            )
    # The times are those of the frames, in seconds.
    settings = replace(settings, time_unit="s")
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
        label = f"{path.name}: episode {int(episodes[rows[0]])}"
        motion = recording(label, columns, settings)
        if motion.quaternions is None and unused:
            motion = replace(motion, notes=(*motion.notes, not_used))
        recordings.append(replace(motion, forces_on="hand" if observed else None))
    return recordings


def _rows(column: Any) -> FloatArray:
    """Return lists of equal length as rows."""
    lists = column.combine_chunks()
    flat = lists.flatten().to_numpy(zero_copy_only=False)
    if lists.null_count or len(lists) == 0 or len(flat) != len(lists) * len(lists[0]):
        raise ValueError("a row lacks numbers, or has more than the first")
    return np.asarray(flat, dtype=np.float64).reshape(len(lists), -1)
