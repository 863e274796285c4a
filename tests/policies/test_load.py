"""Which forces displace the set-point, and when it waits."""

import dataclasses

import numpy as np
import pytest

from gplfd_policies.control.load import CarriedLoad, Encounter, LearnedLoad, YieldToAll
from gplfd_policies.control.stiffness import DEFAULT_PROFILE

FORWARD = np.array([1.0, 0.0, 0.0])


def met(force, position=(0.0, 0.0, 0.0), displacement=(0.0, 0.0, 0.0)):
    return Encounter(
        wrench=force,
        direction=FORWARD,
        pose=np.append(position, np.zeros(3)),
        displacement=np.array(displacement),
    )


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
    response = YieldToAll().begin(DEFAULT_PROFILE).meet(met(given))
    np.testing.assert_array_equal(response.wrench, given)
    assert (response.carried, response.pace, response.give) == (0.0, 1.0, 0.0)


def test_the_carried_load_meets_a_door_as_it_shares():
    given = wrench(x=-40.0, y=2.0)
    response = CarriedLoad(limit=25.0).begin(DEFAULT_PROFILE).meet(met(given))
    left, pace = CarriedLoad(limit=25.0).share(given, FORWARD)
    np.testing.assert_array_equal(response.wrench, left)
    assert (response.carried, response.pace, response.give) == (25.0, pace, 0.0)


def moved(load, resistance, distance, steps=100):
    """Lead the hand on against a resistance; return the last response."""
    for way in np.linspace(0.0, distance, steps):
        response = load.meet(met(wrench(x=-resistance), position=(way, 0.0, 0.0)))
    return response


def test_an_unmoved_door_is_expected_to_be_as_heavy_as_can_be():
    load = LearnedLoad(limit=25.0).begin(DEFAULT_PROFILE)
    response = load.meet(met(wrench(x=-24.0, y=2.0)))
    assert response.carried == 24.0
    np.testing.assert_allclose(response.wrench, wrench(y=2.0), atol=1e-12)
    assert load.meet(met(wrench(x=-30.0))).carried == 25.0


def test_a_door_is_expected_to_be_as_heavy_as_it_was():
    """r̂ goes to the resistance as exp(-way/stretch), by steps of about 5 mm."""
    load = LearnedLoad(limit=25.0, stretch=0.03).begin(DEFAULT_PROFILE)
    moved(load, 6.0, 0.06, steps=600)
    held = load.meet(met(wrench(x=-20.0), position=(0.06, 0.0, 0.0)))
    assert held.carried == pytest.approx(6.0 + 19.0 * np.exp(-2.0), rel=0.06)
    moved(load, 6.0, 0.3)
    held = load.meet(met(wrench(x=-20.0), position=(0.3, 0.0, 0.0)))
    assert held.carried == pytest.approx(6.0, abs=0.05)
    np.testing.assert_allclose(held.wrench, wrench(x=held.carried - 20.0))


def test_a_door_that_sticks_and_slips_is_as_heavy_as_where_it_sticks():
    """15 N start it every 4 mm, 3 N keep it moving; afterwards it is free to move."""
    load = LearnedLoad(limit=25.0, stretch=0.03).begin(DEFAULT_PROFILE)
    for step, way in enumerate(np.arange(0.0, 0.3, 1e-3)):
        resistance = 15.0 if step % 4 == 0 else 3.0
        load.meet(met(wrench(x=-resistance), position=(way, 0.0, 0.0)))
    held = load.meet(met(wrench(x=-20.0), position=(0.299, 0.0, 0.0)))
    assert held.carried == pytest.approx(15.0, abs=0.05)
    moved(load, 3.0, 0.6, steps=600)
    held = load.meet(met(wrench(x=-20.0), position=(0.6, 0.0, 0.0)))
    assert held.carried == pytest.approx(3.0, abs=0.05)


def test_a_light_door_is_still_expected_to_weigh_a_little():
    load = LearnedLoad(least=3.0).begin(DEFAULT_PROFILE)
    moved(load, 0.0, 0.5)
    held = load.meet(met(wrench(x=-20.0), position=(0.5, 0.0, 0.0)))
    assert held.carried == pytest.approx(3.0, abs=1e-3)


