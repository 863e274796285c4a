"""Every example runs and says something."""

import json
import runpy
import sys
import warnings
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock, Mock

import pytest

pytestmark = pytest.mark.slow

ALL = {p.stem: p for p in (Path(__file__).parents[2] / "examples").glob("*.py")}
ELSEWHERE = {
    *("cloned_policy", "learned_policy", "lerobot_policy", "ros2_node"),
    "your_own_policy",
}
"""Run by .ci/run, with the commands of docs/your-policy.md; tested in tests/learners,
with what it needs. The node of ROS 2 is tested below, with stand-ins."""

EXPECTED = {
    "bag_with_forces": ("6 bags in bags", {"bags"}),
    "robot_client": ("equal to one process: True", set()),
}
"""A part of what each of them prints, and what it leaves in the working folder."""


@pytest.fixture
def printed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")

    def run(name, *arguments):
        monkeypatch.setattr(sys, "argv", [str(ALL[name]), *arguments])
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.filterwarnings("ignore", "sensor noise")
            runpy.run_path(str(ALL[name]), run_name="__main__")
        return capsys.readouterr().out

    return run


def test_every_example_is_known():
    assert set(EXPECTED) | ELSEWHERE == set(ALL)


@pytest.mark.usefixtures("short_episodes")
@pytest.mark.parametrize("name", EXPECTED)
def test_example_runs(name, tmp_path, printed):
    said, left = EXPECTED[name]
    assert said in printed(name)
    written = list(tmp_path.iterdir())
    assert {each.name for each in written} == left
    assert all(each.stat().st_size > 10_000 for each in written if each.is_file())


def pose_stamped(x=0.0):
    point = SimpleNamespace(x=x, y=0.0, z=0.0)
    turn = SimpleNamespace(x=0, y=0, z=0, w=1)
    pose = SimpleNamespace(position=point, orientation=turn)
    return SimpleNamespace(pose=pose, header=SimpleNamespace())


def moved(tick, sent):
    """Put the hand to the start after three ticks, and then where it is told to be."""
    return 0.5 if tick < 3 else sent[-1][1].pose.position.x if sent else 0.0


@pytest.mark.parametrize(
    ("follow", "status", "played", "said"),
    [
        (moved, 0, 6, "played to the end"),
        (lambda tick, sent: 0.0, 1, 4, "stopped: the hand was 0.12"),
        (lambda tick, sent: None if tick else 0.0, 1, 1, "0.100 s ago"),
    ],
    ids=("path", "stuck", "silent"),
)
def test_the_node_plays_a_file_and_stops_where_the_hand_does_not_follow(
    tmp_path, monkeypatch, follow, status, played, said
):
    sent = []
    names = "publisher", "subscription", "timer"
    node = {f"create_{name}": Mock() for name in names}
    node["__init__"] = lambda *given: None
    log, node["destroy_node"] = Mock(), Mock()
    node["get_logger"], node["get_clock"] = Mock(return_value=log), MagicMock()
    node["create_publisher"].side_effect = lambda kind, topic, depth: SimpleNamespace(
        publish=lambda message: sent.append((topic, message))
    )

    def spin(player):
        *_, observe, _ = node["create_subscription"].call_args.args
        _, tick = node["create_timer"].call_args.args
        tick()  # Nothing is known of the hand: nothing may be sent.
        assert not sent
        for number in range(50):
            if (place := follow(number, sent)) is not None:
                observe(pose_stamped(place))
            tick()

    for name, content in {
        "rclpy": Mock(spin=spin),
        "rclpy.node": Mock(Node=type("Node", (), node)),
        "geometry_msgs.msg": Mock(PoseStamped=pose_stamped),
        "std_msgs.msg": Mock(Float64MultiArray=SimpleNamespace),
    }.items():
        monkeypatch.setitem(sys.modules, name, content)
    places = [[0.03 * number, 0.0, 0.0] for number in range(10)]
    samples = {
        "time": [0.1 * number for number in range(10)],
        "position": places,
        "path_position": places,
        "quaternion_xyzw": [[0.0, 0.0, 0.0, 1.0]] * 10,
        "stiffness": [[100.0 + number] * 6 for number in range(10)],
    }
    table = {"rate_hz": 10.0, "demonstrated_until_s": 0.55, "samples": samples}
    file = tmp_path / "opening.json"
    file.write_text(json.dumps(table | {"frame": {"name": "base"}}))
    monkeypatch.setattr(sys, "argv", ["ros2_node.py", str(file)])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(ALL["ros2_node"]), run_name="__main__")
    assert (ended.value.code, said in str(log.mock_calls[-1])) == (status, True)
    topics, messages = zip(*sent, strict=True)
    assert topics == ("target_stiffness", "target_pose") * played
    assert [one.data[0] for one in messages[::2]] == [100.0 + n for n in range(played)]
    assert messages[-1].pose.position.x == places[played - 1][0]
    assert messages[-1].header.frame_id == "base"
