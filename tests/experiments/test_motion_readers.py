"""Motion files of every kind: read as they were written, or refused with a message.

Files are written by the libraries that usually write them. Readers are called in this
process, except in the tests of the child process that guards them.
"""

import json
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import ezc3d
import h5py
import numpy as np
import pyarrow
import pyarrow.parquet
import pytest
import scipy.io
from numpy.testing import assert_allclose, assert_array_equal
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from gplfd_experiments.data import readers
from gplfd_experiments.data.preparation import ImportSettings, prepare
from gplfd_experiments.data.raw import RawRecording
from gplfd_experiments.data.readers import READERS, read_files, read_here
from gplfd_experiments.data.settings import METRES
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.demonstrations.npz import save_demonstrations

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("coarse_cuts")]

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


def write_csv(path: Path) -> None:
    heads = "time [s],x [m],y [m],z [m],qw,qx,qy,qz,comment,fx,fy,fz,"
    heads += "mx [N mm],my [N mm],mz [N mm]"
    forces = FORCE * [1.0, 1.0, 1.0, 1e3, 1e3, 1e3]
    rows = np.column_stack([TIMES, POSITIONS, WXYZ, np.zeros(N), forces]).tolist()
    lines = [",".join(map(repr, row)) for row in rows]
    path.write_text("# recorded by hand\n" + "\n".join([heads, *lines]) + "\n")


def write_mat(path: Path, format: str = "5") -> None:
    arrays = {"t": TIMES, "p": 1e3 * POSITIONS, "q": WXYZ, "forces": FORCE}
    scipy.io.savemat(path, arrays, do_compression=format == "5", format=format)


