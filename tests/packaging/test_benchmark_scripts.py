"""The scripts of benchmarks/ run, with tiny settings, and count as they claim."""

import importlib
import math
import re
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tyro

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "benchmarks"
sys.path.insert(0, str(FOLDER))  # as for a script that is run
SCRIPTS = "agents", "contact", "demonstrations", "forecasts", "learning"
agents, contact, demonstrations, forecasts, learning = map(
    importlib.import_module, SCRIPTS
)
stiffness_resolution = importlib.import_module("stiffness_resolution")

RUNS = {
    "agents": ("--repeats 1 --counts 2 --periods 4", "2 agents in lockstep"),
    "building_doors": ("--draws 1 --policies hinge-fit", "that hinge-fit opens"),
    "contact person": ("--seeds 1", "command follows the hand"),
    "door_closers": ("--doors 1 --seeds 1", "gp, with forces"),
    "demonstrations alignments": ("--seeds 1 --habits pauses", "ion, worst habit"),
    "demonstrations rests": ("--sets 1 --rates 60 --noises 3e-4", "sets within 1.5 x"),
    "forecasts doors": ("--draws 1 --every 80", "2 of 3 radii, process"),
    "forecasts inference": ("--policies gp", "radial peak: hard N"),
    "forecasts unseen": ("--draws 1 --unseen 0.42", "synthetic human, own-clock"),
    "forecasts worth": ("--draws 1 --per-radius 2", "synthetic human, left out"),
    "learning calibration": ("--draws 1", "accuracy, 20 smooth: in stated 95 %"),
    "realtime": ("--minutes 0.005", "skill, ordinary: over 10 ms"),
    "stiffness_resolution": ("--policies gmr --seeds 1", "1 seeds from 1000"),
    "learning scaling": ("--repeats 1 --counts 2 3 --samples 20 40", "fit of (3, 40)"),
}
"""Arguments of every command, and a part of what it prints."""
ELSEWHERE = {
    *("contact loop", "leaderboard", "pictures films", "pictures gallery"),
    # They need the extras sb3 and warp and are run by tests/learners.
    *("learners", "on_warp"),
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


def test_every_command_is_run_and_named_in_the_documents_with_its_figures():
    known = commands()
    assert set(RUNS) | ELSEWHERE == known
    text = "".join(path.read_text() for path in (ROOT / "docs").glob("*.md"))
    named = re.findall(r"python benchmarks/(\w+)\.py(?:\s(\w+))?", text)
    assert known == {
        script if script in known else f"{script} {command}"
        for script, command in named
    }


@pytest.mark.parametrize("command", RUNS)
def test_script_runs(command, capsys, monkeypatch):
    one_form = {"left out": forecasts.WORTH_FORMS["left out"]}
    for module, name, fewer in (
        (forecasts, "WORTH_FORMS", one_form),
        (forecasts, "OPENINGS", {"2 of 3 radii": partial(forecasts.arcs, RADII)}),
        (forecasts, "_HARD", 1),
        (forecasts, "_SMALL_AND_LARGE", RADII),
        (demonstrations, "METHODS", ("gp",)),
        (demonstrations, "RESTS", (0.0, 2.0)),
        (demonstrations, "_DOORS", ("small",)),
        (stiffness_resolution, "CANDIDATES", (1e-4,)),
    ):
        monkeypatch.setattr(module, name, fewer)
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


def test_known_distribution_is_learned_well(monkeypatch):
    monkeypatch.setattr(learning, "CASES", [("independent", 20)])
    result = learning.measure_calibration(1)
    assert 0.0 < result.rows["20 independent"]["NLPD above the truth's"] < 0.02
    assert result.targets[0].met


def test_resolution_changes_only_if_more_doors_open():
    chosen = stiffness_resolution.chosen
    assert chosen({1e-4: (3, 5.0), 3e-4: (3, 1.0), 1e-3: (4, 0.5)}) == 1e-4
    assert chosen({1e-4: (3, 1.0), 3e-4: (2, 7.0), 1e-3: (2, 6.0)}) == 1e-3


def test_deciding_is_counted_per_control_step(monkeypatch):
    # One microsecond passes between any two looks at the clock.
    clock = iter(range(0, 10**9, 1000)).__next__
    monkeypatch.setattr(agents.time, "thread_time_ns", clock)
    rows = agents.measure_loops(2, counts=(2,), periods=4).rows
    assert [row["of which agent"] for row in rows.values()] == pytest.approx([1.0, 0.5])


def test_contact_model_agrees_with_the_simulation(capsys, monkeypatch):
    """Free and held, 0 to 3 periods of delay, 100 to 500 N/m, both dampings."""
    found = contact.threshold(lambda k: k < 293.0, 20.0, 1500.0)
    assert found == pytest.approx(293.0, rel=0.01)
    monkeypatch.setattr(contact, "threshold", lambda *arguments: 400.0)
    tyro.cli(contact.loop, args=["--seconds", "2"])
    printed = capsys.readouterr().out
    rows = [line for line in printed.splitlines() if "periods  " in line]
    held = [row for row in rows if row.startswith(("held, 2", "held, 3"))]
    assert [row.count("OSCILLATES") for row in held] == [3, 4]
    assert not any("OSCILLATES" in row for row in rows if "d >= 60" in row)
    for name in ("held", "free"):
        assert re.search(rf"different predictions, {name} +0 +at most 0 +met", printed)


# --- Doors that were not demonstrated ----------------------------------------

RADII = (0.3, 0.4, 0.5)


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
    aligned, radii = forecasts.arcs(RADII, np.random.default_rng(0))
    scores = forecasts.judge_exact(["exact"], [(aligned, radii)], 60)["exact"]
    for fold, poses in enumerate(learned):
        expected = np.delete(aligned.poses, [2 * fold, 2 * fold + 1], axis=0)
        np.testing.assert_array_equal(poses, expected)
    assert len(learned) == 3
    assert 0.0 < scores[forecasts.SOON_ERROR] < scores[forecasts.REST_ERROR]


def test_door_targets_compare_with_the_product_of_the_same_doors():
    scores = {
        forecasts.SOON_ERROR: 4.0,
        forecasts.SOON_HOLDS: 0.95,
        forecasts.REST_HOLDS: 0.85,
    }
    rests = {"product": 80.0, "process": 60.0}
    found = {name: scores | {forecasts.REST_ERROR: at} for name, at in rests.items()}
    targets = forecasts.door_targets("some", found)
    assert [target.met for target in targets] == [True, False, True, False]
    assert targets[1].value == pytest.approx(0.75)


def test_deviation_along_and_across_a_path_is_that_of_its_covariance():
    angles = np.linspace(0.1, 1.0, 9)
    mean, rate, std = np.zeros((3, 9, 6))
    mean[:, [0, 2]] = np.column_stack([np.sin(angles), np.cos(angles)])
    rate[:, [0, 2]] = np.column_stack([np.cos(angles), -np.sin(angles)])
    rate[:, 1], std[:, :3] = 0.3, [3.0, 7.0, 4.0]
    path = forecasts.GaussianTrajectory.from_moments(angles, mean, std, np.empty)
    path = replace(path, mean_rate=rate)
    along, across = forecasts.path_axes(path)
    # The motion is in the plane of x and z, and so are both directions.
    np.testing.assert_allclose(along[:, [0, 2]], rate[:, [0, 2]], atol=1e-12)
    np.testing.assert_allclose(np.abs(np.sum(across * mean[:, :3], axis=1)), 1.0)
    covariance = np.array([[9.0, 0.0, 5.0], [0.0, 49.0, 0.0], [5.0, 0.0, 16.0]])
    forecast = forecasts.Forecast(0.0, path, np.full(9, 5.0))
    for axes in (along, across):
        expected = [d @ covariance @ d for d in axes]
        found = forecasts.std_along(forecast, axes)
        np.testing.assert_allclose(found**2, expected, rtol=1e-12)
