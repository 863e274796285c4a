"""A served agent: messages, states after every fault, limits, transports, journal.

Sessions have a clock of their own here, which only `Robot` moves on.
"""

import json
import math
import os
import random
import socket
import stat
import sys
import time
import tracemalloc
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gplfd_env.spatial.se3 import rotation_distance
from gplfd_policies.agents.agent import as_agent
from gplfd_policies.control.steps import AgentStep
from gplfd_policies.control.stiffness import VirtualDynamics
from gplfd_policies.serving.__main__ import main
from gplfd_policies.serving.client import RefusedError, RemoteAgent, ServerLostError
from gplfd_policies.serving.journal import Journal, read_journal
from gplfd_policies.serving.limits import exceeded, exceeds_following_error, limited
from gplfd_policies.serving.link import Link
from gplfd_policies.serving.protocol import array, decode, encode, numbers
from gplfd_policies.serving.server import (
    Server,
    _listening,
    handle,
    serve,
    served_agent,
)
from gplfd_policies.serving.session import Session
from gplfd_policies.serving.settings import ServeSettings

pytestmark = pytest.mark.usefixtures("unchecked_types")

PERIOD = 0.01
SETTINGS = ServeSettings(source="puller")


class Puller:
    """Pulls on by a millimetre at every decision."""

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

    def __init__(self, agent=None, **settings):
        self.agent = Puller() if agent is None else agent
        chosen = replace(SETTINGS, **settings)
        self.session = Session(as_agent(self.agent), chosen, "here")
        self.now = self.time = 0.0
        self.seq, self.pose, self.force = 0, [0.0] * 6, 0.0
        self.say({"type": "hello", "protocol": 1})
        (ready,) = self.say(self.message("reset"))
        assert ready == {"type": "ready", "seq": 0, "state": "active"}

    def message(self, kind="observe", **changes):
        wrench = [self.force, 0, 0, 0, 0, 0]
        own = {"seq": self.seq, "time": self.time, "ee_pose": self.pose}
        return {"type": kind, **own, "wrench": wrench, **changes}

    def say(self, message):
        line = message if isinstance(message, bytes) else encode(message)
        return handle(self.session, line, self.now)[1]

    def pass_on(self, duration):
        self.now += duration
        self.time += duration
        self.seq += 1

    def step(self, follow=True, **changes):
        """Let a period pass and return the reply to the next observation."""
        self.pass_on(PERIOD)
        *_, reply = self.say(self.message(**changes))
        if follow and reply["type"] == "command":
            self.pose = reply["pose"]
        return reply

    def wait(self, duration):
        """Let time pass in silence and return what the server says by itself."""
        said, until = [], self.now + duration
        while (due := max(self.session.due, self.now)) <= until:
            assert due > self.now or not said, "it says everything at once"
            self.now = due
            said += self.session.tick(due)
        self.now = until
        return said


def test_numbers_survive_bit_for_bit():
    rng = np.random.default_rng(0)
    bits = rng.integers(0, 2**63, 2000, dtype=np.uint64) << np.uint64(1)
    values = np.append(bits.view(np.float64), [5e-324, -0.0, math.nan, math.inf])
    back = array(decode(encode({"type": "x", "v": numbers(values)}))["v"])
    known = ~np.isnan(values)
    assert np.array_equal(back[known].view(np.int64), values[known].view(np.int64))
    assert np.isnan(back[~known]).all()


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


def test_a_limit_that_acts_is_told_and_shortens_the_way():
    robot = Robot(linear_speed=0.05, greatest_stiffness=(300.0, 40.0))
    reply = robot.step()
    assert reply["limited"] == ["linear_speed", "stiffness"]
    assert reply["pose"] == [-0.05 * PERIOD, 0, 0, 0, 0, 0]
    assert reply["stiffness"] == [300.0] * 3 + [40.0] * 3
    assert "limited" not in Robot().step()


