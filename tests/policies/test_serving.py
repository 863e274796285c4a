"""A served agent: messages, states after every fault, limits, transports, journal.

Sessions have their own clock here, which only `Robot` moves on.
"""

import json
import math
import os
import random
import socket
import stat
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gplfd_env.spatial.se3 import rotation_distance
from gplfd_policies import POLICIES, GaussianTrajectory
from gplfd_policies.agents.agent import as_agent
from gplfd_policies.agents.modes import ModesAgent
from gplfd_policies.agents.reaching import ReachingAgent
from gplfd_policies.control.steps import AgentStep
from gplfd_policies.control.stiffness import DEFAULT_DYNAMICS, VirtualDynamics
from gplfd_policies.serving import protocol
from gplfd_policies.serving.__main__ import main
from gplfd_policies.serving.client import RefusedError, RemoteAgent, ServerLostError
from gplfd_policies.serving.protocol import (
    Connection,
    Journal,
    array,
    decode,
    encode,
    numbers,
    read_journal,
)
from gplfd_policies.serving.server import Server, listening
from gplfd_policies.serving.session import (
    Session,
    exceeded,
    exceeds_following_error,
    limited,
)
from gplfd_policies.serving.settings import ServeSettings

PERIOD = 0.01
SETTINGS = ServeSettings(source="puller")
HELLO = {"type": "hello", "protocol": 1}


class Puller:
    """Pulls by another millimetre at every decision."""

    def __init__(self):
        self.decisions = 0

    def reset(self, observation):
        self.decisions = 0

    def act(self, observation):
        self.decisions += 1
        action = np.array([-1e-3 * self.decisions, 0, 0, 0, 0, 0])
        return AgentStep(action=action, stiffness=np.repeat([400.0, 40.0], 3))


class Robot:
    """A client that follows perfectly, and the wire between it and a session."""

    def __init__(self, **settings):
        self.agent, self.clock = Puller(), 0.0
        self.session = Session(as_agent(self.agent), replace(SETTINGS, **settings), "x")
        self.time, self.seq, self.pose, self.force = 0.0, 0, [0.0] * 6, 0.0
        self.say(HELLO)
        (ready,) = self.say(self.message("reset"))
        assert ready == {"type": "ready", "seq": 0, "state": "active"}

    def message(self, kind="observe", **changes):
        values = {"seq": self.seq, "time": self.time, "ee_pose": self.pose}
        values["wrench"] = [self.force, 0, 0, 0, 0, 0]
        return {"type": kind, **values, **changes}

    def say(self, message):
        line = message if isinstance(message, bytes) else encode(message)
        return self.session.receive(line, self.clock)[1]

    def step(self, follow=True, period=PERIOD, delay=0.0, dropped=0):
        """Let a period pass and return the reply to the next observation."""
        passed = period * (1 + dropped)
        self.time, self.clock = self.time + passed, self.clock + passed + delay
        self.seq += 1 + dropped
        *_, reply = self.say(self.message())
        if follow and reply["type"] == "command":
            self.pose = reply["pose"]
        return reply

    def wait(self, duration):
        """Let time pass in silence and return unsolicited messages."""
        messages, until = [], self.clock + duration
        while (due := max(self.session.due, self.clock)) <= until:
            assert due > self.clock or not messages, "it says everything at once"
            self.clock = due
            messages += self.session.tick(due)
        self.clock = until
        return messages


def test_numbers_survive_bit_for_bit():
    rng = np.random.default_rng(0)
    bits = rng.integers(0, 2**63, 2000, dtype=np.uint64) << np.uint64(1)
    values = np.append(bits.view(np.float64), [5e-324, -0.0, math.nan, math.inf])
    back = array(decode(encode({"type": "x", "v": numbers(values)}))["v"])
    numeric = ~np.isnan(values)
    assert np.array_equal(back[numeric].view(np.int64), values[numeric].view(np.int64))
    assert np.isnan(back[~numeric]).all()


