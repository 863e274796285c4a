"""Whatever one policy does, it has an error, and the others have their results."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gplfd_experiments.studies.engines import Engine
from gplfd_experiments.studies.runner import run_study
from gplfd_experiments.studies.settings import StudySettings
from gplfd_experiments.studies.tasks import checked, tasks

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("short_episodes")]

# Its import changes the process, too; a control step may take a second there.
SPOILING = """\
import os, signal, sys, threading, time, warnings
import numpy as np
from gplfd_experiments.studies import jobs

np.seterr(all="raise")
warnings.simplefilter("error")
os.chdir("/")
sys.path.insert(0, "/nowhere")
signal.signal(signal.SIGTERM, signal.SIG_IGN)
jobs.STEP_LIMIT = 1.0

def policy(act):
    return lambda training: type("Agent", (), {"act": lambda self, seen: act()})()

def throw(error):
    raise error

def state():
    np.linalg.norm = np.isfinite = None

def fork():
    threading.Thread(target=time.sleep, args=[99]).start()
    os.fork()
    return np.full(6, np.nan)

def failing(training):
    faults = lambda: throw(KeyboardInterrupt()), lambda: time.sleep(999), fork, state
    return policy(faults[training.seed])(training)

leaving = policy(lambda: os._exit(3))
killed = policy(lambda: os.kill(os.getpid(), signal.SIGKILL))
"""
ERRORS = {
    "failing": [
        "KeyboardInterrupt:  (spoiling.py, line 16, in throw)",
        "TimeoutError: the policy did not return (limits: 900 s to learn",
        "ValueError: Agent.act returned array([nan, nan,",
        "ValueError: Agent.act returned None at step 1",
    ],
    "leaving": ["its process ended: exit status 3, in the policy's code"],
    "killed": ["its process ended: signal 9, in the policy's code"],
}
"""By policy, and seed."""


def outcomes(folder: Path, seeds: dict[str, int]) -> dict[tuple[str, int], Any]:
    """Return error, or metrics without times, by policy and seed, of a study."""
    study: list[Any] = []
    for policy, number in seeds.items():
        options: Any = {"policies": (policy,), "seeds": number, "skill": False}
        study += tasks(checked(StudySettings(doors=("small",), **options)))
    list(run_study(folder, study, Engine(engine="serial")))
    ends = {}
    for path in folder.glob("tasks/*.json"):
        result = json.loads(path.read_text())
        end = result.get("error") or {
            name: value
            for name, value in result["metrics"].items()
            if "latency" not in name
        }
        assert result.get("lost", False) == (end == ERRORS["killed"][0])
        ends[result["task"]["policy"], result["task"]["seed"]] = end
    return ends


def test_no_policy_spoils_another_s_result(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("spoiling.py").write_text(SPOILING)
    alone = outcomes(Path("alone"), {"hinge-fit": 1})
    own = {f"spoiling.py:{name}": errors for name, errors in ERRORS.items()}
    seeds = {name: len(errors) for name, errors in own.items()}
    together = outcomes(Path("together"), seeds | {"hinge-fit": 1})
    assert together.pop(("hinge-fit", 0)) == alone["hinge-fit", 0]
    for name, errors in own.items():
        for seed, error in enumerate(errors):
            assert together.pop((name, seed)).startswith(error), (name, seed)
    assert together == {}
    assert (Path.cwd(), np.geterr()["under"]) == (tmp_path, "ignore")
