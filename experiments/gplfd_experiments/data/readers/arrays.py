"""Motions in named arrays: NumPy, MATLAB, robomimic, LeRobot, and sets of gplfd.

Columns (N,), those of `tables` (N, d), or ``--columns`` of (N, C), (K, N, C), or ᵀ.
"""

import contextlib
import json
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import scipy.io

from gplfd_experiments.data.raw import RawRecording, chosen
from gplfd_experiments.data.readers import tables
from gplfd_experiments.data.settings import ImportSettings
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.files.libraries import optional_libraries
from gplfd_experiments.files.plain_data import entry, read_json
from gplfd_policies.demonstrations.npz import KIND, load_demonstrations

_Arrays = Mapping[str, FloatArray]
_INDEX: Final = re.compile(r"(\{\d+\}|\(\d+\))")
_DEFAULT_HAND: Final = "robot0_eef"  # Of robomimic.
INFO: Final = "meta/info.json"
STATE: Final = "observation.state"
WRENCH: Final = "observation.force"
OBSERVED_WRENCH: Final = "observation.environment_state"
"""Wrenches that gplfd writes; policies of LeRobot read no other numbers."""
AS_OBSERVED: Final = {"wrench": "of the environment on the hand, axes of the state"}
"""Entry ``info`` of the feature of wrenches that gplfd writes."""


def read(path: Path, settings: ImportSettings) -> list[RawRecording]:
    """Read the motions of NumPy or MATLAB up to 7.2, or a set of demonstrations."""
    arrays: dict[str, Any] = {}
    with path.open("rb") as stream:
        if path.suffix.lower() == ".mat":
            if stream.read(10) == b"MATLAB 7.3":
                raise ValueError("it is of version 7.3; save it by save(..., '-v7')")
            for variable, value in scipy.io.loadmat(path, appendmat=False).items():
                arrays.update(_in_cells(value, variable))
        elif isinstance(loaded := np.load(stream, allow_pickle=False), np.ndarray):
            arrays["the array"] = loaded
        else:
            for name in loaded.files:
                with contextlib.suppress(ValueError):  # NumPy unpickles no objects.
                    arrays[name] = loaded[name]
    if str(arrays.get("format", "")) == KIND:
        return own_set(path, settings)
    numbers = {
        key: np.asarray(array, dtype=np.float64)
        for key, array in arrays.items()
        if array.dtype.kind in "biuf"
    }
    if settings.columns and "=" not in settings.columns[0]:
        return _from_columns(path.name, numbers, settings)
    # A structure may contain its motions as cells, s.pos{1} with s.time{1}, or with
    # s.time for all. A single cell may contain the times of the only motion.
    parts = {key: _parted(key) for key, array in numbers.items() if array.size > 1}
    fields = tables.renamed([field for _, field, _ in parts.values()], settings.columns)
    names = dict(zip(parts, fields, strict=True))
    motions: dict[str, _Arrays] = {}
    for key, (where, _, index) in parts.items():
        name = names[key]
        columns = tables.ARRAYS.get(name.lower())
        if tables.understood(name)[0] == "x" or columns == tables.POSITION:
            cells = {cell for other, _, cell in parts.values() if other == where} - {""}
            beside = {"", index} | (cells if len(cells) == 1 else set())
            motions[where + index] = {
                names[other]: numbers[other]
                for other, (structure, _, cell) in parts.items()
                if structure == where and cell in beside
            }
    if not motions:
        raise ValueError(
            f"it has no array of positions: it has {_shapes(numbers)}. Name one, "
            "--columns positions=NAME,quat_wxyz=NAME,..., or the columns of one in "
            "their order, --columns t,x,y,z,... with - for one to leave out"
        )
    labels = _labels(path.name, motions, settings, "set of recordings")
    return [_motion(label, motions[key], settings) for key, label in labels.items()]


