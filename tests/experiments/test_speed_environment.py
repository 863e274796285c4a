"""What `gplfd speed` says of the environment is counted as it claims."""

import itertools
from typing import Any

import mujoco
import numpy as np
import pytest

import gplfd_env.scene.build
from gplfd_env import ENVIRONMENT_ID, IMPEDANCE_ENVIRONMENT_ID
from gplfd_env.task.episode import Episode
from gplfd_experiments.speed import environment, timing, vectors
from gplfd_experiments.speed.environment import measure_resets, measure_steps
from gplfd_experiments.speed.timing import Timed, Timing
from gplfd_experiments.speed.vectors import measure_vectors

# --- Steps -------------------------------------------------------------------


@pytest.fixture
def few_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(environment, "_STEPS", 60)
    monkeypatch.setattr(environment, "_ROUNDS", 1)


@pytest.mark.usefixtures("few_steps")
def test_physics_of_both_environments_is_repeated_bit_for_bit() -> None:
    rows = measure_steps(1).rows
    assert list(rows) == [ENVIRONMENT_ID, IMPEDANCE_ENVIRONMENT_ID]
    assert [row["physics repeated"] for row in rows.values()] == ["bit for bit"] * 2


@pytest.mark.usefixtures("few_steps")
def test_physics_without_the_gains_of_every_step_departs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(environment, "_gains", lambda model: np.zeros(1))
    rows = measure_steps(1).rows
    assert [row["physics repeated"] for row in rows.values()] == [
        "bit for bit",
        "DEPARTS",
    ]


@pytest.mark.usefixtures("few_steps")
def test_step_is_compared_with_its_own_physics(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 0.0

    def work(seconds: float) -> None:
        nonlocal now
        now += seconds

    physics, observe = mujoco.mj_step, Episode.observation

    def timed_physics(*arguments: Any, **settings: Any) -> None:
        work(100e-6)
        physics(*arguments, **settings)

    def timed_observation(*arguments: Any) -> Any:
        work(25e-6)
        return observe(*arguments)

    monkeypatch.setattr(timing.time, "process_time", lambda: now)
    monkeypatch.setattr(mujoco, "mj_step", timed_physics)
    monkeypatch.setattr(Episode, "observation", timed_observation)
    result = measure_steps(2)
    for row in result.rows.values():
        assert row["step µs"] == pytest.approx(125.0)
        assert row["physics µs"] == pytest.approx(100.0)
        assert row["beyond µs"] == pytest.approx(25.0)
        assert row["ratio"] == pytest.approx(1.25)
    assert [target.met for target in result.targets] == [False, True] * 2


# --- Resets ------------------------------------------------------------------


def test_only_new_radii_compile_a_scene(monkeypatch: pytest.MonkeyPatch) -> None:
    build, built, compiled = gplfd_env.scene.build.build_spec, [], {}

    def counted(*arguments: Any, **settings: Any) -> mujoco.MjSpec:
        built.append(arguments)
        return build(*arguments, **settings)

    def run(actions: dict[str, Timed], repeats: int) -> dict[str, Timing]:
        assert repeats == 3
        for name, timed in actions.items():
            action = timed.prepare()
            built.clear()
            action()
            compiled[name] = len(built), timed.operations
        return {name: Timing(cpu=(0.002,), wall=(9.0,)) for name in actions}

    monkeypatch.setattr(gplfd_env.scene.build, "build_spec", counted)
    monkeypatch.setattr(environment, "measure", run)
    result = measure_resets(3)
    assert compiled == {
        "the same door": (0, 20),
        "new friction and mass": (0, 20),
        "a radius met before": (0, 20),
        "a new radius": (5, 5),
    }
    assert [(target.value, target.met) for target in result.targets] == [
        (2.0, False),
        (2.0, False),
        (2.0, True),
    ]


# --- Vectors -----------------------------------------------------------------


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(vectors, "_PERIODS", 3)
    monkeypatch.setattr(vectors, "_LEAST_STEPS", 1)
    monkeypatch.setattr(vectors, "_SIMULATIONS", (1, 2, 64))


@pytest.mark.usefixtures("short")
def test_every_way_to_step_does_the_same_bit_for_bit() -> None:
    result = measure_vectors(1)
    assert "same states bit for bit" in result.title
    sizes = itertools.product((1, 2), (1, 2, 64))
    names = [vectors.vector_name(count, threads) for threads, count in sizes]
    assert list(result.rows) == [
        vectors.PHYSICS,
        vectors.PHYSICS_IN_TURNS,
        vectors.SINGLE,
        vectors.SYNC,
        *names,
    ]


@pytest.mark.usefixtures("short")
def test_a_way_that_does_something_else_is_reported() -> None:
    commands = vectors._commands()
    same = {"raw": vectors._physics(commands), "sync": vectors._vector(commands, 2)}
    assert vectors._end_alike(same)
    other = vectors._single(commands + 1e-9)
    assert not vectors._end_alike({**same, "other": other})


@pytest.mark.usefixtures("short")
def test_vectors_are_compared_with_sync_by_the_clock_and_physics_in_cpu_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = {
        vectors.PHYSICS: Timing(wall=(1.0,), cpu=(100e-6,)),
        vectors.SYNC: Timing(wall=(200e-6,), cpu=(1.0,)),
        vectors.vector_name(2, 2): Timing(wall=(80e-6,), cpu=(9.0,)),
        vectors.vector_name(64, 2): Timing(wall=(9.0,), cpu=(120e-6,)),
    }
    monkeypatch.setattr(vectors, "measure", lambda *_, **__: found)
    few, many = measure_vectors(1).targets
    assert (few.value, few.met) == (pytest.approx(2.5), True)
    assert (many.value, many.met) == (pytest.approx(1.2), False)
