"""`gplfd export`: files that are read back bit for bit, and open doors as the agent."""

import csv
import json
import sys

import gymnasium as gym
import numpy as np
import pytest
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from gplfd_env import ENVIRONMENT_IDS
from gplfd_env.spatial.rotation_paths import rotvecs_from_quaternions
from gplfd_experiments.cli import main as cli
from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.episodes.rollout import rollout
from gplfd_experiments.files.provenance import content_hash
from gplfd_experiments.workflows.exports import export_skill
from gplfd_policies import load_skill, policy_named
from gplfd_policies.registry.method import TrainingInput
from gplfd_policies.registry.open_loop import open_loop

GP = policy_named("gp").method
FRAME = "0.8,-0.1,1,0,0,0.7071067811865476,0.7071067811865476"


@pytest.fixture(scope="module")
def skill_file(tmp_path_factory):
    rng = np.random.default_rng(0)
    given = Teacher().demonstrate_doors([0.4, 0.5, 0.6], per_door=2, rng=rng)
    file = tmp_path_factory.mktemp("skill") / "skill.npz"
    GP.learn(TrainingInput(demonstrations=given)).save(file)
    return file


@pytest.fixture(scope="module")
def exported(skill_file):
    """Return what was exported, and the folder of its files in every form."""
    folder = skill_file.parent
    files = [folder / f"door.{form}" for form in ("csv", "tum", "json", "bag")]
    return export_skill(skill_file, files), folder


def test_a_table_is_read_back_bit_for_bit(exported):
    commands, folder = exported
    text = (folder / "door.csv").read_text().splitlines()
    assert text[0] == "# a gplfd commanded path, version 1"
    assert text[1].startswith("# frame: task: origin at the closed handle")
    heads, *rows = csv.reader(line for line in text if not line.startswith("#"))
    columns = dict(zip(heads, np.array(rows, dtype=float).T, strict=True))
    path = commands.path
    np.testing.assert_array_equal(columns["time [s]"], path.times)
    names = ("x [m]", "y [m]", "z [m]", "qx", "qy", "qz", "qw")
    np.testing.assert_array_equal(
        np.stack([columns[n] for n in names], 1), commands.states
    )
    for name, axis, unit, ours in (
        ("path", "z", "m", path.path[:, 2]),
        ("std", "rx", "rad", path.std[:, 3]),
        ("stiffness", "y", "N/m", path.stiffness[:, 1]),
        ("damping", "rz", "N m s/rad", path.damping[:, 5]),
        ("margin", "x", "N/(m s)", path.margin[:, 0]),
    ):
        np.testing.assert_array_equal(columns[f"{name}_{axis} [{unit}]"], ours)
    trajectory = np.loadtxt(folder / "door.tum")
    np.testing.assert_array_equal(trajectory[:, 0], path.times)
    np.testing.assert_array_equal(trajectory[:, 1:], commands.states)


def test_json_has_everything_with_units_and_origin(exported, skill_file):
    commands, folder = exported
    entries = json.loads((folder / "door.json").read_text())
    samples = entries["samples"]
    assert entries["frame"]["name"] == "task"
    assert set(samples) - set(entries["units"]) == {"quaternion_xyzw"}
    assert entries["gripper"]["command"] == "closed"
    assert entries["provenance"]["config"]["skill_sha256"] == content_hash(skill_file)
    assert entries["stability_bound_for"]["mass"] == [4.0] * 3 + [0.15] * 3
    assert entries["stiffness_law_along_task_axes"]["k_min"] == [100.0] * 3 + [10.0] * 3
    # Nothing is seen of a door: beyond demonstrations the uncertainty grows.
    skill = load_skill(skill_file)
    aligned, end = skill.aligned, skill.predict(np.ones(1))
    drift = (1.0 - aligned.end) * aligned.drift
    np.testing.assert_allclose(samples["std"][-1], np.hypot(end.std[0], drift))
    assert entries["demonstrated_until_s"] == aligned.end * aligned.duration
    np.testing.assert_array_equal(samples["position"], commands.states[:, :3])
    np.testing.assert_array_equal(samples["quaternion_xyzw"], commands.states[:, 3:])
    for name in ("std", "stiffness", "damping", "margin"):
        np.testing.assert_array_equal(samples[name], getattr(commands.path, name))


