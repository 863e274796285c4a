"""Which episodes of a trial are recorded side by side, and how they are linked."""

import dataclasses
import itertools
import json
from pathlib import Path
from typing import Any

import pytest

from gplfd_experiments.analysis.report.document import markdown_page
from gplfd_experiments.analysis.report.page import report
from gplfd_experiments.analysis.results.reading import read_results
from gplfd_experiments.analysis.results.trials import of_trial
from gplfd_experiments.cli.main import main
from gplfd_experiments.studies.runner import run_study
from gplfd_experiments.studies.trials.contrasts import CONSTANT
from gplfd_experiments.studies.trials.plan import named_trials, trial_tasks
from gplfd_experiments.studies.trials.protocol import TRIALS
from gplfd_experiments.studies.trials.records import Side
from gplfd_experiments.workflows import study_recordings as module
from gplfd_experiments.workflows.study_recordings import (
    COMPARED,
    record_trials,
    side_by_side,
)

pytestmark = pytest.mark.slow


@pytest.fixture
def shown(write_study, episode_result):
    """Name the episodes that are compared, of (policy, level, seed, radius)."""

    def shown(trial: str, *rows: Any, trials: Any = TRIALS) -> dict[str, Any]:
        results = [
            episode_result(policy, seed, radius, trial=trial, level=level)
            for policy, level, seed, radius in rows
        ]
        episodes = read_results(write_study(results)).episodes
        chosen = side_by_side(trials[trial], of_trial(episodes, trial))
        return {
            name: (one.task.level, one.task.seed, one.radius)
            for name, one in chosen.items()
        }

    return shown


def test_all_contrasts_fit_beside_gp_and_hinge_fit(shown):
    policies, levels = (*CONSTANT, "dmp", "hinge-fit", "gp"), TRIALS["person"].levels
    found = shown("person", *itertools.product(policies, levels, (4, 2), (0.5,)))
    assert list(found) == ["gp", "hinge-fit", *CONSTANT]
    assert set(found.values()) == {("in the way", 2, 0.5)}
    # Who is missing is left out.
    assert list(shown("stop", ("hinge-fit", "stop", 1, 0.5))) == ["hinge-fit"]
    assert side_by_side(TRIALS["stop"], {}) == {}


def test_more_than_can_be_seen_are_left_out(shown):
    lacking = [f"gp-constant-{100 + place}" for place in range(COMPARED)]
    (contrast, *_) = TRIALS["stop"].contrasts
    contrasts = tuple(
        dataclasses.replace(contrast, lacking=Side(policy=policy)) for policy in lacking
    )
    trial = dataclasses.replace(TRIALS["stop"], contrasts=contrasts)
    policies = ["gp", "hinge-fit", *lacking]
    rows = [(policy, "stop", 0, 0.5) for policy in policies]
    found = shown("stop", *rows, trials={"stop": trial})
    assert list(found) == policies[:COMPARED]


def test_levels_are_compared_where_they_are_what_differs(shown):
    rows = itertools.product(("gp",), TRIALS["further"].levels, (0,), (0.35, 0.65))
    found = shown("further", *rows, ("hinge-fit", "nothing else", 0, 0.65))
    pairs = ("gp", "prior mean"), ("hinge-fit", "nothing else"), ("gp", "nothing else")
    assert found == {f"{name}, {level}": (level, 0, 0.65) for name, level in pairs}


def test_only_episodes_at_one_door_are_compared(write_study, episode_result):
    trials = named_trials(("corrections",))
    tasks = trial_tasks(trials, policies=["gp", "hinge-fit"], part="small", seeds=2)
    results = [
        episode_result(radius=task.door_config["radius"], **task.definition)
        for task in tasks
        # As if gp had failed at the first seed.
        if (task.policy, task.seed) != ("gp", 0)
    ]
    episodes = of_trial(read_results(write_study(results)).episodes, "corrections")
    found = side_by_side(trials["corrections"], episodes)
    assert {name: one.task.seed for name, one in found.items()} == {
        "gp, overhead, 5 shown": 1,
        "hinge-fit, overhead, 0": 1,
        **{f"gp, overhead, {title}": 1 for title in ("1", "0", "5", "1 shown")},
    }
    assert len({json.dumps(one.task.door_config) for one in found.values()}) == 1


def page(folder: Path) -> str:
    return markdown_page(report(read_results(folder), folder, folder, "gp"))


def test_a_trial_is_recorded_and_linked(tmp_path):
    tasks = [
        task
        for task in trial_tasks(named_trials(("push",)), part="small")
        if task.policy == "hinge-fit" and task.seed == 0
    ]
    list(run_study(tmp_path, tasks))
    index = json.loads(record_trials(tmp_path).read_text())
    (compared,) = index["comparisons"]
    assert compared["file"] == "trial-push.rrd"
    assert [one["repeated"] for one in compared["episodes"]] == [True]
    assert (tmp_path / "recordings" / "trial-push.rrd").is_file()
    link = "[trial-push.rrd](recordings/trial-push.rrd)"
    assert f"Side by side: {link}, medium, seed 0." in page(tmp_path)
    assert "Those of trials are linked in their sections." in page(tmp_path)
    file = tmp_path / "recordings" / "index.json"
    differs = {"policy": "gp", "different": {"push_displacement_mm": [1.0, 2.0]}}
    other = {**compared["episodes"][0], **differs, "repeated": False}
    compared["episodes"].append(other)
    file.write_text(json.dumps(index))
    assert (
        "`hinge-fit` medium, seed 0; `gp` medium, seed 0 (**differs from the stored "
        "result:** push displacement mm)"
    ) in page(tmp_path)
    for damaged in ("{", '{"comparisons": [], "episodes": []}'):
        file.write_text(damaged)
        assert f"Side by side: {link}, its description cannot be read" in page(tmp_path)


def test_the_command_records_when_asked(tmp_path, monkeypatch):
    recorded: list[Path] = []
    monkeypatch.setattr("gplfd_experiments.studies.runner.run_or_resume", lambda *_: 0)
    monkeypatch.setattr(module, "record_trials", recorded.append)
    arguments = ["trials", "--trials", "stop", "--out", str(tmp_path), "--quiet"]
    assert main(arguments) == 0
    assert recorded == []
    assert main([*arguments, "--record"]) == 0
    assert recorded == [tmp_path]
