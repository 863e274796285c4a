"""Demonstrations and episodes as a data set of LeRobot, version 3.

Rows are what the environment of `gplfd_env.lerobot` gives and takes, in float32.
LeRobot's own writer needs Python 3.12 and PyTorch.
"""

import contextlib
import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import mujoco
import numpy as np

from gplfd_env.conventions.constants import TASK, ActionForm
from gplfd_env.doors.config import DoorConfig, door_config
from gplfd_env.envs.camera import Camera
from gplfd_env.envs.waypoints import (
    Condition,
    WaypointDoor,
    Waypoints,
    action_to,
    pose_of,
    state_of,
)
from gplfd_env.robot.model import SERVO_STIFFNESS
from gplfd_env.robot.placement import base_for
from gplfd_env.robot.robots import robot_named
from gplfd_experiments.console.progress import LOG, progress_bar
from gplfd_experiments.data.official import OFFICIAL, official_set
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
from gplfd_experiments.files.provenance import content_hash, versions
from gplfd_policies.demonstrations import npz
from gplfd_policies.demonstrations.demonstration import Demonstration

with optional_libraries("LeRobot's data sets need pyarrow", "lerobot"):
    import pyarrow
    import pyarrow.parquet

_Columns = dict[str, Any]
"""Columns of one episode, (N, d), or N pictures each, by their names in the format.
States and actions are positions [m] and quaternions; an action is reached at the next
sample. Wrenches are of the environment on the hand [N, N m], in the frame of the states
and about the position of the hand."""
_Shown = Sequence[tuple[Demonstration, DoorConfig | float | None]]
"""Demonstrations, and the door or radius [m] of each, if it is known."""
_ACTION: Final = "action"
_PICTURES: Final = "observation.images."
_POSE: Final = ["x", "y", "z", "qx", "qy", "qz", "qw"]
_AXES: Final = ["x", "y", "z", "rx", "ry", "rz"]
_OF_ACTIONS: Final = {
    "pose": _POSE,
    "relative": _AXES,
    "stiffness": [*_POSE, *(f"k_{axis}" for axis in _AXES)],
}
_RATE: Final = 20  # Actions per second of the environment by default.
_EQUAL: Final = 0.05  # Largest relative difference of time steps.
_FOLLOWED: Final = 0.25
"""Stiffness of the person whom the hand follows in a replay, as a share of the servo's:
500 N/m. The servo alone pulls the hand off the handle of a door that is not exactly
where the suit has measured it."""
_SAMPLED: Final = np.s_[::10, ::8, ::8]  # Pixels for the statistics of colours.
_CHUNK: Final = 1000  # Number of files of a folder.
_FILE: Final = "chunk-000/file-000.parquet"
_VIDEO: Final = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
_ABOUT: Final[dict[str, Any]] = {
    "codebase_version": "v3.0",
    "robot_type": "tiago-like",
    "total_tasks": 1,
    "chunks_size": _CHUNK,
    "data_files_size_in_mb": 100,
    "video_files_size_in_mb": 200,
    "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
}
_COMPONENTS: Final = {STATE: _POSE, _ACTION: _POSE, OBSERVED_WRENCH: list(FORCE)}
_ENCODING: Final[dict[str, Any]] = {"quality": None, "macro_block_size": 2}
_ENCODING["output_params"] = ["-crf", "18", "-g", "2", "-bf", "0"]
"""Every second picture is coded by itself, so that any is found soon."""
_CARD: Final = """---
task_categories: [robotics]
tags: [LeRobot, gplfd]
configs: [{{config_name: default, data_files: data/*/*.parquet}}]
---
# {title}

{about} {info[total_episodes]} episodes, {info[total_frames]} rows, {info[fps]} per s.

Numbers are in m, rad, N, N m, N/m and N m/rad, in the frame of the door; their names
are in meta/info.json. LeRobot's environment of gplfd has the same form:

    --env.discover_packages_path=gplfd_env.lerobot --env.type=gplfd
    --env.fps={info[fps]} --env.action={form.action} --env.cameras={cameras}

SHA-256 of the rows: {sha256}. Written with {versions}.
"""
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
_PANDAS: Final = {"pandas": json.dumps(_TASKS)}
"""What pandas needs to know of the table of tasks, in which the task is the index."""


