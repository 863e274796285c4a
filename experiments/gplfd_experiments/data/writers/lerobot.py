"""Demonstrations and episodes as a data set of LeRobot, version 3, without videos.

In float32, ``observation.state`` is position and quaternion, ``action`` the next one.
"""

import contextlib
import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np
from PIL import Image

from gplfd_env.conventions.constants import CONTROL_PERIOD, TASK
from gplfd_env.envs.camera import Camera
from gplfd_experiments.console.progress import progress_bar
from gplfd_experiments.data.readers.arrays import (
    AS_OBSERVED,
    INFO,
    OBSERVED_WRENCH,
    STATE,
)
from gplfd_experiments.data.readers.tables import FORCE
from gplfd_experiments.data.writers import states_of
from gplfd_experiments.files.folders import complete_folder
from gplfd_experiments.files.libraries import optional_libraries
from gplfd_experiments.files.plain_data import write_json
from gplfd_policies.demonstrations import npz

with optional_libraries("LeRobot's data sets need pyarrow", "lerobot"):
    import pyarrow
    import pyarrow.parquet

_Columns = dict[str, Any]
"""Columns of one episode, (N, d), or N PNG files each, by their names in the format.
States and actions are positions [m] and quaternions; an action is reached at the next
sample. Wrenches are of the environment on the hand [N, N m], in the frame of the states
and about the position of the hand."""
_ACTION: Final = "action"
_PICTURES: Final = "observation.images."
_POSE: Final = ["x", "y", "z", "qx", "qy", "qz", "qw"]
_COMPONENTS: Final = {STATE: _POSE, _ACTION: _POSE, OBSERVED_WRENCH: list(FORCE)}
_CONTROL_RATE: Final = round(1.0 / CONTROL_PERIOD)
_EQUAL: Final = 0.05  # Largest relative difference of time steps.
_SAMPLED: Final = 50  # Number of pictures for the statistics of colours.
_FILE: Final = "chunk-000/file-000.parquet"
_ABOUT: Final = {
    "codebase_version": "v3.0",
    "robot_type": None,
    "total_tasks": 1,
    "chunks_size": 1000,
    "data_files_size_in_mb": 100,
    "video_files_size_in_mb": 200,
    "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
    "video_path": None,
}
_KINDS: Final = (("task_index", "int64", "int64"), ("task", "unicode", "object"))
_TASKS: Final = {
    "index_columns": ["task"],
    "columns": [
        {"name": name, "field_name": name, "pandas_type": pandas, "numpy_type": numpy}
        | {"metadata": None}
        for name, pandas, numpy in _KINDS
    ],
    "column_indexes": [],
}
"""What pandas needs to know of the table of tasks, in which the task is the index."""


def export_demonstrations(
    source: Path,
    target: Path,
    *,
    rate: int | None = None,
    cameras: Sequence[str] = (),
    size: tuple[int, int] = (320, 240),
) -> int:
    """Write demonstrations or episodes as a data set, and return how many.

    Episodes are written with a number of rows per second (100, or 10 with pictures) and
    the pictures of some cameras, whose size is width and height [px].

    Raises:
        ValueError: The target exists, or the source cannot be exported.
        OSError: A file cannot be read or written, or this machine cannot render.
        ModuleNotFoundError: The library of the format is not installed.
    """
    if target.exists():
        raise ValueError(f"--out {target} exists; give another")
    if (source / "data/metadata.json").is_file():
        rate = rate or (10 if cameras else 100)
        episodes = _recorded(source, rate, cameras, size)
        _write(target, [float(rate)], episodes, TASK)
        return len(episodes)
    if cameras or rate is not None:
        raise ValueError(
            f"{source} holds motions alone; --pictures and --rate are for episodes of "
            "`gplfd demos record`"
        )
    labelled = npz.load_demonstrations(source)
    rates, episodes = list[float](), list[_Columns]()
    for number, demonstration in enumerate(labelled.demonstrations):
        times, wrenches = demonstration.times, demonstration.wrenches
        steps = np.diff(times)
        rates.append(len(steps) / float(times[-1] - times[0]))
        if np.abs(steps * rates[0] - 1.0).max() > _EQUAL:
            raise ValueError(
                f"demonstration {number} is not sampled at equal steps of "
                f"{1.0 / rates[0]:.4g} s; import all with --rate 100"
            )
        states = states_of(demonstration.poses)
        columns: _Columns = {STATE: states}
        columns[_ACTION] = np.vstack([states[1:], states[-1:]])
        signals = labelled.signals[number] if labelled.signals else {}
        columns |= {f"observation.{name}": signals[name] for name in sorted(signals)}
        if wrenches is not None:
            # As the environment observes them: of the opposite sign.
            columns[OBSERVED_WRENCH] = -wrenches
        episodes.append(columns)
    _write(target, rates, episodes, TASK)
    return len(episodes)