def test_a_hand_that_stands_still_learns_nothing():
    load = LearnedLoad().begin(DEFAULT_PROFILE)
    rng = np.random.default_rng(0)
    for _ in range(500):
        load.meet(met(wrench(x=-5.0), position=rng.normal(0.0, 1e-3, 3)))
    assert load.meet(met(wrench(x=-24.0))).carried == 24.0


def test_a_hand_that_is_led_back_and_forth_learns_on_the_way_forward_alone():
    load = LearnedLoad().begin(DEFAULT_PROFILE)
    for way in np.linspace(0.0, -0.3, 50):
        load.meet(met(wrench(x=-5.0), position=(way, 0.0, 0.0)))
    held = met(wrench(x=-24.0), position=(-0.3, 0.0, 0.0))
    assert load.meet(held).carried == 24.0


def test_a_hand_that_was_led_back_learns_on_its_way_forward_again():
    load = LearnedLoad().begin(DEFAULT_PROFILE)
    for way in (*np.linspace(0.0, -0.3, 50), *np.linspace(-0.3, -0.1, 50)):
        load.meet(met(wrench(x=-5.0), position=(way, 0.0, 0.0)))
    held = met(wrench(x=-24.0), position=(-0.1, 0.0, 0.0))
    assert load.meet(held).carried == pytest.approx(5.0, abs=0.1)


def test_reset_forgets_the_door():
    load = LearnedLoad(limit=25.0).begin(DEFAULT_PROFILE)
    moved(load, 5.0, 0.5)
    load.reset()
    assert load.meet(met(wrench(x=-24.0))).carried == 24.0
    assert load.meet(met(wrench(x=-31.0))).pace == 1.0


@pytest.mark.parametrize("give", [0.0, 0.005, 0.02, 0.06])
def test_what_is_carried_falls_with_the_give(give):
    """No more than k(g) ℓ, Eq. (24); a give across the path or forward is none."""
    load = LearnedLoad(reach=0.02).begin(DEFAULT_PROFILE)
    response = load.meet(met(wrench(x=-24.0), displacement=(-give, 0.01, 0.0)))
    stiffness = DEFAULT_PROFILE.stiffness(np.full(6, give))[0]
    assert response.give == give
    assert response.carried == pytest.approx(min(24.0, 0.02 * stiffness))
    ahead = load.meet(met(wrench(x=-24.0), displacement=(give, 0.01, 0.0)))
    assert ahead.give == 0.0


def test_stiffness_along_the_path_is_that_of_the_directions_axes():
    profile = dataclasses.replace(
        DEFAULT_PROFILE, k_min=np.array([100.0, 1.0, 300.0, 1.0, 1.0, 1.0])
    )
    load = LearnedLoad(reach=0.02).begin(profile)
    direction = np.array([0.6, 0.0, 0.8])
    encounter = Encounter(
        wrench=np.append(-24.0 * direction, np.zeros(3)),
        direction=direction,
        pose=np.zeros(6),
        displacement=-0.5 * direction,
    )
    carried = load.meet(encounter).carried
    assert carried == pytest.approx(0.02 * (0.36 * 100.0 + 0.64 * 300.0))


@pytest.mark.parametrize(
    ("give", "force", "pace"),
    [
        (0.0, 0.0, 1.0),
        (0.03, 0.0, 1.0 - 1.0 / 16.0),
        (0.06, 0.0, 0.0),
        (0.1, 0.0, -1.0),
    ],
)
def test_the_clock_waits_for_a_hand_that_gives_way(give, force, pace):
    load = LearnedLoad(limit=25.0, lag=0.06).begin(DEFAULT_PROFILE)
    response = load.meet(met(wrench(x=-force), displacement=(-give, 0.0, 0.0)))
    assert response.pace == pytest.approx(pace)


@pytest.mark.parametrize(
    ("excess", "pace"), [(0.0, 1.0), (3.0, 1.0 - 1.0 / 16.0), (6.0, 0.0), (9.0, -1.0)]
)
def test_the_clock_waits_at_once_where_the_door_is_known(excess, pace):
    """To give way by 3 cm, and by 6 cm, at 100 N/m: 3 N and 6 N beyond the weight."""
    load = LearnedLoad(lag=0.06).begin(DEFAULT_PROFILE)
    moved(load, 5.0, 0.5)
    held = met(wrench(x=-5.0 - excess), position=(0.5, 0.0, 0.0))
    assert load.meet(held).pace == pytest.approx(pace, abs=0.01)