class Form(NamedTuple):
    """Form of the rows."""

    rate: int | None = None
    """Rows per second [Hz]; by default 20, or of motions alone as recorded."""
    action: ActionForm = "pose"
    cameras: Sequence[str] = ()
    size: tuple[int, int] = (320, 240)
    """Width and height of pictures [px]."""


def export_demonstrations(
    source: Path, target: Path, form: Form, replay: Sequence[DoorConfig] | None
) -> int:
    """Write demonstrations or episodes as a data set, and return how many.

    The source is a file or folder of demonstrations, a folder of episodes, or the name
    of an official set. Demonstrations of an official set, or with doors, are replayed:
    in turn at these, or, if there are none, at their own or at bars of their radii.

    Raises:
        ValueError: The target exists, or the source cannot be exported.
        OSError: A file cannot be read or written, or this machine cannot render.
        ModuleNotFoundError: The library of the format is not installed.
    """
    if target.exists():
        raise ValueError(f"--out {target} exists; give another")
    if form.cameras and any(side % 2 for side in form.size):
        raise ValueError(f"--size {form.size}: videos need even numbers of pixels")
    # A user's own folder of such a name comes first, unless it is a set of this format.
    free = not source.exists() or (source / INFO).is_file()
    official = free and str(source) in OFFICIAL
    rate = _RATE if form.rate is None else form.rate
    episodes: Iterable[_Columns]
    if official or replay is not None:
        if official:
            shown: _Shown = official_set(str(source))
        else:
            labelled = npz.load_demonstrations(source)
            if labelled.frame != npz.FRAME:
                raise ValueError(
                    f"these motions open no door, their frame is {labelled.frame!r}; "
                    "import the recordings with gplfd demos import FILES --frame hinge"
                )
            shown = list(zip(labelled.demonstrations, labelled.radii, strict=True))
        identity = npz.hash_of([motion for motion, _ in shown])
        about = f"Replays of the demonstrations {identity} ({source.name})."
        episodes = _replayed(shown, replay, rate, form)
    elif (source / "data/metadata.json").is_file():
        about = f"Episodes of `gplfd demos record` ({source.name})."
        episodes = _recorded(source, rate, form)
    elif form != Form():
        raise ValueError(
            f"{source} holds motions alone; --pictures, --rate and --action are for "
            "episodes of `gplfd demos record`, and with --replay"
        )
    else:
        about = f"Motions as recorded, without an environment ({source.name})."
        rate, episodes = _motions(npz.load_demonstrations(source))
    try:
        return _write(target, rate, episodes, form, about)
    except RuntimeError as error:
        if not form.cameras:
            raise
        raise OSError(f"--pictures: {error}") from error


def _replayed(
    shown: _Shown, doors: Sequence[DoorConfig] | None, rate: int, form: Form
) -> Iterator[_Columns]:
    """Yield the columns of demonstrations that open their doors.

    The hand follows the demonstration like a spring, until the episode ends.
    """
    stiffness = np.repeat(SERVO_STIFFNESS, 3) * _FOLLOWED
    progress = progress_bar(shown, desc="replaying", unit="episode")
    for number, (motion, opened) in enumerate(progress):
        if not doors and opened is None:
            raise ValueError("the doors of these motions are unknown: --replay DOOR")
        door = doors[number % len(doors)] if doors else door_config(opened)
        about = {"door": door, "base": base_for(door, robot_named("tiago-like"))}
        condition = Condition(name="", door="", arguments=about)
        env = WaypointDoor(condition, rate, form.action, form.cameras, form.size)
        rows, ended = list[_Columns](), False
        with contextlib.closing(env):
            observed, info = env.reset(seed=number)
            while not ended:
                hand = pose_of(observed["agent_pos"])
                after = motion.times[0] + (len(rows) + 1) / rate
                columns = motion.poses.T
                goal: Any = [np.interp(after, motion.times, c) for c in columns]
                if form.action == "stiffness":
                    goal = np.append(goal, stiffness)
                else:
                    goal = hand + _FOLLOWED * (goal - hand)
                action: Any = action_to(goal, hand, form.action).astype(np.float32)
                row = {STATE: observed["agent_pos"], _ACTION: action}
                row[OBSERVED_WRENCH] = observed["environment_state"]
                for name in form.cameras:
                    row[_PICTURES + name] = observed["pixels"][name]
                rows.append(row)
                observed, _, terminated, truncated, info = env.step(action)
                ended = terminated or truncated
        if info["is_success"]:
            yield {name: np.stack([row[name] for row in rows]) for name in rows[0]}
        else:
            LOG.warning("warning: demonstration %d opens no door: left out", number)


