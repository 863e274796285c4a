"""`gplfd export`: files that are read back bit for bit, and open doors as the agent."""

import csv
import json
import math
import re
from dataclasses import replace
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from gplfd_env import ENVIRONMENT_IDS
from gplfd_env.conventions.assets import asset_path
from gplfd_env.robot.robots import robot_named
from gplfd_env.spatial.rotation_paths import rotvecs_from_quaternions
from gplfd_experiments.cli import main as cli
from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.data.writers import states_of
from gplfd_experiments.episodes.rollout import rollout
from gplfd_experiments.files.provenance import content_hash
from gplfd_experiments.workflows import exports
from gplfd_experiments.workflows.exports import dry_run, export_skill
from gplfd_policies import load_skill, policy_named
from gplfd_policies.registry.method import TrainingInput

pytestmark = pytest.mark.slow

GP = policy_named("gp").method
FRAME = "0.8,-0.1,1,0,0,0.7071067811865476,0.7071067811865476"


@pytest.fixture(scope="module")
def skill_file(tmp_path_factory):
    rng = np.random.default_rng(0)
    demonstrations = Teacher().demonstrate_doors([0.4, 0.5, 0.6], per_door=2, rng=rng)
    file = tmp_path_factory.mktemp("skill") / "skill.npz"
    GP.learn(TrainingInput(demonstrations=demonstrations)).save(file)
    return file


@pytest.fixture(scope="module")
def exported(skill_file):
    """Return what was exported, its states, and its files without their suffixes."""
    door = skill_file.with_name("door")
    forms = ("csv", "tum", "json", "bag")
    path, _ = export_skill(skill_file, [door.with_suffix(f".{one}") for one in forms])
    return path, states_of(path.poses), door


@pytest.fixture
def few_tries(monkeypatch):
    """Search stances from an eighth of the tries: enough for these doors."""
    monkeypatch.setattr("gplfd_env.robot.search._TRIES", 8)


def test_tables_are_read_back_bit_for_bit(exported):
    path, states, door = exported
    first, second, *lines = door.with_suffix(".csv").read_text().splitlines()
    assert first == "# a gplfd commanded path"
    assert second.startswith("# frame task: origin at the closed handle, x pulls")
    heads, *rows = csv.reader(lines)
    found = heads[7], heads[10], heads[14], heads[20], heads[-1]
    assert ",".join(found) == (
        "qw,path_z [m],std_rx [rad],stiffness_rx [N m/rad],margin_rz [N m/(rad s)]"
    )
    columns = np.c_[path.times, states, path.path[:, :3], path.std, path.stiffness]
    np.testing.assert_array_equal(
        np.array(rows, dtype=float), np.c_[columns, path.damping, path.margin]
    )
    trajectory = np.loadtxt(door.with_suffix(".tum"))
    np.testing.assert_array_equal(trajectory, np.c_[path.times, states])


def test_json_has_everything_with_units_and_origin(exported, skill_file):
    path, states, door = exported
    entries = json.loads(door.with_suffix(".json").read_text())
    samples, law = entries["samples"], entries["stiffness_law_and_dynamics"]
    assert set(samples) - set(entries["units"]) == {"quaternion_xyzw"}
    assert (law["mass"][3], law["k_min"][0]) == (0.15, 100.0)
    assert entries["provenance"]["config"]["skill_sha256"] == content_hash(skill_file)
    np.testing.assert_array_equal(samples["position"], states[:, :3])
    np.testing.assert_array_equal(samples["quaternion_xyzw"], states[:, 3:])
    for name in ("std", "stiffness", "damping", "margin"):
        np.testing.assert_array_equal(samples[name], getattr(path, name))
    # Nothing is seen of a door: beyond demonstrations the uncertainty grows.
    skill = load_skill(skill_file)
    aligned, end = skill.aligned, skill.predict(np.ones(1)).std[0]
    assert entries["demonstrated_until_s"] == aligned.end * aligned.duration
    drift = (1.0 - aligned.end) * aligned.drift
    # What sets the stiffness follows it, with a delay.
    np.testing.assert_allclose(samples["std"][-1], np.hypot(end, drift), rtol=1e-5)


def test_a_bag_is_read_back_bit_for_bit(exported):
    path, states, door = exported
    store, found = get_typestore(Stores.ROS2_HUMBLE), {}
    with Reader(door.with_suffix(".bag")) as bag:
        for connection, at, data in bag.messages():
            message = store.deserialize_cdr(data, connection.msgtype)
            found.setdefault(connection.topic, []).append((at, message))
    assert set(found) == {"/target_pose", "/target_stiffness"}
    numbers = [message.data for _, message in found["/target_stiffness"]]
    np.testing.assert_array_equal(numbers, path.stiffness)
    rows = []
    for at, message in found["/target_pose"]:
        p, q, head = message.pose.position, message.pose.orientation, message.header
        rows.append([p.x, p.y, p.z, q.x, q.y, q.z, q.w])
        assert head.stamp.sec * 10**9 + head.stamp.nanosec == at
        assert at == round(1e9 * path.times[len(rows) - 1])
        assert head.frame_id == "task"
    np.testing.assert_array_equal(rows, states)


