"""LeRobot data sets, version 3: one motion per episode, from parquet files.

The hand is a feature of the data set, by default ``observation.state``. The names of
its numbers are in the data set, or given by ``--columns``. Forces and moments are the
six numbers of ``observation.force`` or of another feature.
"""

from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np

from gplfd_experiments.data.raw import OBSERVED, RawRecording, Selection, chosen
from gplfd_experiments.data.readers.tables import FORCE, named_columns, recording
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.files.libraries import optional_libraries
from gplfd_experiments.files.plain_data import entry, read_json
from gplfd_policies.arrays.storage import DecodingBudget, regular_file

with optional_libraries("LeRobot's data sets need pyarrow", "lerobot"):
    import pyarrow.parquet as parquet

INFO: Final = "meta/info.json"
STATE: Final = "observation.state"
WRENCH: Final = "observation.force"
AS_OBSERVED: Final = {"wrench": "of the environment on the hand, axes of the state"}
"""Entry ``info`` of the feature of wrenches that gplfd writes."""
_VERSION: Final = "v3."

_NUMBERS: Final = frozenset({"BOOLEAN", "INT32", "INT64", "FLOAT", "DOUBLE"})
_LONGEST_HEADER: Final = 2**16  # Bytes of a page header; it may contain two values.
# Fields of a page header: two sizes, and one structure for each kind of page.
_UNCOMPRESSED, _COMPRESSED = 2, 3
_DATA, _DICTIONARY, _DATA_V2 = 5, 7, 8
_VALUES: Final = 1  # Field of each of these structures.


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
        name: one
        for name, one in entry(info, "features", dict[str, Any]).items()
        if isinstance(one, dict) and str(one.get("dtype", "")).startswith("float")
    }
    name, feature = chosen(
        selection.body or STATE, vectors, "feature of numbers", file=path.name
    )
    # The names of its numbers: a list, or lists by group.
    names = feature.get("names")
    if isinstance(names, dict):
        names = [one for group in names.values() for one in group]
    if not selection.columns and not isinstance(names, list):
        raise ValueError(
            "its numbers have no names; give them in their order: --columns x,y,z,..."
        )
    heads = selection.columns or list(map(str, names))
    found = named_columns(heads, "--columns" if selection.columns else f"{name!r}")
    force, sensor = selection.wrench, None
    if vectors.get(WRENCH, {}).get("shape") == [len(FORCE)]:
        force = force or WRENCH
    if force is not None:
        _, felt = chosen(force, vectors, "feature of numbers", file=path.name)
        sensor = OBSERVED if felt.get("info") == AS_OBSERVED else None
    rate = float(entry(info, "fps", float))
    if not 0.0 < rate < 1e6:
        raise ValueError(f"fps is {rate}")
    files = sorted((path / "data").glob("*/*.parquet"))
    if not files:
        raise ValueError("there is no parquet file in its folder data")
    # Episode, frame and feature of every row, in order.
    wanted = ("episode_index", "frame_index", name, *([force] if force else []))
    budget = DecodingBudget(sum(regular_file(file).stat().st_size for file in files))
    parts = []
    for file in files:
        try:
            with file.open("rb") as stream, parquet.ParquetFile(stream) as opened:
                _claim_columns(stream, opened.metadata, wanted, budget)
                table = opened.read(columns=list(wanted))
            numbers = [_rows(table[one].combine_chunks()) for one in wanted[2:]]
            indices = [table[index].to_numpy() for index in wanted[:2]]
            parts.append((*indices, *numbers))
        # Arrow raises errors of every kind for damaged files.
        except Exception as error:
            raise ValueError(f"{file.relative_to(path)}: {error!s:.300}") from error
    episodes, frames, values, *wrenches = map(np.concatenate, zip(*parts, strict=True))
    episodes, frames = episodes.astype(np.int64), frames.astype(np.float64)
    if values.shape[1] != len(heads):
        raise ValueError(
            f"{name} has {values.shape[1]} numbers, and {len(heads)} names"
        )
    if wrenches and wrenches[0].shape[1] != len(FORCE):
        found_numbers = wrenches[0].shape[1]
        raise ValueError(f"{force} has {found_numbers} numbers, not {', '.join(FORCE)}")
    # The times are those of the frames, in seconds.
    seconds = replace(selection, time_unit="s")
    recordings = []
    order = np.argsort(episodes, kind="stable")
    starts = np.flatnonzero(np.diff(episodes[order])) + 1
    for own in np.split(order, starts):
        columns = {
            key: (values[own, place], unit) for key, (place, unit) in found.items()
        }
        columns["t"] = (frames[own] / rate, "s")
        for felt in wrenches:
            columns |= {key: (felt[own, at], None) for at, key in enumerate(FORCE)}
        label = f"{path.name}: episode {episodes[own[0]]}"
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


