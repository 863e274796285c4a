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

pytestmark = pytest.mark.slow

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

interrupting = policy(lambda: throw(KeyboardInterrupt()))
state = policy(state)
forking = policy(fork)
leaving = policy(lambda: os._exit(3))
killed = policy(lambda: os.kill(os.getpid(), signal.SIGKILL))
hanging = policy(lambda: time.sleep(999))
"""
ERRORS = {
    "interrupting": "KeyboardInterrupt:  (spoiling.py, line 16, in throw)",
    "state": "ValueError: Agent.act returned None at step 1",
    "forking": "ValueError: Agent.act returned array([nan, nan,",
    "leaving": "its process ended: exit status 3, in the policy's code",
    "killed": "its process ended: signal 9, in the policy's code",
    "hanging": "TimeoutError: the policy did not return (limits: 900 s to learn",
}


def outcomes(folder: Path, policies: Any, **settings: Any) -> dict[str, Any]:
    """Return error, or metrics without times, by policy, of the files of a study."""
    settings |= {"policies": tuple(policies), "skill": False, "seeds": 1}
    study = tasks(checked(StudySettings(doors=("small",), **settings)))
    list(run_study(folder, study, Engine(engine="serial")))
    ends = {}
    for path in folder.glob("tasks/*.json"):
        result = json.loads(path.read_text())
        end = result.get("error") or {
            name: value
            for name, value in result["metrics"].items()
            if "latency" not in name
        }
        assert result.get("lost", False) == (end == ERRORS["killed"])
        ends[result["task"]["policy"]] = end
    return ends


def test_no_policy_spoils_another_s_result(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("spoiling.py").write_text(SPOILING)
    alone = outcomes(Path("alone"), ["hinge-fit"])
    own = {f"spoiling.py:{name}": error for name, error in ERRORS.items()}
    together = outcomes(Path("together"), [*own, "hinge-fit"])
    assert together.pop("hinge-fit") == alone["hinge-fit"]
    assert together.keys() == own.keys()
    for name, error in own.items():
        assert together[name].startswith(error), name
    assert (Path.cwd(), np.geterr()["under"]) == (tmp_path, "ignore")