def _recorded(source: Path, rate: int, form: Form) -> Iterator[_Columns]:
    """Yield columns of episodes; an action is the last command before the next."""
    from gplfd_experiments.data import minari

    every = Waypoints(rate, form.action).per_action
    dataset = minari.open_dataset(source)
    with contextlib.closing(dataset.make_environment()) as env:
        numbers = range(dataset.n_episodes)
        for number in progress_bar(numbers, desc="exporting", unit="episode"):
            episode = dataset.episode(number)
            stiff = episode.actions.shape[1] == 12
            if stiff != (form.action == "stiffness"):
                raise ValueError(
                    f"{source}: its commands have {'a' if stiff else 'no'} stiffness; "
                    f"give {'' if stiff else 'another '}--action{' stiffness' * stiff}"
                )
            steps = np.arange(0, len(episode.rewards), every)
            following = np.append(steps[1:], len(episode.rewards)) - 1
            hands = episode.observations["ee_pose"][steps]
            commands = zip(episode.actions[following], hands, strict=True)
            columns: _Columns = {
                STATE: np.stack([state_of(hand) for hand in hands]),
                _ACTION: np.stack([action_to(*both, form.action) for both in commands]),
                OBSERVED_WRENCH: episode.observations["wrench"][steps],
            }
            if form.cameras:
                env.reset(seed=episode.seed, options=dict(episode.options) or None)
            inner: Any = env.unwrapped
            for name in form.cameras:
                pictures = []
                camera = Camera(inner.model, *form.size, name, effects=False)
                with contextlib.closing(camera):
                    for state in episode.infos[minari.PHYSICS_STATE][steps]:
                        mujoco.mj_setState(inner.model, inner.data, state, minari.STATE)
                        mujoco.mj_forward(inner.model, inner.data)
                        pictures.append(camera.picture("rgb_array", inner.data))
                columns[_PICTURES + name] = np.stack(pictures)
            yield columns


def _motions(labelled: npz.LabelledDemonstrations) -> tuple[int, list[_Columns]]:
    """Return rate [Hz] and columns of motions; an action is the next state."""
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
    rate = round(rates[0])
    if any(abs(exact / max(rate, 1) - 1.0) > 0.01 for exact in rates):
        raise ValueError(
            f"LeRobot counts whole samples per second, got {rates[0]:.4g}; import the "
            "recordings with --rate 100"
        )
    return rate, episodes


def _write_videos(
    folder: Path, number: int, columns: _Columns, rate: int
) -> dict[str, np.ndarray]:
    """Write the pictures among the columns of an episode, and return some pixels."""
    pixels = {}
    for name in [name for name in columns if name.startswith(_PICTURES)]:
        with optional_libraries("--pictures needs imageio-ffmpeg", "lerobot"):
            import imageio_ffmpeg
        pictures, (chunk, index) = columns[name], divmod(number, _CHUNK)
        place = _VIDEO.format(video_key=name, chunk_index=chunk, file_index=index)
        (file := folder / place).parent.mkdir(parents=True, exist_ok=True)
        encoder = imageio_ffmpeg.write_frames(
            file, pictures.shape[2:0:-1], fps=rate, **_ENCODING
        )
        with contextlib.closing(encoder):
            encoder.send(None)
            for picture in pictures:
                encoder.send(picture)
        # ffmpeg reports a full disk only on its standard error.
        if imageio_ffmpeg.count_frames_and_secs(file)[0] != len(pictures):
            raise OSError(f"{name}: ffmpeg lost pictures; is there space on the disk?")
        pixels[name] = pictures[_SAMPLED].reshape(-1, 3, 1, 1)
    return pixels


def _statistics(samples: np.ndarray) -> dict[str, Any]:
    """Return statistics over the first axis, as lists."""
    kinds = ("min", "max", "mean", "std")
    statistics = {kind: getattr(samples, kind)(axis=0).tolist() for kind in kinds}
    return {"count": [len(samples)]} | statistics


