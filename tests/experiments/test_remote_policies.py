"""Policies behind a WebSocket: the same episodes, and misbehaviours of servers."""

import contextlib
import itertools
import json
import pickle
import re
import subprocess
import sys
import threading
import time

import msgpack
import numpy as np
import pytest
from websockets.sync.client import connect
from websockets.sync.server import serve

from gplfd_env.spatial.se3 import compose_rotvecs
from gplfd_experiments.cli.main import main
from gplfd_experiments.episodes.build import open_together
from gplfd_experiments.episodes.log import PARTS, arrays_of
from gplfd_experiments.episodes.task import episode_task, named_doors
from gplfd_experiments.studies.jobs import run_job
from gplfd_experiments.studies.runner import run_study
from gplfd_experiments.studies.store import stored_results
from gplfd_policies import AgentStep, make_agent
from gplfd_policies.agents import remote
from gplfd_policies.agents.remote import ChunkAgent
from gplfd_policies.arrays.messages import LARGEST, pack, unpack
from gplfd_policies.control.rendering import Admittance
from gplfd_policies.control.stiffness import DEFAULT_DYNAMICS

pytestmark = pytest.mark.slow

MESSAGE = {
    "actions": np.array([[0.5, -2.0]]),
    "state": {"image": np.array([[7]], np.uint8)},
    "dt": np.float32(0.25),
    "prompt": "open",
}
GOLDEN = (
    b"\x84\xa7actions\x84\xc4\x0b__ndarray__\xc3\xc4\x04data\xc4\x10\x00\x00\x00\x00"
    b"\x00\x00\xe0?\x00\x00\x00\x00\x00\x00\x00\xc0\xc4\x05dtype\xa3<f8\xc4\x05shape"
    b"\x92\x01\x02\xa5state\x81\xa5image\x84\xc4\x0b__ndarray__\xc3\xc4\x04data\xc4\x01"
    b"\x07\xc4\x05dtype\xa3|u1\xc4\x05shape\x92\x01\x01\xa2dt\x83\xc4\r__npgeneric__"
    b"\xc3\xc4\x04data\xcb?\xd0\x00\x00\x00\x00\x00\x00\xc4\x05dtype\xa3<f4\xa6prompt"
    b"\xa4open"
)
"""That message as openpi-client 0.1.2 packs it, which cannot be installed here."""


def test_the_bytes_are_those_of_openpi_client():
    assert pack(MESSAGE) == GOLDEN
    assert repr(unpack(GOLDEN)) == repr(MESSAGE)


@pytest.fixture
def served():
    """Serve a handler of connections after the metadata; return the address."""
    with contextlib.ExitStack() as stack:

        def start(handle, metadata=b"\x80"):
            def handler(connection):
                if metadata is not None:
                    connection.send(metadata)
                handle(connection)

            options = {"compression": None, "ping_interval": None, "max_size": None}
            server = serve(handler, "127.0.0.1", 0, close_timeout=0.1, **options)
            thread = threading.Thread(target=server.serve_forever)
            thread.start()
            stack.callback(thread.join)
            stack.callback(server.shutdown)
            return f"ws://127.0.0.1:{server.socket.getsockname()[1]}"

        yield start


def tasks(policy, metadata="{}", doors=("small",), seed=0):
    server = {"kind": "server", "metadata": metadata}
    source = server if policy.startswith("ws:") else None
    return [
        episode_task(name, config, policy=policy, policy_source=source, seed=seed)
        for name, config in named_doors(doors).items()
    ]


def comparable(result):
    """What does not depend on the machine's speed, or on what an agent explains."""
    left_out = ("policy", "latency_", "forecast_")
    metrics = result["metrics"].items()
    return {name: value for name, value in metrics if not name.startswith(left_out)}


