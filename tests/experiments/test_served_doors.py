"""Doors opened through a socket by a process that has no MuJoCo, and its journal."""

import subprocess
import sys
import time

import jaxtyping
import numpy as np
import pytest

from gplfd_experiments.cli import main as cli
from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.episodes.build import make_environment
from gplfd_experiments.episodes.log import PARTS, arrays_of
from gplfd_experiments.episodes.rollout import rollout
from gplfd_experiments.episodes.task import episode_task, named_doors
from gplfd_experiments.recording import viewer
from gplfd_policies import TrainingInput
from gplfd_policies.registry.catalogue import method_and_skill, skill_method
from gplfd_policies.serving.client import RefusedError, RemoteAgent, ServerLostError
from gplfd_policies.serving.protocol import encode, read_journal

pytestmark = pytest.mark.slow

SERVE = """
import sys
for name in ("mujoco", "rerun"):
    sys.modules[name] = None
from gplfd_experiments.cli.main import main
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.bits
def test_a_door_opened_through_a_socket_is_that_of_one_process(tmp_path, monkeypatch):
    """All that is logged of it; then the server is killed, and its journal is there."""
    # Type checks at run time take nine tenths of a step.
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    skill, socket, journal = (tmp_path / name for name in ("s.npz", "s", "j.jsonl"))
    shown = Teacher().standard_demonstrations(seed=0)
    skill_method("gp").learn(TrainingInput(demonstrations=shown)).save(skill)
    words = [sys.executable, "-c", SERVE, "serve", skill, "--socket", socket]
    words += ["--journal", journal, "--hold-after", "600", "--stop-after", "600"]
    ((name, config),) = named_doors(["small"]).items()
    task = episode_task(name, config, policy="gp", seed=0)
    with subprocess.Popen(words, stderr=subprocess.PIPE, text=True) as server:
        try:
            assert "on this machine: unix:" in server.stderr.readline()
            remote = RemoteAgent(f"unix:{socket}", explain=True)
            method, learned = method_and_skill("gp", skill)
            names, logs = {"policy": "gp", "door": name, "seed": task.reset_seed}, []
            for agent in (method.follow(learned), remote):
                with make_environment(task, agent.control) as env:
                    logs.append(rollout(env, agent, **names))
            observation = {"time": np.zeros(1), "ee_pose": np.zeros(6)}
            with pytest.raises(RefusedError, match="field: wrench is missing"):
                remote.act(observation)
            # A line of the journal is written after the reply.
            patience = time.monotonic() + 30.0
            while '"field"' not in journal.read_text() and time.monotonic() < patience:
                time.sleep(0.01)
        finally:
            server.kill()
    with pytest.raises(ServerLostError, match="hold the robot"):
        remote.act(observation)
    remote.close()
    assert logs[0].success
    for part in ("motion", "opening", "forces", "decisions"):
        for field in arrays_of(PARTS[part]).keys() - {"latency_s", "latency_wall_s"}:
            here, there = (getattr(getattr(log, part), field) for log in logs)
            assert here.tobytes() == there.tobytes(), field
    *lines, refused = read_journal(journal)
    assert refused["out"][-1]["code"] == "field"
    said = [one for line in lines for one in line.get("out", ())]
    commands = [one for one in said if one["type"] == "command"]
    assert np.array_equal([one["pose"] for one in commands], logs[0].decisions.action)
    assert not any("limited" in one for one in commands)


def test_a_journal_is_shown_as_a_recording(tmp_path, monkeypatch):
    journal = tmp_path / "j.jsonl"
    serve = [sys.executable, "-m", "gplfd_policies.serving", "reflex"]
    agent = RemoteAgent([*serve, "--journal", str(journal)], timeout=60.0)
    still = {"time": np.zeros(1), "ee_pose": np.zeros(6), "wrench": np.zeros(6)}
    agent.reset(still)
    # Fields of one's own may have any names.
    agent._link.send(encode({"type": "hello", "protocol": 1, "pose": 3}))
    for period in range(3):
        agent.act({**still, "time": np.array([0.01 * period]), "pose": np.ones(1)})
    time.sleep(0.07)
    agent.close()
    said = [one for line in read_journal(journal) for one in line.get("out", [])]
    assert "holding" in {one.get("state") for one in said}
    assert said[-1]["type"] == "bye"
    shown = []
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(viewer.subprocess, "call", lambda c: shown.append(c) or 0)
    assert cli.main(["view", str(journal)]) == 0
    assert shown[0][1:] == ["--bind", "127.0.0.1", f"{journal}.rrd"]
    assert (tmp_path / "j.jsonl.rrd").stat().st_size > 5000


def test_both_command_lines_have_the_same_options(monkeypatch):
    from gplfd_policies.serving import __main__, server

    served = []
    monkeypatch.setattr(server, "serve", lambda settings, *_: served.append(settings))
    words = ["reflex", "--port", "0", "--workspace", *map(str, range(6)), "--seed", "3"]
    assert __main__.main(words) == cli.main(["serve", *words]) == 0
    assert served[0].described() == served[1].described()
