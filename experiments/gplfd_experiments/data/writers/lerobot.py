"""Demonstrations and episodes as a data set of LeRobot, version 3, without videos.

In float32, ``observation.state`` is position and quaternion, ``action`` the next one.
"""

import contextlib
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np
from PIL import Image

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.envs.camera import Camera
from gplfd_experiments.console.progress import progress_bar
from gplfd_experiments.data.readers.lerobot import AS_OBSERVED, INFO, STATE, WRENCH
from gplfd_experiments.data.readers.tables import FORCE
from gplfd_experiments.data.writers import states_of
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.files.folders import complete_folder
from gplfd_experiments.files.libraries import optional_libraries
from gplfd_experiments.files.plain_data import write_json
from gplfd_policies.demonstrations.npz import (
    LabelledDemonstrations,
    load_demonstrations,
)

with optional_libraries("LeRobot's data sets need pyarrow", "lerobot"):
    import pyarrow
    import pyarrow.parquet

_CONTROL_RATE: Final = round(1.0 / CONTROL_PERIOD)
_EQUAL: Final = 0.05  # Largest relative difference of time steps.
_NAMES: Final = ["x", "y", "z", "qx", "qy", "qz", "qw"]
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


@dataclass(frozen=True, kw_only=True, slots=True)
class _Rows:
    """One demonstration, a row per sample."""

    rate: float
    """Samples per second [Hz]."""
    states: FloatArray
    """Position [m] and quaternion, the scalar last, (N, 7)."""
    actions: FloatArray
    """The state to be reached at the next sample, (N, 7)."""
    wrenches: FloatArray | None
    """Forces and moments of the environment on the hand, in the frame of the states and
    about the position of the hand [N, N m], (N, 6); or none."""
    signals: Mapping[str, FloatArray] = field(default_factory=dict)
    """Other recorded signals, (N, d) each."""
    pictures: Mapping[str, Sequence[bytes]] = field(default_factory=dict)
    """PNG files by the name of their camera, N each, all of the same size."""
    task: str = "recorded motion"
    """Description of the task."""


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
        rows = _episode_rows(source, rate or (10 if cameras else 100), cameras, size)
    elif cameras or rate is not None:
        raise ValueError(
            f"{source} holds motions alone; --pictures and --rate are for episodes of "
            "`gplfd demos record`"
        )
    else:
        rows = _demonstration_rows(load_demonstrations(source))
    _write(target, rows)
    return len(rows)


def _demonstration_rows(labelled: LabelledDemonstrations) -> list[_Rows]:
    """Return the rows of demonstrations; raise ValueError unless steps are equal."""
    rows: list[_Rows] = []
    for number, demonstration in enumerate(labelled.demonstrations):
        times, wrenches = demonstration.times, demonstration.wrenches
        steps = np.diff(times)
        rate = len(steps) / float(times[-1] - times[0])
        usual = rows[0].rate if rows else rate
        if np.abs(steps * usual - 1.0).max() > _EQUAL:
            raise ValueError(
                f"demonstration {number} is not sampled at equal steps of "
                f"{1.0 / usual:.4g} s; import all with --rate 100"
            )
        states = states_of(demonstration.poses)
        rows.append(
            _Rows(
                rate=rate,
                states=states,
                actions=np.vstack([states[1:], states[-1:]]),
                # As the environment observes them: of the opposite sign.
                wrenches=None if wrenches is None else -wrenches,
                signals=labelled.signals[number] if labelled.signals else {},
            )
        )
    return rows


def _episode_rows(
    source: Path, rate: int, cameras: Sequence[str], size: tuple[int, int]
) -> list[_Rows]:
    """Return the rows of episodes; an action is the last command before the next."""
    from gplfd_experiments.data.minari import PHYSICS_STATE, STATE, open_dataset

    if not 0 < rate <= _CONTROL_RATE or _CONTROL_RATE % rate:
        raise ValueError(
            f"--rate {rate} must divide the {_CONTROL_RATE} steps per second of an "
            "episode: 100, 50, 25, 20, 10, 5, ..."
        )
    rows, dataset = [], open_dataset(source)
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
            if cameras:
                env.reset(seed=episode.seed, options=dict(episode.options) or None)
            inner: Any = env.unwrapped
            pictures: dict[str, list[bytes]] = {}
            for name in cameras:
                # Drawn from the physics states, as PNG files.
                files = pictures[name] = []
                camera = Camera(inner.model, *size, name, effects=False)
                with contextlib.closing(camera):
                    for state in episode.infos[PHYSICS_STATE][steps]:
                        mujoco.mj_setState(inner.model, inner.data, state, STATE)
                        mujoco.mj_forward(inner.model, inner.data)
                        try:
                            picture = camera.picture("rgb_array", inner.data)
                        except RuntimeError as error:
                            raise OSError(f"--pictures: {error}") from error
                        file = io.BytesIO()
                        Image.fromarray(np.asarray(picture)).save(file, format="png")
                        files.append(file.getvalue())
            rows.append(
                _Rows(
                    rate=float(rate),
                    states=both[:, 0],
                    actions=both[:, 1],
                    wrenches=episode.observations["wrench"][steps],
                    signals={},
                    pictures=pictures,
                    task="open the door",
                )
            )
    return rows