def _in_cells(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Yield name and array, also of those in cells, a{3}, and structures, s(4).t."""
    if not isinstance(value, np.ndarray):
        return
    if not value.dtype.hasobject:
        yield name, value
        return
    for number, part in enumerate(value.ravel(order="F"), start=1):
        index = f"({number})" if value.size > 1 else ""
        for field in value.dtype.names or ():
            yield from _in_cells(part[field], f"{name}{index}.{field}")
        if value.dtype.names is None:
            yield from _in_cells(part, f"{name}{{{number}}}")


def _parted(key: str) -> tuple[str, str, str]:
    """Return the structure of an array, its field in it, and the field's index."""
    where, _, field = key.rpartition(".")
    return where, _INDEX.sub("", field), "".join(_INDEX.findall(field))


def _labels(
    file: str, keys: Iterable[str], settings: ImportSettings, what: str
) -> dict[str, str]:
    """Return keys of the wanted set with labels; cells of one name are one set."""
    sets: dict[str, list[str]] = {}
    for key in keys:
        sets.setdefault(_INDEX.sub("", key), []).append(key)
    _, members = chosen(settings.body, sets, what, file=file)
    return {key: file if len(members) == 1 else f"{file}: {key}" for key in members}


def _from_columns(
    file: str, numbers: _Arrays, settings: ImportSettings
) -> list[RawRecording]:
    """Return the motions in an array of ``--columns``, with the times beside it."""
    vectors = {_INDEX.sub("", key) for key, array in numbers.items() if _vector(array)}
    keys = [
        key
        for key, array in numbers.items()
        if array.ndim in (2, 3) and _INDEX.sub("", key) not in vectors
    ]
    places = tables.named_columns(settings.columns, "--columns")
    width, motions = len(settings.columns), []
    for key, label in _labels(file, keys, settings, "array of columns").items():
        where, _, index = _parted(key)
        parts = {label: numbers[key]}
        if numbers[key].ndim == 3:
            parts = {f"{label}[{n}]": part for n, part in enumerate(numbers[key])}
        times = np.empty(0)
        for other, array in numbers.items():
            structure, field, cell = _parted(other)
            beside = structure == where and cell in ("", index) and _vector(array)
            if beside and tables.ARRAYS.get(field.lower()) == ("t",):
                times = array.reshape(-1)
        for name, table in parts.items():
            rows = table if table.shape[1] == width else table.T
            if rows.shape[1] != width:
                raise ValueError(
                    f"{key!r} has shape {table.shape}, and --columns names {width} "
                    "columns"
                )
            columns = {head: (rows[:, at], unit) for head, (at, unit) in places.items()}
            if len(times) == len(rows):
                columns.setdefault("t", (times, None))
            motions.append(tables.recording(name, columns, settings))
    return motions


def _motion(name: str, arrays: _Arrays, settings: ImportSettings) -> RawRecording:
    """Return the motion in arrays with supported names, see `tables.array_columns`."""
    heads, values, unused = list[str](), list[FloatArray](), list[str]()
    for key, array in arrays.items():
        short, _, owner = tables.understood(key)
        names: tuple[str, ...] = (key,)
        if short is None or owner:
            names = tables.array_columns(key, array.shape, settings)
            if "qw" in names and key.lower() not in tables.ARRAYS:
                settings = replace(settings, quaternions=None)  # It had its effect.
        if names:
            # Rows of samples; MATLAB has vectors as rows or columns.
            width, rows = len(names), array
            if width == 1 and _vector(array):
                rows = array.reshape(-1, 1)
            elif width == 9 and array.ndim == 3:  # Matrices, along MATLAB's last axis.
                rows = np.moveaxis(array, -1, 0) if array.shape[:2] == (3, 3) else array
                rows = rows.reshape(len(rows), -1)
            # Positions may lack z, and forces their torques.
            allowed = {3: (2, 3), 6: (3, 6)}.get(width, (width,))
            if rows.ndim == 2 and rows.shape[1] not in allowed:
                rows = rows.T if rows.shape[0] in allowed else rows
            if rows.ndim != 2 or rows.shape[1] not in allowed:
                wrong = f"{key!r} has shape {rows.shape}, must be (N, {width})"
                raise ValueError(wrong)
            values += list(rows.T)
            heads += names[: rows.shape[1]]
        else:
            unused.append(key)
    if len({len(column) for column in values}) > 1:
        raise ValueError(f"its arrays differ in length: {_shapes(arrays)}")
    places = tables.named_columns(heads, name)
    columns = {column: (values[at], unit) for column, (at, unit) in places.items()}
    return tables.recording(name, columns, settings, unused)


def _vector(array: FloatArray) -> bool:
    return array.size == max(array.shape, default=0)


def _shapes(arrays: _Arrays) -> str:
    names = ", ".join(f"{key} {array.shape}" for key, array in arrays.items())
    return f"{names or 'no array of numbers':.400}"


def robomimic(path: Path, settings: ImportSettings) -> list[RawRecording]:
    """Read every demonstration of a file of robomimic, in the order of their numbers.

    The hand is ``obs/NAME_pos`` and ``obs/NAME_quat``, whose scalar is last, or another
    form of its orientation; forces are ``obs/NAME_wrench``.
    """
    with optional_libraries("robomimic's files need h5py", "robomimic"):
        import h5py
    with h5py.File(path, "r") as file:
        if "data" not in file:
            raise ValueError(f"it has no group 'data' but {', '.join(file)!s:.200}")
        data = file["data"]
        # The control frequency of the environment, if the file states it.
        rate, about = settings.recorded_rate, data.attrs.get("env_args")
        match json.loads(about) if isinstance(about, str) else None:
            case {"env_kwargs": {"control_freq": int() | float() as control}}:
                rate = rate or (float(control) if 0.0 < control < 1e6 else None)
        names = sorted(data, key=lambda name: list(map(int, re.findall(r"\d+", name))))
        motions, angles = [], ImportSettings(angles=settings.angles)
        for name in names:
            if not isinstance(data[name], h5py.Group) or "obs" not in data[name]:
                raise ValueError(
                    f"/data/{name} has no group 'obs'; robosuite records states alone, "
                    "of which robomimic's script dataset_states_to_obs makes "
                    "observations"
                )
            label, obs = f"{path.name}: {name}", data[name]["obs"]
            ends = [key for key in obs if key.endswith("_pos")]
            hands = {key.removesuffix("_pos"): key for key in ends}
            wanted = settings.body or _DEFAULT_HAND
            hand, position = chosen(wanted, hands, "hand in obs", file=label)
            gripper = f"{hand.removesuffix('_eef')}_gripper_qpos"
            force = settings.wrench or f"{hand}_wrench"
            sources = {"positions": position}
            for key in (f"{hand}_quat", *sorted(obs)):
                what = key.removeprefix(f"{hand}_")
                if key in obs and what != key:
                    shape = obs[key].shape
                    scalar_last = 4 in shape and not what.endswith("wxyz")
                    what = f"{what.removesuffix('_xyzw')}_xyzw" if scalar_last else what
                    columns = tables.array_columns(what, shape, angles)
                    if columns and tables.ORIENTED.issuperset(columns):
                        sources[what] = key
                        break
            if force in obs or settings.wrench is not None:
                sources["wrench"] = force
            arrays = {
                what: np.asarray(obs[key][()], dtype=np.float64)
                for what, key in sources.items()
            }
            signals = {"gripper": obs[gripper][()]} if gripper in obs else {}
            motion = replace(_motion(label, arrays, angles), unit="m", signals=signals)
            unused = {key for key in obs if key.startswith(f"{hand}_")}
            motions.append(_not_turning(motion, unused - {*sources.values()}))
    if rate is None or settings.recorded_rate is not None:
        return motions
    return [replace(m, times=np.arange(len(m.positions)) / rate) for m in motions]


def lerobot(path: Path, settings: ImportSettings) -> list[RawRecording]:
    """Read every episode of a data set of LeRobot, version 3, from parquet files."""
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
    marked = [n for n, feature in vectors.items() if feature.get("info") == AS_OBSERVED]
    if not marked and vectors.get(WRENCH, {}).get("shape") == [len(tables.FORCE)]:
        marked = [WRENCH]
    force = force or next(iter(marked), None)
    observed, widths = False, {name: len(heads)}
    if force is not None:
        _, feature = chosen(force, vectors, "feature of numbers", file=path.name)
        observed, widths[force] = feature.get("info") == AS_OBSERVED, len(tables.FORCE)
    unused = {head for head in heads if tables.understood(head)[0] is None}
    unused |= {name for name in vectors if name.startswith("observation")} - {*widths}
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
        motion = _not_turning(tables.recording(label, of_episode, settings), unused)
        recordings.append(replace(motion, forces_on="hand" if observed else None))
    return recordings


def _not_turning(motion: RawRecording, unused: Iterable[str]) -> RawRecording:
    """Return a motion, which without orientations has a note on what is not used."""
    if motion.quaternions is not None or not unused:
        return motion
    note = f"{tables.listed(sorted(unused))} are not used: it has no orientation"
    return replace(motion, notes=(*motion.notes, note))


def own_set(path: Path, settings: ImportSettings) -> list[RawRecording]:
    """Read poses and wrenches of a set of demonstrations, or as they were observed."""
    del settings  # No choice is open.
    signals = dict[int, Any]()
    if observed := (path / "data/metadata.json").is_file():
        from gplfd_experiments.data.minari import open_dataset

        dataset = open_dataset(path)
        seen = [dataset.episode(n).observations for n in range(dataset.n_episodes)]
        motions = [(s["time"][:, 0], s["ee_pose"], s["wrench"]) for s in seen]
    else:
        kept = load_demonstrations(path)
        motions = [(m.times, m.poses, m.wrenches) for m in kept.demonstrations]
        signals = dict(enumerate(kept.signals))
    return [
        RawRecording(
            f"{path.name}: episode {number}" if observed else f"{path.name}[{number}]",
            poses[:, :3],
            "m",
            times,
            tables.quaternions_of(tables.ROTATION_VECTOR, poses[:, 3:]),
            wrenches=wrenches,
            forces_on="hand" if observed else "object",
            signals=signals.get(number, {}),
        )
        for number, (times, poses, wrenches) in enumerate(motions)
    ]