def write_mvnx(path: Path) -> None:
    def frame(kind: str, index: str, place: int) -> str:
        numbers = [9.0, 9.0, 9.0, *POSITIONS[place]], [1.0, 0, 0, 0, *WXYZ[place]]
        position, orientation = (" ".join(map(str, row)) for row in numbers)
        return (
            f'<frame time="{int(place * 1000 / RATE)}" {index} type="{kind}">'
            f"<orientation>{orientation}</orientation>"
            f"<position>{position}</position></frame>"
        )

    frames = [frame("normal", f'index="{i}"', i) for i in range(N)]
    path.write_text(
        '<mvnx version="4" xmlns="http://www.xsens.com/mvn/mvnx">\n'
        f'<subject label="a" frameRate="{RATE:g}" segmentCount="2">\n'
        '<segments><segment label="Pelvis" id="1"/><segment label="RightHand" id="2"/>'
        '</segments><fingerTrackingSegmentsLeft><segment label="LeftCarpus" id="1"/>'
        f"</fingerTrackingSegmentsLeft>\n<frames>{frame('tpose', '', 5)}\n"
        + "\n".join([*frames, "</frames></subject></mvnx>\n"])
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


def vector(kind: str, numbers: Any) -> Any:
    return ros(f"geometry_msgs/{kind}", *map(float, numbers))


def message(topic: str, place: int, frame: str = "base", shift: float = 0.0) -> Any:
    """What is published on a topic at a place of the motion."""
    seconds, ns = divmod(round(TIMES[place] * 1e9), 10**9)
    time = ros("builtin_interfaces/Time", 100 + seconds, ns)
    head, empty = ros("std_msgs/Header", time, frame), np.zeros(0)
    position, turn = POSITIONS[place] + [shift, 0, 0], vector("Quaternion", XYZW[place])
    pose = ros("geometry_msgs/Pose", vector("Point", position), turn)
    match topic:
        case "/hand":
            return ros("geometry_msgs/PoseStamped", head, pose)
        case "/t" | "/tf":
            inner = ros("geometry_msgs/Transform", vector("Vector3", position), turn)
            stamped = ros("geometry_msgs/TransformStamped", head, "hand", inner)
            return stamped if topic == "/t" else ros("tf2_msgs/TFMessage", [stamped])
        case "/o":
            posed = ros("geometry_msgs/PoseWithCovariance", pose, np.zeros(36))
            still = ros("geometry_msgs/Twist", *2 * [vector("Vector3", [0, 0, 0])])
            moving = ros("geometry_msgs/TwistWithCovariance", still, np.zeros(36))
            return ros("nav_msgs/Odometry", head, "hand", posed, moving)
        case "/joints":
            values = PHASE[place] * np.array([1.0, 2.0])
            names = ["slide", "turn"]
            return ros("sensor_msgs/JointState", head, names, values, empty, empty)
    force, torque = (vector("Vector3", f) for f in np.split(FORCE[place], 2))
    felt = ros("geometry_msgs/Wrench", force, torque)
    return ros("geometry_msgs/WrenchStamped", head, felt)


def write_messages(path: Path, storage: Any, **topics: list[Any]) -> None:
    """Write messages that are logged at once."""
    with Writer(path, version=9, storage_plugin=storage) as writer:
        for topic, messages in topics.items():
            kind = messages[0].__msgtype__
            channel = writer.add_connection(f"/{topic}", kind, typestore=STORE)
            for time, content in enumerate(messages):
                data = STORE.serialize_cdr(content, kind)
                writer.write(channel, 10**9 + time, data)


def write_bag(path: Path, *topics: str, storage: Any = StoragePlugin.MCAP) -> None:
    messages = {t[1:]: [message(t, n) for n in range(N)] for t in topics}
    write_messages(path, storage, **messages)


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


def write_lerobot(path: Path) -> None:
    (path / "meta").mkdir(parents=True)
    (path / "data/chunk-000").mkdir(parents=True)
    names = ["x", "y", "z", "qx", "qy", "qz", "qw"]
    features = {
        "observation.state": {"dtype": "float64", "shape": [7], "names": names},
        "observation.force": {"dtype": "float64", "shape": [6], "names": None},
    }
    info = {"codebase_version": "v3.0", "fps": int(RATE), "features": features}
    (path / "meta/info.json").write_text(json.dumps(info))
    table = {
        "observation.state": list(np.tile(np.hstack([POSITIONS, XYZW]), (2, 1))),
        "observation.force": list(np.tile(FORCE, (2, 1))),
        "episode_index": np.repeat([0, 1], N),
        "frame_index": np.tile(np.arange(N), 2),
    }
    pyarrow.parquet.write_table(pyarrow.table(table), path / PARQUET)


def write_set(path: Path) -> None:
    poses = np.hstack([POSITIONS, ROTATIONS.as_rotvec()])
    one = Demonstration(times=TIMES, poses=poses, wrenches=FORCE)
    save_demonstrations(path, [one], signals=[{"gripper": FORCE[:, :2]}])


def write_set_folder(path: Path) -> None:
    path.mkdir()
    write_set(path / "demonstrations.npz")


ANY = ImportSettings()


@dataclass(frozen=True)
class Kind:
    """How files of a kind are written, read, and where in them damage goes."""

    write: Callable[[Path], Any]
    name: str
    selection: ImportSettings = ANY
    damaged: str = ""
    forces: Any = True


FORCELESS: Any = {"forces": False}
SQLITE = {"storage": StoragePlugin.SQLITE3}
PARQUET = "data/chunk-000/file-000.parquet"
METADATA = "data/metadata.json"
ARRAYS = {"times": TIMES, "positions": POSITIONS, "quaternions_xyzw": XYZW}
write_minari = partial(shutil.copytree, RECORDED)
MM = ImportSettings(quaternions="wxyz", units="mm")
KINDS = {
    "csv": Kind(write_csv, "a.csv"),
    "npz": Kind(lambda path: np.savez(path, **ARRAYS), "a.npz", **FORCELESS),
    "mat": Kind(write_mat, "a.mat", MM),
    "mat-4": Kind(partial(write_mat, format="4"), "a.mat", MM),
    "mvnx": Kind(write_mvnx, "a.mvnx", **FORCELESS),
    "bvh": Kind(write_bvh, "a.bvh", ImportSettings(units="cm"), **FORCELESS),
    "c3d": Kind(write_c3d, "a.c3d", ImportSettings(body="A,B,C"), **FORCELESS),
    "mcap": Kind(write_one_file, "a.mcap"),
    "db3": Kind(partial(write_one_file, **SQLITE), "a.db3"),
    "bag": Kind(lambda bag: write_bag(bag, "/t", **SQLITE), "bag", ANY, "bag.db3", 0),
    "robomimic": Kind(write_robomimic, "a.hdf5"),
    "lerobot": Kind(write_lerobot, "set", damaged=PARQUET),
    "minari": Kind(write_minari, "set-v0", damaged=METADATA),
    "own": Kind(write_set, "b.npz"),
    "set": Kind(write_set_folder, "set", damaged="demonstrations.npz"),
}


@pytest.fixture(scope="module", params=KINDS)
def written(request: Any, tmp_path_factory: Any) -> tuple[Kind, Path]:
    kind = KINDS[request.param]
    path = tmp_path_factory.mktemp(request.param) / kind.name
    kind.write(path)
    return kind, path


def test_files_of_every_reader_are_written_here():
    suffixes = {Path(kind.name).suffix for kind in KINDS.values()}
    for reader in READERS:
        assert reader.marks or suffixes & set(reader.suffixes)


def test_reads_what_was_written(written):
    kind, path = written
    found = read_here(path, kind.selection)
    names = [one.name for one in found]
    assert len(set(names)) == len(names)
    if kind.write is write_robomimic:  # in the order of the numbers
        assert names == ["a.hdf5: demo_2", "a.hdf5: demo_10"]
    assert all(name.startswith(path.name) for name in names)
    float32 = path.suffix == ".c3d"
    positions, rotations, times = POSITIONS, ROTATIONS, TIMES
    if kind.write is write_minari:
        positions, rotations, times, wrenches = recorded()
        assert_array_equal(found[0].wrenches, wrenches)
    for one in found:
        metres = METRES[one.unit or kind.selection.units or "m"]
        atol = 1e-6 if float32 else 1e-9
        assert_allclose(metres * one.positions, positions, rtol=0, atol=atol)
        # Bags have whole nanoseconds since an epoch, read as seconds since the first.
        assert_allclose(np.asarray(one.times), times, rtol=0, atol=1e-15)
        if kind.write in (write_robomimic, write_set):
            assert_array_equal(one.signals["gripper"], FORCE[:, :2])
        # Markers of a body tell its orientation relative to its first.
        expected = rotations * rotations[0].inv() if float32 else rotations
        turned = Rotation.from_quat(quaternions(one), scalar_first=True)
        apart = (turned * expected.inv()).magnitude().max()
        assert apart < (1e-5 if float32 else 1e-9)


def recorded() -> tuple[Any, Rotation, Any, Any]:
    """Positions, rotations, times and wrenches of the stored episode."""
    with h5py.File(RECORDED / "data/main_data.hdf5") as file:
        seen = {
            name: array[()] for name, array in file["episode_0/observations"].items()
        }
    poses = seen["ee_pose"]
    rotations = Rotation.from_rotvec(poses[:, 3:])
    return poses[:, :3], rotations, seen["time"][:, 0], seen["wrench"]


AS_RECORDED = ImportSettings(frame="recorded", keep_rests=True, cutoff=0.0, rate=0.0)


def test_forces_pass_from_files_to_demonstrations(written):
    """As a WrenchStamped has them, unless the files are of this program."""
    kind, path = written
    prepared = prepare(read_here(path, kind.selection), AS_RECORDED)
    turned = np.einsum("nij,npj->npi", ROTATIONS.as_matrix(), FORCE.reshape(N, 2, 3))
    expected, states_convention = -turned.reshape(N, 6), False
    if kind.write is write_minari:
        expected, states_convention = -recorded()[3], True
    elif kind.write in (write_set, write_set_folder):
        expected, states_convention = FORCE, True
    for motion in prepared[: 1 if kind.write is write_minari else None]:
        wrenches = motion.demonstration.wrenches
        assert (wrenches is not None) == kind.forces
        if wrenches is not None:
            assert_allclose(wrenches, expected, rtol=0, atol=1e-9)
            notes = " ".join(note.text for note in motion.notes)
            assumed = "forces are on the hand, in the axes of the sensor" in notes
            assert assumed != states_convention


def endless_rows(path: Path) -> None:
    """A database whose version is computed without end."""
    write_one_file(path, StoragePlugin.SQLITE3)
    with closing(sqlite3.connect(path)) as database:
        database.executescript(
            "DROP TABLE schema; CREATE VIEW schema AS WITH RECURSIVE n(i) AS (SELECT 1 "
            "UNION ALL SELECT i+1 FROM n) SELECT i AS schema_version FROM n WHERE i<0;"
        )


def zeros_without_data(path: Path) -> None:
    """A shape and no chunk, of which HDF5 makes gigabytes of zeros."""
    with h5py.File(path, "w") as file:
        obs = file.create_group("data/demo_1/obs")
        obs.create_dataset("robot0_eef_pos", (10**9, 3), "i1", chunks=(10**5, 3))


@pytest.mark.parametrize(
    ("name", "write", "message"),
    [
        ("a.hdf5", zeros_without_data, r"needs more than \d+ MB of memory"),
        ("a.db3", endless_rows, "its reader crashed or ran for more than 1 s"),
    ],
)
def test_a_file_that_would_take_the_machine_ends_its_reader_alone(
    tmp_path, monkeypatch, name, write, message
):
    monkeypatch.setattr(readers, "_LIMITS", (*readers._LIMITS[:3], (1.0, 5e-6)))
    write_csv(tmp_path / "good.csv")
    write(tmp_path / name)
    read = read_files([tmp_path / "good.csv", tmp_path / name], ANY)
    assert_array_equal(next(read)[0].positions, POSITIONS)
    with pytest.raises(ValueError, match=message) as caught:
        next(read)
    assert str(tmp_path / name) in str(caught.value)


def test_errors_of_the_child_are_those_of_the_reader(tmp_path):
    (tmp_path / "a.csv").write_text("x,y,z\n1,2,3\n1,2\n")
    with pytest.raises(ValueError, match=r"a\.csv cannot .* line 3 has 2 columns"):
        next(read_files([tmp_path / "a.csv"], ANY))
    with pytest.raises(FileNotFoundError, match=r"there is no file .*b\.csv"):
        next(read_files([tmp_path / "b.csv"], ANY))


def test_frames_that_a_header_cannot_count_are_missed(tmp_path):
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["RATE"]["value"] = [RATE]
    file["parameters"]["POINT"]["LABELS"]["value"] = ("A",)
    file["data"]["points"] = np.ones((4, 1, 65600))
    file.write(str(tmp_path / "a.c3d"))
    with pytest.raises(
        ValueError, match=r"only 65535 of its about 656\d\d frames can be read"
    ):
        read_here(tmp_path / "a.c3d", ANY)


def only(path: Path, **selection: Any) -> RawRecording:
    (one,) = read_here(path, ImportSettings(**selection))
    return one


def quaternions(one: RawRecording) -> Any:
    assert one.quaternions is not None
    return one.quaternions


CHAIN = ["slide", "turn"]
URDF = """<robot name="r"><link name="base"/><link name="arm"/><link name="hand"/>
<joint name="slide" type="prismatic"><parent link="base"/><child link="arm"/>
<axis xyz="1 0 0"/><limit lower="-9" upper="9" effort="1" velocity="1"/></joint>
<joint name="turn" type="revolute"><parent link="arm"/><child link="hand"/>
<origin xyz="0 0.2 0"/><axis xyz="0 0 1"/>
<limit lower="-9" upper="9" effort="1" velocity="1"/></joint></robot>"""


def test_reads_every_message_with_a_pose_and_joint_states(tmp_path):
    bag = tmp_path / "bag"
    write_bag(bag, "/t", "/o", "/tf", "/joints", "/hand")
    for topic in ("/t", "/o", "/tf:hand", "/hand"):
        motion = only(bag, body=topic)
        assert_allclose(motion.positions, POSITIONS, atol=1e-12)
        assert_allclose(quaternions(motion), WXYZ, atol=1e-12)
    # The pose of a link from the joints of its robot.
    (tmp_path / "r.urdf").write_text(URDF)
    motion = only(bag, body="/joints", urdf=tmp_path / "r.urdf", link="hand")
    straight = np.column_stack([PHASE, np.full(N, 0.2), np.zeros(N)])
    assert_allclose(motion.positions, straight, atol=1e-12)
    turned = Rotation.from_quat(quaternions(motion), scalar_first=True).as_rotvec()
    assert_allclose(turned[:, 2], 2.0 * PHASE, atol=1e-12)
    (tmp_path / "r.urdf").write_text(URDF.replace("9", "1"))
    notes = only(bag, body="/joints", urdf=tmp_path / "r.urdf", link="hand").notes
    assert "joints turn go far beyond their limits in r.urdf" in notes[0]
    for body, problem in (
        ("/tf", r"say which frame: --body /tf:FRAME, of hand"),
        ("/joints", r"--urdf FILE --link NAME"),
    ):
        with pytest.raises(ValueError, match=problem):
            only(bag, body=body)


@pytest.mark.parametrize(
    ("topic", "frames", "body"),
    [
        ("/hand", "base, camera", "/hand:base"),
        ("/t", "hand:base, hand:camera", "/t:hand:base"),
        ("/tf", "hand:base, hand:camera", "/tf:hand:base"),
    ],
)
def test_frames_in_one_topic_are_asked_about(tmp_path, topic, frames, body):
    pairs = ((message(topic, n, "camera", 0.5), message(topic, n)) for n in range(N))
    messages = {topic[1:]: [published for pair in pairs for published in pair]}
    write_messages(tmp_path / "written", StoragePlugin.SQLITE3, **messages)
    bag = (tmp_path / "written").rename(tmp_path / "50% #1")
    with pytest.raises(ValueError, match=f"several frames .*:FRAME, of {frames}"):
        only(bag, body=body.removesuffix(":base"))
    assert_allclose(only(bag, body=body).positions, POSITIONS, atol=1e-12)


def state(place: int, *names: str, frame: str = "base", values: int = 9) -> Any:
    """Joint states of some joints, or of a number of positions."""
    published = message("/joints", place, frame)
    numbers = {"slide": PHASE[place], "turn": 2.0 * PHASE[place], "head": 1.0}
    published.name = list(names)
    published.position = np.array([numbers[name] for name in names][:values])
    return published


@pytest.mark.parametrize(
    ("messages", "problem"),
    [
        ([state(n, "slide", "turn", values=0) for n in range(N)], "have no positions"),
        ([state(n, "head") for n in range(N)], "no joint state has slide, turn"),
        ([state(n, "slide", "turn", values=1) for n in range(N)], "2 names and"),
        ([state(n, *CHAIN, frame="ab"[n % 2]) for n in range(N)], "a, b have joint"),
        (
            [state(0, "turn"), state(1, "turn")]
            + [state(n, *part) for n in range(2, N) for part in (["head"], CHAIN)],
            "",
        ),
    ],
)
def test_joint_states_are_of_the_chain_since_all_were_seen(tmp_path, messages, problem):
    (tmp_path / "r.urdf").write_text(URDF)
    robot = {"urdf": tmp_path / "r.urdf", "link": "hand"}
    write_messages(tmp_path / "bag", StoragePlugin.SQLITE3, joint_states=messages)
    if problem:
        with pytest.raises(ValueError, match=problem):
            only(tmp_path / "bag", **robot)
    else:
        assert_allclose(only(tmp_path / "bag", **robot).positions[:, 0], PHASE[2:])


def test_forces_of_a_bag_are_those_of_one_topic_on_the_clock_of_the_hand(tmp_path):
    write_bag(tmp_path / "bag", "/hand", "/a", "/b")
    motion = only(tmp_path / "bag")
    assert motion.wrenches is None
    assert motion.notes == ("forces left out: choose with --wrench: /a, /b",)
    motion = only(tmp_path / "bag", wrench="/b")
    assert motion.notes[0].startswith("forces have the frame of the poses")
    assert_allclose(motion.wrenches, FORCE, rtol=0, atol=1e-12)
    # Forces at every fifth sample from the tenth to the fortieth, but for three.
    hand = [message("/hand", place) for place in range(N)]
    sparse = [message("/wrench", place) for place in (10, 15, 20, 40)]
    write_messages(tmp_path / "sparse", StoragePlugin.MCAP, hand=hand, wrench=sparse)
    felt = only(tmp_path / "sparse").wrenches
    assert felt is not None
    # Linear between the samples, and missing far from all of them.
    missing = np.isnan(felt).any(axis=1)
    assert_array_equal(np.flatnonzero(~missing), [*range(5, 26), *range(35, 46)])
    between = [*range(10, 26), *range(35, 41)]
    assert_allclose(felt[between], FORCE[between], atol=1e-12)


def test_c3d_marks_lost_markers_and_checks_rigid_bodies(tmp_path):
    path = tmp_path / "a.c3d"
    write_c3d(path)
    marker = only(path, body="B")
    file = ezc3d.c3d(str(path))
    assert_array_equal(marker.positions, file["data"]["points"][:3, 1].T)
    assert marker.quaternions is None
    points = file["data"]["points"]
    points[:3, 1, 3] = np.nan
    points[:3, 1, 7] = 0.0  # as programs write it that know no missing markers
    # Markers of which one slides away by 5 cm are on no rigid body.
    points[0, 2] += np.linspace(0.0, 50.0, N)
    file["data"]["points"] = points
    file.write(str(path))
    lost = np.isnan(only(path, body="B").positions).any(axis=1)
    assert_array_equal(np.flatnonzero(lost), [3, 7])
    with pytest.raises(ValueError, match=r"are on no rigid body: .* of 58 frames"):
        only(path, body="A,B,C")


BVH = (
    "HIERARCHY ROOT Hips\n{\nOFFSET 1 0 0 CHANNELS 3 Zrotation Xrotation Yrotation\n"
    "JOINT RightHand\n{\nOFFSET 2 0 0 CHANNELS 3 Zrotation Xrotation Yrotation\n"
    "End Site { OFFSET 0 0 0 }\n}\n}\nMOTION\nFrames: 2\nFrame Time: 0.5\n"
    "0 0 0 0 0 0\n90 0 0 0 90 0\n"
)
# Programs that write positions of every joint repeat its offset in them.
MOVING = BVH.replace(
    "2 0 0 CHANNELS 3", "2 0 0 CHANNELS 6 Xposition Yposition Zposition"
).replace("0 0 0 0 0 0\n90 0 0 0", "0 0 0 2 0 0 0 0 0\n90 0 0 2 0 0 0")


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        (BVH, ""),
        (MOVING, ""),
        (BVH.replace("RightHand", "RightWrist"), ""),
        ("\ufeff" + BVH.replace("\n{\n", " {\n").replace("Time: ", "Time:"), ""),
        (BVH.replace("ROOT", "Root").replace("HIERARCHY", "Hierarchy"), ""),
        (BVH.replace("0.5", "0.0"), "Frame Time is 0 s"),
        (BVH.replace("}\n", "", 1), "1 braces are not closed"),
        (BVH.replace("}\n", "}}\n", 1), "braces or numbers lack"),
        (BVH.replace("RightHand\n{", "RightHand\n"), "braces or numbers lack"),
        (BVH.replace("Hips", "RightHand"), "2 joints are called RightHand"),
        (BVH[:-4], "and has 11 numbers: it is cut"),
    ],
)
def test_bvh_follows_the_chain_of_joints(tmp_path, content, problem):
    """A hand at the end of an arm of 2 that the root turns by 90° about z."""
    path = tmp_path / "a.bvh"
    path.write_text(content, encoding="utf-16" if content is MOVING else "utf-8")
    if problem:
        with pytest.raises(ValueError, match=problem):
            only(path)
        return
    motion = only(path)
    about_z, about_x = (Rotation.from_euler(a, 90, degrees=True) for a in "ZX")
    assert_allclose(motion.positions, [[3, 0, 0], [1, 2, 0]], atol=1e-12)
    turned = Rotation.from_quat(quaternions(motion)[1], scalar_first=True)
    assert (turned * (about_z * about_x).inv()).magnitude() < 1e-12
    assert motion.unit is None


