"""Tables and arrays of people: names, units, forms of orientations, dialects."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from gplfd_experiments.data.preparation import ImportSettings, prepare
from gplfd_experiments.data.raw import RawRecording
from gplfd_experiments.data.readers import read_here

N = 60
TIMES = np.arange(N) / 64.0
PHASE = np.linspace(0.0, 1.0, N)
POSITIONS = np.column_stack([0.3 + 0.5 * PHASE, np.sin(3.0 * PHASE), PHASE**2])
ROTATIONS = Rotation.from_rotvec(np.column_stack([PHASE, 0.5 - PHASE, 2.0 * PHASE]))
WXYZ = ROTATIONS.as_quat(scalar_first=True)
XYZW = ROTATIONS.as_quat()
ANY = ImportSettings()


def only(path: Path, **selection: Any) -> RawRecording:
    (motion,) = read_here(path, ImportSettings(**selection))
    return motion


def quaternions(motion: RawRecording) -> Any:
    assert motion.quaternions is not None
    return motion.quaternions


def table(tmp_path: Path, text: str, **options: Any) -> RawRecording:
    (tmp_path / "a.csv").write_text(text)
    return only(tmp_path / "a.csv", **options)


def test_heads_say_units_and_places(tmp_path):
    heads = "y (cm);x_cm;Time [ms];rz [deg];rx [deg];ry [deg]"
    motion = table(tmp_path, f"{heads}\n1,5;2;0;90;0;0\n1;2;4;90;0;0")
    assert motion.unit == "cm"
    assert_array_equal(motion.positions, [[2, 1.5, 0], [2, 1, 0]])
    assert_array_equal(motion.times, [0, 0.004])
    assert_allclose(quaternions(motion)[0], [0.5**0.5, 0, 0, 0.5**0.5], atol=1e-15)
    text = "header.stamp.secs,header.stamp.nsecs,x,y\n9,900000000,0,0\n10,0,0,1\n"
    assert_allclose(table(tmp_path, text).times, [0.9, 1.0])
    for day in ("", "2024-01-31T"):
        text = f"time,x,y\n{day}09:59:59.5,0,0\n{day}10:00:00.25,0,1\n"
        assert_allclose(np.diff(table(tmp_path, text).times), 0.75)


def rows(columns: str, row: str) -> str:
    """A thousand rows of a format, at i / 100 s, with angles of 5 sin(i / 16)."""
    angles = [5.0 * np.sin(i / 16) for i in range(1000)]
    lines = (row.format(t=i / 100, s=i // 100, yaw=a) for i, a in enumerate(angles))
    return "\n".join([columns, *lines])


@pytest.mark.parametrize(
    ("text", "options", "note"),
    [
        ("x,y,rx,ry,rz\n0,0,0,0,45\n0,1,0,0,90", {}, "are they degrees? say --angles"),
        (rows("t,x,y,roll,pitch,yaw", "{t},0,0,0,0,{yaw}"), {}, "29 rad/s, mostly yaw"),
        (rows("t,x,y,rx,ry,rz", "{t},{t},0,0,0,{t}"), {"angles": "deg"}, ""),
        (rows("t,x,y", "{s},{t},0"), {}, ""),
        (rows("t,x,y", "{s}000,{t},0"), {}, "are times in ms? say --time-unit ms"),
        ("x,y,rx,ry,rz\n0,0,0,0,1\n0,1,0,0,2", {}, ""),
        (rows("x,y,q0,q1,q2,q3,roll,pitch,yaw,a", "{t},0,1" + 7 * ",0"), {}, "a, pitc"),
        ("x,y,mx,-,my\n1,2,3,4,5\n1,2,3,4,5\n", {}, "columns mx, my are not used"),
        ("t [s],x,y\n1,2,3\n2,3,4", {"time_unit": "ms"}, "although the file states s"),
        ("x,y,qw\n1,2,3\n2,3,4", {"angles": "deg"}, "--angles has no effect"),
        ("x,y\n1,2\n2,3", {"quaternions": "xyzw"}, "--quaternions has no effect"),
        ("x,y\n1,2\n2,3", {"body": "Hand"}, "--body has no effect"),
        ("x,y\n1,2\n2,3", {"urdf": Path("a")}, "--urdf has no effect"),
        ("x,y\n1,2\n2,3", {"wrench": "/ft"}, "--wrench has no effect"),
    ],
)
def test_what_looks_wrong_or_has_no_effect_is_noted(tmp_path, text, options, note):
    text = text.replace("x,y,qw", "x,y,gripper")
    notes = " ".join(table(tmp_path, text, **options).notes)
    assert note in notes
    assert note or not notes


MATRICES = ROTATIONS.as_matrix().reshape(N, 9)
NUMBERS = ("11", "12", "13", "21", "22", "23", "31", "32", "33")


def euler(sequence: str, by_axis: bool = True, unit: float = 1.0) -> Any:
    angles = ROTATIONS.as_euler(sequence) / unit  # type: ignore[call-overload]
    order = np.argsort(["xyz".index(axis) for axis in sequence.lower()])
    return angles[:, order] if by_axis else angles


@pytest.mark.parametrize(
    ("heads", "values", "options"),
    [
        ("rot_x rot_y rot_z rot_w", XYZW, {}),
        ("rx ry rz rw", XYZW, {}),
        ("hand.rotation.x hand.rotation.y hand.rotation.z hand.rotation.w", XYZW, {}),
        ("quatW quatX quatY quatZ", WXYZ, {}),
        ("q0 q1 q2 q3", XYZW, {"quaternions": "xyzw"}),
        ("rx ry rz", ROTATIONS.as_rotvec(), {}),
        ("roll_deg pitch_deg yaw_deg", euler("xyz", unit=np.pi / 180), {}),
        ("rx ry rz", euler("ZYX"), {"angles": "euler-ZYX"}),
        ("rx ry rz", euler("yzx", unit=np.pi / 180), {"angles": "euler-yzx-deg"}),
        ("euler_x euler_y euler_z", euler("zxz", False), {"angles": "euler-zxz"}),
        (" ".join(f"r{at}" for at in NUMBERS), MATRICES, {}),
        (" ".join(f"rot6d_{at}" for at in range(6)), MATRICES[:, :6], {}),
        # Names of arrays.
        ("orientation", XYZW, {"quaternions": "xyzw"}),
        ("rotations", MATRICES.reshape(N, 3, 3), {}),
        ("rot", np.moveaxis(MATRICES.reshape(N, 3, 3), 0, -1), {}),
        ("rpy", euler("xyz"), {}),
        ("euler", euler("ZYX", False), {"angles": "euler-ZYX"}),
        ("ypr", euler("xyz")[:, ::-1], {}),
        ("rot_6d", MATRICES[:, :6], {}),
        ("axis_angle", ROTATIONS.as_rotvec(), {}),
    ],
)
def test_orientations_of_every_form_are_read(tmp_path, heads, values, options):
    if " " in heads:
        rows = np.column_stack([POSITIONS, values]).tolist()
        lines = [",".join(map(repr, row)) for row in rows]
        text = "\n".join(["pos_x,pos_y,pos_z," + heads.replace(" ", ","), *lines])
        check(table(tmp_path, text, **options))
        return
    np.savez(tmp_path / "a.npz", positions=POSITIONS, **{heads: values})
    check(only(tmp_path / "a.npz", **options))
    if heads not in ("orientation", "rot"):
        with h5py.File(tmp_path / "a.hdf5", "w") as file:
            obs = file.create_group("data/demo_1/obs")
            obs["robot0_eef_pos"], obs[f"robot0_eef_{heads}"] = POSITIONS, values
        check(only(tmp_path / "a.hdf5", **options))


def check(motion: RawRecording) -> None:
    turned = Rotation.from_quat(quaternions(motion), scalar_first=True)
    assert (turned * ROTATIONS.inv()).magnitude().max() < 1e-9
    assert_array_equal(motion.positions, POSITIONS)


MOTIVE = ",p,p,p,p\n,M,R,R,R\nTime (Seconds),c,x,y,z\n0,1,.5,2,3\n1,1,1,2,3"


@pytest.mark.parametrize(
    ("text", "encoding", "columns"),
    [
        ("sep=;\nx;y;z\n0,5;2;3\n1;2;3", "utf-8", ""),
        ("x\ty\tz\n0,5\t2\t3\n1\t2\t3", "utf-8-sig", ""),
        ("x y z\n0,5 2 3\n1 2 3", "utf-16", ""),
        ("0,5 2 3\n1 2 3", "utf-16-le", "x y z"),
        ("a b c d\n.5 9 2 3\n1 9 2 3\n", "utf-8", "x - y z"),
        ("# Tür\nx,y,z\n0.5,2,3\nNA,2,3\n1,2,3", "latin-1", ""),
        ("by me\n\nx,y,z\n0.5,2,3\n1,2,3", "utf-8", ""),
        ("a,b,c\n0.5,2,3\n1,2,3", "utf-8", "x=a y=b z=c"),
        (MOTIVE, "utf-8", ""),
        ("x|y|z\n0.5|2|3\n1|2|3", "utf-8", ""),
        ("x,y,z,t,a\ncm,cm,cm,s,-\n0.5,2,3,1,1\n1,2,3,2,1", "utf-8", ""),
        (
            "Hz\n9\n,A,,,B,,\nF,X,Y,Z,X,Y,Z\n,m,m,m,m,m,m\n1,.5,2,3,0,0,0\n2,1,2,3,0,0,0",
            "utf-8",
            "body=A",
        ),
    ],
)
def test_dialects_of_tables(tmp_path, text, encoding, columns):
    (tmp_path / "a.csv").write_bytes(text.encode(encoding))
    options: dict[str, Any] = {"columns": tuple(columns.split())}
    options = {"body": "A"} if columns == "body=A" else options
    positions = only(tmp_path / "a.csv", **options).positions
    positions = positions[np.isfinite(positions).all(axis=1)]
    assert_array_equal(positions, [[0.5, 2, 3], [1, 2, 3]])


def test_motive_states_units_in_its_first_line_and_bodies_above_the_columns(tmp_path):
    kinds = ["Rotation"] * 4 + ["Position"] * 3
    rows = [
        ["Format Version", "1", "Rotation Type", "a", "Length Units", "Millimeters"],
        ["", "", *["Rigid Body"] * 14],
        ["", "", *["Hand"] * 7, *["Door"] * 7],
        ["", "", *["1"] * 7, *["2"] * 7],
        ["", "", *kinds, *kinds],
        ["Frame", "Time (Seconds)", *"XYZWXYZXYZWXYZ"],
    ]
    hand = np.hstack([XYZW, 1e3 * POSITIONS])
    values = np.column_stack([np.arange(N), TIMES, hand, np.roll(hand, 1, axis=0)])
    text = "\n".join(",".join(map(str, row)) for row in [*rows, *values.tolist()])
    motion = table(tmp_path, text, body="Hand")
    assert motion.unit == "mm"
    check(replace(motion, positions=POSITIONS))
    assert_allclose(motion.positions, 1e3 * POSITIONS)
    several = "choose by --body: rigid body door 2, rigid"
    with pytest.raises(ValueError, match=several):
        table(tmp_path, text)


def cells(*arrays: Any) -> Any:
    made = np.empty((1, len(arrays)), dtype=object)
    made[0, :] = arrays
    return made


XYZ = ("x", "y", "z")
WITH_QUATERNION = (*XYZ, "qw", "qx", "qy", "qz")
BOTH = np.hstack([POSITIONS, WXYZ]).T
TURNED = {"hand": POSITIONS, "turn": WXYZ.T, "time": TIMES}
NAMED = ("positions=hand", "quat_wxyz=turn")


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
        ({"time": TIMES, "hand": np.stack([BOTH] * 3)}, "hand", WITH_QUATERNION),
        ({"x": cells(TURNED, TURNED)}, None, NAMED),
    ],
)
def test_times_and_rotations_stand_beside_positions(tmp_path, content, body, columns):
    scipy.io.savemat(tmp_path / "a.mat", content)
    settings = ImportSettings(body=body, columns=columns)
    for motion in read_here(tmp_path / "a.mat", settings):
        assert_array_equal(motion.positions, POSITIONS)
        assert_array_equal(np.asarray(motion.times), TIMES)
        if len(columns) > 3 or columns == NAMED:
            assert_array_equal(quaternions(motion), WXYZ)


def test_cells_and_structures_of_one_name_are_one_set(tmp_path):
    motions = cells(*(np.vstack([POSITIONS[:n].T, TIMES[:n]]) for n in (20, 30, 40)))
    structures = np.array(
        [(POSITIONS[:n], TIMES[:n]) for n in (10, 50)], dtype=[("pos", "O"), ("t", "O")]
    )
    path = tmp_path / "a.mat"
    content = {"data": motions, "best": motions[0, 0], "s": structures}
    scipy.io.savemat(path, content | {"e": {"pos": PHASE}, "z": 1j * PHASE, "n": "me"})
    found = read_here(path, ImportSettings(columns=(*XYZ, "t"), body="data"))
    names = [motion.name for motion in found]
    assert names == [f"a.mat: data{{{n}}}" for n in (1, 2, 3)]
    for motion, samples in zip(found, (20, 30, 40), strict=True):
        assert_array_equal(motion.positions, POSITIONS[:samples])
        assert_array_equal(motion.times, TIMES[:samples])
    found = read_here(path, ImportSettings(body="s"))
    assert [len(motion.positions) for motion in found] == [10, 50]
    with pytest.raises(ValueError, match=r"more than one set of recordings; .* e, s"):
        read_here(path, ANY)


def states_of_robosuite(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["data/demo_1/states"] = POSITIONS


def write_text(text: str) -> Callable[[Path], object]:
    return lambda path: path.write_text(text)


def write_arrays(**arrays: Any) -> Callable[[Path], object]:
    return lambda path: np.savez(path, **arrays)


REFUSED: tuple[tuple[str, Callable[[Path], object], dict[str, Any], str], ...] = (
    ("a.csv", write_text("1,2,3\n4,5,6"), {}, r"3 columns have no names; .* t,x,y,z"),
    ("a.csv", write_text("N,2\nHand X,b\n1,2\n3,4"), {}, "y: it has Hand X, b"),
    ("a.csv", write_text("x,y\n1,2\n1,q\n"), {}, r"line 3, column 2 \(y\): 'q' is no"),
    ("a.csv", write_text("a,b\n1,2\n"), {}, "no column x and no y: it has a, b"),
    ("a.csv", write_text("x [m],y [cm]\n1,2\n3,4"), {}, "in cm and m; they must share"),
    ("a.csv", write_text("x,y,Zeit\n1,2,3\n3,4,5"), {}, "t=NAME; columns Zeit are not"),
    ("a.hdf5", states_of_robosuite, {}, r"no group 'obs'; .* dataset_states_to_obs"),
    ("a.mvnxx", Path.touch, {}, r"\(did you mean '.mvnx'\?\); readable are .csv"),
    ("a.npz", write_arrays(pos=POSITIONS, quat=WXYZ), {}, "--quaternions wxyz or"),
    ("a.npz", write_arrays(a=BOTH.T), {"columns": XYZ}, "and --columns names 3 col"),
    ("a.npz", write_arrays(pos=POSITIONS), {"body": "b"}, "no set of recordings 'b'"),
)


@pytest.mark.parametrize(("name", "write", "options", "message"), REFUSED)
def test_what_cannot_be_read_is_said(tmp_path, name, write, options, message):
    write(tmp_path / name)
    with pytest.raises(ValueError, match=message):
        prepare(read_here(tmp_path / name, ImportSettings(**options)), ANY)