def test_replayed_open_loop_it_opens_a_door_as_its_agent(exported, skill_file):
    """The acceptance is 1 N and 1°."""
    samples = json.loads(exported[-1].with_suffix(".json").read_text())["samples"]
    turns = rotvecs_from_quaternions(samples["quaternion_xyzw"], order="xyzw")
    rows = iter(np.hstack([samples["position"], turns, samples["stiffness"]]))
    player = SimpleNamespace(control="impedance", act=lambda observation: next(rows))
    logs = []
    for agent in (GP.open_loop(0.01).follow(load_skill(skill_file)), player):
        env = gym.make(ENVIRONMENT_IDS["impedance"], door="large")
        logs.append(rollout(env, agent, policy="gp", door="large", seed=0))
        env.close()
    assert [log.success for log in logs] == [True, True]
    forces = (log.forces.wrench[:, :3] for log in logs)
    np.testing.assert_allclose(*forces, atol=0.1)
    angles = (log.opening.door_angle for log in logs)
    np.testing.assert_allclose(*angles, atol=1e-4)


def test_the_command_names_its_files_and_their_frame(skill_file, tmp_path, capsys):
    given = ["export", str(skill_file), "--rate", "20", "--out", str(tmp_path / "a.b")]
    assert cli.main([*given, "--form", "json", "bag", "--frame", FRAME]) == 0
    said = capsys.readouterr()
    assert "samples in the frame of the base" in said.out
    assert "without --tool" in said.err
    assert "not a door's" not in said.err
    assert {one.name for one in tmp_path.iterdir()} == {"a.b.json", "a.b.bag"}
    entries = json.loads((tmp_path / "a.b.json").read_text())
    assert (entries["frame"]["name"], entries["rate_hz"]) == ("base", 20.0)
    replace(load_skill(skill_file), frame="first pose").save(tmp_path / "other.npz")
    given[1:] = [str(tmp_path / "other.npz"), "--out", str(tmp_path / "c.csv")]
    assert cli.main([*given, "--frame", FRAME]) == 0
    assert "are not a door's (first pose frame)" in capsys.readouterr().err
    assert cli.main([*given, "--form", "bag"]) == 0  # a bag is replaced


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("a.txt", "a.txt must end in .csv, .tum, .bag, .json; or give --form"),
        ("a.csv --rate nan", "--rate nan must be 20 to 1000"),
        ("a.csv --frame 0,0,0,1,1,1,1", "--frame and --tool: quaternions[0] has norm"),
        ("a.csv --policy gp-paper@published", "does not; learn it again"),
        ("folder.bag", "folder.bag exists and is no bag"),
        ("a.csv --door small", "--door goes with --robot"),
    ],
)
def test_bad_options_are_refused_before_anything_is_written(
    skill_file, tmp_path, monkeypatch, capsys, words, message
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder.bag").mkdir()
    (tmp_path / "folder.csv").mkdir()
    assert cli.main(["export", str(skill_file), "--out", *words.split()]) == 2
    assert message in capsys.readouterr().err
    assert len(list(tmp_path.rglob("*"))) == 2


BEYOND = {
    "--robot panda-like --frame=0.6,-0.1,1,0,0,0,1": (
        "at 0.00 s the angle between y of --frame and up is 90 deg; 0 to 2 deg is"
    ),
    "--linear-speed 0.1": r"at 2.\d+ s the set-point's speed is 0.19.* 0 to 0.1 m/s is",
    "--workspace -1 -1 -1 0.1 1 1": "the set-point's x is .*; -1 to 0.1 m in the task",
    "--greatest-stiffness 300 50": "the stiffness along y is 49.*; 100 to 300 N/m is",
    "--robot ur5e-like --force 1": "the force on the handle is .*; 0 to 1 N is",
    "--robot tiago-like --door large": (
        r"at 8.\d+ s the position of arm_6_joint is -1.41\d+ rad; -1.4137 to 1.4137 rad"
    ),
    "--robot weak.json": (
        r"(?s)the speed of \w+ is .*; 0 to 0.3 rad/s .*"
        r"the torque of wrist_1_joint is .* N m; 0 to 2 N m is"
    ),
}


@pytest.mark.parametrize("words", BEYOND)
def test_beyond_limits_nothing_is_written_unless_allowed(
    skill_file, tmp_path, monkeypatch, capsys, words
):
    monkeypatch.chdir(tmp_path)
    text = asset_path("ur5e_like.urdf").read_text().replace('effort="28"', 'effort="2"')
    (tmp_path / "weak.urdf").write_text(text)
    (tmp_path / "weak.json").write_text('{"path": "weak.urdf", "velocity": 0.3}')
    (tmp_path / "a.csv").write_text("an earlier file")
    before = sorted(tmp_path.iterdir())
    given = ["export", str(skill_file), "--out", "a.csv", "b.json", *words.split()]
    assert cli.main(given) == 1
    said = capsys.readouterr().err
    assert re.search(BEYOND[words], said)
    assert "gplfd: nothing is written; --allow writes it" in said
    assert (tmp_path / "a.csv").read_text() == "an earlier file"
    assert sorted(tmp_path.iterdir()) == before
    if words == "--linear-speed 0.1":
        assert cli.main([*given, "--allow"]) == 0
        assert re.search(BEYOND[words], capsys.readouterr().err)
        assert (tmp_path / "a.csv").read_text().startswith("# a gplfd commanded path")


def test_a_dry_run_says_what_to_expect_of_a_robot(skill_file, tmp_path, capsys):
    out = tmp_path / "door.json"
    options = ["--out", str(out), "--robot", "ur5e-like", "--door", "small"]
    assert cli.main(["export", str(skill_file), *options]) == 0
    lines = capsys.readouterr().out.splitlines()
    printed = dict(line.split(": ", 1) for line in lines if ": " in line)
    assert printed["robot"] == "ur5e-like, fixed base"
    assert printed["door"].startswith("small: opened, 7")
    # A joint without an effort limit has no share of it.
    text = asset_path("ur5e_like.urdf").read_text().replace('effort="150"', "", 1)
    (tmp_path / "arm.urdf").write_text(text)
    arm = replace(robot_named("ur5e-like"), urdf=str(tmp_path / "arm.urdf"))
    run = dry_run(skill_file, "gp", arm, "small")
    # What the true arc of 0.35 m takes, and what limits the arm.
    assert np.ptp(run.hand[:, 2]) < 2e-3
    chord = np.linalg.norm(run.hand[-1] - run.hand[0])
    opened = float(run.summary["door"].split()[-2])
    assert chord == pytest.approx(0.7 * np.sin(np.radians(opened) / 2), abs=0.02)
    assert re.match(r"\d?\d % of the limit of ", run.summary["greatest effort"])
    assert run.summary["least joint-limit margin"].split()[-1] in arm.arm
    assert 475.0 < float(run.summary["greatest stiffness"].split()[0]) < 525.0


@pytest.mark.usefixtures("few_tries")
def test_a_dry_run_stands_where_the_frame_says(skill_file, monkeypatch):
    """In the base frame the hand begins at the handle and is pulled along its x."""
    monkeypatch.setattr(exports, "_APART", 80)  # A stance for few places of the path.
    axes = Rotation.from_euler("z", -0.3) * Rotation.from_quat(
        [0.0, math.sqrt(0.5), math.sqrt(0.5), 0.0]
    )
    frame = (0.9, -0.1, 0.2, *axes.as_quat(scalar_first=True))
    run = dry_run(skill_file, "gp", "ur5e-like", "small", frame)
    assert run.summary["robot"] == "ur5e-like, fixed base"
    assert run.summary["door"].startswith("small: opened")
    np.testing.assert_allclose(run.hand[0, :2], frame[:2], atol=2e-3)
    along = axes.inv().apply(run.hand - run.hand[0])
    # The door of 0.35 m, hinged at z = -0.35 of the task frame.
    distances = np.hypot(along[:, 0], along[:, 2] + 0.35)
    np.testing.assert_allclose(distances, 0.35, atol=0.01)


@pytest.mark.usefixtures("few_tries")
def test_a_frame_out_of_reach_says_where_it_is_in_reach(
    skill_file, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(exports, "_APART", 80)
    out = ["--out", str(tmp_path / "a.json"), "--robot", "ur5e-like", "--door", "small"]

    def status_at(position):
        pose = ",".join(map("{:.3f}".format, position)) + ",0,0,0.7071068,0.7071068"
        return cli.main(["export", str(skill_file), *out, f"--frame={pose}"])

    far = np.array([1.3, 0.3, 0.2])
    assert status_at(far) == cli.BAD_INPUT
    assert list(tmp_path.iterdir()) == []
    message = capsys.readouterr().err
    shift = re.search(r"stays \[(.*)\] m away", message)[1].split(",")
    # A little more than it says, where the arm is stretched.
    assert status_at(far - 1.5 * np.array(shift, dtype=float)) == 0
