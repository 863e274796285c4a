"""The scripts of benchmarks/ run, with tiny settings, and count as they claim."""

import dataclasses
import importlib
import math
import re
import sys
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tyro

from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.studies.learning_tests.scores import recorded_metrics
from gplfd_policies import POLICIES
from gplfd_policies.demonstrations.npz import save_demonstrations

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "benchmarks"
sys.path.insert(0, str(FOLDER))  # as for a script that is run
agents, approach, building_doors, contact, demonstrations, forecasts, learning = map(
    importlib.import_module,
    (
        *("agents", "approach", "building_doors", "contact", "demonstrations"),
        *("forecasts", "learning"),
    ),
)

RUNS = {
    "agents": ("--repeats 1 --counts 2 --periods 4", "2 agents in lockstep"),
    "approach": ("--seeds 1 --policies oracle --doors small", "oracle: share grasped"),
    "building_doors": (
        "--seeds 1 --draws 1 --repeats 1 --policy promp",
        "standard: share of these that promp opens",
    ),
    "contact person": ("--seeds 1", "command follows the hand"),
    "contact renderings": ("--seeds 1 --trials", "ordinary, hard: gp-impedance"),
    "demonstrations alignments": (
        "--seeds 1 --habits pauses",
        "directions / interpolation, worst habit",
    ),
    "demonstrations rests": (
        "--sets 1 --rates 60 --noises 3e-4",
        "gp, 2 s: sets within 1.5 x the same",
    ),
    "forecasts doors": ("--draws 1 --every 80", "2 of 3 radii, process"),
    "forecasts unseen": ("--draws 1 --unseen 0.42", "synthetic human, own-clock"),
    "forecasts worth": ("--draws 1 --per-radius 2", "synthetic human, left out"),
    "learning calibration": ("--draws 1", "accuracy, 20 smooth: in stated 95 %"),
    "learning scaling": (
        "--repeats 1 --counts 2 3 --samples 20 40",
        "scaling: fit of (3, 40) / fit of (3, 40)",
    ),
}
"""Arguments of every command, and a part of what it prints."""
ELSEWHERE = {
    "contact loop",
    "demonstrations sets",
    "leaderboard",
    # They need the extras sb3 and warp and are run by tests/learners.
    "learners",
    "on_warp",
    "pictures films",
    "pictures gallery",
}


def commands() -> set[str]:
    """Return every script, with each of its commands if it has several."""
    found = set()
    for path in FOLDER.glob("*.py"):
        if "tyro.cli(main)" in path.read_text():
            found.add(path.stem)
        elif path.stem != "harness":
            module = importlib.import_module(path.stem)
            found |= {f"{path.stem} {command}" for command in module.COMMANDS}
    return found


def test_every_command_is_run():
    assert set(RUNS) | ELSEWHERE == commands()


def test_documents_name_every_command_and_no_other():
    """Every figure in the documents keeps the command that made it."""
    text = "".join(path.read_text() for path in (ROOT / "docs").glob("*.md"))
    named = re.findall(r"python benchmarks/(\w+)\.py(?:\s(\w+))?", text)
    known = commands()
    assert known == {
        script if script in known else f"{script} {command}"
        for script, command in named
    }


@pytest.mark.parametrize("command", RUNS)
def test_script_runs(command, capsys, monkeypatch):
    fewer = {"2 of 3 radii": partial(forecasts.arcs, (0.3, 0.4, 0.5))}
    monkeypatch.setattr(forecasts, "OPENINGS", fewer)
    worth = {"left out": forecasts.WORTH_FORMS["left out"]}
    monkeypatch.setattr(forecasts, "WORTH_FORMS", worth)
    monkeypatch.setattr(demonstrations, "METHODS", ("gp",))
    monkeypatch.setattr(demonstrations, "RESTS", (0.0, 2.0))
    monkeypatch.setattr(demonstrations, "_DOORS", ("small",))
    rooms = {
        name: building_doors.ROOMS[name] for name in ("room-584", building_doors._WIDE)
    }
    monkeypatch.setattr(building_doors, "ROOMS", rooms)
    levels = {
        name: dataclasses.replace(level, doors=("small",))
        for name, level in contact.NO_TRIAL.levels.items()
    }
    trial = dataclasses.replace(contact.NO_TRIAL, levels=levels)
    monkeypatch.setattr(contact, "NO_TRIAL", trial)
    script, *name = command.split()
    module = importlib.import_module(script)
    run = module.COMMANDS[name[0]] if name else module.main
    arguments, said = RUNS[command]
    tyro.cli(run, args=arguments.split())
    printed = capsys.readouterr().out
    assert said in printed
    assert "targets" in printed
    assert "nan" not in printed
    assert printed.startswith("commit ")


def test_slopes_of_a_power_law_are_its_exponents():
    sizes = [(d, m) for d in (2, 6, 20) for m in (100, 400)]
    seconds = [3e-3 * d**0.25 * m**1.5 for d, m in sizes]
    assert learning.log_log_slopes(sizes, seconds) == pytest.approx((0.25, 1.5))


def test_known_distribution_is_learned_well():
    result = learning.measure_calibration(1, [("independent", 20)])
    assert 0.0 < result.rows["20 independent"]["NLPD above the truth's"] < 0.02
    assert result.targets[0].met


