"""`gplfd skill`: recordings left out in turn, and what is said of them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gplfd_env.spatial.se3 import handle_pose_on_arc
from gplfd_experiments.analysis.results.measures import PREDICTED
from gplfd_experiments.analysis.results.reading import read_results
from gplfd_experiments.cli import main as cli
from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.studies.learning_tests.folds import aligned_to, learn
from gplfd_experiments.studies.learning_tests.scores import (
    GRID,
    Forecast,
    forecasts,
    online_forecasts,
    path_distance,
    recorded_metrics,
    watch,
    without,
)
from gplfd_policies import policy_named
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.demonstrations.npz import load_demonstrations, save_demonstrations
from gplfd_policies.movements.movement import GaussianTrajectory
from gplfd_policies.phase.phase_rule import ClockPhase, PhaseEstimate
from gplfd_policies.registry.method import Method

pytestmark = pytest.mark.slow


def arcs(radii: tuple[float, ...] = (0.40, 0.45, 0.50, 0.55)) -> list[Demonstration]:
    """Doors opened without noise at one pace: a family of one number."""
    times = np.linspace(0.0, 4.0, 161)
    turned = np.radians(60.0) * (1.0 - np.cos(np.pi * times / 4.0)) / 2.0
    return [
        Demonstration(times=times, poses=handle_pose_on_arc(radius, turned))
        for radius in radii
    ]


def three(seed: int) -> tuple[Demonstration, ...]:
    """A demonstration of each standard door."""
    return Teacher().standard_demonstrations(seed=seed)[::2]


def method(name: str) -> Method:
    found = policy_named(name).method
    assert found is not None
    return found


def test_errors_are_those_of_a_family_that_is_known():
    # 0.45 is left out of 0.40, 0.50 and 0.55, whose mean is 0.4833 everywhere. The
    # phase is the share of the path, so that the mean is the arc of that radius.
    found = recorded_metrics(method("gp"), arcs(), 1)
    turned = np.radians(np.linspace(0.0, 60.0, 161))
    apart = handle_pose_on_arc(0.4833, turned) - handle_pose_on_arc(0.45, turned)
    largest = np.linalg.norm(apart[:, :3], axis=1).max()
    assert 0.4 * largest < found["rmse_position_m"] < largest
    assert found["rmse_rotation_rad"] < 1e-3
    # Once a part of it is seen, the rest of a family of one number is known.
    errors = [found[f"forecast_{share}_position_m"] for share in (10, 25, 50)]
    assert errors[0] < found["rmse_position_m"]
    assert errors[2] < 0.2 * found["rmse_position_m"]


def test_a_forecast_depends_on_no_later_sample():
    movement, left_out, _ = without(method("gp"), arcs(), 1)
    other = left_out.poses.copy()
    other[70:, :3] += 0.1
    before, after = (
        watch(method("gp"), movement, poses, [40, 70, 75], 0.025)
        for poses in (left_out.poses, other)
    )
    for count in (40, 70):
        first, second = before[count], after[count]
        assert first.phase == second.phase
        np.testing.assert_array_equal(first.trajectory.mean, second.trajectory.mean)
        np.testing.assert_array_equal(first.trajectory.std, second.trajectory.std)
    assert not np.array_equal(before[75].trajectory.mean, after[75].trajectory.mean)


class Told(ClockPhase):
    """A phase rule that is told the phases of the poses, one by one."""

    def __init__(self, phases: np.ndarray) -> None:
        self._phases = iter(phases)

    def update(self, *arguments: object) -> PhaseEstimate:
        zero = np.zeros(())
        return PhaseEstimate(zero + next(self._phases), zero, zero)


def test_online_equals_offline_where_the_phase_is_exact():
    """But for via-points at samples, not hundredths: 1.5 mm and 0.1 of the NLPD."""
    gp = method("gp@no-size")
    movement, left_out, _ = without(gp, arcs(), 1)
    offline = forecasts(gp, movement, left_out)

    def told(error: float) -> dict[str, float | None]:
        rule = Told(left_out.phases + error)
        pipeline = replace(gp.pipeline, phases=lambda _: rule)
        exact = replace(gp, pipeline=pipeline)
        return online_forecasts(exact, movement, left_out, 0.025)

    online, wrong = told(0.0), told(0.05)
    for share in (10, 25, 50):
        for name, tolerance in (("position_m", 1.5e-3), ("nlpd", 0.1)):
            known = offline[f"forecast_{share}_{name}"]
            assert online[f"online_{share}_{name}"] == pytest.approx(
                known, abs=tolerance
            )
            assert wrong[f"online_{share}_{name}"] > known + 2.0 * tolerance
    # Without via-points both are what was learned.
    fixed = method("gp@no-adaptation")
    online = online_forecasts(fixed, movement, left_out, 0.025)
    for name, value in forecasts(fixed, movement, left_out).items():
        assert online[name.replace("forecast", "online")] == value
    assert online.keys() == {n for n in PREDICTED if n.startswith("online")}


def test_a_path_is_judged_ahead_and_without_its_timing():
    late = handle_pose_on_arc(0.5, 1.2 * GRID**1.3)
    truth = handle_pose_on_arc(0.5, np.linspace(0.6, 1.2, 40))[:, :3]

    def distance(phase: float, aside: float = 0.0) -> float:
        mean = late + np.array([0.0, aside, 0.0, 0.0, 0.0, 0.0])
        moments = (GRID, mean, np.ones_like(mean))
        path = GaussianTrajectory.from_moments(*moments, covariance_function=np.empty)
        return path_distance(Forecast(phase, path), truth)

    assert distance(0.5) < 1e-4
    assert distance(0.5, aside=0.004) == pytest.approx(0.004, rel=1e-3)
    assert distance(0.9) > 0.05


def test_outputs_that_never_move_are_not_scored():
    """How exactly a method knows a constant is not how well it knows the task."""
    moving = np.array([True, True, False, False, False, False])
    shown = [
        Demonstration(times=each.times, poses=np.where(moving, each.poses, 0.25))
        for each in three(seed=0)
    ]
    found = recorded_metrics(method("gp"), shown, 1)
    movement, _ = learn(method("gp"), [shown[0], *shown[2:]], 1)
    asked = aligned_to(shown[1], movement.aligned).thinned(200)
    predicted = movement.predict(asked.phases)
    error = (asked.poses - predicted.mean)[:, moving]
    std = predicted.std[:, moving]
    density = -0.5 * (np.log(2.0 * np.pi) + 2.0 * np.log(std) + (error / std) ** 2)
    assert found["nlpd"] == pytest.approx(-density.mean())
    assert found["coverage_95"] == pytest.approx(np.mean(np.abs(error) < 1.96 * std))
    for share in (10, 25, 50):
        assert -6.0 < found[f"forecast_{share}_nlpd"] < 0.0
        assert found[f"forecast_{share}_coverage_95"] < 1.0


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    save_demonstrations("demos.npz", three(seed=0))
    return tmp_path


def test_the_command_reports_and_goes_on(folder, capsys):
    command = ["skill", "demos.npz", "--out", "out", "--engine", "serial"]
    command += ["--reference", "promp", "--policies", "promp"]
    assert cli.main([*command, "dmp", "--quiet"]) == 0
    printed = capsys.readouterr().out
    assert printed.index("promp ") < printed.index("dmp ")
    page = Path("out/report.md").read_text()
    assert "6 recordings left out of 2 policies" in page
    assert "| online 25 % [mm] |" in page
    assert "Doors opened" not in page
    # Another method is added; finished tests are kept.
    before = {path: path.stat().st_mtime_ns for path in Path("out/tasks").iterdir()}
    assert cli.main([*command, "gmr"]) == 0
    assert "6 tasks, 3 of them done already" in capsys.readouterr().err
    assert all(path.stat().st_mtime_ns == then for path, then in before.items())
    results = read_results(Path("out")).recorded
    assert {result.policy for result in results} == {"promp", "dmp", "gmr"}
    # Other recordings are not mixed into a page.
    save_demonstrations("other.npz", three(seed=1))
    assert cli.main(["skill", "other.npz", *command[2:]]) == 2
    assert "choose another --out" in capsys.readouterr().err
    assert len(list(Path("out/tasks").iterdir())) == 9


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["none.npz"], "there is no file none.npz"),
        (["two.npz"], "holds 2 demonstration(s)"),
        (["demos.npz", "--policies", "oracle"], "'oracle' learns no movement"),
        (["demos.npz", "--policies", "promp"], "--reference gp is not among"),
    ],
)
def test_what_is_wrong_is_said_and_nothing_written(folder, arguments, message, capsys):
    shown = load_demonstrations("demos.npz").demonstrations
    save_demonstrations("two.npz", shown[:2])
    assert cli.main(["skill", *arguments, "--out", "out"]) == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert message in said
    assert not Path("out").exists()
