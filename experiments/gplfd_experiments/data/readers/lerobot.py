"""LeRobot data sets, version 3: one motion per episode, from parquet files."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from gplfd_experiments.data.raw import RawRecording, chosen
from gplfd_experiments.data.readers import tables
from gplfd_experiments.data.settings import ImportSettings
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.files.libraries import optional_libraries
from gplfd_experiments.files.plain_data import entry, read_json

INFO: Final = "meta/info.json"
STATE: Final = "observation.state"
WRENCH: Final = "observation.force"
_ORIENTED: Final = re.compile("roll|pitch|yaw|rot|quat|orient|euler|rpy")
AS_OBSERVED: Final = {"wrench": "of the environment on the hand, axes of the state"}
"""Entry ``info`` of the feature of wrenches that gplfd writes."""


def read(path: Path, settings: ImportSettings) -> list[RawRecording]:
    """Read every episode of a data set."""
    with optional_libraries("LeRobot's data sets need pyarrow", "lerobot"):
        import pyarrow
        from pyarrow import parquet
    info = read_json(path / INFO)
    version = entry(info, "codebase_version", str)
    if not version.startswith("v3."):
        raise ValueError(
            f"it has version {version:.20}, but only v3.x can be read; convert it with "
            "LeRobot's own script convert_dataset_v21_to_v30"
        )
    features = entry(info, "features", dict[str, dict[str, Any]]).items()
    vectors = {n: f for n, f in features if str(f.get("dtype", "")).startswith("float")}
    name = settings.body or STATE
    _, state = chosen(name, vectors, "feature of numbers", file=path.name)
    # The names of its numbers: a list, or lists by group.
    names = state.get("names")
    if isinstance(names, dict):
        names = [column for group in names.values() for column in group]
    heads = settings.columns or list(map(str, names or ()))
    if not heads:
        raise ValueError(
            "its numbers have no names; give them in their order: --columns x,y,z,..."
        )
    where = "--columns" if settings.columns else repr(name)
    places = tables.named_columns(heads, where)
    force = settings.wrench
    if vectors.get(WRENCH, {}).get("shape") == [len(tables.FORCE)]:
        force = force or WRENCH
    observed, widths = False, {name: len(heads)}
    if force is not None:
        _, feature = chosen(force, vectors, "feature of numbers", file=path.name)
        observed, widths[force] = feature.get("info") == AS_OBSERVED, len(tables.FORCE)
    unused = {head for head in heads if tables.understood(head)[0] is None}
    unused |= vectors.keys() - widths.keys()
    unused = {text for text in unused if _ORIENTED.search(text.lower())}
    not_used = f"{', '.join(sorted(unused))!s:.200} are not used: it has no orientation"
    rate = entry(info, "fps", float)
    files = sorted((path / "data").glob("*/*.parquet"))
    if not files or not rate > 0.0:
        raise ValueError(f"fps is {rate:g}, and {len(files)} parquet files are in data")
    wanted = ["episode_index", "frame_index", *widths]
    parts = [parquet.read_table(f, columns=wanted, partitioning=None) for f in files]
    table = pyarrow.concat_tables(parts)
    episodes, frames = (table[index].to_numpy() for index in wanted[:2])
    numbers = {}
    for source, width in widths.items():
        lists = table[source].combine_chunks()
        flat = lists.flatten().to_numpy(zero_copy_only=False)
        if lists.null_count or len(flat) != len(lists) * width:
            raise ValueError(f"{source} does not have {width} numbers in every row")
        numbers[source] = flat.astype(np.float64).reshape(-1, width)
    columns: dict[str, tuple[FloatArray, str | None]] = {
        **{key: (numbers[name][:, at], unit) for key, (at, unit) in places.items()},
        "t": (frames / rate, "s"),
    }
    if force is not None:
        forces = zip(tables.FORCE, numbers[force].T, strict=True)
        columns |= {key: (column, None) for key, column in forces}
    # The times are those of the frames, in seconds.
    settings = replace(settings, time_unit="s")
    recordings = []
    order = np.argsort(episodes, kind="stable")
    starts = np.flatnonzero(np.diff(episodes[order])) + 1
    for rows in np.split(order, starts):
        label = f"{path.name}: episode {int(episodes[rows[0]])}"
        of_episode = {key: (column[rows], u) for key, (column, u) in columns.items()}
        motion = tables.recording(label, of_episode, settings)
        if motion.quaternions is None and unused:
            motion = replace(motion, notes=(*motion.notes, not_used))
        recordings.append(replace(motion, forces_on="hand" if observed else None))
    return recordings
