"""Every kind of motion file is read as it was written, or refused with one message.

First files of every kind, written by the libraries that usually write them or by the
format's description; then the contract of all readers, what is particular to a kind,
refusals, and files that would fill the memory.
"""

import contextlib
import importlib
import json
import os
import shutil
import sqlite3
import struct
import subprocess
import sys
import tracemalloc
import warnings
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import ezc3d
import h5py
import lz4.frame
import numpy as np
import pyarrow
import pyarrow.parquet
import pytest
import scipy.io
from numpy.testing import assert_allclose, assert_array_equal
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from gplfd_experiments.data.minari import open_dataset
from gplfd_experiments.data.preparation import Preparation, prepare
from gplfd_experiments.data.raw import METRES, RawRecording, Selection
from gplfd_experiments.data.readers import READERS, read_recordings
from gplfd_experiments.data.readers.matlab import read_arrays
from gplfd_policies.arrays.storage import DecodingBudget
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.demonstrations.npz import save_demonstrations

pytestmark = pytest.mark.slow

VARIANTS = int(os.environ.get("GPLFD_VARIANTS", "14"))
"""Damaged files of every kind; 200 take a quarter of a minute each."""
RECORDED = Path(__file__).with_name("data") / "door-opening-v0"
N = 60
RATE = 64.0
TIMES = np.arange(N) / RATE
PHASE = np.linspace(0.0, 1.0, N)
POSITIONS = np.column_stack([0.3 + 0.5 * PHASE, np.sin(3.0 * PHASE), PHASE**2])
ROTATIONS = Rotation.from_rotvec(np.column_stack([PHASE, 0.5 - PHASE, 2.0 * PHASE]))
WXYZ = ROTATIONS.as_quat(scalar_first=True)
XYZW = ROTATIONS.as_quat()
FORCE = np.column_stack([10.0 * PHASE, PHASE, -PHASE, 0.1 * PHASE, PHASE, PHASE])
STORE = get_typestore(Stores.ROS2_HUMBLE)


# ------------------------------------------------------------------ files of every kind
def write_csv(path: Path) -> None:
    heads = "time [s],x [m],y [m],z [m],qw,qx,qy,qz,comment,fx,fy,fz,"
    heads += "mx [N mm],my [N mm],mz [N mm]"
    forces = FORCE * [1.0, 1.0, 1.0, 1e3, 1e3, 1e3]
    rows = np.column_stack([TIMES, POSITIONS, WXYZ, np.zeros(N), forces]).tolist()
    lines = [",".join(map(repr, row)) for row in rows]
    path.write_text("# recorded by hand\n" + "\n".join([heads, *lines]) + "\n")


def write_npz(path: Path) -> None:
    np.savez(path, times=TIMES, positions=POSITIONS, quaternions_xyzw=XYZW)


def write_npy(path: Path) -> None:
    np.save(path, np.column_stack([TIMES, POSITIONS, WXYZ]))


def write_mat(path: Path, format: str = "5") -> None:
    arrays = {"t": TIMES, "p": 1e3 * POSITIONS, "q": WXYZ, "forces": FORCE}
    scipy.io.savemat(path, arrays, do_compression=format == "5", format=format)


def write_mat_cells(path: Path) -> None:
    """Two recordings as MATLAB users keep them: structures in cells, samples across."""
    one = {"pos": 100.0 * POSITIONS.T, "t": TIMES, "q": WXYZ.T, "label": "first"}
    cells = np.empty((1, 2), dtype=object)
    cells[0, :] = [one, one]
    scipy.io.savemat(path, {"dt": 1.0 / RATE, "demos": cells}, do_compression=True)


def write_mvnx(path: Path) -> None:
    def frame(kind: str, index: str, place: int) -> str:
        own = POSITIONS[place].tolist(), WXYZ[place].tolist()
        position, orientation = (
            " ".join(map(repr, [*other, *numbers]))
            for other, numbers in zip(([9.0] * 3, [1.0, 0, 0, 0]), own, strict=True)
        )
        return (
            f'<frame time="{int(place * 1000 / RATE)}" {index} type="{kind}">'
            f"<orientation>{orientation}</orientation>"
            f"<position>{position}</position></frame>"
        )

    frames = [
        frame("tpose", "", 5),
        *(frame("normal", f'index="{i}"', i) for i in range(N)),
    ]
    path.write_text(
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<mvnx version="4" xmlns="http://www.xsens.com/mvn/mvnx">\n'
        f'<subject label="a" frameRate="{RATE:g}" segmentCount="2">\n'
        '<segments><segment label="Pelvis" id="1"/><segment label="RightHand" id="2"/>'
        "</segments>\n<frames>\n" + "\n".join(frames) + "\n</frames></subject></mvnx>\n"
    )


def write_bvh(path: Path) -> None:
    # The root moves by the positions, the hand sits in it without offset.
    angles = ROTATIONS.as_euler("ZXY", degrees=True)
    frames = np.column_stack([100.0 * POSITIONS, angles])
    lines = [" ".join(map(repr, row)) for row in frames.tolist()]
    path.write_text(
        "HIERARCHY\nROOT Hips\n{\n OFFSET 0 0 0\n CHANNELS 6 Xposition Yposition "
        "Zposition Zrotation Xrotation Yrotation\n JOINT RightHand\n {\n  OFFSET "
        "0 0 0\n  CHANNELS 0\n  End Site\n  {\n   OFFSET 0 1 0\n  }\n }\n}\n"
        f"MOTION\nFrames: {N}\nFrame Time: {1 / RATE!r}\n" + "\n".join(lines) + "\n"
    )


SHAPE = np.array([[0.1, 0.0, 0.0], [-0.1, 0.1, 0.0], [0.0, -0.1, 0.1]])
SHAPE = SHAPE - SHAPE.mean(axis=0)


def write_c3d(path: Path) -> None:
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["RATE"]["value"] = [RATE]
    file["parameters"]["POINT"]["UNITS"]["value"] = ("mm",)
    file["parameters"]["POINT"]["LABELS"]["value"] = ("A", "B", "C")
    points = np.ones((4, 3, N))
    for place, arm in enumerate(SHAPE):
        points[:3, place] = 1e3 * (POSITIONS + ROTATIONS.apply(arm)).T
    file["data"]["points"] = points
    file.write(str(path))


def ros(kind: str, *fields: Any) -> Any:
    """A message of a type such as "geometry_msgs/Pose"."""
    return STORE.types[kind.replace("/", "/msg/")](*fields)


def header(place: int) -> Any:
    seconds, ns = divmod(round(TIMES[place] * 1e9), 10**9)
    time = ros("builtin_interfaces/Time", 100 + seconds, ns)
    return ros("std_msgs/Header", time, "base")


def vector(kind: str, numbers: Any) -> Any:
    return ros(f"geometry_msgs/{kind}", *map(float, numbers))


def pose(place: int) -> Any:
    position = vector("Point", POSITIONS[place])
    return ros("geometry_msgs/Pose", position, vector("Quaternion", XYZW[place]))