class _Columns:
    """The columns of all samples, one episode after the other."""

    def __init__(self) -> None:
        self.data: dict[str, Any] = {}
        self.features: dict[str, dict[str, Any]] = {}
        self.statistics: dict[str, dict[str, Any]] = {}

    def add(
        self, name: str, values: np.ndarray, names: list[str] | None = None
    ) -> None:
        """Add a column of numbers, (N,), or of vectors of them, (N, d)."""
        samples = values.astype(np.float64).reshape(len(values), -1)
        column, width = pyarrow.array(values.ravel()), samples.shape[1]
        if values.ndim == 2:
            column = pyarrow.FixedSizeListArray.from_arrays(column, width)
        feature = {"dtype": str(values.dtype), "shape": [width], "names": names}
        self._store(name, column, feature, samples)

    def stack(self, name: str, parts: Any, names: list[str] | None = None) -> None:
        """Add a column of vectors in float32."""
        self.add(name, np.vstack(parts).astype(np.float32), names)

    def add_pictures(self, name: str, files: Sequence[bytes]) -> None:
        """Add a column of PNG files."""
        kind = pyarrow.struct([("bytes", pyarrow.binary()), ("path", pyarrow.string())])
        column = pyarrow.array([{"bytes": file, "path": None} for file in files], kind)
        some = files[:: max(1, len(files) // _SAMPLED)]
        pixels = [np.asarray(Image.open(io.BytesIO(file))) for file in some]
        colours = np.concatenate([image.reshape(-1, 3, 1, 1) for image in pixels])
        names = ["height", "width", "channels"]
        feature = {"dtype": "image", "shape": list(pixels[0].shape), "names": names}
        self._store(name, column, feature, colours / 255.0)

    def _store(self, name: str, column: Any, feature: Any, samples: np.ndarray) -> None:
        """Store a column, and statistics of samples (N, d), or (N, 3, 1, 1)."""
        self.data[name], self.features[name] = column, feature
        self.statistics[name] = {"count": [len(column)]} | {
            kind: getattr(samples, kind)(axis=0).tolist()
            for kind in ("min", "max", "mean", "std")
        }


def _write(path: Path, demonstrations: Sequence[_Rows]) -> None:
    """Write a data set; raise ValueError if the rate is no whole number [Hz]."""
    rate = round(demonstrations[0].rate)
    if any(abs(rows.rate / max(rate, 1) - 1.0) > 0.01 for rows in demonstrations):
        raise ValueError(
            f"LeRobot counts whole samples per second, got {demonstrations[0].rate:.4g}"
            "; import the recordings with --rate 100"
        )
    lengths = np.array([len(rows.states) for rows in demonstrations])
    episode, ends = np.arange(len(lengths)), np.cumsum(lengths)
    frames = np.concatenate([np.arange(length) for length in lengths])
    columns = _Columns()
    columns.stack(STATE, [rows.states for rows in demonstrations], _NAMES)
    columns.stack("action", [rows.actions for rows in demonstrations], _NAMES)
    for name in sorted(set.intersection(*(set(r.signals) for r in demonstrations))):
        signals = [rows.signals[name] for rows in demonstrations]
        columns.stack(f"observation.{name}", signals)
    if all(rows.wrenches is not None for rows in demonstrations):
        columns.stack(WRENCH, [rows.wrenches for rows in demonstrations], list(FORCE))
        columns.features[WRENCH]["info"] = AS_OBSERVED
    for camera in demonstrations[0].pictures:
        files = [file for rows in demonstrations for file in rows.pictures[camera]]
        columns.add_pictures(f"observation.images.{camera}", files)
    columns.add("timestamp", (frames / rate).astype(np.float32))
    columns.add("frame_index", frames)
    columns.add("episode_index", np.repeat(episode, lengths))
    columns.add("index", np.arange(len(frames)))
    columns.add("task_index", np.zeros(len(frames), dtype=np.int64))
    episodes = {
        "episode_index": episode,
        "tasks": [[rows.task] for rows in demonstrations],
        "length": lengths,
        "dataset_from_index": ends - lengths,
        "dataset_to_index": ends,
        **{
            f"{part}/{index}_index": np.zeros(len(lengths), dtype=np.int64)
            for part in ("data", "meta/episodes")
            for index in ("chunk", "file")
        },
    }
    tasks = pyarrow.table({"task_index": [0], "task": [demonstrations[0].task]})
    tasks = tasks.replace_schema_metadata({"pandas": json.dumps(_TASKS)})
    info = _ABOUT | {
        "total_episodes": len(demonstrations),
        "total_frames": len(frames),
        "fps": rate,
        "splits": {"train": f"0:{len(demonstrations)}"},
        "features": columns.features,
    }
    with complete_folder(path) as written:
        for table, file in (
            (pyarrow.table(columns.data), f"data/{_FILE}"),
            (pyarrow.table(episodes), f"meta/episodes/{_FILE}"),
            (tasks, "meta/tasks.parquet"),
        ):
            (written / file).parent.mkdir(parents=True, exist_ok=True)
            pyarrow.parquet.write_table(table, written / file)
        write_json(written / "meta/stats.json", columns.statistics)
        write_json(written / INFO, info, indent=4)