def test_the_clock_goes_on_at_a_door_that_never_moved():
    """Else the hand would press on at the limit, and never learn that it is locked."""
    load = LearnedLoad(limit=25.0, lag=0.06).begin(DEFAULT_PROFILE)
    assert load.meet(met(wrench(x=-31.0))).pace == 1.0


def test_what_holds_the_hand_bears_the_least_stiffness():
    """Statics of Eq. (22): k e = F with e = -lag; then force = k_min (reach + lag)."""
    rule = LearnedLoad(reach=0.07, lag=0.06)
    load = rule.begin(DEFAULT_PROFILE)
    force = 100.0 * (0.07 + 0.06)
    held = met(wrench(x=-force), displacement=(-0.06, 0.0, 0.0))
    response = load.meet(held)
    assert response.pace == pytest.approx(0.0, abs=1e-3)
    assert response.wrench[0] == pytest.approx(-100.0 * 0.06, rel=1e-4)


def test_a_path_without_direction_is_waited_on_by_nobody():
    still = Encounter(
        wrench=wrench(x=-20.0),
        direction=np.zeros(3),
        pose=np.zeros(6),
        displacement=np.zeros(3),
    )
    response = LearnedLoad().begin(DEFAULT_PROFILE).meet(still)
    assert (response.carried, response.pace, response.give) == (0.0, 1.0, 0.0)
    np.testing.assert_array_equal(response.wrench, still.wrench)


def test_fingers_behind_a_handle_carry_what_the_arm_carries():
    """What the stiffness allows, at once: 500 N/m over 0.1 m; then up to 58 N."""
    for hooked, carried in ((False, 25.0), (True, 58.0)):
        load = LearnedLoad().begin(DEFAULT_PROFILE)
        heavy = dataclasses.replace(met(wrench(x=-70.0)), hooked=hooked)
        response = load.meet(heavy)
        assert response.carried == pytest.approx(carried)
        assert response.wrench[0] == pytest.approx(carried - 70.0)


def test_a_hooked_hand_that_is_held_bears_twice_as_much():
    """As before, with 58 / 25 of the reach."""
    load = LearnedLoad(reach=0.1, lag=0.03).begin(DEFAULT_PROFILE)
    held = met(wrench(x=-40.0), displacement=(-0.5, 0.0, 0.0))
    response = load.meet(dataclasses.replace(held, hooked=True))
    assert response.carried == pytest.approx(100.0 * 0.232, rel=1e-3)


@pytest.mark.parametrize(
    "name", ["limit", "hooked_gain", "least", "stretch", "reach", "lag"]
)
@pytest.mark.parametrize("value", [0.0, -1.0, np.inf, np.nan])
def test_impossible_numbers_of_a_learned_load_are_refused(name, value):
    with pytest.raises(ValueError, match=rf"LearnedLoad\.{name} must be positive"):
        LearnedLoad(**{name: value})


def test_the_least_load_is_not_above_the_limit():
    with pytest.raises(ValueError, match=r"LearnedLoad\.least must not exceed limit"):
        LearnedLoad(least=30.0)


@pytest.mark.bits
@pytest.mark.parametrize(
    "rule", [CarriedLoad(limit=20.0), YieldToAll(), LearnedLoad(limit=20.0)]
)
def test_members_meet_their_doors_as_each_alone(rule):
    rng = np.random.default_rng(0)
    together = rule.begin(DEFAULT_PROFILE, (50,))
    alone = [rule.begin(DEFAULT_PROFILE) for _ in range(50)]
    for _ in range(5):
        directions = rng.normal(size=(50, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        fields = {
            "wrench": 15.0 * rng.normal(size=(50, 6)),
            "direction": directions,
            "pose": 0.02 * rng.normal(size=(50, 6)),
            "displacement": 0.02 * rng.normal(size=(50, 3)),
        }
        some = np.flatnonzero(rng.random(50) < 0.7)
        rows = {name: values[some] for name, values in fields.items()}
        response = together.meet(Encounter(**rows), some)
        for row, member in enumerate(some):
            # Copies: alone, an array begins where memory does.
            own = {name: values[member].copy() for name, values in fields.items()}
            expected = alone[member].meet(Encounter(**own))
            for part in dataclasses.fields(expected):
                np.testing.assert_array_equal(
                    getattr(response, part.name)[row], getattr(expected, part.name)
                )