@given(
    st.lists(st.floats(-5, 5), min_size=12, max_size=12),
    st.lists(st.floats(1, 1e4), min_size=6, max_size=6),
)
def test_no_command_leaves_the_limits(poses, stiffness):
    pose, last = np.array(poses[:6]), np.clip(poses[6:], -2, 2)
    commanded, rendered, _ = limited(SETTINGS, pose, np.array(stiffness), last)
    slack = 1 + 1e-9
    assert np.abs(commanded[:3]).max() <= 2.0 * slack
    shift = np.linalg.norm(commanded[:3] - last[:3])
    assert shift <= SETTINGS.linear_speed * PERIOD * slack
    turn = rotation_distance(commanded[3:], last[3:])
    assert turn <= SETTINGS.angular_speed * PERIOD * slack
    low, high = SETTINGS.least_stiffness, SETTINGS.greatest_stiffness
    assert (np.repeat(low, 3) <= rendered).all()
    assert (rendered <= np.repeat(high, 3)).all()
    again, _, acted = limited(SETTINGS, commanded, rendered, commanded)
    assert acted == []
    assert again is commanded


@pytest.mark.parametrize("axis", range(6))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_limit_holds_along_every_axis_and_both_ways(axis, sign):
    unit = sign * (np.arange(6) == axis)
    for share, beyond in ((0.999, False), (1.001, True)):
        wrench = share * unit * (200.0 if axis < 3 else 50.0)
        pose = share * 2.0 * unit
        assert bool(exceeded(SETTINGS, np.zeros(6), wrench)) == beyond
        assert bool(exceeded(SETTINGS, pose, np.zeros(6))) == (beyond and axis < 3)
        away = share * unit * (0.5 if axis < 3 else 1.5)
        assert exceeds_following_error(SETTINGS, away, np.zeros(6)) == beyond


def test_silence_holds_then_softens_and_only_a_reset_moves_again():
    robot = Robot()
    robot.step()
    robot.wait(0.1)
    robot.time = robot.clock
    reply = robot.step()
    assert (reply["state"], reply["pose"][0]) == ("active", -2e-3)
    pose = reply["pose"]
    assert robot.wait(0.049) == []
    (first,) = robot.wait(0.002)
    assert (first["state"], first["unsolicited"]) == ("holding", True)
    assert (first["pose"], first["stiffness"][0]) == (pose, 400.0)
    assert len(robot.wait(0.448)) == 44, "one per period"
    soft = robot.wait(0.9)
    assert {tuple(command["pose"]) for command in soft if "pose" in command} == {
        tuple(pose)
    }
    falling = [command["stiffness"] for command in soft if "pose" in command]
    assert np.all(np.diff(falling, axis=0) <= 0)
    assert falling[-1] == [100.0] * 3 + [10.0] * 3
    assert (soft[-1]["type"], soft[-1]["state"]) == ("heartbeat", "stopped")
    robot.time = robot.clock
    assert (robot.step()["state"], robot.agent.decisions) == ("stopped", 2)
    robot.say(robot.message("reset"))
    assert robot.step()["state"] == "active"


def test_time_is_that_of_the_robot_and_of_the_server():
    """What comes late, early or not at all never makes the agent hurry."""
    robot, rng = Robot(), random.Random(0)
    for _ in range(50):
        jitter = rng.uniform(0.0, 0.04)
        robot.clock = robot.time + jitter
        reply = robot.step()
        assert reply["state"] == "active"
    assert reply["pose"][0] == pytest.approx(-0.05)
    robot.clock = robot.time
    reply = robot.step(dropped=3)
    assert (reply["missed"], reply["pose"][0]) == (3, pytest.approx(-0.051))
    for _ in range(100):
        robot.step(period=0.001)
    assert robot.agent.decisions <= 63
    # 50 ms more delay than the fastest; then they all are.
    codes = [robot.step(delay=0.06 * (count == 0))["code"] for count in range(60)]
    assert set(codes) == {"late"}
    assert robot.session.state == "stopped"
    # A clock that drifts by less than a thousandth is no delay.
    robot = Robot()
    robot.agent.act = lambda _: [0.0] * 6
    for seq in range(1, 2001):
        robot.seq, robot.time, robot.clock = seq, seq * PERIOD, seq * PERIOD / 0.9991
        assert robot.say(robot.message())[0]["state"] == "active"


