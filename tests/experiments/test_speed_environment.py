"""What `gplfd speed` says of the environment is counted as it claims."""

import itertools
from typing import Any

import mujoco
import pytest

import gplfd_env.scene
from experiments.benchmarks import loops, resetting, stepping, throughput, vectors
from experiments.benchmarks.elsewhere import quote_elsewhere
from experiments.benchmarks.loops import Loops, measure_loops
from experiments.benchmarks.recording_cost import RecordingCost, measure_recording
from experiments.benchmarks.report import Target
from experiments.benchmarks.resetting import Resetting, measure_resets
from experiments.benchmarks.stepping import Stepped, Stepping, measure_stepping
from experiments.benchmarks.throughput import Entrant, Load, Pace, measure_paces
from experiments.benchmarks.timing import Candidate, CpuTime
from experiments.benchmarks.vectors import Vectors, measure_vectors
from gplfd_env import ENVIRONMENT_ID, IMPEDANCE_ENVIRONMENT_ID
from gplfd_env.door_opening import DoorOpeningEnv

IDLE = Load(before=0.0, after=0.5, cores=2)


class Clock:
    """Wall and CPU clocks that move when told [s]."""

    wall = 0.0
    cpu = 0.0

    def work(self, seconds: float, *, waiting: float = 0.0) -> None:
        self.cpu += seconds
        self.wall += seconds + waiting


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(throughput.time, "perf_counter", lambda: clock.wall)
    monkeypatch.setattr(throughput.time, "process_time", lambda: clock.cpu)
    monkeypatch.setattr(stepping.time, "thread_time_ns", lambda: round(1e9 * clock.cpu))
    return clock


def pace(wall: float, cpu: float | None = None) -> Pace:
    """Return a pace of one round [s]."""
    return Pace(wall=(wall,), cpu=(wall if cpu is None else cpu,))


def outcomes(targets: tuple[Target, ...]) -> list[tuple[float, bool]]:
    return [(pytest.approx(target.value), target.met) for target in targets]


# --- Steps -------------------------------------------------------------------


