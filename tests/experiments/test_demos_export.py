"""``gplfd demos export``: what is written for others is read back as it was."""

import contextlib
import json
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import imageio_ffmpeg
import numpy as np
import pyarrow.parquet
import pytest
import yaml
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from gplfd_env.doors.config import DoorConfig
from gplfd_env.envs.waypoints import SIZES, Condition, WaypointDoor
from gplfd_env.robot.placement import base_for
from gplfd_env.robot.robots import robot_named
from gplfd_env.spatial.se3 import rotation_distance
from gplfd_experiments.cli import main as cli
from gplfd_experiments.data.minari import open_dataset
from gplfd_experiments.data.official import KINDS, OFFICIAL, SEED, official_set
from gplfd_experiments.data.preparation import ImportSettings, prepare
from gplfd_experiments.data.preparation.samples import Notes, usable
from gplfd_experiments.data.readers import read_here
from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.studies.trials import protocol
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.demonstrations.npz import hash_of, save_demonstrations

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("coarse_cuts")]


@pytest.fixture(autouse=True)
def shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Demonstration, ...]:
    """Two demonstrations with two signals in a file of the working folder."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    both = tuple(
        replace(one, wrenches=rng.normal(size=one.poses.shape))
        for one in Teacher().demonstrate_doors([0.35, 0.5], 1, rng=rng)
    )
    signals = [
        {"gripper": np.full((len(one.times), 2), 0.04), "grasped": one.times[:, None]}
        for one in both
    ]
    save_demonstrations("demonstrations.npz", both, signals=signals)
    return both


AS_RECORDED = ImportSettings(frame="recorded", keep_rests=True, cutoff=0.0, rate=0.0)


def exported(out: str) -> int:
    return cli.main(["demos", "export", ".", "--out", out])


def test_what_was_written_is_read_back(shown):
    apart = 1e-6  # Of float32.
    Path("learner-6").symlink_to(".")  # It comes before the official set.
    assert cli.main(["demos", "export", "learner-6", "--out", "b"]) == 0
    again = read_here(Path("b"), ImportSettings())
    assert len(again) == len(shown)
    for one, recorded in zip(shown, again, strict=True):
        notes = Notes()
        samples = usable(recorded, AS_RECORDED, notes)
        assert len(notes) <= 1
        assert_allclose(samples.times, one.times - one.times[0], atol=1e-9)
        assert_allclose(samples.poses[:, :3], one.poses[:, :3], rtol=0, atol=apart)
        found = Demonstration.from_quaternions(
            samples.times, samples.poses[:, :3], samples.poses[:, 3:]
        )
        turned = rotation_distance(found.poses[:, 3:], one.poses[:, 3:])
        assert turned.max() < apart
        # As the environment observes them, and as the hand applies them.
        assert_allclose(recorded.wrenches, -np.asarray(one.wrenches), atol=apart)
        (motion,) = prepare([recorded], AS_RECORDED)
        assert_allclose(motion.demonstration.wrenches, one.wrenches, atol=apart)


def test_what_only_some_demonstrations_have_is_left_out_with_a_warning(shown, caplog):
    some = [shown[0], replace(shown[1], wrenches=None)]
    save_demonstrations("demonstrations.npz", some)
    assert exported("b") == 0
    assert "lack it: observation.environment_state" in caplog.text


def test_lerobot_finds_what_it_looks_for(shown):
    assert exported("b") == 0
    info = json.loads(Path("b/meta/info.json").read_text())
    lengths = [len(one.times) for one in shown]
    assert (info["total_episodes"], info["total_frames"]) == (2, sum(lengths))
    tasks = pyarrow.parquet.read_table("b/meta/tasks.parquet")
    assert tasks.to_pydict() == {"task_index": [0], "task": ["open the door"]}
    assert tasks.schema.pandas_metadata["index_columns"] == ["task"]
    path = info["data_path"].format(chunk_index=0, file_index=0)
    table = pyarrow.parquet.read_table(Path("b") / path)
    # As LeRobot asks for: every feature a column, of its type and shape.
    assert set(table.column_names) == set(info["features"])
    for name, feature in info["features"].items():
        column = table[name].to_pylist()
        assert np.asarray(column[0]).size == feature["shape"][0]
    episodes = pyarrow.parquet.read_table("b/meta/episodes/chunk-000/file-000.parquet")
    assert episodes["dataset_from_index"].to_pylist() == [0, lengths[0]]
    assert episodes["dataset_to_index"].to_pylist() == [lengths[0], sum(lengths)]
    stats = json.loads(Path("b/meta/stats.json").read_text())
    states = np.array(table["observation.state"].to_pylist())
    assert_allclose(stats["observation.state"]["mean"], states.mean(axis=0), atol=1e-6)


def test_uneven_steps_and_what_is_there_are_refused(shown, caplog):
    assert exported("demonstrations.npz") == 2
    assert "--out demonstrations.npz exists" in caplog.text
    one = shown[0]
    uneven = Demonstration(times=one.times**1.2, poses=one.poses)
    save_demonstrations("demonstrations.npz", [uneven])
    assert exported("b") == 2
    assert "not sampled at equal steps of" in caplog.text
    assert not Path("b").exists()


@pytest.fixture(scope="module")
def episodes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two short episodes as `gplfd demos record` writes them."""
    folder = tmp_path_factory.mktemp("recorded") / "oracle-v0"
    record = ["demos", "record", "--policy", "oracle", "--doors", "small", "0.5"]
    cut = ["--max-steps", "45", "--out", str(folder), "--quiet"]
    assert cli.main([*record, *cut]) == 0
    return folder