def test_a_bag_is_read_back_bit_for_bit(exported):
    commands, folder = exported
    store, found = get_typestore(Stores.ROS2_HUMBLE), {}
    with Reader(folder / "door.bag") as bag:
        for connection, stamp, data in bag.messages():
            message = store.deserialize_cdr(data, connection.msgtype)
            found.setdefault(connection.topic, []).append((stamp, message))
    poses, stiffnesses = found.pop("/target_pose"), found.pop("/target_stiffness")
    assert not found
    states = []
    for stamp, message in poses:
        p, q, time = (
            message.pose.position,
            message.pose.orientation,
            message.header.stamp,
        )
        states.append([p.x, p.y, p.z, q.x, q.y, q.z, q.w])
        assert (time.sec * 10**9 + time.nanosec, message.header.frame_id) == (
            stamp,
            "task",
        )
    np.testing.assert_array_equal(states, commands.states)
    numbers = np.array([message.data for _, message in stiffnesses])
    np.testing.assert_array_equal(numbers, commands.path.stiffness)
    stamps = np.array([stamp for stamp, _ in poses])
    np.testing.assert_array_equal(stamps, 10_000_000 * np.arange(len(poses)))


class Player:
    """Plays an exported file open loop."""

    control = "impedance"

    def __init__(self, file):
        samples = json.loads(file.read_text())["samples"]
        turns = rotvecs_from_quaternions(samples["quaternion_xyzw"], order="xyzw")
        self.rows = np.hstack([samples["position"], turns, samples["stiffness"]])

    def reset(self, observation):
        self.step = -1

    def act(self, observation):
        self.step += 1
        return self.rows[min(self.step, len(self.rows) - 1)]


def test_replayed_open_loop_it_opens_a_door_as_the_agent_that_wrote_it(
    exported, skill_file
):
    _, folder = exported
    logs = []
    for agent in (
        open_loop(GP).follow(load_skill(skill_file)),
        Player(folder / "door.json"),
    ):
        env = gym.make(ENVIRONMENT_IDS["impedance"], door="large")
        logs.append(rollout(env, agent, policy="gp", door="large", seed=0))
        env.close()
    agent, player = logs
    assert agent.success
    assert player.success
    assert len(agent.times) == len(player.times)
    # The acceptance is 1 N and 1°.
    np.testing.assert_allclose(player.wrench[:, :3], agent.wrench[:, :3], atol=0.1)
    np.testing.assert_allclose(player.door_angle, agent.door_angle, atol=1e-4)


def test_the_command_names_its_files_and_their_frame(skill_file, tmp_path, capsys):
    given = ["export", str(skill_file), "--out", str(tmp_path / "a.b"), "--rate", "20"]
    assert cli.main([*given, "--form", "json", "bag", "--frame", FRAME]) == 0
    said = capsys.readouterr()
    assert "frame: base of the robot" in said.out
    assert "stable for 4 kg and 0.15 kg m²" in said.out
    assert "give --tool" in said.err
    assert {one.name for one in tmp_path.iterdir()} == {"a.b.json", "a.b.bag"}
    entries = json.loads((tmp_path / "a.b.json").read_text())
    assert (entries["frame"]["name"], entries["rate_hz"]) == ("base", 20.0)
    assert entries["task_frame_in_base"][:3] == [0.8, -0.1, 1.0]
    # Up in the task frame is up in the base: z.
    np.testing.assert_allclose(
        entries["samples"]["position"][0], [0.8, -0.1, 1.0], atol=0.002
    )
    # A bag is replaced, and nothing else that has its name.
    assert cli.main([*given[:3], str(tmp_path / "a.b.bag"), "--quiet"]) == 0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("--out a.txt", "--out a.txt must end in one of .csv, .tum, .json, .bag, or"),
        ("--out a.csv b.tum --form json", "--form goes with one --out"),
        ("--out a.csv --rate 5", "--rate 5 must be from 20 to 1000"),
        ("--out a.csv --rate nan", "--rate nan must be from 20 to 1000"),
        ("--out a.csv --frame 1,2,3", "'1,2,3' must be numbers x,y,z,qw,qx,qy,qz"),
        ("--out a.csv --frame 0,0,0,1,1,1,1", "--frame: quaternions[0] has norm 2"),
        ("--out a.csv --frame 0,0,0,1,0,0,nan", "--frame: quaternions[0]"),
        ("--out a.csv --tool 1,0,0,0", "--tool goes with --frame"),
        ("--out a.csv --policy promp", "'promp' learns no skill"),
        ("--out a.csv --policy gp-paper", "learned by one that does not"),
        ("--out folder.bag", "folder.bag exists and is no bag"),
    ],
)
def test_wrong_options_say_what_is_right(
    skill_file, tmp_path, monkeypatch, capsys, words, said
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder.bag").mkdir()
    assert cli.main(["export", str(skill_file), *words.split()]) == 2
    assert said in capsys.readouterr().err
    assert [one.name for one in tmp_path.iterdir()] == ["folder.bag"]


def test_without_rosbags_the_error_says_what_to_install(
    skill_file, tmp_path, monkeypatch, capsys
):
    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)
    bag = tmp_path / "a.bag"
    assert cli.main(["export", str(skill_file), "--out", str(bag), "--rate", "20"]) == 2
    assert "pip install 'gplfd[ros]'" in capsys.readouterr().err
    assert not bag.exists()