def transform(place: int) -> Any:
    shift, turn = vector("Vector3", POSITIONS[place]), vector("Quaternion", XYZW[place])
    inner = ros("geometry_msgs/Transform", shift, turn)
    return ros("geometry_msgs/TransformStamped", header(place), "hand", inner)


def odometry(place: int) -> Any:
    posed = ros("geometry_msgs/PoseWithCovariance", pose(place), np.zeros(36))
    still = ros("geometry_msgs/Twist", *2 * [vector("Vector3", [0, 0, 0])])
    moving = ros("geometry_msgs/TwistWithCovariance", still, np.zeros(36))
    return ros("nav_msgs/Odometry", header(place), "hand", posed, moving)


def wrench(place: int) -> Any:
    parts = (vector("Vector3", part) for part in (FORCE[place, :3], FORCE[place, 3:]))
    inner = ros("geometry_msgs/Wrench", *parts)
    return ros("geometry_msgs/WrenchStamped", header(place), inner)


def joints(place: int) -> Any:
    values = PHASE[place] * np.array([1.0, 2.0]), np.zeros(0), np.zeros(0)
    return ros("sensor_msgs/JointState", header(place), ["slide", "turn"], *values)


TOPICS: dict[str, Callable[[int], Any]] = {
    "/hand": lambda n: ros("geometry_msgs/PoseStamped", header(n), pose(n)),
    "/t": transform,
    "/tf": lambda n: ros("tf2_msgs/TFMessage", [transform(n)]),
    "/o": odometry,
    "/wrench": wrench,
    "/joints": joints,
}


def write_bag(path: Path, *topics: str, storage: Any = StoragePlugin.MCAP) -> None:
    with Writer(path, version=9, storage_plugin=storage) as writer:
        for topic in topics:
            messages = [TOPICS[topic](place) for place in range(N)]
            kind = messages[0].__msgtype__
            connection = writer.add_connection(topic, kind, typestore=STORE)
            for time, message in zip(TIMES, messages, strict=True):
                content = STORE.serialize_cdr(message, kind)
                writer.write(connection, round((100 + time) * 1e9), content)


def write_one_file(path: Path, storage: Any = StoragePlugin.MCAP) -> None:
    folder = path.with_suffix("")
    write_bag(folder, "/hand", "/wrench", storage=storage)
    next(folder.glob(f"*{path.suffix}")).rename(path)
    (folder / "metadata.yaml").unlink()


def write_robomimic(path: Path) -> None:
    with h5py.File(path, "w") as file:
        data = file.create_group("data")
        data.attrs["env_args"] = json.dumps({"env_kwargs": {"control_freq": RATE}})
        for name in ("demo_10", "demo_2"):
            obs = data.create_group(f"{name}/obs")
            obs["robot0_eef_pos"] = POSITIONS
            obs["robot0_eef_quat"] = XYZW
            obs["robot0_gripper_qpos"] = FORCE[:, :2]
            obs["robot0_eef_wrench"] = FORCE


def write_lerobot(path: Path, columns: Any = None) -> None:
    (path / "meta").mkdir(parents=True)
    (path / "data/chunk-000").mkdir(parents=True)
    names = ["x", "y", "z", "qx", "qy", "qz", "qw"]
    state = {"dtype": "float64", "shape": [7], "names": names}
    info = {
        "codebase_version": "v3.0",
        "fps": int(RATE),
        "features": {
            "observation.state": state,
            "observation.force": {"dtype": "float64", "shape": [6], "names": None},
        },
    }
    (path / "meta/info.json").write_text(json.dumps(info))
    table = {
        "observation.state": list(np.tile(np.hstack([POSITIONS, XYZW]), (2, 1))),
        "observation.force": list(np.tile(FORCE, (2, 1))),
        "episode_index": np.repeat([0, 1], N),
        "frame_index": np.tile(np.arange(N), 2),
    }
    pyarrow.parquet.write_table(
        pyarrow.table(columns or table), path / "data/chunk-000/file-000.parquet"
    )


def write_set(path: Path) -> None:
    poses = np.hstack([POSITIONS, ROTATIONS.as_rotvec()])
    one = Demonstration(times=TIMES, poses=poses, wrenches=FORCE)
    save_demonstrations(path, [one])


def write_set_folder(path: Path) -> None:
    path.mkdir()
    write_set(path / "demonstrations.npz")


ANY = Selection()


@dataclass(frozen=True)
class Kind:
    """How files of a kind are written, read, and where in them damage goes."""

    reader: str
    write: Callable[[Path], Any]
    name: str
    selection: Selection = ANY
    damaged: str = ""
    text: bool = False
    signals: Mapping[str, Any] = field(default_factory=dict)
    forces: bool = True


FORCELESS: Any = {"forces": False}
SQLITE = {"storage": StoragePlugin.SQLITE3}
COLUMNS = ("t", "x", "y", "z", "qw", "qx", "qy", "qz")
GRIPPER = {"gripper": FORCE[:, :2]}
PARQUET, INFO = "data/chunk-000/file-000.parquet", "meta/info.json"
METADATA = "data/metadata.json"
write_minari = partial(shutil.copytree, RECORDED)
MM, CM = (Selection(quaternions="wxyz", units=unit) for unit in ("mm", "cm"))
KINDS = {
    "csv": Kind("csv", write_csv, "a.csv", text=True),
    "npz": Kind("numpy", write_npz, "a.npz", **FORCELESS),
    "npy": Kind(
        "numpy", write_npy, "a.npy", Selection(columns=COLUMNS, units="m"), **FORCELESS
    ),
    "mat": Kind("matlab", write_mat, "a.mat", MM),
    "mat-4": Kind("matlab", partial(write_mat, format="4"), "a.mat", MM),
    "mat-cells": Kind("matlab", write_mat_cells, "b.mat", CM, **FORCELESS),
    "mvnx": Kind("mvnx", write_mvnx, "a.mvnx", text=True, **FORCELESS),
    "bvh": Kind(
        "bvh", write_bvh, "a.bvh", Selection(units="cm"), text=True, **FORCELESS
    ),
    "c3d": Kind("c3d", write_c3d, "a.c3d", Selection(body="A,B,C"), **FORCELESS),
    "mcap": Kind("ros", write_one_file, "a.mcap"),
    "db3": Kind("ros", partial(write_one_file, **SQLITE), "a.db3"),
    "bag": Kind(
        "ros",
        lambda bag: write_bag(bag, "/t", **SQLITE),
        "bag",
        damaged="bag.db3",
        **FORCELESS,
    ),
    "robomimic": Kind("robomimic", write_robomimic, "a.hdf5", signals=GRIPPER),
    "lerobot": Kind("lerobot", write_lerobot, "set", damaged=PARQUET),
    "lerobot-info": Kind("lerobot", write_lerobot, "set", damaged=INFO, text=True),
    "minari": Kind("minari", write_minari, "set-v0", damaged=METADATA, text=True),
    "own": Kind("numpy", write_set, "b.npz"),
    "set": Kind("set", write_set_folder, "set", damaged="demonstrations.npz"),
}