def test_episodes_are_read_back_with_what_was_commanded(episodes):
    out = ["--form", "lerobot", "--out", "b", "--rate", "20"]
    assert cli.main(["demos", "export", str(episodes), *out]) == 0
    dataset = open_dataset(episodes)
    again = read_here(Path("b"), ImportSettings())
    assert len(again) == 2
    rows = pyarrow.parquet.read_table("b/data/chunk-000/file-000.parquet").to_pydict()
    for number, one in enumerate(again):
        episode = dataset.episode(number)
        assert one.times is not None
        assert_allclose(one.times, episode.observations["time"][:-1:5, 0], atol=1e-9)
        seen = episode.observations["ee_pose"][:-1:5]
        assert_allclose(one.positions, seen[:, :3], rtol=0, atol=1e-6)
        own = np.array(rows["episode_index"]) == number
        commanded = np.array(rows["action"])[own]
        # What is to be reached by the next row is the last command before it.
        last = episode.actions[4::5]
        assert_allclose(commanded[:, :3], last[:, :3], rtol=0, atol=1e-6)
        turned = Rotation.from_quat(commanded[:, 3:]).as_rotvec()
        assert rotation_distance(turned, last[:, 3:6]).max() < 1e-6
        force = np.array(rows["observation.environment_state"])[own]
        wrenches = episode.observations["wrench"][:-1:5]
        assert_allclose(force, wrenches, rtol=1e-6)
        (motion,) = prepare([one], AS_RECORDED)
        assert_allclose(motion.demonstration.wrenches, -wrenches, rtol=1e-6)


@pytest.mark.needs("opengl")
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_videos_show_the_recorded_states(episodes):
    out = ["--form", "lerobot", "--out", "b", "--rate", "10", "--size", "64", "48"]
    pictures = ["--pictures", "overview", "hand_camera"]
    assert cli.main(["demos", "export", str(episodes), *out, *pictures]) == 0
    assert len(read_here(Path("b"), ImportSettings())) == 2
    info = json.loads(Path("b/meta/info.json").read_text())
    column = "observation.images.overview"
    assert info["features"][column]["dtype"] == "video"
    assert info["features"][column]["shape"] == [48, 64, 3]
    table = pyarrow.parquet.read_table("b/meta/episodes/chunk-000/file-000.parquet")
    drawn = []
    for row in table.to_pylist():
        place = {name: row[f"videos/{column}/{name}"] for name in ("chunk_index",)}
        place["file_index"] = row[f"videos/{column}/file_index"]
        file = Path("b") / info["video_path"].format(video_key=column, **place)
        frames = imageio_ffmpeg.read_frames(file)
        about = next(frames)
        assert (about["fps"], about["size"], about["codec"]) == (10, (64, 48), "h264")
        images = [np.frombuffer(one, np.uint8).reshape(48, 64, 3) for one in frames]
        assert len(images) == row["length"] == 5
        assert row[f"videos/{column}/to_timestamp"] == 0.5
        drawn += images
    stats = json.loads(Path("b/meta/stats.json").read_text())[column]
    # Of every tenth picture, of every eighth pixel.
    some = np.stack(drawn[::5])[:, ::8, ::8] / 255.0
    assert_allclose(np.ravel(stats["mean"]), some.mean(axis=(0, 1, 2)), atol=0.02)
    # The picture of an episode's state is that of the same episode when it ran.
    dataset = open_dataset(episodes)
    episode = dataset.episode(1)
    env = gym.make(
        dataset.environment,
        **dataset.arguments,
        render_mode="rgb_array",
        width=64,
        height=48,
    )
    with contextlib.closing(env):
        env.reset(seed=episode.seed, options=dict(episode.options))
        for action in episode.actions[:40]:
            env.step(action)
        as_it_ran = np.asarray(env.render(), dtype=int)
    # The code changes colours a little; the first picture is of another door.
    other, same = (np.abs(drawn[k] - as_it_ran).mean() for k in (0, -1))
    assert same < 3.0 < other


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["SET", "--rate", "30"], "must divide the 100 control periods"),
        (["SET", "--pictures", "side"], "camera_name = 'side' is not one of 'overv"),
        (["learner-6", "--rate", "0"], "fps = 0 must divide"),
        (["SET", "--action", "stiffness"], "its commands have no stiffness"),
        ([".", "--pictures", "top"], "are for episodes of `gplfd demos record`, and"),
        ([".", "--replay"], "the doors of these motions are unknown"),
        (["learner-6", "--pictures", "top", "--size", "63", "48"], "even numbers"),
    ],
)
def test_what_cannot_be_exported_is_said(episodes, arguments, message, caplog):
    given = [str(episodes) if word == "SET" else word for word in arguments]
    assert cli.main(["demos", "export", *given, "--out", "b"]) == 2
    assert message in caplog.text
    assert not Path("b").exists()