def test_orientations_of_a_set_that_are_not_used_are_named(tmp_path):
    write_lerobot(tmp_path / "set")
    info = tmp_path / "set" / "meta/info.json"
    names = '["x", "y", "z", "tilt rot", "pad", "eef_rot_1", "eef_rot_2"]'
    was = '["x", "y", "z", "qx", "qy", "qz", "qw"]'
    info.write_text(info.read_text().replace(was, names))
    note = "eef_rot_1, eef_rot_2, pad, tilt rot are not used: it has no orientation"
    assert all(note in one.notes for one in read_here(tmp_path / "set", ANY))
    write_robomimic(tmp_path / "a.hdf5")
    with h5py.File(tmp_path / "a.hdf5", "a") as file:
        file["data/demo_2/obs"].move("robot0_eef_quat", "robot0_eef_pose")
    note = "robot0_eef_pose are not used: it has no orientation"
    stated = read_here(tmp_path / "a.hdf5", ImportSettings(recorded_rate=9.0))
    assert stated[0].times is None  # So that no time stamps are said to be replaced.
    turned = [note in one.notes for one in read_here(tmp_path / "a.hdf5", ANY)]
    assert turned == [True, False]


@pytest.mark.parametrize("damaged", [lambda b: b[: len(b) // 2], lambda b: b"\0" * 99])
def test_a_damaged_file_is_refused_by_its_name(written, damaged):
    kind, path = written
    file = path / kind.damaged
    content = file.read_bytes()
    file.write_bytes(damaged(content))
    with pytest.raises(ValueError, match=r"cannot be read as") as caught:
        read_here(path, kind.selection)
    file.write_bytes(content)
    assert str(path) in str(caught.value)
