"""A policy of the user's: found, checked at once, run, studied, reported, recorded."""

import json
import re
from pathlib import Path

import pytest

from gplfd_experiments.analysis.report.document import markdown_page
from gplfd_experiments.analysis.report.page import report
from gplfd_experiments.analysis.results.reading import read_results
from gplfd_experiments.cli import main as cli
from gplfd_experiments.files.provenance import content_hash
from gplfd_experiments.studies.sources import source_of
from gplfd_policies.registry.catalogue import policy_named

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("short_episodes")]

OWN = """\
import warnings; import numpy as np; from dataclasses import replace
from gplfd_policies import TrainingInput, make_agent
from gplfd_policies.adaptation import NoAdaptation
from gplfd_policies.registry.built_in import LEARNERS

class Still:
    def act(self, observation):
        return np.zeros(6)

def make(training: TrainingInput):
    \"\"\"Stays where it is.\"\"\"
    return Still()

def refusing(training):
    raise FileNotFoundError("no weights")

class Leaving(NoAdaptation):
    def observe(self, via_point):
        raise SystemExit(0)

leaving = replace(LEARNERS["promp"], adaptation=Leaving)

def chatty(training):
    warnings.warn("the gain is zero")
    print("making an agent")
    return Still()
"""
SHORT = ("--doors", "small", "--seeds", "1", "--no-skill")


@pytest.fixture
def module(tmp_path, monkeypatch):
    """Write a module into the working folder; its name is its own in this process."""
    monkeypatch.chdir(tmp_path)
    name = f"own_{tmp_path.name.replace('-', '_')}"
    Path(f"{name}.py").write_text(OWN)
    return name


def gplfd(*arguments: str) -> int:
    try:
        return cli.main(arguments)
    except SystemExit as error:
        return int(error.code or 0)


@pytest.mark.filterwarnings("default")
def test_json_stays_alone_on_standard_output(module, capfd):
    policy = f"{module}:chatty"
    command = ("benchmark", *SHORT, "--workers", "1", "--policies", policy)
    assert gplfd(*command, "--out", "out", "--json") == 0
    printed = capfd.readouterr()
    (row,) = json.loads(printed.out)
    assert row["policy"] == policy
    assert "making an agent" in printed.err
    assert "gplfd: warning: the gain is zero" in printed.err


@pytest.mark.usefixtures("policies_here")
def test_run_keeps_which_file_the_policy_came_from(module):
    name = f"./{module}.py:make"
    assert gplfd("run", "--policy", name, "--doors", "small", "--quiet") == 0
    # The folder has a name that a file system takes.
    (folder,) = Path("results").iterdir()
    assert re.fullmatch(r"[\w-]+", folder.name, re.ASCII)
    (metrics,) = json.loads((folder / "metrics.json").read_text())
    assert (metrics["policy"], metrics["success"]) == (name, False)
    assert json.loads((folder / "run.json").read_text())["config"]["policy_source"] == {
        "kind": "module",
        "file": f"{module}.py",
        "sha256": content_hash(Path(f"{module}.py")),
    }


@pytest.mark.usefixtures("policies_here")
def test_an_error_in_the_policy_is_reported_with_its_place(module, capsys):
    name, line = f"{module}:refusing", "line 15, in refusing"
    place = f"FileNotFoundError: no weights ({module}.py, {line})"
    assert gplfd("run", "--policy", name, "--doors", "small", "--out", "out") == 2
    failed = f"gplfd: policy '{name}' failed with {place}"
    assert capsys.readouterr().err.splitlines()[-1] == failed
    # An error at one door does not keep the others closed, which it opens in lockstep.
    leaving = f"{module}:leaving@no-size"
    run = ("run", "--policy", leaving, "--doors", "small", "0.42", "--out", "out")
    assert gplfd(*run) == 1
    metrics = json.loads(Path("out/metrics.json").read_text())
    failed = f"SystemExit: 0 ({module}.py, line 19, in observe)"
    assert [one["error"].endswith(failed) for one in metrics] == [True, True]
    capsys.readouterr()
    study = ("benchmark", "--policies", name, *SHORT, "--out", "study")
    assert gplfd(*study, "--engine", "serial") == 1
    printed = capsys.readouterr().err.splitlines()[-1]
    assert printed == f"gplfd: {name}, small, seed 0: {place}"
    (file,) = Path("study/tasks").glob("*.json")
    trace = json.loads(file.read_text())["traceback"]
    assert f'{module}.py", {line}' in trace


@pytest.mark.usefixtures("policies_here")
def test_a_study_keeps_the_source_in_every_file_and_reports_it(module):
    name = f"{module}:make"
    study = ("benchmark", "--policies", "oracle", name, *SHORT, "--out", "study")
    assert gplfd(*study, "--engine", "serial") == 0
    source = source_of(policy_named(name))
    results = [json.loads(p.read_text()) for p in Path("study/tasks").iterdir()]
    sources = {r["task"]["policy"]: r["task"].get("policy_source") for r in results}
    assert sources == {"oracle": None, name: source}
    config = json.loads(Path("study/study.json").read_text())["config"]
    assert config["policy_sources"] == {name: source}
    page = report(read_results(Path("study")), name)
    text = f"`{name}` | `kind module, file {module}.py, sha256"
    assert text in markdown_page(page)
