"""The bookkeeping of `gplfd speed`; how fast anything is depends on the machine."""

import importlib.util
import json
import math
from collections.abc import Callable

import numpy as np
import pytest

from gplfd_experiments.cli.commands.machine import PartName
from gplfd_experiments.speed import peers, policies, timing
from gplfd_experiments.speed.known_process import KnownProcess, score
from gplfd_experiments.speed.parts import PARTS
from gplfd_experiments.speed.report import at_least, at_most, between, value_table
from gplfd_experiments.speed.timing import Timed, Timing, after, measure, repeated
from gplfd_policies.demonstrations.dynamic_time_warping import dynamic_time_warping
from gplfd_policies.movements.skill import fit_skill
from gplfd_policies.movements.trajectory import GaussianTrajectory

pytestmark = pytest.mark.slow

Gplfd = Callable[..., int]


@pytest.fixture
def without_peers(monkeypatch):
    """Pretend that nothing but the plain installation is there."""
    real = importlib.util.find_spec
    monkeypatch.setattr(
        peers.importlib.util,
        "find_spec",
        lambda name: None if name in ("hetgpy", "dtw") else real(name),
    )


# --- Timing ------------------------------------------------------------------


@pytest.fixture
def work(monkeypatch):
    """Let CPU and wall clocks move when someone works [s], and only then."""
    clock = {"cpu": 0.0, "wall": 0.0}
    monkeypatch.setattr(timing.time, "process_time", lambda: clock["cpu"])
    monkeypatch.setattr(timing.time, "perf_counter", lambda: clock["wall"])

    def work(seconds: float, *, waiting: float = 0.0) -> None:
        clock["cpu"] += seconds
        clock["wall"] += seconds + waiting

    return work


def test_actions_run_in_turns_after_a_round_that_does_not_count(work):
    calls: list[str] = []

    def action(name: str, first: float, later: float) -> Timed:
        def act() -> None:
            work(later if name in calls else first, waiting=1.0)
            calls.append(name)

        return repeated(act)

    times = measure({"a": action("a", 9.0, 2.0), "b": action("b", 9.0, 3.0)}, 3)
    assert calls == ["a", "b"] * 4
    assert times["a"] == Timing(cpu=(2.0,) * 3, wall=(3.0,) * 3)
    assert times["b"].cpu_median == 3.0
    assert times["b"].rate == pytest.approx(1 / 4)


def test_preparation_is_not_timed_and_times_are_per_operation(work):
    def prepare() -> timing.Action:
        work(100.0)
        return lambda: work(6.0)

    actions = {
        "prepared": Timed(prepare=prepare, operations=3),
        "after": after(lambda: work(100.0), lambda: work(6.0), 3),
        "repeated": repeated(lambda: work(2.0), 7, lambda: work(100.0)),
    }
    for time in measure(actions, 1).values():  # A single round is counted.
        assert time.cpu == (pytest.approx(2.0),)
    with pytest.raises(ValueError, match="repeats must be 1 or more, got 0"):
        measure({}, 0)


def test_short_actions_are_prepared_and_run_again(work):
    calls: list[str] = []

    def counted(name: str, operations: int) -> Timed:
        def run() -> None:
            calls.append(f"run {name}")
            work(0.1 * operations)

        return after(lambda: calls.append(f"begin {name}"), run, operations)

    actions = {"few": counted("few", 10), "many": counted("many", 20)}
    times = measure(actions, 1, least_operations=11)
    assert calls == ["begin few", "run few"] * 2 + ["begin many", "run many"]
    assert times["few"].cpu == times["many"].cpu == (pytest.approx(0.1),)


def test_comparisons_are_medians_over_rounds_not_of_medians():
    # The machine was three times slower in the last two rounds.
    ours = Timing(wall=(1.0, 3.0, 3.0), cpu=(2.0, 4.0, 4.0))
    theirs = Timing(wall=(2.0, 6.0, 9.0), cpu=(1.0, 1.0, 4.0))
    assert ours.speed_over(theirs) == 2.0
    assert theirs.speed_over(ours) == 0.5
    assert ours.cpu_over(theirs) == 2.0
    assert ours.cpu_beyond(theirs) == 1.0
    cpu = (5e-3, 1e-3, 2e-3, 4e-3, 3e-3)
    assert str(Timing(cpu=cpu, wall=cpu)) == "3.00 [2.00, 4.00]"


# --- Scores and data ---------------------------------------------------------


@pytest.mark.parametrize("kind", ["independent", "smooth"])
def test_true_model_covers_95_percent_and_costs_its_entropy(kind):
    process = KnownProcess.on_grid(50)
    drawn = process.draw(600, kind, np.random.default_rng(0))  # type: ignore[arg-type]
    known = score(process.truth, drawn)
    assert known["within 1.96 std"] == pytest.approx(0.95, abs=0.01)
    std = process.truth.std
    entropy = 0.5 * math.log(2 * math.pi * math.e) + np.mean(np.log(std))
    assert known["NLPD"] == pytest.approx(entropy, abs=0.04)
    variances = np.diagonal(process.truth.covariance, axis1=1, axis2=2)
    np.testing.assert_array_equal(variances.T, std**2)


def test_smooth_deviations_of_neighbours_agree_and_independent_ones_do_not():
    process = KnownProcess.on_grid(200)
    correlation = {}
    for kind in ("independent", "smooth"):
        drawn = process.draw(50, kind, np.random.default_rng(0))  # type: ignore[arg-type]
        deviation = (drawn - process.truth.mean) / process.truth.std
        correlation[kind] = np.mean(deviation[:, 1:] * deviation[:, :-1])
    assert correlation["smooth"] == pytest.approx(0.99, abs=0.1)
    assert correlation["independent"] == pytest.approx(0.0, abs=0.02)