@pytest.fixture(scope="module", params=KINDS)
def written(request: Any, tmp_path_factory: Any) -> tuple[Kind, Path]:
    kind = KINDS[request.param]
    path = tmp_path_factory.mktemp(request.param) / kind.name
    kind.write(path)
    return kind, path


# ------------------------------------------------------------------ the contract
def test_every_reader_keeps_the_contract():
    assert {kind.reader for kind in KINDS.values()} == set(READERS)


def test_reads_what_was_written(written):
    kind, path = written
    found = read_recordings(path, kind.selection)
    names = [one.name for one in found]
    assert len(set(names)) == len(names)
    if kind.reader == "robomimic":  # in the order of the numbers
        assert names == ["a.hdf5: demo_2", "a.hdf5: demo_10"]
    assert all(name.startswith(path.name) for name in names)
    float32 = path.suffix == ".c3d"
    positions, rotations, times = POSITIONS, ROTATIONS, TIMES
    if kind.reader == "minari":
        seen = open_dataset(path).episode(0).observations
        positions, times = seen["ee_pose"][:, :3], seen["time"][:, 0]
        rotations = Rotation.from_rotvec(seen["ee_pose"][:, 3:])
        assert_array_equal(found[0].wrenches, seen["wrench"])
    for one in found:
        metres = METRES[one.unit or kind.selection.units or "m"]
        assert_allclose(
            metres * one.positions, positions, rtol=0, atol=1e-6 if float32 else 1e-9
        )
        # Bags have whole nanoseconds since an epoch, read as seconds since the first.
        atol = 1e-15 if kind.reader == "ros" else 0.0
        assert_allclose(np.asarray(one.times), times, rtol=0, atol=atol)
        assert one.quaternions is not None
        for name, signal in kind.signals.items():
            assert_allclose(one.signals[name], signal, rtol=0, atol=1e-12)
        # Markers of a body tell its orientation relative to its first.
        expected = rotations * rotations[0].inv() if float32 else rotations
        turned = Rotation.from_quat(one.quaternions, scalar_first=True)
        apart = (turned * expected.inv()).magnitude().max()
        assert apart < (1e-5 if float32 else 1e-9)


AS_RECORDED = Preparation(frame="recorded", trim_rests=False, cutoff=None, rate=None)


def test_forces_pass_from_files_to_demonstrations(written):
    """As a WrenchStamped has them, unless the files are of this program."""
    kind, path = written
    prepared = prepare(read_recordings(path, kind.selection), AS_RECORDED)
    turned = np.einsum("nij,npj->npi", ROTATIONS.as_matrix(), FORCE.reshape(N, 2, 3))
    expected = -turned.reshape(N, 6)
    if kind.reader == "minari":
        expected = -open_dataset(path).episode(0).observations["wrench"]
    elif kind.write in (write_set, write_set_folder):
        expected = FORCE
    for motion in prepared[: 1 if kind.reader == "minari" else None]:
        found = motion.demonstration.wrenches
        assert (found is not None) == kind.forces
        if found is not None:
            assert_allclose(found, expected, rtol=0, atol=1e-9)
            says = kind.reader == "minari" or kind.write in (
                write_set,
                write_set_folder,
            )
            notes = " ".join(note.text for note in motion.notes)
            assert (
                "forces are on the hand, in the axes of the sensor" in notes
            ) != says


def test_nothing_is_waited_for(written, tmp_path):
    """A named pipe without a writer, where a file of this kind is expected."""
    kind, path = written
    copy = tmp_path / path.name
    if path.is_dir():
        shutil.copytree(path, copy)
        (copy / kind.damaged).unlink()
    os.mkfifo(pipe := copy / kind.damaged)
    # A pipe is no mark of a folder of any kind.
    missing = path.is_dir() and kind.damaged not in (PARQUET, "bag.db3")
    message = "unknown folder" if missing else rf"{pipe.name} is a named pipe; give a"
    with pytest.raises(ValueError, match=message):
        read_recordings(copy, kind.selection)
    os.mkfifo(tmp_path / "a.unknown")
    with pytest.raises(ValueError, match=r"a\.unknown is a named pipe; give a record"):
        read_recordings(tmp_path / "a.unknown", ANY)


TOKENS = (b"", b"0", b"-1", b"nan", b"1e999", b"9" * 400, b"null", b"[]", b"\xff\xfe")


def damaged(content: bytes, rng: np.random.Generator, text: bool) -> bytes:
    """Cut, flip, overwrite, remove, repeat; or replace a number by something else."""
    # Half of the damage goes where files say what they hold.
    near = min(len(content), 2048) if rng.random() < 0.5 else len(content)
    start = int(rng.integers(near))
    end = start + int(2 ** rng.uniform(0, np.log2(len(content) - start + 1)))
    head, run, tail = content[:start], content[start:end], content[end:]
    number = rng.choice([0, 1, 2**15, 2**31 - 1, 2**32 - 1, 2**62])
    claim = struct.pack("<Q", number)[: int(rng.choice([2, 4, 8]))]
    flipped = bytes([content[start] ^ (1 << int(rng.integers(8)))])
    words = content.split(b" ")
    words[int(rng.integers(len(words)))] = TOKENS[rng.integers(len(TOKENS))]
    ways = (
        head,
        head + flipped + content[start + 1 :],
        head + bytes([int(rng.choice([0, 255]))]) * len(run) + tail,
        head + tail,
        head + run + run + tail,
        head + claim + content[start + len(claim) :],
        b" ".join(words),
    )
    return ways[rng.integers(7 if text else 6)]


USUAL = Preparation(segments="rests", frame="hinge")


def test_damaged_files_are_read_or_refused(written):
    kind, path = written
    file = path / kind.damaged
    original = file.read_bytes()
    rng = np.random.default_rng(20)
    refused = []
    for number in range(VARIANTS):
        file.write_bytes(damaged(original, rng, kind.text))
        # Measuring memory takes several times as long as reading.
        if number % 2 == 0:
            tracemalloc.start()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                recordings = read_recordings(path, kind.selection)
                # What was read may be anything, and is prepared or refused.
                with contextlib.suppress(ValueError):
                    prepare(recordings[: number % 8 == 0], USUAL, recorded_rate=RATE)
        except ValueError as error:
            refused.append(str(error))
        assert tracemalloc.get_traced_memory()[1] < 2 * len(original) + 200 * 2**20
        tracemalloc.stop()
    file.write_bytes(original)
    assert len(refused) > VARIANTS // 10
    assert all(str(path) in message for message in refused)
    assert max(map(len, refused)) < 1000


# ------------------------------------------------------------------ particular kinds
def only(path: Path, **selection: Any) -> RawRecording:
    (one,) = read_recordings(path, Selection(**selection))
    return one


def quaternions(one: RawRecording) -> Any:
    assert one.quaternions is not None
    return one.quaternions