@pytest.mark.bits
def test_a_study_behind_a_socket_is_that_of_one_process(served, tmp_path, capsys):
    connections = itertools.count()

    def handle(connection):
        next(connections)
        agent = make_agent("hinge-fit", ())
        for number, data in enumerate(connection):
            observation = unpack(data)
            assert observation.pop("prompt") == "open the door"
            if number == 0:
                agent.reset(observation)
            connection.send(pack({"actions": agent.act(observation).action[None]}))

    address = served(handle, pack({"policy": "circle", "layers": np.arange(2)}))
    doors, metadata = ("small", "0.6"), '{"layers": [0, 1], "policy": "circle"}'
    here = list(map(comparable, run_job(tuple(tasks("hinge-fit", doors=doors)))))
    study = tasks(address, metadata, doors)
    list(run_study(tmp_path / "study", study))
    there = stored_results(tmp_path / "study", study).finished
    for alone, result in zip(here, map(comparable, there), strict=True):
        # A server explains nothing: there is no stiffness.
        measured = {name for name, value in result.items() if value is not None}
        assert {"success", "final_angle_deg", "force_radial_peak"} <= measured
        assert {n: result[n] for n in measured} == {n: alone[n] for n in measured}
    assert next(connections) == 2  # one for each episode
    words = ["run", "--doors", "small", "--policy", address, "--out", str(tmp_path)]
    assert main([*words, "--json", "--quiet"]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert (row["policy"], row["duration"]) == (address, here[0]["duration"])
    stored = json.loads((tmp_path / "run.json").read_text())["config"]
    assert stored["policy_source"] == {"kind": "server", "metadata": metadata}


HORIZON = 7


def chunk(observation, size):
    """Pull on from the observed pose, by up to 1.2 cm; with a stiffness that varies."""
    ahead = np.linspace(0.006, 0.012, HORIZON)
    actions = np.tile(observation["ee_pose"], (HORIZON, 1))
    actions[:, 0] -= ahead
    stiffness = np.outer(1.0 + ahead, np.repeat([400.0, 40.0], 3))
    return np.hstack([actions, stiffness])[:, :size]


class Here:
    """Executes the same chunks in this process."""

    def __init__(self, form):
        self.control = "impedance" if form == "impedance" else "pose"
        self.size, self.chunk = 6 if form == "pose" else 12, []
        self.form, self.admittance = form, Admittance(DEFAULT_DYNAMICS)

    def act(self, observation):
        self.chunk = self.chunk or list(chunk(observation, self.size))
        action = self.chunk.pop(0)
        if self.form == "pose":
            return action
        pose = action[:6].copy()
        if self.form == "admittance":
            offset = self.admittance.step(action[6:], observation["wrench"], 0.01)
            pose += offset
            pose[3:] = compose_rotvecs(offset[3:], action[3:6])
        return AgentStep(action=pose, desired=action[:6], stiffness=action[6:])


@pytest.mark.bits
@pytest.mark.usefixtures("short_episodes")
@pytest.mark.parametrize("form", remote.FORMS)
def test_chunks_are_executed_open_loop_in_every_form(form, served):
    asked = []

    def handle(connection):
        for data in connection:
            asked.append(unpack(data))
            actions = chunk(asked[-1], 6 if form == "pose" else 12)
            connection.send(pack({"actions": actions}))

    metadata = {"control": form}
    address = served(handle, pack(metadata))
    agents = [Here(form), ChunkAgent(address, json.dumps(metadata))]
    logs = [next(open_together(tasks("gp"), [agent])) for agent in agents]
    assert len(asked) == -(-len(logs[0].times) // HORIZON)
    for part in ("motion", "opening", "forces", "decisions"):
        for name in arrays_of(PARTS[part]).keys() - {"latency_s", "latency_wall_s"}:
            here, there = (getattr(getattr(log, part), name) for log in logs)
            assert here.tobytes() == there.tobytes(), name


STILL = pack({"actions": np.zeros((150, 6)), "server_timing": {"infer_ms": 1.0}})
CLOSE, VANISH = "close", "vanish"


def raw(dtype="<f8", shape=(1, 6), data=bytes(48)):
    array = {b"__ndarray__": True, b"data": data, b"dtype": dtype, b"shape": shape}
    return msgpack.packb({"actions": array})


def actions(array):
    return pack({"actions": np.asarray(array)})


def endless_fragments():
    while True:
        time.sleep(0.01)
        yield b"0"


LATE = "no answer within 0.5 s, at step 1$"
SHAPE = r"not \(H, 6\), with H from 1 to 10000, at step 1$"
CASES = {
    "extra keys": ([STILL], None),
    "silence": ([], LATE),
    "slow answers": ([0.9, STILL], LATE),
    "endless fragments": ([endless_fragments()], LATE),
    "closing after metadata": ([CLOSE], "closed .*1000.*, at step 1$"),
    "death in mid-episode": ([actions(np.zeros((9, 6))), VANISH], "closed .* step 10$"),
    "huge frames": ([bytes(LARGEST + 1)], "closed .*too big.*, at step 1$"),
    "text": (["Traceback: no memory"], "it sent a text: Traceback: no memory, at"),
    "not MessagePack": ([b"\xc1"], "not MessagePack with arrays"),
    "nested deeply": ([b"\x91" * 100_000], "not MessagePack with arrays"),
    "no actions": ([b"\x80"], "no array of numbers 'actions'"),
    "wrong shape": ([actions(np.zeros((4, 7)))], SHAPE),
    "one axis": ([actions(np.zeros(6))], SHAPE),
    "empty chunk": ([actions(np.zeros((0, 6)))], SHAPE),
    "horizon of 10^6": ([actions(np.zeros((10**6, 6), np.float16))], SHAPE),
    "NaN": ([actions([[0.0] * 5 + [np.nan]])], "its actions are not finite"),
    "infinities": ([actions([[np.inf] + [0.0] * 5])], "its actions are not finite"),
    "complex numbers": ([raw("<c16", (1, 3))], "an array of '<c16' is not accepted"),
    "objects": ([raw("|O", (1, 6), pickle.dumps([None]))], "'|O' is not accepted"),
    "negative shape": ([raw(shape=(-1, 6))], "not the shape of an array"),
    "wrong sizes": ([raw(shape=(10**12, 6))], "48 bytes are not an array"),
    "duplicate answers": ([actions(np.zeros((9, 6)))] * 2, "nobody had asked for, at"),
    # Instead of metadata, as the last message.
    "no metadata": (None, "no metadata within 0.5 s$"),
    "other metadata": (pack({"step": 2}), "its metadata have changed meanwhile$"),
    "metadata without end": (pack({"a": np.zeros(9999)}), "more than 8192 characters$"),
}


def misbehaving(replies):
    """Return a handler that gives these replies to an observation each."""

    def handle(connection):
        for _ in connection:
            for reply in replies:
                if reply is VANISH:
                    return connection.socket.shutdown(2)
                if reply is CLOSE:
                    return None
                if isinstance(reply, float):
                    time.sleep(reply)
                else:
                    connection.send(reply)
        return None

    return handle


@pytest.mark.usefixtures("short_episodes")
@pytest.mark.parametrize("name", CASES)
def test_a_server_that_misbehaves_fails_its_episode(name, served, monkeypatch):
    """And nothing else: the result is an error of the policy, with the reason."""
    replies, outcome = CASES[name]
    if outcome and "0.5 s" in outcome:
        monkeypatch.setattr(remote, "GREETING_LIMIT", 0.5)
        monkeypatch.setattr(remote, "ANSWER_LIMIT", 0.5)
    metadata = b"\x80" if isinstance(replies, list) else replies
    address = served(misbehaving(replies), metadata)
    (result,) = run_job(tuple(tasks(address)))
    if outcome is None:
        assert result["metrics"]["failure"] == "time_limit"
        return
    assert re.search(f"^ServerError: {address}: .*{outcome}", result["error"])
    assert "lost" not in result


@pytest.mark.usefixtures("short_episodes")
def test_a_lost_server_is_no_failure_of_the_study(served, tmp_path, capsys):
    """In lockstep, a lost connection fails no other episode, nor its own next try."""
    connections = itertools.count()

    def handle(connection):
        if next(connections) != 1:
            misbehaving([STILL])(connection)

    healed = run_job(tuple(tasks(served(handle), doors=("small", "0.6"))))
    assert [result["metrics"]["failure"] for result in healed] == ["time_limit"] * 2
    assert next(connections) == 4

    gone = tasks("ws://127.0.0.1:9")
    list(run_study(tmp_path, [*gone, *tasks("reflex")]))
    stored = stored_results(tmp_path, [*gone, *tasks("reflex")])
    assert [result["task"]["policy"] for result in stored.finished] == ["reflex"]
    assert "ws://127.0.0.1:9: no server answers" in stored.failed[0]["error"]
    words = ["run", "--doors", "small", "--policy", served(misbehaving([CLOSE]))]
    assert main([*words, "--out", str(tmp_path / "run")]) == 1
    assert "closed" in (tmp_path / "run" / "metrics.json").read_text()


BAD_INPUT = {
    "ws://127.0.0.1:9": "no server answers",
    "ws://": "it must be ws://HOST:PORT",
    "ws://me:secret@127.0.0.1:9": "without a password",
    "ws://127.0.0.1:port": "could not be cast to integer",
}


def test_an_address_where_nobody_answers_is_bad_input(served, capsys):
    torque = served(misbehaving([]), pack({"control": "torque"}))
    for address, message in {**BAD_INPUT, torque: "have control 'torque', not"}.items():
        assert main(["benchmark", "--policies", address, "--doors", "small"]) == 2
        assert message in capsys.readouterr().err


@pytest.mark.bits
@pytest.mark.usefixtures("short_episodes")
def test_a_served_agent_answers_in_this_protocol_and_stays_safe():
    serve = [sys.executable, "-m", "gplfd_policies.serving", "reflex", "--port", "0"]
    serve += ["--protocol", "openpi", "--hold-after", "600", "--stop-after", "600"]
    with subprocess.Popen(serve, stderr=subprocess.PIPE, text=True) as process:
        try:
            address = process.stderr.readline().split()[-1]
            metadata = remote.stated_metadata(address)
            assert json.loads(metadata)["limits"]["force"] == 200.0
            agents = [make_agent("reflex", ()), ChunkAgent(address, metadata)]
            # At once, as in lockstep: each connection has an agent and limits.
            logs = list(open_together(tasks("reflex") * 2, agents))
            for name in ("ee_pose", "qpos"):
                here, there = (getattr(log.motion, name) for log in logs)
                assert here.tobytes() == there.tobytes()
            with connect(address) as client:
                client.recv()
                values = {"ee_pose": np.zeros(6), "wrench": np.zeros(6), "time": 0.0}
                hard, nowhere = np.full(6, 1e3), np.full(6, np.nan)
                for wrong, message in {
                    "text": "no observation",
                    pack({**values, "ee_pose": nowhere}): "must be 6 numbers",
                    pack({**values, "wrench": hard}): "force beyond its limit",
                    pack({"time": 0.0}): "ee_pose is missing",
                }.items():
                    client.send(wrong)
                    assert message in client.recv()
                client.send(pack({**values, "image": np.zeros((9, 9)), "prompt": "go"}))
                assert unpack(client.recv())["actions"].shape == (1, 6)
                client.send(pack({**values, "time": 0.01, "wrench": hard}))
                assert client.recv() == "holding: measured force beyond its limit"
        finally:
            process.kill()