def test_both_environments_are_replayed_bit_for_bit(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(stepping, "_STEPS", 60)
    result = measure_stepping(1)
    ids = [one.environment_id for one in result.environments]
    assert ids == [ENVIRONMENT_ID, IMPEDANCE_ENVIRONMENT_ID]
    assert all(one.identical for one in result.environments)
    (table,) = result.tables()
    assert [row[-1] for row in table.rows] == ["bit for bit"] * 2


def test_replay_without_the_gains_of_every_step_departs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(stepping, "_STEPS", 60)
    monkeypatch.setattr(stepping, "_WRITTEN", ())
    result = measure_stepping(1)
    assert [one.identical for one in result.environments] == [True, False]
    (table,) = result.tables()
    assert [row[-1] for row in table.rows] == ["bit for bit", "DEPARTS"]


def test_step_is_compared_with_its_own_physics(
    clock: Clock, monkeypatch: pytest.MonkeyPatch
) -> None:
    physics, observe = mujoco.mj_step, DoorOpeningEnv._observation

    def timed_physics(*arguments: Any, **settings: Any) -> None:
        clock.work(100e-6)
        physics(*arguments, **settings)

    def timed_observation(*arguments: Any) -> Any:
        clock.work(15e-6)
        return observe(*arguments)

    monkeypatch.setattr(mujoco, "mj_step", timed_physics)
    monkeypatch.setattr(DoorOpeningEnv, "_observation", timed_observation)
    monkeypatch.setattr(stepping, "_STEPS", 12)
    for one in measure_stepping(2).environments:
        assert one.step == pytest.approx(115e-6)
        assert one.physics == pytest.approx(100e-6)
        assert one.ratio == pytest.approx(1.15)


def test_step_targets_are_what_is_beyond_the_physics() -> None:
    def stepped(step: float, physics: float, ratio: float) -> Stepped:
        return Stepped(
            environment_id="id", step=step, physics=physics, ratio=ratio, identical=True
        )

    result = Stepping(
        environments=(stepped(119e-6, 100e-6, 1.2), stepped(131e-6, 100e-6, 1.31)),
        rounds=1,
    )
    assert outcomes(result.targets()) == [
        *((19.0, True), (1.2, True)),
        *((31.0, False), (1.31, False)),
    ]


# --- Resets ------------------------------------------------------------------


def test_only_new_radii_compile_a_scene(monkeypatch: pytest.MonkeyPatch) -> None:
    build, built, compiled = gplfd_env.scene.build_spec, [], {}

    def counted(*arguments: Any, **settings: Any) -> mujoco.MjSpec:
        built.append(arguments)
        return build(*arguments, **settings)

    def run(candidates: dict[str, Candidate], repeats: int) -> dict[str, CpuTime]:
        assert repeats == 3
        for name, candidate in candidates.items():
            action = candidate.prepare()
            built.clear()
            action()
            compiled[name] = len(built), candidate.operations
        return {name: CpuTime.of([1.0]) for name in candidates}

    monkeypatch.setattr(gplfd_env.scene, "build_spec", counted)
    monkeypatch.setattr(resetting, "interleaved", run)
    measure_resets(3)
    assert compiled == {
        "same_door": (0, 20),
        "new_physics": (0, 20),
        "known_radius": (0, 20),
        "new_radius": (5, 5),
    }


def test_reset_targets_are_in_milliseconds() -> None:
    half, two, thirty = (CpuTime.of([seconds]) for seconds in (5e-4, 2e-3, 3e-2))
    result = Resetting(
        same_door=half, new_physics=two, known_radius=half, new_radius=thirty
    )
    assert outcomes(result.targets()) == [(0.5, True), (2.0, False), (30.0, False)]
    (table,) = result.tables()
    assert len(table.rows) == 4


# --- Throughput --------------------------------------------------------------


def test_entrants_run_in_turns_and_only_their_runs_are_timed(clock: Clock) -> None:
    calls: list[str] = []

    def entrant(name: str, steps: int, first: float) -> Entrant:
        def begin() -> None:
            calls.append(f"begin {name}")
            clock.work(100.0)

        def run() -> None:
            warm = calls.count(f"run {name}") > 0
            calls.append(f"run {name}")
            clock.work(2.0 if warm else first, waiting=4.0)

        return Entrant(begin=begin, run=run, steps=steps)

    entrants = {"few": entrant("few", 10, 2.0), "many": entrant("many", 20, 50.0)}
    paces, load = measure_paces(entrants, 3, least_steps=11)
    turn = ["begin few", "run few"] * 2 + ["begin many", "run many"]
    assert calls == turn * 4  # the first warms up
    assert paces["few"] == Pace(wall=(0.6,) * 3, cpu=(0.2,) * 3)
    assert paces["many"] == Pace(wall=(0.3,) * 3, cpu=(0.1,) * 3)
    assert load.cores is None or load.cores >= 1


def test_single_round_is_counted(clock: Clock) -> None:
    entrant = Entrant(begin=lambda: None, run=lambda: clock.work(1.0), steps=4)
    assert measure_paces({"one": entrant}, 1)[0]["one"] == pace(0.25)
    assert clock.cpu == 1.0


def test_ratios_are_medians_over_rounds_not_ratios_of_medians() -> None:
    # The machine was three times slower in the last two rounds.
    ours = Pace(wall=(1.0, 3.0, 3.0), cpu=(2.0, 4.0, 4.0))
    theirs = Pace(wall=(2.0, 6.0, 9.0), cpu=(1.0, 1.0, 4.0))
    assert ours.rate == pytest.approx(1 / 3)
    assert ours.cost == 4.0
    assert ours.speed_up(theirs) == 2.0
    assert theirs.speed_up(ours) == 0.5
    assert ours.cost_ratio(theirs) == 2.0


def test_load_is_told_where_it_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    assert str(Load(before=0.44, after=1.9, cores=2)) == "load 0.4 to 1.9 on 2 cores"
    monkeypatch.delattr(throughput.os, "getloadavg", raising=False)
    _, load = measure_paces({}, 1)
    assert (load.before, load.after) == (None, None)
    assert str(load).startswith("load unknown")


# --- Vectors -----------------------------------------------------------------


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(vectors, "_PERIODS", 3)
    monkeypatch.setattr(vectors, "_LEAST_STEPS", 1)
    monkeypatch.setattr(vectors, "_SIMULATIONS", (1, 2, 64))
    monkeypatch.setattr(loops, "_PERIODS", 4)
    monkeypatch.setattr(loops, "_AGENTS", (2,))


def test_every_way_to_step_does_the_same_bit_for_bit(short: None) -> None:
    result = measure_vectors(1)
    assert result.identical
    sizes = itertools.product((1, 2), (1, 2, 64))
    names = [vectors.vector_name(count, threads) for threads, count in sizes]
    others = [vectors.RAW, vectors.RAW_MANY, vectors.SINGLE, vectors.SYNC]
    assert list(result.paces) == [*others, *names]
    (table,) = result.tables()
    assert [row[0] for row in table.rows] == list(result.paces)
    assert "bit for bit" in table.title


def test_a_loop_that_does_something_else_is_told(short: None) -> None:
    commands = vectors._opening()
    same = {"raw": vectors._raw(commands), "sync": vectors._vector(commands, 2)}
    assert vectors._agree(same)
    other = vectors._single(commands + 1e-9)
    assert not vectors._agree({**same, "other": other})
    result = Vectors(
        paces={vectors.RAW: pace(1.0), vectors.SYNC: pace(2.0)},
        identical=False,
        load=IDLE,
    )
    assert "DEPART" in result.tables()[0].title


def test_vector_targets_compare_with_sync_on_the_wall_and_physics_in_cpu_time() -> None:
    def result(few: Pace, many: Pace) -> Vectors:
        paces = {
            vectors.RAW: pace(100e-6),
            vectors.SYNC: pace(200e-6),
            vectors.vector_name(2, 2): few,
            vectors.vector_name(64, 2): many,
        }
        return Vectors(paces=paces, identical=True, load=IDLE)

    fast = result(few=pace(80e-6, 150e-6), many=pace(55e-6, 110e-6))
    assert outcomes(fast.targets()) == [(2.5, True), (1.1, True)]
    slow = result(few=pace(100e-6, 80e-6), many=pace(60e-6, 120e-6))
    assert outcomes(slow.targets()) == [(2.0, False), (1.2, False)]


# --- Agents and recordings ---------------------------------------------------


def test_deciding_is_counted_per_control_step(
    short: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    # One microsecond passes between any two looks at the clock.
    clock = itertools.count(step=1000)
    monkeypatch.setattr(loops.time, "thread_time_ns", lambda: next(clock))
    result = measure_loops(2)
    together = loops.TOGETHER.format(2, 2)
    assert list(result.paces) == [loops.ALONE, together]
    assert result.deciding == {
        loops.ALONE: pytest.approx(1e-6),
        together: pytest.approx(0.5e-6),
    }
    assert [len(one.wall) for one in result.paces.values()] == [2, 2]


@pytest.mark.parametrize(("seconds", "met"), [(1.9e-4, True), (2.1e-4, False)])
def test_loop_target_is_of_the_largest_batch(seconds: float, met: bool) -> None:
    largest = loops.TOGETHER.format(64, 2)
    paces = {loops.ALONE: pace(1e-6), largest: pace(seconds)}
    result = Loops(paces=paces, deciding=dict.fromkeys(paces, 1e-6), load=IDLE)
    assert outcomes(result.targets()) == [(1.0 / seconds, met)]
    assert len(result.tables()[0].rows) == 2


def test_recording_is_measured_beside_its_episode() -> None:
    result = measure_recording(1)
    assert result.steps > 300
    assert result.bytes > 10_000
    assert result.recording.cost > 0.0
    assert result.rollout.cost > 0.0
    (table,) = result.tables()
    assert [row[0] for row in table.rows] == ["rollout", "recording"]


def test_recording_target_is_a_share_of_the_rollouts_cpu_time() -> None:
    result = RecordingCost(
        rollout=pace(3.0, 1e-3), recording=pace(9.0, 2e-4), steps=500, bytes=10**6
    )
    assert outcomes(result.targets()) == [(0.2, False)]
    assert result.tables()[0].rows == (
        ("rollout", "500", "1000"),
        ("recording", "100", "200"),
    )


# --- Others ------------------------------------------------------------------


def test_quoted_numbers_say_so_and_fit_together(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    result = quote_elsewhere(1)
    assert result.targets() == ()
    assert all("quoted" in table.title for table in result.tables())
    for one in result.steps:
        # The median of ratios is near the ratio of medians, no more.
        assert one.ratio == pytest.approx(one.step / one.physics, rel=0.03), one
        assert "MuJoCo" in one.package