def test_stated_interval_is_judged_apart_from_the_standard_deviation():
    held_out = np.array([-2.5, 0.0, 1.0, 2.5])[:, None, None] * np.ones((1, 3, 6))
    nothing = np.zeros((3, 6))
    student = GaussianTrajectory(
        times=np.arange(3.0),
        mean=nothing,
        std=nothing + 1.0,
        mean_rate=nothing,
        std_rate=nothing,
        covariance_function=lambda: np.zeros((6, 3, 3)),
        degrees_of_freedom=3.0,
    )
    known = score(student, held_out)
    assert known["within 1.96 std"] == 0.5
    assert known["in stated 95 %"] == 1.0  # Student's t reaches to 3.18


# --- Peers -------------------------------------------------------------------


def test_peers_learn_the_same_as_the_skill():
    rng = np.random.default_rng(0)
    given = KnownProcess.on_grid(40).demonstrations(20, "independent", rng)
    ours = fit_skill(given).predict(given.times)
    limits = {peers.sklearn_fit: (0.2, 0.25), peers.hetgpy_fit: (0.4, 0.4)}
    for learn, (far, rtol) in limits.items():
        theirs = learn(given)
        assert np.abs((theirs.mean - ours.mean) / ours.std).max() < far
        np.testing.assert_allclose(theirs.std, ours.std, rtol=rtol)


def test_dtw_python_finds_paths_of_our_cost():
    rng = np.random.default_rng(0)
    a, b = np.sort(rng.uniform(size=(2, 40)), axis=1)
    rows, columns = peers.dtw_python(a, b)
    first, second = dynamic_time_warping(lambda row: np.abs(b - a[row]), len(a))
    ours = np.abs(a[first] - b[second]).sum()
    assert np.abs(a[rows] - b[columns]).sum() == pytest.approx(ours)


CPU_TIMES = {policies.OURS: 2.0, policies.HETGPY: 70.0, policies.SKLEARN: 9.0}


@pytest.fixture
def small_fit(monkeypatch):
    """Learn from few samples, in times that do not depend on the machine."""

    def measure(actions: dict[str, Timed], repeats: int) -> dict[str, Timing]:
        return {
            name: Timing(cpu=(CPU_TIMES[name],) * repeats, wall=(1.0,) * repeats)
            for name in actions
        }

    monkeypatch.setattr(policies, "_SAMPLES", 25)
    monkeypatch.setattr(policies, "measure", measure)


@pytest.mark.usefixtures("small_fit")
def test_libraries_are_compared_on_the_same_data():
    comparison = policies.compare_fits(repeats=1)
    names = (policies.OURS, policies.HETGPY, "the true model")
    for kind in ("independent", "smooth"):
        ours, theirs, truth = (comparison.rows[f"{name}, {kind}"] for name in names)
        assert ours["ratio"] == 1.0
        assert theirs["ratio"] == 35.0
        assert ours["NLPD"] > truth["NLPD"] - 0.01
        assert list(ours)[2:] == list(truth)
    targets = [target.name for target in comparison.targets]
    assert "fit, smooth: NLPD above hetGP's" in targets


# --- Report and command ------------------------------------------------------


def test_numbers_have_four_digits_and_what_lacks_is_a_dash():
    table = value_table({"a": {"ms": 1.23456, "word": "yes"}, "b": {"ms": 12345.6}})
    assert table.rows == (("a", "1.235", "yes"), ("b", "12346", "-"))


def test_targets_say_what_was_wanted_and_whether_it_is_met():
    for target, wanted, met in (
        (at_least("speed", 31.0, 30.0), "at least 30", True),
        (at_least("speed", 29.0, 30.0), "at least 30", False),
        (at_most("error", 6.0, 5.0), "at most 5", False),
        (between("coverage", 0.95, 0.9, 0.98), "0.9 to 0.98", True),
        (between("coverage", 0.99, 0.9, 0.98), "0.9 to 0.98", False),
    ):
        assert (target.wanted, target.met) == (wanted, met)


def test_speed_prints_tables_and_writes_where_they_come_from(
    gplfd, tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(policies, "_GRID", np.linspace(0.0, 1.0, 101))
    assert list(PARTS) == list(PartName.__args__)  # type: ignore[attr-defined]
    assert gplfd("speed", "--only", "adapt", "--repeats", "1", "--out", "out") == 0
    written = json.loads((tmp_path / "out" / "speed.json").read_text())
    (result,) = written["results"].values()
    (time,) = result["rows"]["predict, 200 phases"].values()
    (cpu,) = time["cpu"]
    assert cpu > 0.0
    assert written["versions"]["numpy"] == np.__version__
    assert written["config"]["only"] == ["adapt"]
    pools = written["measured_on"]["thread_pools"]
    assert all(pool["num_threads"] == 1 for pool in pools)
    assert written["measured_on"]["processor"]
    assert "process: one via-point" in result["rows"]
    assert result["targets"][0]["name"] == "adapt: predict, 200 phases [ms]"
    printed = capsys.readouterr()
    assert "measuring adapt: about 1 min" in printed.err
    assert "predict, 200 phases, first time" in printed.out
    assert "targets" in printed.out


@pytest.mark.usefixtures("without_peers", "small_fit")
def test_plain_installation_gets_a_line_that_says_what_is_missing(gplfd, capsys):
    assert gplfd("speed", "--only", "fit", "--repeats", "1", "--out", "out") == 0
    printed = capsys.readouterr()
    assert "without hetgpy, not installed (pip install 'gplfd[bench]')" in printed.err
    lines = [line.split() for line in printed.out.splitlines()]
    assert ["hetgpy", "hetGP,", "smooth", "not", "installed", *"----"] in lines
    assert "hetGP's time" not in printed.out
