"""Which forces displace the set-point, and when it waits."""

import numpy as np
import pytest

from policies.load import CarriedLoad, YieldToAll

FORWARD = np.array([1.0, 0.0, 0.0])


def wrench(x=0.0, y=0.0, moment=0.0):
    return np.array([x, y, 0.0, 0.0, moment, 0.0])


def test_resistance_is_taken_out_up_to_the_limit():
    left, _ = CarriedLoad(limit=25.0).share(wrench(x=-10.0, y=3.0, moment=1.0), FORWARD)
    np.testing.assert_allclose(left, wrench(y=3.0, moment=1.0))
    left, _ = CarriedLoad(limit=25.0).share(wrench(x=-40.0), FORWARD)
    np.testing.assert_allclose(left, wrench(x=-15.0))


def test_a_door_that_helps_is_yielded_to():
    given = wrench(x=5.0)
    left, pace = CarriedLoad().share(given, FORWARD)
    np.testing.assert_array_equal(left, given)
    assert pace == 1.0


@pytest.mark.parametrize(
    ("load", "pace"), [(0.0, 1.0), (12.5, 1.0 - 1.0 / 16.0), (25.0, 0.0), (40.0, -1.0)]
)
def test_the_clock_slows_stops_and_turns_back(load, pace):
    _, measured = CarriedLoad(limit=25.0).share(wrench(x=-load), FORWARD)
    assert measured == pytest.approx(pace)


def test_the_given_wrench_is_not_changed():
    given = wrench(x=-10.0)
    CarriedLoad().share(given, FORWARD)
    np.testing.assert_array_equal(given, wrench(x=-10.0))


@pytest.mark.parametrize("limit", [0.0, -1.0, np.inf, np.nan])
def test_impossible_limits_are_refused(limit):
    with pytest.raises(ValueError, match=r"CarriedLoad\.limit"):
        CarriedLoad(limit=limit)


def test_yield_to_all_changes_nothing():
    given = wrench(x=-40.0, y=2.0)
    left, pace = YieldToAll().share(given, FORWARD)
    np.testing.assert_array_equal(left, given)
    assert pace == 1.0


@pytest.mark.bits
@pytest.mark.parametrize("rule", [CarriedLoad(limit=20.0), YieldToAll()])
def test_members_share_as_each_alone(rule):
    rng = np.random.default_rng(0)
    wrenches, directions = 15.0 * rng.normal(size=(50, 6)), rng.normal(size=(50, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    left, pace = rule.share(wrenches, directions)
    for row, (one, direction) in enumerate(zip(wrenches, directions, strict=True)):
        # Copies: alone, an array begins where memory does.
        left_alone, pace_alone = rule.share(one.copy(), direction.copy())
        np.testing.assert_array_equal(left[row], left_alone)
        assert pace[row] == pace_alone