@pytest.mark.parametrize(
    ("module", "library", "extra"),
    [
        ("bags", "rosbags.highlevel", "ros"),
        ("robomimic", "h5py", "robomimic"),
        ("lerobot", "pyarrow.parquet", "lerobot"),
    ],
)
def test_a_library_that_is_missing_is_named_with_its_extra(
    monkeypatch, module, library, extra
):
    name = f"gplfd_experiments.data.readers.{module}"
    monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(ModuleNotFoundError, match=rf"pip install 'gplfd\[{extra}\]'"):
        importlib.import_module(name)


def test_reads_every_message_with_a_pose_and_joint_states(tmp_path):
    bag = tmp_path / "bag"
    write_bag(bag, "/t", "/o", "/tf", "/joints", "/hand")
    for topic in ("/t", "/o", "/tf:hand", "/hand"):
        one = only(bag, body=topic)
        assert_allclose(one.positions, POSITIONS, atol=1e-12)
        assert_allclose(quaternions(one), WXYZ, atol=1e-12)
    # The pose of a link from the joints of its robot.
    (tmp_path / "r.urdf").write_text(URDF)
    robot = {"body": "/joints", "urdf": tmp_path / "r.urdf"}
    one = only(bag, **robot, link="hand")
    straight = np.column_stack([PHASE, np.full(N, 0.2), np.zeros(N)])
    assert_allclose(one.positions, straight, atol=1e-12)
    turned = Rotation.from_quat(quaternions(one), scalar_first=True).as_rotvec()
    assert_allclose(turned[:, 2], 2.0 * PHASE, atol=1e-12)
    for selection, message in (
        ({}, r"has more than one topic; choose with --body: /"),
        ({"body": "/tf"}, r"say which frame: --body /tf:FRAME, of hand"),
        ({"body": "/tf:palm"}, r"/tf has no frame 'palm': .*, of hand"),
        ({"body": "/joints"}, r"--urdf FILE --link NAME"),
        ({**robot, "link": "claw"}, r"no link 'claw'; it has base, arm, hand"),
    ):
        with pytest.raises(ValueError, match=message):
            read_recordings(bag, Selection(**selection))


def test_forces_of_a_bag_are_those_of_one_topic_on_the_clock_of_the_hand(
    tmp_path, monkeypatch
):
    for topic in ("/a", "/b"):
        monkeypatch.setitem(TOPICS, topic, wrench)
    write_bag(tmp_path / "bag", "/hand", "/a", "/b")
    one = only(tmp_path / "bag")
    assert one.wrenches is None
    assert one.notes == ("forces left out: choose with --wrench: /a, /b",)
    one = only(tmp_path / "bag", wrench="/b")
    assert_allclose(one.wrenches, FORCE, rtol=0, atol=1e-12)
    with pytest.raises(ValueError, match="has no force topic '/c'; it has /a, /b"):
        only(tmp_path / "bag", wrench="/c")
    # Forces at every fifth sample from the tenth to the fortieth, but for three.
    sparse = [10, 15, 20, 40]
    bag = tmp_path / "sparse"
    with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, places in (("/hand", range(N)), ("/wrench", sparse)):
            messages = [TOPICS[topic](place) for place in places]
            kind = messages[0].__msgtype__
            connection = writer.add_connection(topic, kind, typestore=STORE)
            for message in messages:
                writer.write(connection, 1, STORE.serialize_cdr(message, kind))
    found = only(bag).wrenches
    assert found is not None
    # Linear between the samples, and missing far from all of them.
    missing = np.isnan(found).any(axis=1)
    assert_array_equal(np.flatnonzero(~missing), [*range(5, 26), *range(35, 46)])
    between = [*range(10, 26), *range(35, 41)]
    assert_allclose(found[between], FORCE[between], atol=1e-12)


def test_features_and_observations_of_forces_are_chosen(tmp_path):
    write_lerobot(tmp_path / "set")
    info = json.loads((tmp_path / "set/meta/info.json").read_text())
    info["features"]["observation.force"]["shape"] = [1]
    (tmp_path / "set/meta/info.json").write_text(json.dumps(info))
    first, _ = read_recordings(tmp_path / "set", ANY)
    assert first.wrenches is None  # Of another shape, it is something else.
    for name, message in (
        ("observation.state", "observation.state has 7 numbers, not fx, fy, fz, mx"),
        ("force", "has no feature of numbers 'force'"),
    ):
        with pytest.raises(ValueError, match=message):
            read_recordings(tmp_path / "set", Selection(wrench=name))
    write_robomimic(tmp_path / "a.hdf5")
    with pytest.raises(ValueError, match=r"obs/robot0_eef_pos has shape .*\(N, 6\)"):
        read_recordings(tmp_path / "a.hdf5", Selection(wrench="robot0_eef_pos"))


URDF = """<robot name="r"><link name="base"/><link name="arm"/><link name="hand"/>
<joint name="slide" type="prismatic"><parent link="base"/><child link="arm"/>
<axis xyz="1 0 0"/><limit lower="-9" upper="9" effort="1" velocity="1"/></joint>
<joint name="turn" type="revolute"><parent link="arm"/><child link="hand"/>
<origin xyz="0 0.2 0"/><axis xyz="0 0 1"/>
<limit lower="-9" upper="9" effort="1" velocity="1"/></joint></robot>"""


def test_c3d_agrees_with_ezc3d_on_lost_markers_and_integers(tmp_path):
    path = tmp_path / "a.c3d"
    write_c3d(path)
    marker = only(path, body="B")
    file = ezc3d.c3d(str(path))
    oracle = file["data"]["points"][:3, 1].T
    assert_array_equal(marker.positions, oracle)
    assert marker.quaternions is None
    # The same file with integer coordinates, and marker B lost in frame 3.
    content = bytearray(path.read_bytes())
    start = 512 * (struct.unpack_from("<H", content, 16)[0] - 1)
    floats = np.frombuffer(content[start : start + 48 * N], "<f4").reshape(N, 3, 4)
    integers = np.round(floats * 4.0).astype("<i2")
    integers[..., 3], integers[3, 1, 3] = 0, -1
    struct.pack_into("<f", content, 12, 0.25)
    content[start:] = integers.tobytes()
    (tmp_path / "b.c3d").write_bytes(content)
    whole = only(tmp_path / "b.c3d", body="B")
    lost = np.isnan(whole.positions).any(axis=1)
    assert_array_equal(np.flatnonzero(lost), [3])
    assert_allclose(whole.positions[~lost], oracle[~lost], atol=0.126)
    # Markers of which one slides away by 5 cm are on no rigid body.
    points = np.ones((4, 3, N))
    points[:3] = file["data"]["points"][:3]
    points[0, 2] += np.linspace(0.0, 50.0, N)
    file["data"]["points"] = points
    file.write(str(path))
    with pytest.raises(ValueError, match=r"A, B, C keep .* of 60 .* not on a rigid"):
        only(path, body="A,B,C")