@pytest.mark.parametrize(
    ("action", "track"),
    [("pose", "learner"), ("relative", "pipeline"), ("stiffness", "corrections")],
)
def test_replayed_actions_lead_to_the_same_states_again(action, track, monkeypatch):
    monkeypatch.setitem(OFFICIAL, "two", (track, 2))
    export = ["demos", "export", "two", "--out", "b", "--action", action]
    assert cli.main(export) == 0
    info = json.loads(Path("b/meta/info.json").read_text())
    assert (info["fps"], info["total_episodes"]) == (20, 2)
    assert info["features"]["action"]["shape"] == [SIZES[action]]
    assert len(info["features"]["action"]["names"]) == SIZES[action]
    rows = pyarrow.parquet.read_table("b/data/chunk-000/file-000.parquet").to_pylist()
    official = official_set("two")
    for number, (motion, opened) in enumerate(official):
        about = {"door": opened, "base": base_for(opened, robot_named("tiago-like"))}
        condition = Condition(name="", door="", arguments=about)
        door = WaypointDoor(condition, info["fps"], action)
        seen, _ = door.reset(seed=5)  # Nothing is drawn.
        ended, its_rows = False, [r for r in rows if r["episode_index"] == number]
        for row in its_rows:
            assert not ended
            assert row["observation.state"] == seen["agent_pos"].tolist()
            wrench = row["observation.environment_state"]
            assert wrench == seen["environment_state"].tolist()
            seen, _, ended, _, about = door.step(np.float32(row["action"]))
        assert ended
        assert about["is_success"]
        # A quarter of the way to where the demonstrator is at the end of the action.
        if action == "pose":
            hand, goal = its_rows[60]["observation.state"][0], its_rows[60]["action"][0]
            demonstrated = np.interp(61 / 20, motion.times, motion.poses[:, 0])
            assert_allclose(goal, hand + (demonstrated - hand) / 4, atol=1e-6)
    head, text = Path("b/README.md").read_text().split("---\n")[1:]
    assert yaml.safe_load(head)["configs"][0]["data_files"] == "data/*/*.parquet"
    assert f"--env.fps=20 --env.action={action} " in text
    assert hash_of([motion for motion, _ in official]) in text


def test_what_does_not_open_a_door_is_left_out(shown, caplog):
    first, second = shown
    short = Demonstration(times=second.times[:40], poses=second.poses[:40])
    save_demonstrations("demonstrations.npz", [short])
    export = ["demos", "export", ".", "--out", "b", "--rate", "10", "--replay"]
    assert cli.main([*export, "0.5"]) == 2
    assert "no demonstration opens its door" in caplog.text
    assert not Path("b").exists()
    save_demonstrations("demonstrations.npz", [short, first], [0.5, 0.35])
    assert cli.main(export) == 0
    assert len(read_here(Path("b"), ImportSettings())) == 1


def test_official_sets_are_those_of_the_page():
    page = (Path(__file__).parents[2] / "docs" / "your-policy.md").read_text()
    assert all(f"| `{name}` |" in page for name in OFFICIAL)
    # Larger ones take seconds, and draw as these do.
    names = [*(f"{track}-6" for track in KINDS), "learner-50", "forces-50"]
    sets = {name: official_set(name) for name in names}
    for name, pairs in sets.items():
        identity = hash_of([motion for motion, _ in pairs])
        assert f"| `{name}` | {len(pairs)} | `{identity}` |" in page
        smaller = sets[f"{OFFICIAL[name][0]}-6"]
        for (motion, door), (same, opened) in zip(smaller, pairs[:6], strict=True):
            assert door == opened
            assert_array_equal(motion.poses, same.poses)
    bar = DoorConfig().kind
    for track in KINDS.keys() - {"learner"}:
        trials = protocol.named_trials(protocol.TRACKS[track].trials)
        shown = [
            (task.demonstrated_kind or bar) | {n: of[n] for n in of.keys() & bar.keys()}
            for task in protocol.trial_tasks(trials, only=("mean",), seeds=1)
            for of in task.demonstrated_hardware or ({},)
        ]
        assert {str(door.kind) for door in KINDS[track]} == {*map(str, shown)}
    assert SEED not in range(protocol.FIRST_SEED, protocol.FIRST_SEED + protocol.SEEDS)