def test_deciding_is_counted_per_control_step(monkeypatch):
    # One microsecond passes between any two looks at the clock.
    monkeypatch.setattr(
        agents.time, "thread_time_ns", iter(range(0, 10**9, 1000)).__next__
    )
    rows = agents.measure_loops(2, counts=(2,), periods=4).rows
    assert [row["of which agent"] for row in rows.values()] == pytest.approx([1.0, 0.5])


# --- A held hand -------------------------------------------------------------


def test_contact_model_agrees_with_the_simulation(capsys, monkeypatch):
    """Free and held, 0 to 3 periods of delay, 100 to 500 N/m, both dampings."""
    monkeypatch.setattr(contact, "threshold", lambda *arguments: 400.0)
    tyro.cli(contact.loop, args=["--seconds", "2"])
    printed = capsys.readouterr().out
    rows = [line for line in printed.splitlines() if "periods  " in line]
    held = [row for row in rows if row.startswith(("held, 2", "held, 3"))]
    assert [row.count("OSCILLATES") for row in held] == [3, 4]
    assert not any("OSCILLATES" in row for row in rows if "d >= 60" in row)
    for name in ("held", "free"):
        assert re.search(rf"verdicts that differ, {name} +0 +at most 0 +met", printed)


def test_threshold_is_where_it_stops():
    found = contact.threshold(lambda k: k < 293.0, 20.0, 1500.0)
    assert found == pytest.approx(293.0, rel=0.01)


# --- Doors that were not demonstrated ----------------------------------------


def test_door_opening_without_wobble_is_the_arc():
    times = np.linspace(0.0, 1.0, 20)
    rng = np.random.default_rng(0)
    poses = forecasts.wobbling_arc(0.4, times, times, 0.0, rng)
    from_hinge = np.hypot(poses[:, 0], poses[:, 2] + 0.4)
    np.testing.assert_allclose(from_hinge, 0.4, rtol=1e-12)
    assert poses[-1, 4] == pytest.approx(math.radians(67.0))


def test_left_out_radius_is_not_learned_from(monkeypatch):
    learned, fit = [], forecasts.fit_skill

    def learn(aligned: Any) -> Any:
        learned.append(aligned.poses)
        return fit(aligned)

    monkeypatch.setattr(forecasts, "fit_skill", learn)
    aligned, radii = forecasts.arcs((0.3, 0.4, 0.5), np.random.default_rng(0))
    scores = forecasts.judge_exact(["exact"], [(aligned, radii)], 60)["exact"]
    for fold, poses in enumerate(learned):
        expected = np.delete(aligned.poses, [2 * fold, 2 * fold + 1], axis=0)
        np.testing.assert_array_equal(poses, expected)
    assert len(learned) == 3
    assert 0.0 < scores[forecasts.SOON_ERROR] < scores[forecasts.REST_ERROR]


def test_door_targets_compare_with_the_product_of_the_same_doors():
    def scores(rest: float) -> dict[str, float]:
        return {
            forecasts.SOON_ERROR: 4.0,
            forecasts.SOON_HOLDS: 0.95,
            forecasts.REST_ERROR: rest,
            forecasts.REST_HOLDS: 0.85,
        }

    found = {"product": scores(80.0), "process": scores(60.0)}
    targets = forecasts.door_targets("some", found)
    assert [target.met for target in targets] == [True, False, True, False]
    assert targets[1].value == pytest.approx(0.75)


# --- Recorded demonstrations -------------------------------------------------


def test_a_task_that_is_lost_shows_however_good_the_mean():
    tasks = {
        "letters": {"gp": -5.0, "kmp": -4.0},
        "doors": {"gp": -3.0, "kmp": -2.9},
        "boxes": {"gp": -2.0, "kmp": -2.7},
    }
    found = demonstrations.compare_methods(tasks, [0.9, 0.95, 0.97])
    assert found.rows["gp"] == {
        "mean NLPD": pytest.approx(-10.0 / 3.0),
        "median": -3.0,
        "best in": 2,
        "most behind": pytest.approx(0.7),
        "where": "boxes",
    }
    assert found.rows["kmp"]["where"] == "letters"
    behind, ahead, held = found.targets
    assert not behind.met
    assert (ahead.met, ahead.value) == (True, pytest.approx(-10.0 / 3.0 + 3.2))
    assert (held.met, held.value) == (True, pytest.approx(0.94))


def test_sets_are_judged_as_the_command_skill_judges_them(tmp_path, capsys):
    demos = Teacher().standard_demonstrations(seed=0)[:3]
    save_demonstrations(tmp_path / "demos.npz", demos)
    tyro.cli(
        demonstrations.judged_sets,
        args=[str(tmp_path / "demos.npz"), "--policies", "promp", "gmr"],
    )
    printed = capsys.readouterr().out
    promp = POLICIES["promp"].method
    assert promp is not None
    nlpd = np.mean([recorded_metrics(promp, demos, one)["nlpd"] for one in range(3)])
    assert f"{nlpd:.4g}" in printed


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["demos.npz"], "demos.npz holds fewer than 3 recordings"),
        (["demos.npz", "--policies", "gp"], "--policies needs two or more"),
        (["demos.npz", "--policies", "gp", "oracle"], "oracle learns nothing"),
        (["none.npz"], "none.npz"),
    ],
)
def test_what_cannot_be_judged_is_said(arguments, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_demonstrations("demos.npz", Teacher().standard_demonstrations(seed=0)[:2])
    with pytest.raises(SystemExit, match=message):
        tyro.cli(demonstrations.judged_sets, args=arguments)
