"""Every example runs and says something."""

import json
import runpy
import sys
import warnings
from pathlib import Path
from types import ModuleType, SimpleNamespace

import pytest

pytestmark = pytest.mark.slow

ALL = {
    path.stem: path for path in (Path(__file__).parents[2] / "examples").glob("*.py")
}
ELSEWHERE = {"cloned_policy", "diffusion_policy", "learned_policy", "ros2_node"}
"""Run by .ci/run, with the commands of docs/learners.md; tested in tests/learners, with
what it needs. The node of ROS 2 is tested below, with stand-ins."""

EXPECTED = {
    "random_agent": ("failure:", set()),
    "your_own_policy": ("gplfd view results/imitate/medium.rrd", {"results"}),
    "vectorised_evaluation": ("5/5 opened", set()),
    "rl_smoke": ("16/16 opened", set()),
    "plot_episode": ("opened: True", {"episode.png"}),
    "bag_with_forces": ("6 bags in bags", {"bags"}),
    "play_trajectory": ("opened: True", {"movement.csv"}),
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


@pytest.mark.parametrize("name", EXPECTED)
def test_example_runs(name, tmp_path, printed):
    said, left = EXPECTED[name]
    assert said in printed(name)
    written = list(tmp_path.iterdir())
    assert {each.name for each in written} == left
    assert all(each.stat().st_size > 10_000 for each in written if each.is_file())


def test_a_table_of_one_s_own_is_played_and_left_as_it_is(tmp_path, printed):
    names = "x [m],y [m],z [m],qx,qy,qz,qw"
    table = tmp_path / "opening.csv"
    table.write_text(text := "\n".join(["# mine", names, *5 * ["0,0,0,0,0,0,1"]]))
    said = printed("play_trajectory", "opening.csv")
    assert said == "5 rows of opening.csv played: door at 0 deg, opened: False\n"
    assert table.read_text() == text
    assert list(tmp_path.iterdir()) == [table]


class Ros:
    """Stand-ins for rclpy and messages."""

    def __init__(self, monkeypatch, follow):
        self.follow, self.said, self.sent = follow, [], []
        log = SimpleNamespace(
            **dict.fromkeys(("info", "warn", "error"), self.said.append)
        )
        ros = self

        class Node:
            def __init__(self, name):
                self.get_logger = lambda: log
                now = SimpleNamespace(to_msg=lambda: "now")
                self.get_clock = lambda: SimpleNamespace(now=lambda: now)
                self.destroy_node = lambda: None

            def create_publisher(self, kind, topic, depth):
                def publish(message):
                    assert type(message) is kind
                    ros.sent.append((topic, message))

                return SimpleNamespace(publish=publish)

            def create_subscription(self, kind, topic, callback, depth):
                assert (topic, kind) == ("current_pose", Pose)
                ros.observe = callback

            def create_timer(self, period, callback):
                assert period == 0.1
                ros.tick = callback

        class Pose:
            def __init__(self):
                point = SimpleNamespace(x=0.0, y=0.0, z=0.0)
                turn = SimpleNamespace(x=0.0, y=0.0, z=0.0, w=1.0)
                self.header = SimpleNamespace()
                self.pose = SimpleNamespace(position=point, orientation=turn)

        class Float64MultiArray:
            def __init__(self, data):
                self.data = data

        kinds = {
            "rclpy": {
                "init": lambda: None,
                "try_shutdown": lambda: None,
                "spin": self.spin,
            },
            "rclpy.node": {"Node": Node},
            "geometry_msgs": {},
            "geometry_msgs.msg": {"PoseStamped": Pose},
            "std_msgs": {},
            "std_msgs.msg": {"Float64MultiArray": Float64MultiArray},
        }
        self.hand = Pose()
        for name, content in kinds.items():
            module = ModuleType(name)
            vars(module).update(content)
            monkeypatch.setitem(sys.modules, name, module)

    def spin(self, node):
        self.tick()  # Nothing is known of the hand: nothing may be sent.
        assert not self.sent
        for tick in range(50):
            if self.follow(tick, self):
                self.observe(self.hand)
            self.tick()


def moved(tick, ros):
    """The hand starts elsewhere, is put to the start, and then follows."""
    place = 0.5 if tick < 3 else ros.sent[-1][1].pose.position.x if ros.sent else 0.0
    ros.hand.pose.position.x = place
    return True


def stuck(tick, ros):
    return True


def silent(tick, ros):
    return tick == 0


@pytest.mark.parametrize(
    ("follow", "options", "status", "played", "said"),
    [
        (moved, (), 0, 6, "played to the end"),
        (moved, ("--whole",), 0, 10, "played to the end"),
        (stuck, (), 1, 4, "stopped: the hand was 0.12"),
        (silent, (), 1, 1, "0.100 s ago"),
    ],
)
def test_the_node_plays_what_was_exported_and_stops_where_the_hand_does_not_follow(
    tmp_path, monkeypatch, follow, options, status, played, said
):
    ros = Ros(monkeypatch, follow)
    times = [0.1 * number for number in range(10)]
    places = [[0.3 * time, 0.0, 0.0] for time in times]
    table = {
        "frame": {"name": "base"},
        "rate_hz": 10.0,
        "demonstrated_until_s": 0.55,
        "samples": {
            "time": times,
            "position": places,
            "path_position": places,
            "quaternion_xyzw": [[0.0, 0.0, 0.0, 1.0]] * 10,
            "stiffness": [[100.0 + n] * 3 + [10.0] * 3 for n in range(10)],
        },
    }
    file = tmp_path / "opening.json"
    file.write_text(json.dumps(table))
    monkeypatch.setattr(sys, "argv", ["ros2_node.py", str(file), *options])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(ALL["ros2_node"]), run_name="__main__")
    assert ended.value.code == status
    assert said in ros.said[-1]
    assert [topic for topic, _ in ros.sent] == [
        "target_stiffness",
        "target_pose",
    ] * played
    stiffnesses = [message.data[0] for _, message in ros.sent[::2]]
    assert stiffnesses == [100.0 + n for n in range(played)]
    assert ros.sent[-1][1].pose.position.x == places[played - 1][0]
    assert ros.sent[-1][1].header.frame_id == "base"


def test_the_node_refuses_the_task_frame(tmp_path, monkeypatch, capsys):
    Ros(monkeypatch, moved)
    file = tmp_path / "opening.json"
    file.write_text('{"frame": {"name": "task"}}')
    monkeypatch.setattr(sys, "argv", ["ros2_node.py", str(file)])
    with pytest.raises(SystemExit):
        runpy.run_path(str(ALL["ros2_node"]), run_name="__main__")
    assert "export it with --frame" in capsys.readouterr().err