def test_silence_holds_then_softens_and_only_a_reset_moves_again():
    robot = Robot()
    pose = robot.step()["pose"]
    assert robot.wait(0.049) == []
    said = robot.wait(0.002)
    assert [one["state"] for one in said] == ["holding"]
    assert (said[0]["pose"], said[0]["stiffness"][0]) == (pose, 400.0)
    assert said[0]["unsolicited"]
    held = robot.wait(0.448)
    assert len(held) == 44, "one per period"
    soft = robot.wait(0.9)
    assert {tuple(one["pose"]) for one in soft if "pose" in one} == {tuple(pose)}
    falling = [one["stiffness"] for one in soft if "pose" in one]
    assert np.all(np.diff(falling, axis=0) <= 0)
    assert falling[-1] == [100.0] * 3 + [10.0] * 3
    assert (soft[-1]["type"], soft[-1]["state"]) == ("heartbeat", "stopped")
    robot.time = robot.now
    decisions = robot.agent.decisions
    assert (robot.step()["state"], robot.agent.decisions) == ("stopped", decisions)
    robot.say(robot.message("reset"))
    assert robot.step()["state"] == "active"


def test_an_observation_in_time_ends_holding():
    robot = Robot()
    robot.step()
    robot.wait(0.1)
    robot.time = robot.now
    reply = robot.step()
    assert (reply["state"], reply["pose"][0]) == ("active", -2e-3)


def test_jitter_changes_no_command():
    rng, robot, calm = random.Random(0), Robot(), Robot()
    for _ in range(200):
        calm.step()
        robot.seq, robot.time = robot.seq + 1, robot.time + PERIOD
        robot.now = max(robot.now, robot.time + rng.uniform(0.0, 0.04))
        *_, reply = robot.say(robot.message())
        robot.pose = reply["pose"]
        assert reply["state"] == "active"
    assert robot.pose == calm.pose


def test_a_dropped_message_is_counted_and_the_agent_does_not_hurry():
    robot = Robot()
    robot.step()
    robot.now, robot.time, robot.seq = 0.04, 0.04, 4
    reply = robot.step()
    assert (reply["missed"], reply["state"], reply["pose"][0]) == (3, "active", -2e-3)


def test_late_messages_count_as_none():
    robot = Robot()
    robot.step()
    robot.now += 0.2
    for _ in range(60):
        reply = robot.step()
        assert (reply["type"], reply["code"]) == ("error", "late")
    assert (robot.session.state, robot.agent.decisions) == ("stopped", 1)


def test_observations_faster_than_the_period_do_not_speed_the_agent_up():
    robot = Robot()
    for _ in range(100):
        robot.pass_on(0.001)
        robot.say(robot.message())
    assert robot.agent.decisions <= 12