def _write(
    path: Path, rate: int, episodes: Iterable[_Columns], form: Form, about: str
) -> int:
    """Write a data set with its card, and return the number of episodes."""
    with complete_folder(path) as written:
        kept, colours = list[_Columns](), list[dict[str, np.ndarray]]()
        for columns in episodes:
            colours.append(_write_videos(written, len(kept), columns, rate))
            kept.append({n: columns[n] for n in columns if n not in colours[-1]})
        if not kept:
            raise ValueError("no demonstration opens its door; is it the right door?")
        lengths = np.array([len(columns[STATE]) for columns in kept])
        numbers, ends = np.arange(len(lengths)), np.cumsum(lengths)
        frames = np.concatenate([np.arange(length) for length in lengths])
        whole: dict[str, Any] = {
            name: np.vstack([columns[name] for columns in kept]).astype(np.float32)
            for name in kept[0]
            if all(name in columns for columns in kept)
        }
        if partial := ", ".join(sorted(set[str]().union(*kept) - whole.keys())):
            LOG.warning(f"warning: left out, as some demonstrations lack it: {partial}")
        whole["timestamp"] = (frames / rate).astype(np.float32)
        whole["frame_index"] = frames
        whole["episode_index"] = np.repeat(numbers, lengths)
        whole["index"] = np.arange(len(frames))
        whole["task_index"] = np.zeros(len(frames), dtype=np.int64)
        names = _COMPONENTS | {_ACTION: _OF_ACTIONS[form.action]}
        data, features, statistics = {}, dict[str, Any](), {}
        for name, values in whole.items():
            samples = values.astype(np.float64).reshape(len(values), -1)
            column, width = pyarrow.array(values.ravel()), samples.shape[1]
            if values.ndim == 2:
                column = pyarrow.FixedSizeListArray.from_arrays(column, width)
            data[name], statistics[name] = column, _statistics(samples)
            features[name] = {"dtype": str(values.dtype), "shape": [width]}
            features[name]["names"] = names.get(name)
        if OBSERVED_WRENCH in features:
            features[OBSERVED_WRENCH]["info"] = AS_OBSERVED
        table: dict[str, Any] = {
            "episode_index": numbers,
            "tasks": [[TASK]] * len(lengths),
            "length": lengths,
            "dataset_from_index": ends - lengths,
            "dataset_to_index": ends,
            **{
                f"{part}/{index}_index": np.zeros_like(numbers)
                for part in ("data", "meta/episodes")
                for index in ("chunk", "file")
            },
        }
        for name in colours[0]:
            pixels = np.concatenate([episode[name] for episode in colours])
            statistics[name] = _statistics(pixels / 255.0)
            features[name] = {"dtype": "video", "shape": [*form.size[::-1], 3]}
            features[name]["names"] = ["height", "width", "channels"]
            features[name]["info"] = {"video.fps": rate, "video.codec": "h264"}
            table[f"videos/{name}/chunk_index"] = numbers // _CHUNK
            table[f"videos/{name}/file_index"] = numbers % _CHUNK
            table[f"videos/{name}/from_timestamp"] = np.zeros(len(lengths))
            table[f"videos/{name}/to_timestamp"] = lengths / rate
        tasks = pyarrow.table({"task_index": [0], "task": [TASK]})
        info = _ABOUT | {
            "total_episodes": len(lengths),
            "total_frames": len(frames),
            "fps": rate,
            "splits": {"train": f"0:{len(lengths)}"},
            "video_path": _VIDEO if colours[0] else None,
            "features": features,
        }
        for rows, place in (
            (pyarrow.table(data), f"data/{_FILE}"),
            (pyarrow.table(table), f"meta/episodes/{_FILE}"),
            (tasks.replace_schema_metadata(_PANDAS), "meta/tasks.parquet"),
        ):
            (written / place).parent.mkdir(parents=True, exist_ok=True)
            pyarrow.parquet.write_table(rows, written / place)
        write_json(written / "meta/stats.json", statistics)
        write_json(written / INFO, info, indent=4)
        card = _CARD.format(
            title=path.name,
            about=about,
            info=info,
            form=form,
            cameras=",".join(form.cameras),
            sha256=content_hash(written / f"data/{_FILE}"),
            versions=", ".join(map(" ".join, versions().items())),
        )
        (written / "README.md").write_text(card, encoding="utf-8", newline="\n")
    return len(lengths)
