import math
import time
import weakref
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from gplfd_experiments.episodes.log import PER_STEP, EpisodeLog
from gplfd_experiments.episodes.rollout import ForecastRecorder, Progress, rollout
from gplfd_policies.movements.trajectory import GaussianTrajectory


@pytest.fixture
def run(door_env: Any, arc_agent: Any) -> Callable[..., EpisodeLog]:
    def run(env: Any = None, agent: Any = None, **options: Any) -> EpisodeLog:
        return rollout(
            door_env() if env is None else env,
            arc_agent() if agent is None else agent,
            policy="arc",
            door="medium",
            seed=4,
            **options,
        )

    return run


def test_rows_pair_each_state_with_the_decision_taken_in_it(
    run: Callable[..., EpisodeLog], door_env: Any
) -> None:
    env = door_env()
    log = run(env)
    assert log.times.size == 31
    np.testing.assert_allclose(log.times, 0.01 * np.arange(31), atol=1e-12)
    np.testing.assert_array_equal(log.action[:-1], np.array(env.actions))
    # The door obeys at once: the angle of a row is the command of the row before.
    np.testing.assert_array_equal(log.door_angle[1:], log.action[:-1, 4])
    np.testing.assert_array_equal(log.qpos[:, 0], log.door_angle)
    np.testing.assert_array_equal(log.predicted_mean, log.ee_pose + 0.002)
    assert (log.seed, log.policy, log.dt) == (4, "arc", pytest.approx(0.01))


def test_last_row_is_the_state_in_which_the_episode_ended(
    run: Callable[..., EpisodeLog], door_env: Any
) -> None:
    env = door_env()
    log = run(env)
    assert len(env.actions) == 30
    assert log.solved[-1]
    assert not log.solved[:-1].any()
    assert math.degrees(log.door_angle[-1]) == pytest.approx(66.0)


@pytest.mark.parametrize(
    ("outcome", "success", "failure"),
    [
        ("success", True, ""),
        ("time_limit", False, "time_limit"),
        ("stalled", False, "stalled"),
        ("grasp_lost", False, "grasp_lost"),
    ],
)
def test_failure_is_the_environments_or_the_time_limit(
    run: Callable[..., EpisodeLog],
    door_env: Any,
    outcome: str,
    success: bool,
    failure: str,
) -> None:
    log = run(door_env(outcome))
    assert (log.success, log.failure) == (success, failure)


def test_forecasts_are_taken_first_regularly_and_last(
    run: Callable[..., EpisodeLog],
) -> None:
    log = run(forecast_period=0.12)
    np.testing.assert_allclose(log.forecast_times, [0.0, 0.12, 0.24, 0.3], atol=1e-12)
    # Before the first decision the agent has not been called: its widest belief.
    np.testing.assert_allclose(log.forecast_std[0, -1], 0.05 + 1e-3)
    assert np.all(np.diff(log.forecast_std[:, -1, 0]) < 0.0)


def test_of_a_forecast_nothing_but_its_moments_is_kept() -> None:
    """Trajectories hold on to what they were computed from."""
    moments = np.zeros((3, 6)), np.ones((3, 6))
    forecast = GaussianTrajectory.from_moments(
        np.linspace(0.0, 1.0, 3), *moments, lambda: np.zeros((6, 3, 3))
    )
    made, left = weakref.ref(forecast), [forecast]
    del forecast
    recorder = ForecastRecorder(left.pop, period=0.1)
    recorder.take_if_due(0.0, force=False)
    assert made() is None
    kept = recorder.arrays()
    np.testing.assert_array_equal(kept["forecast_mean"], [moments[0]])
    np.testing.assert_array_equal(kept["forecast_std"], [moments[1]])


def test_agents_without_forecasts_have_none_in_the_log(
    run: Callable[..., EpisodeLog], arc_agent: Any
) -> None:
    log = run(agent=arc_agent(forecasts=False))
    assert log.forecast_mean.shape == (0, 0, 6)


def test_latency_is_the_agents_cpu_time_and_its_wall_time(
    run: Callable[..., EpisodeLog], arc_agent: Any, door_env: Any
) -> None:
    class Thinker(arc_agent):  # type: ignore[misc]
        def act(self, observation: Any) -> Any:
            time.sleep(0.006)  # as if another process had the core
            end = time.thread_time() + 0.004
            while time.thread_time() < end:
                pass
            return super().act(observation)

    class SlowDoor(door_env):  # type: ignore[misc]
        def step(self, action: Any) -> Any:
            time.sleep(0.002)
            end = time.thread_time() + 0.010
            while time.thread_time() < end:
                pass
            return super().step(action)

    log = run(SlowDoor(n_steps=5), Thinker(n_steps=5))
    assert 0.004 <= np.median(log.latency_s) < 0.008
    assert log.latency_wall_s.min() >= 0.010


def test_on_step_sees_every_state(run: Callable[..., EpisodeLog]) -> None:
    seen: list[tuple[float, float]] = []
    log = run(on_step=lambda now: seen.append((now.time, now.door_angle)))
    assert seen == list(zip(log.times, log.door_angle, strict=True))


def test_the_log_so_far_is_the_beginning_of_the_log(
    run: Callable[..., EpisodeLog],
) -> None:
    so_far: list[EpisodeLog] = []

    def keep(progress: Progress) -> None:
        if progress.steps == 15:
            so_far.append(progress.log())

    log = run(on_step=keep)
    (first,) = so_far
    assert not first.success
    assert not first.failure
    for name in PER_STEP:
        np.testing.assert_array_equal(getattr(first, name), getattr(log, name)[:15])
    count = first.forecast_times.size
    np.testing.assert_array_equal(first.forecast_mean, log.forecast_mean[:count])


def test_missing_information_is_named(
    run: Callable[..., EpisodeLog], door_env: Any
) -> None:
    class Terse(door_env):  # type: ignore[misc]
        def _state(self) -> Any:
            observation, info = super()._state()
            del info["slip"]
            return observation, info

    with pytest.raises(ValueError, match=r"info lacks 'slip'; it has .*door_angle"):
        run(Terse())