WRONG = {
    "duplicate": ("duplicate", {"seq": 1, "time": 9.0}),
    "order": ("order", {"seq": 0, "time": 9.0}),
    "clock that goes back": ("order", {"seq": 9, "time": 0.0}),
    "seq": ("field", {"seq": -1}),
    "boolean": ("field", {"seq": True}),
    "short": ("field", {"ee_pose": [0.0] * 5}),
    "text": ("field", {"wrench": ["0"] * 6}),
    "nested": ("field", {"other": [[0.0]]}),
    "empty": ("field", {"other": []}),
    "absent": ("field", {"wrench": None}),
    "far": ("range", {"ee_pose": [11.0] + [0.0] * 5}),
    "huge": ("range", {"wrench": [10**400] + [0.0] * 5}),
    "time": ("range", {"time": 2e10}),
    "type": ("type", {"type": "move"}),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_observation_is_named_and_moves_nothing(name):
    code, changes = WRONG[name]
    robot = Robot()
    pose = robot.step()["pose"]
    (error,) = robot.say(robot.message(**{"seq": 2, "time": 0.02, **changes}))
    assert (error["type"], error["code"]) == ("error", code)
    assert robot.agent.decisions == 1
    assert robot.wait(0.06)[0]["pose"] == pose
    assert robot.session.state == "holding"


@pytest.mark.parametrize(
    "line",
    [
        *(b"\xff", b"", b"[]", b"{}", b'{"type":"observe","time":NaN}', b"[" * 9999),
        *(b'{"type":"stop","type":"bye"}', b'{"type":1e999}', b"1" * 9999),
        '{"type":"stop"}'.encode("utf-16"),
    ],
)
def test_a_malformed_line_is_named_and_moves_nothing(line):
    robot = Robot()
    (error,) = robot.say(line)
    assert (error["type"], error["code"]) == ("error", "malformed")
    assert (robot.agent.decisions, robot.session.state) == (0, "active")


def test_malformed_lines_do_not_put_off_the_watchdog():
    robot = Robot()
    robot.step()
    robot.now += 0.06
    held, error = robot.say(b"x")
    assert (held["state"], error["code"]) == ("holding", "malformed")


def test_a_wrong_version_is_refused():
    session = Session(as_agent(Puller()), SETTINGS, "here")
    (early,) = session.receive({"type": "reset"}, 0.0)
    assert early["code"] == "state"
    (error,) = session.receive({"type": "hello", "protocol": 2}, 0.0)
    assert (error["code"], session.closed) == ("version", True)
    assert "protocol 1" in error["message"]


FAULTS = {
    "measured force beyond its limit": {"force": 250.0},
    "hand outside the workspace": {"pose": [3.0, 0, 0, 0, 0, 0]},
    "the robot does not follow": {"pose": [0.6, 0, 0, 0, 0, 0]},
}


@pytest.mark.parametrize("reason", FAULTS)
def test_a_fault_of_the_robot_holds_then_stops_with_the_reason(reason):
    """One that ends before `stop_after` lets it go on."""
    robot = Robot()
    before = robot.step()["pose"]
    vars(robot).update(FAULTS[reason])
    patience = 20 if "follow" in reason else 0
    for _ in range(patience):
        assert robot.step(follow=False)["state"] == "active"
    held = robot.step(follow=False)
    decisions = robot.agent.decisions
    assert (held["state"], held["reason"]) == ("holding", reason)
    assert held["pose"][0] == -1e-3 * decisions <= before[0]
    robot.pose, robot.force = held["pose"], 0.0
    assert robot.step()["state"] == "active"
    vars(robot).update(FAULTS[reason])
    for _ in range(patience):
        robot.step(follow=False)
    states = [robot.step(follow=False) for _ in range(52)]
    assert {one["state"] for one in states[:49]} == {"holding"}
    assert (states[-1]["state"], states[-1]["reason"]) == ("stopped", reason)
    soft = robot.wait(0.6)
    assert {tuple(one["pose"]) for one in states + soft if "pose" in one} == {
        tuple(states[0]["pose"])
    }
    assert [one for one in soft if "pose" in one][-1]["stiffness"][0] == 100.0


@pytest.mark.parametrize(
    ("act", "reason"),
    [
        (lambda _: 1 / 0, "the agent failed with ZeroDivisionError"),
        (lambda _: [math.nan] * 6, "the agent failed with ValueError"),
        (lambda _: [0, 0, 0, 1e200, 0, 0], "beyond ±7.0 rad"),
    ],
)
def test_an_agent_that_fails_stops(act, reason):
    agent = Puller()
    robot = Robot(agent)
    pose = robot.step()["pose"]
    agent.act = act
    reply = robot.step()
    assert (reply["state"], reply["pose"]) == ("stopped", pose)
    assert reason in reply["reason"]


def test_an_agent_that_begins_far_from_the_hand_does_not_move_it():
    agent = Puller()
    agent.act = lambda _: [0, 0, 0.6, 0, 0, 0]
    reply = Robot(agent).step()
    assert (reply["state"], reply["pose"]) == ("stopped", [0.0] * 6)
    assert reply["reason"] == "the agent begins far from the hand"
    agent.act = lambda _: [0, 0, 0.4, 0, 0, 0]
    assert Robot(agent).step()["pose"] == [0, 0, 0.02, 0, 0, 0]


def test_a_reset_begins_anew():
    agent = Puller()
    robot = Robot(agent)
    assert robot.say(robot.message(seq=1))[0]["state"] == "active", "of the same time"
    robot.seq = 1
    away = [0.6, 0, 0, 0, 0, 0]
    robot.pose = away
    assert [robot.step(False)["state"] for _ in range(15)] == ["active"] * 15
    robot.pose = [0.0] * 6
    robot.say(robot.message("reset"))
    robot.step()
    robot.pose = away
    assert robot.step(False)["state"] == "active", "not away for long"
    robot.pose = [0.0] * 6
    robot.say(robot.message("reset"))
    agent.act = lambda _: away
    assert robot.step()["reason"] == "the agent begins far from the hand"


def test_a_reset_beyond_the_limits_or_one_that_fails_moves_nothing():
    agent = Puller()
    robot = Robot(agent)
    pose = robot.step()["pose"]
    (error,) = robot.say(robot.message("reset", wrench=[0, 0, 201.0, 0, 0, 0]))
    assert (error["code"], "measured force" in error["message"]) == ("limit", True)
    assert robot.step()["pose"][0] == 2 * pose[0], "the task was not begun anew"
    agent.reset = lambda _: 1 / 0
    (error,) = robot.say(robot.message("reset"))
    assert (error["code"], error["seq"]) == ("agent", robot.seq)
    assert (robot.session.state, robot.step()["code"]) == ("idle", "state")


def test_a_delay_since_the_reset_is_seen_and_a_slow_clock_is_not_one():
    robot = Robot()
    robot.now += 0.06
    assert robot.step()["code"] == "late"
    agent = Puller()
    agent.act = lambda _: [0.0] * 6
    robot = Robot(agent)
    for seq in range(1, 6001):
        robot.seq, robot.time = seq, seq * PERIOD
        robot.now = robot.time / (1 - 9e-4)
        (reply,) = robot.say(robot.message())
        assert reply["state"] == "active"


def test_a_stop_softens_once_from_the_stiffness_that_there_is():
    agent = Puller()
    agent.control = "impedance"
    robot = Robot(agent)
    (soft,) = robot.say({"type": "stop"})
    assert soft["stiffness"] == [100.0] * 3 + [10.0] * 3
    assert "unsolicited" not in soft
    assert Robot().say({"type": "stop"})[0]["stiffness"] is None
    robot = Robot()
    robot.step()
    robot.say({"type": "stop"})
    robot.wait(0.3)
    assert robot.say({"type": "stop"})[-1]["reason"] == "the client said stop"
    robot.wait(0.2)
    assert robot.say({"type": "stop"})[-1]["stiffness"][0] == 100.0


def test_a_command_has_the_damping_and_the_explanation_that_are_asked_for():
    agent = as_agent(Puller())
    mass = np.repeat([4.0, 0.15], 3)
    agent.config = SimpleNamespace(dynamics=VirtualDynamics(mass=mass))
    session = Session(agent, SETTINGS, "here")
    still = {"ee_pose": [0.0] * 6, "wrench": [0.0] * 6}
    for explain in (False, True):
        session.receive({"type": "hello", "protocol": 1, "explain": explain}, 0.0)
        session.receive({"type": "reset", "seq": 0, "time": 0.0, **still}, 0.0)
        seen = {"type": "observe", "seq": 1, "time": PERIOD, **still}
        (reply,) = session.receive(seen, PERIOD)
        damping = 2 * np.sqrt(mass * reply["stiffness"])
        np.testing.assert_allclose(reply["damping"], damping)
        assert ("step" in reply) == explain


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


def test_a_clock_in_the_wrong_unit_stops_the_robot():
    """In milliseconds a thousand observations a second would be one per period."""
    robot = Robot()
    robot.now, robot.time, robot.seq = 1e-3, 1.0, 1
    (reply,) = robot.say(robot.message())
    assert (reply["state"], robot.agent.decisions) == ("stopped", 0)


def test_holding_begins_at_the_time_that_was_told():
    for start in np.random.default_rng(0).uniform(0.0, 1e6, 50):
        session = Session(as_agent(Puller()), SETTINGS, "here")
        session.receive({"type": "hello", "protocol": 1}, start)
        still = {"seq": 0, "time": 0, "ee_pose": [0.0] * 6, "wrench": [0.0] * 6}
        session.receive({"type": "reset", **still}, start)
        (said,) = session.tick(session.due)
        assert said["state"] == "holding"


def test_a_thousand_fuzzed_messages_neither_crash_nor_move():
    rng, robot = random.Random(0), Robot()
    robot.step()
    values = [None, True, -1, 0, 2**60, 1e308, "x", [], {}, [None] * 6, [1e9] * 6]
    for _ in range(1000):
        message = robot.message(seq=robot.seq + 1, time=robot.time + PERIOD)
        name = rng.choice(list(message))
        if rng.random() < 0.5:
            message[name] = rng.choice(values)
        else:
            del message[name]
        line = bytearray(encode(message))
        if rng.random() < 0.5:
            for _ in range(rng.randint(1, 5)):
                line[rng.randrange(len(line))] = rng.randrange(256)
        robot.now += rng.uniform(0.0, 0.02)
        before, count = robot.session._pose.tolist(), robot.agent.decisions
        replies = robot.say(bytes(line))
        if robot.agent.decisions == count:
            held = [one["pose"] for one in replies if one["type"] == "command"]
            assert all(pose == before for pose in held)
        else:
            robot.seq, robot.time = robot.session._seq, robot.session._time
        if rng.random() < 0.2:
            robot.say({"type": "hello", "protocol": 1})
            robot.say(robot.message("reset", seq=0, time=robot.now))
            robot.seq, robot.time = 0, robot.now
            robot.pose = robot.session._pose.tolist()


@pytest.fixture
def served(tmp_path):
    """Return a server on a Unix socket whose clock stands still, and its journal."""
    settings = replace(SETTINGS, socket=tmp_path / "s", journal=tmp_path / "j.jsonl")
    listener, address = _listening(settings)
    session = Session(as_agent(Puller()), settings, address)
    journal = Journal(settings.journal, {})
    with listener:
        server = Server(session, journal, listener, clock=lambda: 0.0)
        yield server, session, settings
        server._leave("the test ends")
    journal.close()


def connected(settings):
    client = socket.socket(socket.AF_UNIX)
    client.connect(str(settings.socket))
    return client


def test_a_killed_client_ends_its_session_and_makes_room(served):
    server, session, settings = served
    assert stat.S_IMODE(settings.socket.stat().st_mode) == 0o600
    robot = Robot()
    first = connected(settings)
    assert server.step()
    second = connected(settings)
    hello = encode({"type": "hello", "protocol": 1})
    first.sendall(hello + encode(robot.message("reset")) + b'{"type":"ob')
    assert server.step()
    with second:
        assert json.loads(second.recv(999))["code"] == "busy"
    assert session.state == "active"
    first.close()
    while session.state != "idle":
        assert server.step()
    with connected(settings) as third:
        server.step()
        third.sendall(hello + encode(robot.message(seq=1)))
        server.step()
        assert b'"code":"state"' in third.recv(9999)
    last = [line.get("in") for line in read_journal(settings.journal)]
    assert "the client has gone; the session was active" in last


def test_a_client_that_is_silent_for_long_makes_room(tmp_path):
    now = [0.0]
    settings = replace(SETTINGS, socket=tmp_path / "s")
    listener, address = _listening(settings)
    session = Session(as_agent(Puller()), settings, address)
    with listener, connected(settings) as client:
        server = Server(session, Journal(None, {}), listener, clock=lambda: now[0])
        server.step()
        client.sendall(encode({"type": "hello", "protocol": 1}))
        server.step()
        for now[0], greeted in ((29.9, True), (30.1, False)):
            server.step()
            assert session.greeted == greeted


def test_whatever_a_client_says_can_be_written_down(served):
    server, session, settings = served
    with connected(settings) as client:
        server.step()
        client.sendall(b'{"type":"hello","protocol":1,"x":1e999}\n')
        assert server.step()
    assert session.greeted
    assert read_journal(settings.journal)[2]["in"]["x"] == math.inf


def test_a_second_client_need_not_wait_for_a_first_that_is_silent(served):
    server, _, settings = served
    with connected(settings):
        server.step()
        with connected(settings) as second:
            second.settimeout(0.0)
            began = time.monotonic()
            server.step()
            assert json.loads(second.recv(999))["code"] == "busy"
    assert time.monotonic() - began < 5.0


def test_a_full_disk_ends_the_journal_and_not_the_motion(tmp_path, monkeypatch, capfd):
    def full(*_):
        raise OSError(28, "No space left on device")

    journal = Journal(tmp_path / "journal", {})
    monkeypatch.setattr("gplfd_policies.serving.journal.os.write", full)
    journal.write(0.1, "one", [], 0.0)
    monkeypatch.undo()
    journal.write(0.2, "two", [], 0.0)
    assert "the journal ends here: [Errno 28]" in capfd.readouterr().err
    assert len(read_journal(tmp_path / "journal")) == 1


def test_what_a_policy_prints_while_it_learns_is_no_message(monkeypatch, capfd):
    def learned(*_):
        os.write(1, b"learning")
        raise ValueError("enough")

    monkeypatch.setattr("gplfd_policies.serving.server.served_agent", learned)
    with pytest.raises(ValueError, match="enough"):
        serve(SETTINGS)
    assert capfd.readouterr() == ("", "learning")


def test_another_server_s_socket_is_left_and_a_dead_one_s_replaced(served):
    _, _, settings = served
    with pytest.raises(ValueError, match="another server listens on"):
        _listening(settings)
    dead = replace(settings, socket=settings.socket.with_name("dead"))
    _listening(dead)[0].close()
    _listening(dead)[0].close()


def test_a_killed_server_is_an_error_of_the_client(tmp_path):
    hello = {"type": "hello", "control": "pose"}
    gone = "print(input() and {!r}, flush=True)"
    command = [sys.executable, "-S", "-c", gone.format(json.dumps(hello))]
    agent = RemoteAgent(command)
    with pytest.raises(ServerLostError, match="closed the connection; hold"):
        agent.reset({"time": np.zeros(1), "ee_pose": np.zeros(6)})
    agent.close()
    with pytest.raises(ServerLostError, match="nobody serves on unix:"):
        RemoteAgent(f"unix:{tmp_path / 'nothing'}")
    error = {"type": "error", "code": "busy", "message": "another"}
    refused = [sys.executable, "-S", "-c", gone.format(json.dumps(error))]
    with pytest.raises(RefusedError, match="busy: another"):
        RemoteAgent(refused)
    deaf = [sys.executable, "-S", "-c", "import time; time.sleep(60)"]
    with pytest.raises(ServerLostError, match="is silent"):
        RemoteAgent(deaf, timeout=0.1)


def test_a_client_takes_no_other_command_for_its_reply():
    said = [{"type": "hello", "control": "pose"}, {"type": "ready", "seq": 1}]
    for x, seq, more in ((1.0, 2, {"unsolicited": True}), (2.0, 1, {}), (3.0, 2, {})):
        said.append({"type": "command", "seq": seq, "pose": [x] + [0.0] * 5, **more})
    lines = "\n".join(map(json.dumps, said))
    says = [sys.executable, "-S", "-c", f"print({lines!r}, flush=True); input()"]
    agent = RemoteAgent(says)
    seen = {"time": np.zeros(1), "ee_pose": np.zeros(6), "wrench": np.zeros(6)}
    agent.reset(seen)
    assert agent.act(seen).action[0] == 3.0
    agent.close()


def test_garbage_is_collected_after_every_hundredth_reply(served, monkeypatch):
    server, _, settings = served
    collected = []
    monkeypatch.setattr(
        "gplfd_policies.serving.server.gc.collect", lambda: collected.append(1)
    )
    with connected(settings) as client:
        server.step()
        client.sendall(encode({"type": "hello", "protocol": 1}))
        for _ in range(98):
            client.sendall(encode({"type": "heartbeat"}))
        server.step()
        assert collected == []
        client.sendall(encode({"type": "heartbeat"}))
        server.step()
    assert collected == [1]


def test_a_link_keeps_parts_of_lines_and_refuses_endless_ones():
    near, far = socket.socketpair()
    with near, far:
        link = Link(near.fileno(), near.fileno())
        far.sendall(b"a\nb")
        assert link.lines() == [b"a"]
        far.sendall(b"c\n")
        assert link.lines() == [b"bc"]
        for _ in range(40):
            link.send(bytes(2**16))
        assert link.closed, "a peer that does not read"
        link.closed = False
        for _ in range(3):
            far.sendall(b"x" * 40000)
            link.lines()
        assert link.closed, "a line without end"


def test_a_journal_loses_no_more_than_its_last_line(tmp_path):
    file = tmp_path / "journal"
    for _ in range(2):
        journal = Journal(file, {"settings": {}})
        journal.write(0.1, b'{"type":"observe"}', [{"type": "command"}], 1e-3)
        journal.close()
        with open(file, "ab") as cut:
            cut.write(b'{"at":0.2,"in"')
    lines = read_journal(file)
    assert [one.get("at") for one in lines] == [None, 0.1, None, 0.1]
    content = file.read_bytes()
    file.write_bytes(content.replace(b'"took"', b"took", 1))
    with pytest.raises(ValueError, match="line 2 is damaged"):
        read_journal(file)
    (tmp_path / "other").write_text("{}\n")
    with pytest.raises(ValueError, match="is not a journal"):
        read_journal(tmp_path / "other")


def test_the_loop_keeps_no_memory():
    robot = Robot()
    tracemalloc.start()
    for count in (300, 400):  # the first fill Python's own free lists
        before = tracemalloc.get_traced_memory()[0]
        for _ in range(count):
            robot.step()
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert grown < 4000, "ten bytes a step"


BAD = {
    "x.npz": "x.npz",
    "gp": "give --demonstrations FILE.npz",
    "gpp": "did you mean 'gp'",
    "reflex --host 0.0.0.0 --port 0": "add --beyond-loopback",
    "reflex --host robot --port 0": "give --host 127.0.0.1",
    "reflex --port 70000": "from 0 to 65535",
    "reflex --port 1 --socket s": "not both",
    "reflex --force nan": "--force nan must be finite and greater than 0.0",
    "reflex --stop-after 0.03": "must not be less than --hold-after",
    "reflex --workspace 0 0 0 1 1 0": "each least below its greatest",
    "reflex --workspace 0 0 0 1 1 inf": "all finite",
    "reflex --least-stiffness 9 900": "not above --greatest-stiffness",
    "reflex --start approach": "cannot reach by itself",
    "reflex --socket no/folder": "No such file",
    f"reflex --socket {'a' * 200}": "too long",
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


def test_localhost_is_this_machine_whatever_its_name_is_resolved_to():
    listener, address = _listening(replace(SETTINGS, host="localhost", port=0))
    with listener:
        assert address == f"tcp:127.0.0.1:{listener.getsockname()[1]}"


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("oracle", "'oracle' needs the true door"),
        ("gp", "'gp' learns: give --demonstrations"),
        ("no.npz", "no.npz"),
    ],
)
def test_what_cannot_be_served_is_refused(source, message):
    with pytest.raises((ValueError, OSError), match=message):
        served_agent(ServeSettings(source=source))
