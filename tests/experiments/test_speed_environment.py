"""What `gplfd speed` says of the environment is counted as it claims."""

import itertools
from typing import Any

import mujoco
import numpy as np
import pytest

import gplfd_env.scene.build
from gplfd_env import ENVIRONMENT_ID, IMPEDANCE_ENVIRONMENT_ID
from gplfd_env.task.episode import Episode
from gplfd_experiments.speed import environment, timing
from gplfd_experiments.speed.environment import (
    measure_resets,
    measure_steps,
    measure_vectors,
)
from gplfd_experiments.speed.timing import Timed, Timing

pytestmark = pytest.mark.slow

# --- Steps -------------------------------------------------------------------


@pytest.fixture
def few_steps(monkeypatch):
    monkeypatch.setattr(environment, "_STEPS", 30)
    monkeypatch.setattr(environment, "_ROUNDS", 1)


@pytest.mark.usefixtures("few_steps")
def test_physics_is_repeated_bit_for_bit_with_the_gains_of_every_step(monkeypatch):
    ids, alike = [ENVIRONMENT_ID, IMPEDANCE_ENVIRONMENT_ID], "bit for bit"
    for repeated in ([alike, alike], [alike, "DEPARTS"]):
        rows = measure_steps(1).rows
        assert list(rows) == ids
        assert [row["physics repeated"] for row in rows.values()] == repeated
        monkeypatch.setattr(environment, "_gains", lambda model: np.zeros(1))


@pytest.mark.usefixtures("few_steps")
def test_step_is_compared_with_its_own_physics(monkeypatch):
    now = 0.0

    def timed(work: Any, seconds: float) -> Any:
        def run(*arguments: Any, **settings: Any) -> Any:
            nonlocal now
            now += seconds
            return work(*arguments, **settings)

        return run

    monkeypatch.setattr(timing.time, "process_time", lambda: now)
    for owner, name, seconds in (
        (mujoco, "mj_step", 100e-6),
        (Episode, "observation", 25e-6),
    ):
        monkeypatch.setattr(owner, name, timed(getattr(owner, name), seconds))
    result = measure_steps(2)
    for row in result.rows.values():
        found = [row[f"{name} µs"] for name in ("step", "physics", "beyond")]
        assert found == pytest.approx([125.0, 100.0, 25.0])
        assert row["ratio"] == pytest.approx(1.25)
    assert [target.met for target in result.targets] == [False, True] * 2


# --- Resets ------------------------------------------------------------------


def test_only_new_radii_compile_a_scene(monkeypatch):
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
    assert [target.value for target in result.targets] == [2.0] * 3
    assert [target.met for target in result.targets] == [False, False, True]


# --- Vectors -----------------------------------------------------------------


def test_every_way_to_step_does_the_same_bit_for_bit(monkeypatch):
    settings = {"PERIODS": 3, "LEAST_STEPS": 1, "SIMULATIONS": (1, 2, 64)}
    for name, value in settings.items():
        monkeypatch.setattr(environment, f"_{name}", value)
    result = measure_vectors(1)
    assert "same states bit for bit" in result.title
    sizes = itertools.product((1, 2), (1, 2, 64))
    names = [environment.vector_name(count, threads) for threads, count in sizes]
    assert list(result.rows) == [
        *(environment.PHYSICS, environment.PHYSICS_IN_TURNS),
        *(environment.SINGLE, environment.SYNC, *names),
    ]


def test_a_way_that_does_something_else_is_reported(monkeypatch):
    for name, value in (("_PERIODS", 3), ("_SIMULATIONS", ()), ("_THREADS", ())):
        monkeypatch.setattr(environment, name, value)
    ways = environment._ways_to_step()
    same = {name: ways[name] for name in (environment.PHYSICS, environment.SYNC)}
    assert environment._end_alike(same)
    end = same[environment.SYNC].prepare()()
    other = Timed(prepare=lambda: lambda: end + 1e-9)
    assert not environment._end_alike({**same, "other": other})


def test_vectors_are_compared_with_sync_by_the_clock_and_physics_in_cpu_time(
    monkeypatch,
):
    found = {
        environment.PHYSICS: Timing(wall=(1.0,), cpu=(100e-6,)),
        environment.SYNC: Timing(wall=(200e-6,), cpu=(1.0,)),
        environment.vector_name(2, 2): Timing(wall=(80e-6,), cpu=(9.0,)),
        environment.vector_name(64, 2): Timing(wall=(9.0,), cpu=(120e-6,)),
    }
    monkeypatch.setattr(environment, "_ways_to_step", dict)
    monkeypatch.setattr(environment, "_end_alike", lambda _: True)
    monkeypatch.setattr(environment, "measure", lambda *_, **__: found)
    few, many = measure_vectors(1).targets
    assert (few.value, few.met) == (pytest.approx(2.5), True)
    assert (many.value, many.met) == (pytest.approx(1.2), False)