MARKERS = np.concatenate([1e3 * POSITIONS, np.zeros((N, 1))], axis=1).astype("f4")
"""What `c3d_of` writes of its only marker: mm, and that it was seen."""


def c3d_of(
    processor: int, *, analog: int = 0, sampled: int = 1, blocks: int = 1
) -> bytes:
    """A C3D file after the format's description, as a processor writes numbers."""
    order = ">" if processor == 86 else "<"

    def floats(numbers: Any) -> bytes:
        values = np.asarray(numbers, order + "f4")
        if processor != 85:
            return values.tobytes()
        words = (values * np.float32(4.0)).view("<u2").reshape(-1, 2)
        return words[:, ::-1].tobytes()

    def integers(*numbers: int) -> bytes:
        return np.asarray(numbers, order + "i2").tobytes()

    def named(group: int, name: bytes, body: bytes = b"") -> bytes:
        start = struct.pack("bb", len(name), group) + name
        return start + integers(3 + len(body)) + body + b"\0"

    head = bytes([2, 80]) + integers(1, analog, 1, N, 0) + floats([-1.0])
    head += integers(4, sampled) + floats([RATE])
    parameters = bytes([1, 80, blocks, processor])
    parameters += named(-1, b"POINT") + named(1, b"UNITS", b"\xff\1\2mm")
    for name, number in ((b"USED", 1), (b"FRAMES", N), (b"DATA_START", 4)):
        parameters += named(1, name, b"\2\0" + integers(number))
    for name, value in ((b"SCALE", -1.0), (b"RATE", RATE)):
        parameters += named(1, name, b"\4\0" + floats([value]))
    parameters += named(-2, b"ANALOG") + named(2, b"USED", b"\2\0" + integers(analog))
    parameters += named(2, b"RATE", b"\4\0" + floats([sampled * RATE]))
    parameters += named(1, b"DESCRIPTIONS", bytes([255, 2, 100, 5]) + 500 * b".")
    parameters += named(1, b"LABELS", b"\xff\2\4\1HAND")
    rest = np.full((N, max(1, analog * sampled)), -2048.0)[:, : analog * sampled]
    frames = floats(np.hstack([MARKERS, rest]).ravel())
    return head.ljust(512, b"\0") + parameters.ljust(1024, b"\0") + frames


@pytest.mark.parametrize("processor", [84, 85, 86])
def test_c3d_of_every_processor_is_read(tmp_path, processor):
    path = tmp_path / "a.c3d"
    path.write_bytes(c3d_of(processor, blocks=2))
    read = only(path, body="HAND")
    assert_array_equal(read.positions, MARKERS[:, :3])
    assert read.unit == "mm"
    assert_array_equal(read.times, TIMES)
    if processor != 86:  # which ezc3d does not read
        oracle = ezc3d.c3d(str(path))["data"]["points"][:3, 0].T
        assert_array_equal(oracle, MARKERS[:, :3])


def test_c3d_is_read_where_its_program_counted_wrongly(tmp_path):
    path = tmp_path / "a.c3d"
    # Seven samples of two channels a frame counted as two, two blocks as one.
    path.write_bytes(c3d_of(84, analog=2, sampled=7, blocks=1))
    assert_array_equal(only(path, body="HAND").positions, MARKERS[:, :3])
    # Markers without a label have a number, and a strange unit can be said.
    path.write_bytes(c3d_of(84).replace(b"LABELS", b"TITLES").replace(b"\2mm", b"\2mu"))
    with pytest.raises(ValueError, match=r"UNITS is 'mu'.*say --units"):
        only(path, body="1")
    assert_array_equal(only(path, body="1", units="mm").positions, MARKERS[:, :3])


def test_bvh_follows_the_chain_of_joints(tmp_path):
    # A hand at the end of an arm of 2 that the root turns by 90° about z.
    path = tmp_path / "a.bvh"
    text = (
        "HIERARCHY\nROOT Hips\n{\nOFFSET 1 0 0\nCHANNELS 3 Zrotation Xrotation "
        "Yrotation\nJOINT RightHand\n{\nOFFSET 2 0 0\nCHANNELS 3 Zrotation "
        "Xrotation Yrotation\n"
        "End Site\n{\nOFFSET 0 0 0\n}\n}\n}\nMOTION\nFrames: 2\nFrame Time: 0.5\n"
        "0 0 0 0 0 0\n90 0 0 0 90 0\n"
    )
    # Programs that write positions of every joint repeat its offset in them.
    moving = text.replace(
        "2 0 0\nCHANNELS 3", "2 0 0\nCHANNELS 6 Xposition Yposition Zposition"
    ).replace("0 0 0 0 0 0\n90 0 0 0", "0 0 0 2 0 0 0 0 0\n90 0 0 2 0 0 0")
    about_z, about_x = (Rotation.from_euler(a, 90, degrees=True) for a in "ZX")
    for content in (text, moving, text.replace("RightHand", "RightWrist")):
        path.write_text(content)
        one = only(path)
        assert_allclose(one.positions, [[3, 0, 0], [1, 2, 0]], atol=1e-12)
        found = Rotation.from_quat(quaternions(one)[1], scalar_first=True)
        assert (found * (about_z * about_x).inv()).magnitude() < 1e-12
        assert one.unit is None


# ------------------------------------------------------------------ tables of people
def table(tmp_path: Path, text: str, **options: Any) -> RawRecording:
    (tmp_path / "a.csv").write_text(text)
    return only(tmp_path / "a.csv", **options)


def test_heads_say_units_and_places(tmp_path):
    heads = "y (cm);x_cm;Time [ms];rz [deg];rx [deg];ry [deg]"
    one = table(tmp_path, f"{heads}\n1,5;2;0;90;0;0\n1;2;4;90;0;0")
    assert one.unit == "cm"
    assert_array_equal(one.positions, [[2, 1.5, 0], [2, 1, 0]])
    assert_array_equal(one.times, [0, 0.004])
    assert_allclose(quaternions(one)[0], [0.5**0.5, 0, 0, 0.5**0.5], atol=1e-15)
    # Given columns replace heads, and name what is left out.
    one = table(tmp_path, "a b c d\n1 9 2 3\n4 9 5 6\n", columns=("x", "-", "y", "z"))
    assert_array_equal(one.positions, [[1, 2, 3], [4, 5, 6]])
    assert one.times is None
    one = table(tmp_path, "   1.0e-01  2   3\n  -4 5 6\n", columns=("x", "y", "z"))
    assert_array_equal(one.positions, [[0.1, 2, 3], [-4, 5, 6]])


def test_rotation_vectors_of_many_turns_are_noticed(tmp_path):
    one = table(tmp_path, "x,y,z,rx,ry,rz\n0,0,0,0,0,45\n0,0,1,0,0,90\n")
    assert "are they degrees? say --angles deg" in one.notes[0]
    assert not table(tmp_path, "x,y,rx,ry,rz\n0,0,0,0,1\n0,1,0,0,2\n").notes