WRONG = {
    "duplicate": ("duplicate", {"seq": 1, "time": 9.0}),
    "clock that goes back": ("order", {"seq": 9, "time": 0.0}),
    "short": ("field", {"ee_pose": [0.0] * 5}),
    "far": ("range", {"ee_pose": [11.0] + [0.0] * 5}),
    "type": ("type", {"type": "move"}),
    "not a number": ("range", b'{"seq":2,"time":NaN,"ee_pose":0,"type":"observe"}'),
    "no object": ("malformed", b"[]"),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_message_is_named_and_moves_nothing(name):
    """It does not put off the watchdog, either."""
    code, changes = WRONG[name]
    robot = Robot()
    pose = robot.step()["pose"]
    message = changes
    if isinstance(changes, dict):
        message = robot.message(**{"seq": 2, "time": 0.02, **changes})
    (error,) = robot.say(message)
    assert (error["type"], error["code"]) == ("error", code)
    robot.clock += 0.06
    held, error = robot.say(message)
    assert (held["state"], held["pose"], error["code"]) == ("holding", pose, code)
    assert robot.agent.decisions == 1


@pytest.mark.parametrize(
    "flood",
    [
        {"type": "heartbeat"},
        {"type": "observe", "seq": 1, "time": 9.0, "ee_pose": [0] * 6, "wrench": []},
        {"type": "observe", "seq": 1, "time": 9.0},
        {"type": "hello", "protocol": 1},
        b"{",
    ],
)
def test_a_flood_of_messages_puts_off_neither_holding_nor_softening(flood):
    robot, messages = Robot(), []
    robot.step()
    for _ in range(300):
        messages += robot.wait(0.005) + robot.say(flood)
    commands = [message for message in messages if message["type"] == "command"]
    states = [command["state"] for command in commands]
    assert states.count("holding") in range(44, 47), "one per period"
    assert states.count("stopped") in range(49, 53)
    assert commands[-1]["stiffness"] == [100.0] * 3 + [10.0] * 3


FAULTS = {
    "measured force beyond its limit": {"force": 250.0},
    "hand outside the workspace": {"pose": [3.0, 0, 0, 0, 0, 0]},
    "the robot does not follow": {"pose": [0.6, 0, 0, 0, 0, 0]},
}


@pytest.mark.parametrize("reason", FAULTS)
def test_a_fault_of_the_robot_holds_then_stops_with_the_reason(reason):
    """A fault that ends before `stop_after` lets it go on."""
    robot = Robot()
    robot.step()
    patience = 20 if "follow" in reason else 0
    for _ in range(2):
        vars(robot).update(FAULTS[reason])
        for _ in range(patience):
            assert robot.step(follow=False)["state"] == "active"
        held = robot.step(follow=False)
        assert (held["state"], held["reason"]) == ("holding", reason)
        assert held["pose"][0] == pytest.approx(-1e-3 * robot.agent.decisions)
        states = [robot.step(follow=False) for _ in range(48)]
        assert {command["state"] for command in states} == {"holding"}
        robot.pose, robot.force = held["pose"], 0.0
        assert robot.step()["state"] == "active"
    vars(robot).update(FAULTS[reason])
    stopped = [robot.step(follow=False) for _ in range(patience + 52)][-1]
    assert (stopped["state"], stopped["reason"]) == ("stopped", reason)
    soft = [command for command in robot.wait(0.6) if "pose" in command]
    assert {tuple(command["pose"]) for command in soft} == {tuple(stopped["pose"])}
    assert soft[-1]["stiffness"][0] == 100.0


def raising(error):
    def act(observation):
        observation["ee_pose"][:] = 9.0
        raise error

    return act


@pytest.mark.parametrize(
    ("act", "reason"),
    [
        (raising(ZeroDivisionError()), "the agent failed with ZeroDivisionError"),
        (raising(SystemExit(0)), "the agent failed with SystemExit: 0"),
        (raising(KeyboardInterrupt()), "the agent failed with KeyboardInterrupt"),
        (lambda _: [math.nan] * 6, "the agent failed with ValueError"),
        (lambda _: [0, 0, 0, 1e200, 0, 0], "beyond ±7.0 rad"),
        (lambda _: [0, 0, 0.6, 0, 0, 0], "the agent begins far from the hand"),
    ],
)
def test_an_agent_that_fails_stops(act, reason):
    robot = Robot()
    robot.agent.act = act
    reply = robot.step()
    assert (reply["state"], reply["pose"]) == ("stopped", [0.0] * 6)
    assert reason in reply["reason"]
    assert robot.wait(0.8)[-1]["type"] == "heartbeat", "it has softened"
    robot.time = robot.clock
    robot.say(robot.message("reset"))
    robot.agent.act = lambda _: [0, 0, 0.4, 0, 0, 0]
    assert robot.step()["pose"] == [0, 0, 0.02, 0, 0, 0], "at the greatest speed"


@pytest.mark.parametrize(("largest", "bound"), [(3.0, 7.0), (9.5, 11.0)])
def test_turns_are_bounded_by_what_the_agent_itself_turns(largest, bound):
    robot, pose = Robot(), [0.0] * 6
    turning = np.outer([0.0, largest], np.eye(6)[3])
    robot.agent.forecast = lambda: GaussianTrajectory.from_moments(
        np.array([0.0, 1.0]), turning, turning, lambda: turning
    )
    robot.say(robot.message("reset"))
    for turn, code in ((0.99 * bound, None), (1.01 * bound, "range")):
        robot.seq, robot.time, pose[3] = robot.seq + 1, robot.time + PERIOD, turn
        assert robot.say(robot.message(ee_pose=pose))[0].get("code") == code


@pytest.mark.parametrize("width", [math.nan, math.inf, "wide"])
def test_a_gripper_width_that_is_no_finite_number_stops(width):
    robot = Robot()
    robot.session._agent = SimpleNamespace(
        control="pose",
        dynamics=None,
        gripper_width=width,
        act=lambda _: AgentStep(action=np.zeros(6)),
    )
    reply = robot.step()
    assert (reply["state"], reply["pose"]) == ("stopped", [0.0] * 6)
    assert "gripper_width" not in reply


@pytest.mark.parametrize("begun", [False, True])
def test_a_reset_beyond_the_limits_moves_nothing_and_one_that_fails_stops(begun):
    robot = Robot()
    pose = robot.step()["pose"]
    (error,) = robot.say(robot.message("reset", wrench=[0, 0, 201.0, 0, 0, 0]))
    assert (error["code"], "measured force" in error["message"]) == ("limit", True)
    assert robot.step()["pose"][0] == 2 * pose[0], "the task was not begun anew"
    robot.agent.reset = raising(SystemExit())
    if not begun:
        robot.session.connect(robot.clock)
        robot.say(HELLO)
    (error,) = robot.say(robot.message("reset"))
    assert (error["code"], error["seq"]) == ("agent", robot.seq)
    soft = [message for message in robot.wait(0.6) if message["type"] == "command"]
    assert {message["state"] for message in soft} == {"stopped"}
    assert (len(soft), soft[-1]["stiffness"][0]) == (50, 100.0)
    assert {tuple(message["pose"]) for message in soft} == {(2 * pose[0], *[0.0] * 5)}


def test_a_stop_softens_once_from_the_present_stiffness():
    robot = Robot()
    assert robot.say({"type": "stop"})[0]["stiffness"] == [500.0] * 3 + [50.0] * 3
    robot = Robot()
    robot.step()
    robot.say({"type": "stop"})
    robot.wait(0.3)
    assert robot.say({"type": "stop"})[-1]["reason"] == "the client said stop"
    robot.wait(0.2)
    assert robot.say({"type": "stop"})[-1]["stiffness"][0] == 100.0


def test_every_served_agent_sends_stiffness_and_damping(skill):
    """Whatever wraps it, also while it reaches, and in every state."""
    agent = POLICIES["gp"].method.follow(skill)
    for served in (
        agent,
        as_agent(ModesAgent([agent], [1])),
        ReachingAgent(skill, agent),
        as_agent(SimpleNamespace(act=lambda _: [0.0] * 6)),
    ):
        robot = Robot()
        robot.session = Session(served, SETTINGS, "x")
        robot.say(HELLO)
        robot.say(robot.message("reset"))
        for command in (robot.step(), robot.wait(0.06)[0], robot.wait(0.6)[-1]):
            damping = (served.dynamics or DEFAULT_DYNAMICS).damping(
                np.array(command["stiffness"])
            )
            assert command["damping"] == damping.tolist()


def test_a_journal_has_a_greatest_size(tmp_path, capfd, monkeypatch):
    monkeypatch.setattr(protocol, "LARGEST", 1000)
    journal = Journal(tmp_path / "journal", {})
    for _ in range(100):
        journal.write(0.1, "text", [], 0.0)
    assert 1000 < (tmp_path / "journal").stat().st_size < 1100
    assert "the journal ends here: it has 1000 bytes" in capfd.readouterr().err


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a full disk")
def test_a_full_disk_ends_the_journal_and_not_the_motion(tmp_path, capfd):
    journal = Journal(tmp_path / "journal", {})
    journal._file.close()
    journal._file = os.fdopen(os.open("/dev/full", os.O_WRONLY), "wb", buffering=0)
    for at in (0.1, 0.2):
        journal.write(at, "text", [], 0.0)
    assert capfd.readouterr().err.count("the journal ends here: [Errno 28]") == 1


def test_a_command_names_limits_and_has_damping_and_explanation():
    robot = Robot(linear_speed=0.05, greatest_stiffness=(300.0, 40.0))
    reply = robot.step()
    assert reply["limited"] == ["linear_speed", "stiffness"]
    assert reply["pose"] == [-0.05 * PERIOD, 0, 0, 0, 0, 0]
    assert reply["stiffness"] == [300.0] * 3 + [40.0] * 3
    assert "step" not in reply
    mass = robot.agent.dynamics = VirtualDynamics(mass=np.repeat([4.0, 0.15], 3))
    robot.session = Session(as_agent(robot.agent), SETTINGS, "here")
    robot.say({**HELLO, "explain": True})
    robot.say(robot.message("reset"))
    reply = robot.step()
    assert "step" in reply
    assert "limited" not in reply
    damping = 2 * np.sqrt(mass.mass * reply["stiffness"])
    np.testing.assert_allclose(reply["damping"], damping)


@pytest.fixture
def served(tmp_path):
    """Return a server on a Unix socket whose clock is ``server.now``, and its parts."""
    settings = replace(SETTINGS, socket=tmp_path / "s", journal=tmp_path / "j.jsonl")
    listener, address = listening(settings)
    session = Session(as_agent(Puller()), settings, address)
    journal = Journal(settings.journal, {})
    now = [0.0]
    with listener:
        server = Server(session, journal, listener, clock=lambda: now[0])
        yield server, session, settings, now
        server._leave("the test ends")
    journal.close()


def connected(settings):
    client = socket.socket(socket.AF_UNIX)
    client.connect(str(settings.socket))
    client.settimeout(1.0)
    return client


def test_a_client_that_is_killed_or_silent_for_long_makes_room(served):
    server, session, settings, now = served
    assert stat.S_IMODE(settings.socket.stat().st_mode) == 0o600
    robot = Robot()
    first = connected(settings)
    assert server.step()
    with connected(settings) as second:
        first.sendall(encode(HELLO) + encode(robot.message("reset")) + b'{"type":"ob')
        assert server.step()
        assert json.loads(second.recv(999))["code"] == "busy"
    assert session.state == "active"
    first.close()
    while session.state != "idle":
        assert server.step()
    with connected(settings) as third:
        server.step()
        third.sendall(encode(HELLO) + encode(robot.message(seq=1)))
        server.step()
        assert b'"code":"state"' in third.recv(9999)
        # What a client without hello sends does not keep its place.
        others = []
        for now[0], greeted in ((0.49, True), (0.51, False), (1.01, False)):
            others.append(connected(settings))
            server.step()
            assert session.greeted == greeted
            if not greeted:
                others[-1].sendall(b"{}\n")
        others[-1].sendall(encode(HELLO))
        server.step()
        assert session.greeted
        for client in others:
            client.close()
    events = [line.get("in") for line in read_journal(settings.journal)]
    assert "the client has gone; the session was active" in events


def test_a_server_that_ends_or_refuses_is_an_error_of_the_client(tmp_path):
    def server(code):
        return [sys.executable, "-S", "-c", code]

    hello = json.dumps({"type": "hello", "control": "pose"})
    agent = RemoteAgent(server(f"print(input() and {hello!r}, flush=True)"))
    with pytest.raises(ServerLostError, match="closed the connection; hold"):
        agent.reset({"time": np.zeros(1), "ee_pose": np.zeros(6)})
    agent.close()
    with pytest.raises(ServerLostError, match="nobody serves on unix:"):
        RemoteAgent(f"unix:{tmp_path / 'nothing'}")
    error = json.dumps({"type": "error", "code": "busy", "message": "another"})
    with pytest.raises(RefusedError, match="busy: another"):
        RemoteAgent(server(f"print(input() and {error!r}, flush=True)"))
    with pytest.raises(ServerLostError, match="is silent"):
        RemoteAgent(server("import time; time.sleep(60)"), timeout=0.1)


def test_a_client_takes_no_other_command_for_its_reply():
    sent = [{"type": "hello", "control": "pose"}, {"type": "ready", "seq": 1}]
    for x, seq, more in ((1.0, 2, {"unsolicited": True}), (2.0, 1, {}), (3.0, 2, {})):
        sent.append({"type": "command", "seq": seq, "pose": [x] + [0.0] * 5, **more})
    lines = "\n".join(map(json.dumps, sent))
    says = [sys.executable, "-S", "-c", f"print({lines!r}, flush=True); input()"]
    agent = RemoteAgent(says)
    seen = {"time": np.zeros(1), "ee_pose": np.zeros(6), "wrench": np.zeros(6)}
    agent.reset(seen)
    assert agent.act(seen).action[0] == 3.0
    agent.close()


def test_a_link_keeps_parts_of_lines_and_refuses_endless_ones():
    near, far = socket.socketpair()
    with near, far:
        link = Connection(near.fileno(), near.fileno())
        far.sendall(b"a\nb")
        assert link.lines() == [b"a"]
        far.sendall(b"c\n")
        assert link.lines() == [b"bc"]
        for _ in range(40):
            link.send(bytes(2**16))
        assert link.closed, "a peer that does not read"
    for last in (b"", b"\nz\n"):
        near, far = socket.socketpair()
        with near, far:
            link, lines = Connection(near.fileno(), near.fileno()), []
            far.sendall(b"a\n" + b"x" * 40000)
            lines += link.lines()
            far.sendall(b"x" * 40000 + last)
            lines += link.lines()
            assert (lines, link.closed) == ([b"a"], True), "a line that is too long"


def test_a_journal_loses_no_more_than_the_last_line_of_a_run(tmp_path):
    file = tmp_path / "journal"
    for _ in range(2):
        journal = Journal(file, {"settings": {}})
        journal.write(0.1, b'{"type":"observe"}', [{"type": "command"}], 1e-3)
        journal.close()
        with open(file, "ab") as cut:
            cut.write(b'{"at":0.2,"in"')
    assert [line.get("at") for line in read_journal(file)] == [None, 0.1, None, 0.1]
    file.write_text("{}\n")
    with pytest.raises(ValueError, match="is not a journal"):
        read_journal(file)


BAD = {
    "gp": "give --demonstrations FILE.npz",
    "oracle": "'oracle' needs the true door",
    "reflex --host 0.0.0.0 --port 0": "add --beyond-loopback",
    "reflex --port 1 --socket s": "not both",
    "reflex --force nan": "--force nan must be finite and greater than 0.0",
    "reflex --stop-after 0.03": "must not be less than --hold-after",
    "reflex --start approach": "cannot reach by itself",
    "reflex --socket no/folder": "No such file",
}


@pytest.mark.parametrize("arguments", BAD)
def test_bad_arguments_end_with_status_2(arguments, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    try:
        status = main(arguments.split())
    except SystemExit as error:
        status = error.code
    assert status == 2
    assert BAD[arguments] in capfd.readouterr().err
    assert os.listdir(tmp_path) == []