def _recorded(
    source: Path, rate: int, cameras: Sequence[str], size: tuple[int, int]
) -> list[_Columns]:
    """Return columns of episodes; an action is the last command before the next."""
    from gplfd_experiments.data import minari

    if not 0 < rate <= _CONTROL_RATE or _CONTROL_RATE % rate:
        raise ValueError(
            f"--rate {rate} must divide the {_CONTROL_RATE} steps per second of an "
            "episode: 100, 50, 25, 20, 10, 5, ..."
        )
    episodes, dataset = list[_Columns](), minari.open_dataset(source)
    with contextlib.closing(dataset.make_environment()) as env:
        numbers = range(dataset.n_episodes)
        for number in progress_bar(numbers, desc="exporting", unit="episode"):
            episode = dataset.episode(number)
            steps = np.arange(0, len(episode.rewards), _CONTROL_RATE // rate)
            following = np.append(steps[1:], len(episode.rewards)) - 1
            seen = episode.observations["ee_pose"][steps]
            commanded = episode.actions[following, :6]
            # In one sequence, so that the signs of a state and its action agree.
            poses = np.stack([seen, commanded], axis=1)
            both = states_of(poses.reshape(-1, 6)).reshape(len(steps), 2, 7)
            columns: _Columns = {STATE: both[:, 0], _ACTION: both[:, 1]}
            columns[OBSERVED_WRENCH] = episode.observations["wrench"][steps]
            if cameras:
                env.reset(seed=episode.seed, options=dict(episode.options) or None)
            inner: Any = env.unwrapped
            for name in cameras:
                # Drawn from the physics states, as PNG files.
                files: list[bytes] = []
                camera = Camera(inner.model, *size, name, effects=False)
                with contextlib.closing(camera):
                    for state in episode.infos[minari.PHYSICS_STATE][steps]:
                        mujoco.mj_setState(inner.model, inner.data, state, minari.STATE)
                        mujoco.mj_forward(inner.model, inner.data)
                        try:
                            picture = camera.picture("rgb_array", inner.data)
                        except RuntimeError as error:
                            raise OSError(f"--pictures: {error}") from error
                        file = io.BytesIO()
                        Image.fromarray(np.asarray(picture)).save(file, format="png")
                        files.append(file.getvalue())
                columns[_PICTURES + name] = files
            episodes.append(columns)
    return episodes


def _described(name: str, values: Any) -> tuple[Any, Any, Any]:
    """Return a column of numbers or PNG files, its feature, and its statistics."""
    feature: dict[str, Any]
    if name.startswith(_PICTURES):
        kind = pyarrow.struct([("bytes", pyarrow.binary()), ("path", pyarrow.string())])
        column = pyarrow.array([{"bytes": f, "path": None} for f in values], kind)
        some = values[:: max(1, len(values) // _SAMPLED)]
        pixels = [np.asarray(Image.open(io.BytesIO(file))) for file in some]
        colours = np.concatenate([image.reshape(-1, 3, 1, 1) for image in pixels])
        samples, names = colours / 255.0, ["height", "width", "channels"]
        feature = {"dtype": "image", "shape": list(pixels[0].shape), "names": names}
    else:
        samples = values.astype(np.float64).reshape(len(values), -1)
        column, width = pyarrow.array(values.ravel()), samples.shape[1]
        if values.ndim == 2:
            column = pyarrow.FixedSizeListArray.from_arrays(column, width)
        feature = {"dtype": str(values.dtype), "shape": [width]}
        feature["names"] = _COMPONENTS.get(name)
    if name == OBSERVED_WRENCH:
        feature["info"] = AS_OBSERVED
    kinds = ("min", "max", "mean", "std")
    statistics = {k: getattr(samples, k)(axis=0).tolist() for k in kinds}
    return column, feature, {"count": [len(values)]} | statistics


def _write(
    path: Path, rates: Sequence[float], episodes: Sequence[_Columns], task: str
) -> None:
    """Write a data set; raise ValueError if a rate is no whole number [Hz]."""
    rate = round(rates[0])
    if any(abs(exact / max(rate, 1) - 1.0) > 0.01 for exact in rates):
        raise ValueError(
            f"LeRobot counts whole samples per second, got {rates[0]:.4g}; import the "
            "recordings with --rate 100"
        )
    lengths = np.array([len(columns[STATE]) for columns in episodes])
    numbers, ends = np.arange(len(lengths)), np.cumsum(lengths)
    frames = np.concatenate([np.arange(length) for length in lengths])
    whole: dict[str, Any] = {}
    for name in episodes[0]:
        if all(name in columns for columns in episodes):
            parts = [columns[name] for columns in episodes]
            if name.startswith(_PICTURES):
                whole[name] = [file for files in parts for file in files]
            else:
                whole[name] = np.vstack(parts).astype(np.float32)
    whole["timestamp"] = (frames / rate).astype(np.float32)
    whole["frame_index"] = frames
    whole["episode_index"] = np.repeat(numbers, lengths)
    whole["index"] = np.arange(len(frames))
    whole["task_index"] = np.zeros(len(frames), dtype=np.int64)
    data, features, statistics = {}, {}, {}
    for name, values in whole.items():
        data[name], features[name], statistics[name] = _described(name, values)
    about = {
        "episode_index": numbers,
        "tasks": [[task]] * len(lengths),
        "length": lengths,
        "dataset_from_index": ends - lengths,
        "dataset_to_index": ends,
        **{
            f"{part}/{index}_index": np.zeros(len(lengths), dtype=np.int64)
            for part in ("data", "meta/episodes")
            for index in ("chunk", "file")
        },
    }
    tasks = pyarrow.table({"task_index": [0], "task": [task]})
    tasks = tasks.replace_schema_metadata({"pandas": json.dumps(_TASKS)})
    info = _ABOUT | {
        "total_episodes": len(lengths),
        "total_frames": len(frames),
        "fps": rate,
        "splits": {"train": f"0:{len(lengths)}"},
        "features": features,
    }
    with complete_folder(path) as written:
        for table, file in (
            (pyarrow.table(data), f"data/{_FILE}"),
            (pyarrow.table(about), f"meta/episodes/{_FILE}"),
            (tasks, "meta/tasks.parquet"),
        ):
            (written / file).parent.mkdir(parents=True, exist_ok=True)
            pyarrow.parquet.write_table(table, written / file)
        write_json(written / "meta/stats.json", statistics)
        write_json(written / INFO, info, indent=4)