def test_columns_that_are_not_used_are_named(tmp_path):
    text = "x,y,z,a,b,-\n1,2,3,4,5,6\n1,2,4,4,5,6\n"
    assert table(tmp_path, text).notes == ("columns a, b are not used",)


def test_columns_among_which_the_time_may_be_are_shown(tmp_path):
    text = "Zeit;X;Ort;Y;Z\n0,0;1;a;2;3\n0,1;1;b;2;3\n"
    message = (
        r"no time stamps: its columns are Zeit, X, Ort, Y, Z\. If one of them is "
        r"the time, .* --columns t,x,-,y,z\. Otherwise say how many samples"
    )
    with pytest.raises(ValueError, match=message):
        prepare([table(tmp_path, text)], Preparation())
    one = table(tmp_path, text, columns=("t", "x", "-", "y", "z"))
    assert_array_equal(np.asarray(one.times), [0.0, 0.1])
    np.savez(tmp_path / "a.npz", pos=POSITIONS, zeit=TIMES)
    message = r"arrays are pos \(60, 3\), zeit \(60,\)\. .* --body POSIT"
    with pytest.raises(ValueError, match=message):
        prepare(read_recordings(tmp_path / "a.npz", ANY), Preparation())


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        ("", {}, "it is empty"),
        ("1,2,3\n4,5,6", {}, r"3 columns have no names; .* --columns t,x,y,z"),
        ("x,y,z\n1,2,3\n1,2\n", {}, "line 3 has 2 columns, and 3 are named: x, y, z"),
        ("x,y,z\n1,2,3\n1,q,3\n", {}, r"line 3, column 2 \(y\): 'q' is no number"),
        ("a,b,c\n1,2,3\n", {}, "no column x and no y: it has a, b, c"),
        ("x,y,x\n1,2,3\n", {}, "two columns for x"),
        ("x,y,qw,qx,qy\n1,2,3,4,5", {}, "no column qz"),
        ("x,y,fx,fy\n1,2,3,4\n5,6,7,8", {}, "fx, fy of a force and a moment; they n"),
        ("x,y,fx [m],fy,fz\n1,2,3,4,5", {}, "fx, fy, fz are in m; they must share"),
        ("x [m],y [cm]\n1,2\n3,4", {}, "x, y, z are in cm and m; they must share"),
        ("x,y,z\n1,2,3\n", {}, "has 1 samples; a motion needs at least two"),
        ("x\0y\n", {}, "line 1 holds a zero byte"),
        ("1,2\n3,4", {"columns": ("x", "y", "z")}, "line 1 has 2 columns, and 3 are"),
    ],
)
def test_a_table_that_is_not_understood(tmp_path, text, options, message):
    with pytest.raises(ValueError, match=message) as caught:
        table(tmp_path, text, **options)
    assert "a.csv cannot be read as a table in a text file" in str(caught.value)


def test_matlab_agrees_with_scipy_on_all_that_stands_in_each_other(tmp_path):
    rng = np.random.default_rng(0)
    inner = np.array([(POSITIONS, 3), (PHASE, 4)], dtype=[("a", "O"), ("n", "O")])
    cells = np.empty((2, 2), dtype=object)
    cells[:] = [[np.int8([1, -2]), "text"], [inner, rng.random((2, 3, 4)) > 0.5]]
    plain = {"u": np.uint16([[1, 2], [3, 4]]), "z": 1j * PHASE, "s": {"c": cells}}
    for packed in (False, True):
        path = tmp_path / f"{packed}.mat"
        scipy.io.savemat(path, plain, do_compression=packed)
        found = read_arrays(path, DecodingBudget(path.stat().st_size))
        expected = {"u": plain["u"], "s.c{1}": [[1, -2]], "s.c{4}": cells[1, 1]}
        expected |= {"s.c{2}(1).a": POSITIONS, "s.c{2}(1).n": [[3]]}
        expected |= {"s.c{2}(2).a": PHASE[None], "s.c{2}(2).n": [[4]]}
        assert set(found) == set(expected)
        for name, array in expected.items():
            assert_array_equal(found[name], array)
        with pytest.raises(ValueError, match="unpacks to more than its size allows"):
            read_arrays(path, DecodingBudget(0, least=500))


def test_cells_and_structures_of_one_name_are_one_set(tmp_path):
    cells = np.empty((3, 1), dtype=object)
    cells[:, 0] = [np.vstack([POSITIONS[:n].T, TIMES[:n]]) for n in (20, 30, 40)]
    structures = np.array(
        [(POSITIONS[:n], TIMES[:n]) for n in (10, 50)], dtype=[("pos", "O"), ("t", "O")]
    )
    content = {"data": cells, "best": cells[0, 0], "s": structures, "e": {"pos": PHASE}}
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, content)
    columns = ("x", "y", "z", "t")
    found = read_recordings(path, Selection(columns=columns, body="data"))
    assert [one.name for one in found] == [f"a.mat: data{{{n}}}" for n in (1, 2, 3)]
    for one, samples in zip(found, (20, 30, 40), strict=True):
        assert_array_equal(one.positions, POSITIONS[:samples])
        assert_array_equal(one.times, TIMES[:samples])
    own = read_recordings(path, Selection(body="s"))
    assert [len(one.positions) for one in own] == [10, 50]
    with pytest.raises(ValueError, match=r"one array of columns; .* best, da"):
        read_recordings(path, Selection(columns=columns))
    with pytest.raises(ValueError, match=r"more than one set of recordings; .* e, s"):
        read_recordings(path, ANY)


def cells(*arrays: Any) -> Any:
    made = np.empty((1, len(arrays)), dtype=object)
    made[0, :] = arrays
    return made


WITH_QUATERNION = ("x", "y", "z", "qw", "qx", "qy", "qz")


XYZ = ("x", "y", "z")
BOTH = np.hstack([POSITIONS, WXYZ]).T


@pytest.mark.parametrize(
    ("content", "body", "columns"),
    [
        ({"x": {"pos": POSITIONS, "time": TIMES}}, None, ()),
        ({"datasetRaw": {"pos": POSITIONS.T, "time": TIMES[:, None]}}, None, ()),
        ({"x": {"pos": cells(POSITIONS.T, POSITIONS.T), "time": TIMES}}, None, ()),
        ({"x": {"pos": cells(POSITIONS), "time": cells(TIMES)}}, None, ()),
        ({"x": {"pos": POSITIONS, "time": cells(TIMES)}}, None, ()),
        ({"x": {"pos": POSITIONS, "time": TIMES}}, "x.pos", XYZ),
        ({"datasetRaw": {"pos": BOTH, "time": TIMES}}, None, WITH_QUATERNION),
        (
            {"x": cells(*2 * [{"hand": POSITIONS, "turn": WXYZ.T, "time": TIMES}])},
            "x.hand,x.turn",
            WITH_QUATERNION,
        ),
        ({"hand": POSITIONS, "stamp": TIMES}, "hand, stamp", (*XYZ, "t")),
    ],
)
def test_times_and_rotations_stand_beside_positions(tmp_path, content, body, columns):
    scipy.io.savemat(tmp_path / "a.mat", content)
    selection = Selection(body=body, columns=columns)
    for one in read_recordings(tmp_path / "a.mat", selection):
        assert_array_equal(one.positions, POSITIONS)
        assert_array_equal(np.asarray(one.times), TIMES)
        if "qw" in columns:
            assert_array_equal(quaternions(one), WXYZ)


