"""The bookkeeping of `gplfd speed`; how fast anything is depends on the machine."""

import dataclasses
import importlib.util
import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from experiments import cli
from experiments.benchmarks import calibration, doors, fitting, peers, recorded, timing
from experiments.benchmarks.artificial import KnownProcess, door_opening
from experiments.benchmarks.parts import PARTS
from experiments.benchmarks.report import Table, Target, target_table
from experiments.benchmarks.scaling import log_log_slopes
from experiments.benchmarks.scores import Score, score
from experiments.benchmarks.timing import Candidate, CpuTime, interleaved, repeated
from experiments.commands.speed import PartName
from policies.skill import fit_skill

Gplfd = Callable[..., int]


@pytest.fixture
def gplfd(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Gplfd:
    """Run the command in an empty folder; parser errors become exit statuses."""
    monkeypatch.chdir(tmp_path)
    for variable in cli._THREADS:
        monkeypatch.setenv(variable, "1")

    def run(*arguments: str) -> int:
        try:
            return cli.main(arguments)
        except SystemExit as error:
            return int(error.code or 0)

    return run


def without(monkeypatch: pytest.MonkeyPatch, *modules: str) -> None:
    """Pretend that libraries are not installed."""
    real = importlib.util.find_spec
    monkeypatch.setattr(
        peers.importlib.util,
        "find_spec",
        lambda name: None if name in modules else real(name),
    )


# --- Timing ------------------------------------------------------------------


class Clock:
    """A clock that moves when told."""

    now = 0.0

    def advance(self, seconds: float) -> None:
        self.now += seconds


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(timing.time, "process_time", lambda: clock.now)
    return clock


def test_candidates_run_in_turns_after_a_round_that_does_not_count(
    clock: Clock,
) -> None:
    calls: list[str] = []

    def entrant(name: str, first: float, later: float) -> Candidate:
        def act() -> None:
            clock.advance(later if name in calls else first)
            calls.append(name)

        return repeated(act)

    entrants = {"a": entrant("a", 9.0, 2.0), "b": entrant("b", 9.0, 3.0)}
    times = interleaved(entrants, repeats=3)
    assert calls == ["a", "b"] * 4
    assert times["a"] == CpuTime(median=2.0, low=2.0, high=2.0, repeats=3)
    assert times["b"].median == 3.0


def test_preparation_is_not_timed_and_times_are_per_operation(clock: Clock) -> None:
    def prepare() -> timing.Action:
        clock.advance(100.0)
        return lambda: clock.advance(6.0)

    (time,) = interleaved({"a": Candidate(prepare=prepare, operations=3)}, 1).values()
    assert time.median == 2.0
    (time,) = interleaved({"a": repeated(lambda: clock.advance(0.5), 7)}, 1).values()
    assert time.median == pytest.approx(0.5)


def test_quartiles_show_the_spread() -> None:
    time = CpuTime.of([5e-3, 1e-3, 2e-3, 4e-3, 3e-3])
    assert time == CpuTime(median=3e-3, low=2e-3, high=4e-3, repeats=5)
    assert str(time) == "3.00 [2.00, 4.00]"


def test_no_repeats_are_refused() -> None:
    with pytest.raises(ValueError, match="repeats must be 1 or more, got 0"):
        interleaved({}, 0)


def test_slopes_of_a_power_law_are_its_exponents() -> None:
    sizes = [(d, m) for d in (2, 6, 20) for m in (100, 400)]
    seconds = [3e-3 * d**0.25 * m**1.5 for d, m in sizes]
    assert log_log_slopes(sizes, seconds) == pytest.approx((0.25, 1.5))


# --- Scores and data ---------------------------------------------------------


@pytest.mark.parametrize("kind", ["independent", "smooth"])
def test_true_model_covers_95_percent_and_costs_its_entropy(kind: str) -> None:
    process = KnownProcess.on_grid(50)
    drawn = process.draw(600, kind, np.random.default_rng(0))  # type: ignore[arg-type]
    known = score(drawn, process.mean, process.std)
    assert known.coverage == pytest.approx(0.95, abs=0.01)
    entropy = 0.5 * math.log(2 * math.pi * math.e) + np.mean(np.log(process.std))
    assert known.nlpd == pytest.approx(entropy, abs=0.04)


def test_smooth_deviations_of_neighbours_agree_and_independent_ones_do_not() -> None:
    process = KnownProcess.on_grid(200)
    correlation = {}
    for kind in ("independent", "smooth"):
        drawn = process.draw(50, kind, np.random.default_rng(0))  # type: ignore[arg-type]
        deviation = (drawn - process.mean) / process.std
        correlation[kind] = np.mean(deviation[:, 1:] * deviation[:, :-1])
    assert correlation["smooth"] == pytest.approx(0.99, abs=0.1)
    assert correlation["independent"] == pytest.approx(0.0, abs=0.02)


def test_stated_interval_is_judged_apart_from_the_standard_deviation() -> None:
    held_out = np.array([[-2.5], [0.0], [1.0], [2.5]])[:, None, :] * np.ones((1, 3, 6))
    zero, one = np.zeros((3, 6)), np.ones((3, 6))
    known = score(held_out, zero, one, (-3.0 * one, 3.0 * one))
    assert known.coverage == 0.5
    assert known.interval_coverage == 1.0


def test_scores_average_and_leave_out_what_nobody_states() -> None:
    scores = [Score(nlpd=1.0, coverage=0.9), Score(nlpd=2.0, coverage=1.0)]
    assert Score.mean_of(scores) == Score(nlpd=1.5, coverage=0.95)
    with pytest.raises(ValueError, match="no scores"):
        Score.mean_of([])


def test_excess_is_over_the_true_model_on_the_same_data(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(calibration, "_CASES", (("independent", 20),))
    (row,) = calibration.calibrate(seeds=1).rows
    assert row.excess == pytest.approx(row.score.nlpd - row.truth.nlpd)
    assert 0.0 < row.excess < 0.02
    assert row.truth.coverage == pytest.approx(0.95, abs=0.01)


def test_door_opening_without_wobble_is_the_arc() -> None:
    times = np.linspace(0.0, 1.0, 20)
    poses = door_opening(0.4, times, np.random.default_rng(0), wobble_std=0.0)
    from_hinge = np.hypot(poses[:, 0], poses[:, 2] + 0.4)
    np.testing.assert_allclose(from_hinge, 0.4, rtol=1e-12)
    assert poses[-1, 4] == pytest.approx(math.radians(67.0))


# --- Parts -------------------------------------------------------------------


def test_command_offers_every_part() -> None:
    assert list(PARTS) == list(PartName.__args__)  # type: ignore[attr-defined]


def test_peers_learn_the_same_as_the_skill() -> None:
    rng = np.random.default_rng(0)
    given = KnownProcess.on_grid(60).demonstrations(20, "independent", rng)
    predicted = fit_skill(given).predict(given.times)
    mean, std = peers.sklearn_fit(given.times, given.poses)
    assert np.abs((mean - predicted.mean) / predicted.std).max() < 0.2
    np.testing.assert_allclose(std, predicted.std, rtol=0.25)
    mean, std = peers.hetgpy_fit(given.times, given.poses)
    assert np.abs((mean - predicted.mean) / predicted.std).max() < 0.4
    np.testing.assert_allclose(std, predicted.std, rtol=0.4)


def test_dtw_python_finds_paths_of_our_cost() -> None:
    from policies.dynamic_time_warping import dynamic_time_warping

    rng = np.random.default_rng(0)
    a, b = np.sort(rng.uniform(size=(2, 40)), axis=1)
    rows, columns = peers.dtw_python(a, b)
    ours = dynamic_time_warping(lambda row: np.abs(b - a[row]), len(a))
    assert np.abs(a[rows] - b[columns]).sum() == pytest.approx(ours.cost)


def test_missing_libraries_leave_a_line_and_no_target(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    without(monkeypatch, "hetgpy", "sklearn")
    comparison = fitting.compare_fits(repeats=1)
    (table,) = comparison.tables()
    lines = [row[:2] for row in table.rows]
    assert ("hetgpy hetGP, independent", "not installed") in lines
    assert ("scikit-learn, collapsed, smooth", "not installed") in lines
    assert comparison.targets() == ()
    ours = next(row for row in comparison.rows if row.library == "gplfd")
    assert ours.time is not None


def test_left_out_radius_is_not_learned_from(monkeypatch: pytest.MonkeyPatch) -> None:
    learned = []

    def learn(aligned: object) -> object:
        learned.append(aligned.poses)  # type: ignore[attr-defined]
        return fit_skill(aligned)  # type: ignore[arg-type]

    monkeypatch.setattr(doors, "fit_skill", learn)
    monkeypatch.setattr(doors, "_EVERY", 60)
    aligned, radii = doors._arcs((0.3, 0.4, 0.5), np.random.default_rng(0))
    row = doors.judge_form("three", "exact", [(aligned, radii)])
    for fold, poses in enumerate(learned):
        expected = np.delete(aligned.poses, [2 * fold, 2 * fold + 1], axis=0)
        np.testing.assert_array_equal(poses, expected)
    assert len(learned) == 3
    assert 0.0 < row.soon.rmse < row.rest.rmse < 0.3


def test_door_targets_compare_with_the_product_of_the_same_doors() -> None:
    def row(form: str, rest: float) -> doors.DoorRow:
        good = doors.Forecast(rmse=4e-3, coverage=0.9, interval_coverage=0.95)
        return doors.DoorRow(
            doors="some",
            form=form,
            soon=good,
            rest=dataclasses.replace(good, rmse=rest),
        )

    result = doors.DoorForecasts(rows=(row("product", 0.08), row("process", 0.06)))
    targets = {target.name: target for target in result.targets()}
    ratio = targets["accuracy, some: rmse of the rest / product's"]
    assert ratio.value == pytest.approx(0.75)
    assert not ratio.met
    assert targets["accuracy, some: rmse of the next 20 [mm]"].met


# --- Recorded demonstrations -------------------------------------------------


def save_array(path: Path, count: int = 4, unit: float = 100.0) -> np.ndarray:
    """Openings of doors as positions [cm] and quaternions, w first."""
    rng = np.random.default_rng(0)
    times = np.linspace(0.0, 1.0, 80)
    poses = np.stack([door_opening(0.5, times, rng) for _ in range(count)])
    quaternions = [
        Rotation.from_rotvec(one[:, 3:]).as_quat(scalar_first=True) for one in poses
    ]
    np.save(path, np.concatenate([unit * poses[:, :, :3], quaternions], axis=2))
    return poses


def test_arrays_are_read_in_metres_and_one_frame(tmp_path: Path) -> None:
    poses = save_array(tmp_path / "demos.npy")
    loaded = recorded.load_recordings(tmp_path / "demos.npy", unit="cm")
    assert len(loaded) == 4
    np.testing.assert_allclose(loaded[0].poses[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(loaded[2].poses, poses[2], atol=1e-12)


def test_every_recording_is_left_out_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save_array(tmp_path / "demos.npy", count=5)
    loaded = recorded.load_recordings(tmp_path / "demos.npy", unit="cm")
    learned = []

    def learn(aligned: object) -> object:
        learned.append(aligned.poses)  # type: ignore[attr-defined]
        return fit_skill(aligned)  # type: ignore[arg-type]

    monkeypatch.setattr(recorded, "fit_skill", learn)
    result = recorded.score_recordings(loaded, "demos.npy")
    assert [len(poses) for poses in learned] == [4] * 10
    firsts = [poses[0, -1, 0] for poses in learned[:5]]
    assert len(set(firsts)) == 2  # only the first fold lacks the first recording
    assert [row.clock for row in result.rows] == [
        *("aligned by completion", "clock as recorded")
    ]
    assert all(row.worst_nlpd >= row.score.nlpd for row in result.rows)


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (np.zeros((4, 9, 6)), r"got \(4, 9, 6\)"),
        (np.zeros((4, 9)), r"shape \(demonstrations, samples, 7\).*got \(4, 9\)"),
        (None, r"holds 2 demonstration\(s\); leaving one out needs 3 or more"),
    ],
)
def test_unusable_recordings_are_refused(
    tmp_path: Path, array: np.ndarray | None, message: str
) -> None:
    path = tmp_path / "demos.npy"
    if array is None:
        save_array(path, count=2)
    else:
        np.save(path, array)
    with pytest.raises(ValueError, match=message):
        recorded.load_recordings(path, unit="cm")


def test_other_files_are_refused(tmp_path: Path) -> None:
    for name, content in (("empty.npy", ""), ("notes.txt", "not an array")):
        (tmp_path / name).write_text(content)
        with pytest.raises(ValueError, match=f"{name} is neither demonstrations"):
            recorded.load_recordings(tmp_path / name)


# --- Report and command ------------------------------------------------------


def test_table_is_aligned_text() -> None:
    table = Table(
        title="what", columns=("", "ms"), rows=(("long name", "1.5"), ("b", "10.25"))
    )
    assert str(table).splitlines() == [
        *("what", "                ms", "  long name    1.5", "  b          10.25")
    ]


def test_targets_say_what_was_wanted_and_whether_it_is_met() -> None:
    targets = (
        Target(name="speed", value=31.0, low=30.0),
        Target(name="error", value=6.0, high=5.0),
        Target(name="coverage", value=0.95, low=0.9, high=0.98),
    )
    assert target_table(targets).rows == (
        ("speed", "31", "at least 30", "met"),
        ("error", "6", "at most 5", "MISSED"),
        ("coverage", "0.95", "0.9 to 0.98", "met"),
    )


def test_speed_prints_tables_and_writes_where_they_come_from(
    gplfd: Gplfd, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save_array(tmp_path / "demos.npy")
    arguments = ["--only", "predict", "--repeats", "1", "--out", "out"]
    recordings = ["--demonstrations", "demos.npy", "--unit", "cm"]
    assert gplfd("speed", *arguments, *recordings) == 0
    written = json.loads((tmp_path / "out" / "speed.json").read_text())
    assert set(written["results"]) == {"predict", "recorded"}
    assert written["results"]["predict"]["at_200"]["median"] > 0.0
    assert written["versions"]["numpy"] == np.__version__
    assert written["config"]["only"] == ["predict"]
    pools = written["measured_on"]["thread_pools"]
    assert all(pool["num_threads"] == 1 for pool in pools)
    assert written["measured_on"]["processor"]
    names = [target["name"] for target in written["targets"]]
    assert names[0] == "predict: 200 phases [ms]"
    printed = capsys.readouterr().out
    assert "200 phases, first time" in printed
    assert "aligned by completion" in printed
    assert "targets" in printed


def test_part_asked_for_names_the_missing_libraries(
    gplfd: Gplfd,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    without(monkeypatch, "hetgpy")
    assert gplfd("speed", "--only", "fit", "--out", "out") == 2
    complaint = capsys.readouterr().err
    assert "needs hetgpy, which is not installed" in complaint
    assert "pip install 'gplfd[bench]'" in complaint
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--repeats", "0"], "--repeats 0 must be 1 or more"),
        (["--out", "taken"], "--out taken is a file; give a folder"),
        (["--demonstrations", "none.npy"], "none.npy: No such file"),
    ],
)
def test_wrong_arguments_are_named_before_anything_runs(
    gplfd: Gplfd,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    message: str,
) -> None:
    (tmp_path / "taken").touch()
    assert gplfd("speed", *arguments) == 2
    printed = capsys.readouterr()
    assert message in printed.err
    assert printed.out == ""