def _claim_columns(
    file: BinaryIO, metadata: Any, wanted: tuple[str, ...], budget: DecodingBudget
) -> None:
    """Claim the memory of columns of numbers, or lists of them, decoded to float64.

    The footer of a file states the number of values of a column, but a reader trusts
    the header of every page, and a run of one value takes a few bytes for any length.
    The headers are structures of Thrift's compact protocol, see *Parquet: Page Header*
    in https://github.com/apache/parquet-format and *Thrift Compact Protocol*.
    """
    groups = map(metadata.row_group, range(metadata.num_row_groups))
    for column in (one.column(n) for one in groups for n in range(one.num_columns)):
        name = f"column {column.path_in_schema:.80}"
        # The numbers of a list x are in a column x.list.element.
        if not f"{column.path_in_schema}.".startswith(tuple(f"{w}." for w in wanted)):
            continue
        if column.physical_type not in _NUMBERS:
            raise ValueError(f"{name} holds {column.physical_type}, not numbers")
        place = column.data_page_offset
        if column.has_dictionary_page and 0 < column.dictionary_page_offset < place:
            place = column.dictionary_page_offset
        end = place + column.total_compressed_size
        while place < end:
            file.seek(place)
            stream = BytesIO(file.read(_LONGEST_HEADER))
            header = _structure(stream)
            kinds = (header.get(kind, {}) for kind in (_DATA, _DICTIONARY, _DATA_V2))
            values = sum(kind.get(_VALUES, 0) for kind in kinds)
            budget.claim(header.get(_UNCOMPRESSED, 0) + 8 * values, name)
            place += stream.tell() + max(0, header.get(_COMPRESSED, 0))


def _structure(stream: BytesIO) -> dict[int, Any]:
    """Return the integers and structures of a Thrift structure by field."""
    fields: dict[int, Any] = {}
    field = 0
    while head := _byte(stream):
        field = field + (head >> 4) if head >> 4 else _integer(stream)
        match head & 0xF:
            case 1 | 2:  # true or false
                pass
            case 3:
                _byte(stream)
            case 4 | 5 | 6:
                fields[field] = _integer(stream)
            case 7:
                stream.seek(8, 1)
            case 8:
                stream.seek(_unsigned(stream), 1)
            case 12:
                fields[field] = _structure(stream)
            case kind:
                raise ValueError(f"the header of a page has a field of type {kind}")
    return fields


def _byte(stream: BytesIO) -> int:
    read = stream.read(1)
    if not read:
        raise ValueError("the header of a page is cut off")
    return read[0]


def _unsigned(stream: BytesIO) -> int:
    """Return a number of seven bits per byte, the lowest first."""
    number, shift = 0, 0
    while (byte := _byte(stream)) & 0x80:
        number |= (byte & 0x7F) << shift
        shift += 7
    return number | byte << shift


def _integer(stream: BytesIO) -> int:
    """Return a signed number; its lowest bit is the sign."""
    number = _unsigned(stream)
    return number >> 1 ^ -(number & 1)