def test_arrays_of_one_npz_are_put_side_by_side(tmp_path):
    stacked = {"ee_pos": np.stack([POSITIONS] * 3), "ee_quat": np.stack([WXYZ] * 3)}
    np.savez(tmp_path / "a.npz", time=TIMES, **stacked)
    both = Selection(body="ee_pos,ee_quat", columns=WITH_QUATERNION)
    found = read_recordings(tmp_path / "a.npz", both)
    assert [one.name for one in found] == [f"a.npz[{n}]" for n in range(3)]
    for one in found:
        assert_array_equal(np.asarray(one.times), TIMES)
        assert_array_equal(quaternions(one), WXYZ)
    np.savez(tmp_path / "b.npz", ee_pos=POSITIONS, ee_quat=WXYZ[1:])
    for body, columns, message in (
        (both.body, both.columns, r"\(60, 3\), \(59, 4\) differ in the number"),
        ("ee_pos,turn", XYZ, "no array of columns 'turn'"),
    ):
        with pytest.raises(ValueError, match=message):
            read_recordings(tmp_path / "b.npz", Selection(body=body, columns=columns))


# ------------------------------------------------------------------ refusals
def states_of_robosuite(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["data/demo_1/states"] = POSITIONS


def lerobot_2(path: Path) -> None:
    write_lerobot(path)
    info = path / "meta/info.json"
    info.write_text(info.read_text().replace("v3.0", "v2.1"))


mat_without_positions = partial(scipy.io.savemat, mdict={"s": {"t": TIMES}})


def nested_cells(depth: int) -> bytes:
    """Cells in cells in a MATLAB file, which SciPy's reader follows to the end."""

    def element(kind: int, data: bytes) -> bytes:
        return struct.pack("<II", kind, len(data)) + data

    content, parts = b"", []
    for _ in range(depth):
        head = element(6, struct.pack("<II", 1, 0)) + element(
            5, struct.pack("<ii", 1, 1)
        )
        head += element(1, b"")
        size = len(content) + sum(map(len, parts)) + len(head)
        parts.append(struct.pack("<II", 14, size) + head)
    return b"MATLAB 5.0".ljust(126) + b"IM" + b"".join(reversed(parts))


def text(content: str | bytes) -> Callable[[Path], object]:
    data = content.encode() if isinstance(content, str) else content
    return lambda path: path.write_bytes(data)


ENTITIES = '<!DOCTYPE m [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><m>&b;</m>'
UNORDERED = {"positions": POSITIONS, "quat": WXYZ}
REFUSED: tuple[tuple[str, Callable[[Path], object], str | None, str], ...] = (
    ("a.hdf5", states_of_robosuite, None, r"no group 'obs'; .* dataset_states_to_obs"),
    ("a.mvnxx", text(""), None, r"\(did you mean '.mvnx'\?\); readable are .csv"),
    ("folder", Path.mkdir, None, "unknown folder; .* folders with metadata"),
    ("a.npz", lambda path: np.savez(path, **UNORDERED), None, "--quaternions wxyz or"),
    ("a.mvnx", text(ENTITIES), None, "line 1: it declares an entity, 'a'"),
    ("a.mvnx", write_mvnx, "LeftHand", r"no segment 'LeftHand'.*Pelvis, RightHand"),
    ("a.mat", text(b"MATLAB 7.3 MAT-file" + bytes(600)), None, r"save\(..., '-v7'"),
    ("a.mat", text(nested_cells(2000)), None, "nested too deeply"),
    ("a.mat", mat_without_positions, None, r"positions: it has s\.t \(1, 60"),
    ("set", lerobot_2, None, "version v2.1, but only v3"),
    ("a.c3d", lambda path: path.write_bytes(c3d_of(7)), None, "unknown processor, 7"),
)


@pytest.mark.parametrize(("name", "write", "body", "message"), REFUSED)
def test_what_cannot_be_read_is_said(tmp_path, name, write, body, message):
    write(tmp_path / name)
    with pytest.raises(ValueError, match=message):
        read_recordings(tmp_path / name, Selection(body=body))


POSITION = "data/demo_2/obs/robot0_eef_pos"
ELSEWHERE: dict[str, tuple[str, Any]] = {
    "demonstration": ("data/demo_2", h5py.ExternalLink("pipe", "/data")),
    "obs": ("data/demo_10/obs", h5py.ExternalLink("pipe", "/obs")),
    "array": (POSITION, h5py.ExternalLink("pipe", "/pos")),
    "inside": (POSITION, h5py.SoftLink("/data/demo_10/obs/x")),
    "data": ("data", h5py.SoftLink("/somewhere")),
    "external": (POSITION, None),
    "virtual": (POSITION, h5py.VirtualLayout((N, 3), "f8")),
}


@pytest.mark.parametrize("case", ELSEWHERE)
def test_links_in_hdf5_are_not_followed(tmp_path, case):
    place, link = ELSEWHERE[case]
    os.mkfifo(pipe := tmp_path / "pipe")
    write_robomimic(tmp_path / "a.hdf5")
    message = rf"values of /{place} lie in other files"
    with h5py.File(tmp_path / "a.hdf5", "r+") as file:
        del file[place]
        if case == "external":
            whole = [(pipe, 0, 24 * N)]
            file.create_dataset(place, (N, 3), "f8", external=whole)
        elif case == "virtual":
            link[:] = h5py.VirtualSource(pipe, "x", (N, 3))
            file.create_virtual_dataset(place, link)
        else:
            file[place] = link
            message = rf"/{place} is a (External|Soft)Link.* copy"
    with pytest.raises(ValueError, match=message):
        read_recordings(tmp_path / "a.hdf5", ANY)


# ------------------------------------------------------------------ bombs
BOMB = 2**26 + 2**22
"""A little more than a small file may unpack to [bytes]."""


def write_robomimic_without_data(path: Path) -> None:
    """A shape, and no chunk: HDF5 makes zeros of it."""
    with h5py.File(path, "w") as file:
        obs = file.create_group("data/demo_1/obs")
        for name, width in (("robot0_eef_pos", 3), ("robot0_eef_quat", 4)):
            obs.create_dataset(name, (10**7, width), "i1", chunks=(10**5, width))


def write_robomimic_of_many(path: Path) -> None:
    """Each demonstration alone is allowed."""
    with h5py.File(path, "w") as file:
        for number in range(40):
            file[f"data/demo_{number}/obs/robot0_eef_pos"] = (
                file["data/demo_0/obs/robot0_eef_pos"] if number else h5py.Empty("i1")
            )
            if not number:
                del file["data/demo_0/obs/robot0_eef_pos"]
                file["data/demo_0/obs"].create_dataset(
                    "robot0_eef_pos", (10**5, 3), "i1", chunks=(10**5, 3)
                )


def write_robomimic_large_chunk(path: Path) -> None:
    """A deflated stream holds more than a chunk, and HDF5 unpacks all of it."""
    write_robomimic(path)
    with h5py.File(path, "r+") as file:
        obs = file["data/demo_2/obs"]
        del obs["robot0_eef_pos"]
        made = obs.create_dataset(
            "robot0_eef_pos", (N, 3), "f8", chunks=(N, 3), compression="gzip"
        )
        made.id.write_direct_chunk((0, 0), zlib.compress(bytes(BOMB)))


def write_constants(path: Path) -> None:
    rows = 10**6
    lists = pyarrow.ListArray.from_arrays(
        np.arange(0, 7 * rows + 1, 7, dtype=np.int32), np.zeros(7 * rows)
    )
    columns = {"observation.state": lists}
    columns |= {name: np.zeros(rows, int) for name in ("episode_index", "frame_index")}
    write_lerobot(path, columns)


def write_constants_and_lie(path: Path) -> None:
    """Two rows of millions, and a footer that counts fourteen values."""
    size = 2**22
    write_lerobot(
        path,
        {
            "observation.state": [np.zeros(size)] * 2,
            "episode_index": [0, 0],
            "frame_index": [0, 1],
        },
    )
    file = path / "data/chunk-000/file-000.parquet"
    content = file.read_bytes()
    start = len(content) - 8 - int.from_bytes(content[-8:-4], "little")
    # 2 size values as a signed Thrift number of four bytes, and 14 in as many.
    said, lie = b"\x80\x80\x80\x08", b"\x9c\x80\x80\x00"
    assert said in content[start:]
    file.write_bytes(content[:start] + content[start:].replace(said, lie))


def bag_of_zeros(path: Path, storage: Any, mode: Any) -> None:
    """A bag whose second message is zeros, more than are allowed."""
    kind = "geometry_msgs/msg/PoseStamped"
    writer = Writer(path, version=9, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/hand", kind, typestore=STORE)
        writer.write(connection, 1, STORE.serialize_cdr(TOPICS["/hand"](0), kind))
        writer.write(connection, 2, bytes(BOMB))


def write_mcap_of_chunks(path: Path) -> None:
    folder = path.with_suffix("")
    bag_of_zeros(folder, StoragePlugin.MCAP, CompressionMode.STORAGE)
    next(folder.glob("*.mcap")).rename(path)


def write_mcap_of_lz4(path: Path) -> None:
    """A chunk of zeros, in LZ4, in a file without an index."""
    compressed = lz4.frame.compress(bytes(BOMB))
    chunk = struct.pack("<QQQI", 0, 0, BOMB, 0) + struct.pack("<I", 3) + b"lz4"
    chunk += struct.pack("<Q", len(compressed)) + compressed
    header = struct.pack("<I", 4) + b"ros2" + struct.pack("<I", 0)
    records = ((1, header), (6, chunk), (2, struct.pack("<QQI", 0, 0, 0)))
    framed = [struct.pack("<BQ", op, len(body)) + body for op, body in records]
    magic = b"\x89MCAP0\r\n"
    path.write_bytes(magic + b"".join(framed) + magic)


def write_ros1(path: Path, compression: Any) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    writer = Writer1(path)
    writer.set_compression(compression)
    with writer:
        kind = "geometry_msgs/msg/PoseStamped"
        connection = writer.add_connection("/hand", kind, typestore=store)
        writer.write(connection, 1, bytes(BOMB))


def write_generated_messages(path: Path) -> None:
    """A column of a database is zeros that are not in the file."""
    write_one_file(path, StoragePlugin.SQLITE3)
    with contextlib.closing(sqlite3.connect(path)) as database:
        database.executescript(
            "ALTER TABLE messages DROP COLUMN data; ALTER TABLE messages ADD COLUMN "
            f"data BLOB GENERATED ALWAYS AS (zeroblob({BOMB})) VIRTUAL;"
        )


ZEROS = {"pos": np.zeros((2**23, 3), "i1"), "t": np.zeros(2**23, "i1")}
ALLOWED = "unpacks to more than its size allows"
BOMBS: dict[str, tuple[Callable[[Path], None], str, str]] = {
    "hdf5-shape": (write_robomimic_without_data, "a.hdf5", ALLOWED),
    "hdf5-many": (write_robomimic_of_many, "a.hdf5", ALLOWED),
    "hdf5-chunk": (write_robomimic_large_chunk, "a.hdf5", "more than a chunk"),
    "lerobot": (write_constants, "set", ALLOWED),
    "lerobot-lie": (write_constants_and_lie, "set", ALLOWED),
    **{
        f"ros2-{one.name}": (partial(bag_of_zeros, **SQLITE, mode=one), "bag", ALLOWED)
        for one in (CompressionMode.MESSAGE, CompressionMode.FILE)
    },
    "mcap-zstd": (write_mcap_of_chunks, "a.mcap", ALLOWED),
    "mcap-lz4": (write_mcap_of_lz4, "a.mcap", ALLOWED),
    "db3": (write_generated_messages, "a.db3", "too big"),
    **{
        f"ros1-{one.name}": (partial(write_ros1, compression=one), "a.bag", ALLOWED)
        for one in Writer1.CompressionFormat
    },
    "mat": (
        lambda to: scipy.io.savemat(to, ZEROS, do_compression=True),
        "a.mat",
        ALLOWED,
    ),
    "npz": (lambda to: np.savez_compressed(to, **ZEROS), "a.npz", ALLOWED),
}

READ_AND_MEASURE = """
import importlib, resource, sys
from gplfd_experiments.data.readers import READERS, read_recordings
from gplfd_experiments.data.raw import Selection
for reader in READERS.values():
    importlib.import_module(f"gplfd_experiments.data.readers.{reader.module}")
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
for path in sys.argv[1:]:
    try:
        read_recordings(path, Selection())
    except ValueError as error:
        print(error)
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
"""
"""Reads files, and prints their errors and the kilobytes of memory that they took."""


def test_small_files_do_not_become_large_ones(tmp_path):
    """They take 64 MiB, which is allowed, and as much again in passing."""
    paths = []
    for name, (write, file, _) in BOMBS.items():
        paths.append(tmp_path / name / file)
        paths[-1].parent.mkdir()
        write(paths[-1])
        files = [one for one in paths[-1].parent.rglob("*") if one.is_file()]
        assert sum(one.stat().st_size for one in files) < 2**20, name
    found = subprocess.run(
        [sys.executable, "-c", READ_AND_MEASURE, *paths],
        capture_output=True,
        text=True,
        check=True,
    )
    *messages, kilobytes = found.stdout.splitlines()
    for path, (_, _, reason), message in zip(
        paths, BOMBS.values(), messages, strict=True
    ):
        assert message.startswith(f"{path} cannot be read"), message
        assert reason in message, message
    assert int(kilobytes) < 3 * 2**16
