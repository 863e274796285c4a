"""Which forces displace the set-point, and when it waits."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from gplfd_policies.control.load import (
    CarriedLoad,
    ContactState,
    ExpectedForce,
    LearnedLoad,
    YieldToAll,
)
from gplfd_policies.control.stiffness import DEFAULT_PROFILE

FORWARD = np.array([1.0, 0.0, 0.0])


def contact(force, position=(0.0, 0.0, 0.0), displacement=(0.0, 0.0, 0.0), **fields):
    return ContactState(
        wrench=force,
        direction=FORWARD,
        pose=np.append(position, np.zeros(3)),
        displacement=np.array(displacement),
        **fields,
    )


def wrench(x=0.0, y=0.0, moment=0.0):
    return np.array([x, y, 0.0, 0.0, moment, 0.0])


@pytest.mark.parametrize(
    ("rule", "force", "left", "compensated", "pace"),
    [
        (CarriedLoad(), wrench(x=-10.0, y=3.0, moment=1.0), wrench(0, 3, 1), 10, None),
        (CarriedLoad(), wrench(x=-40.0, y=2.0), wrench(x=-15.0, y=2.0), 25.0, -1.0),
        (CarriedLoad(), wrench(x=5.0), wrench(x=5.0), 0.0, 1.0),  # the door helps
        (CarriedLoad(), wrench(x=-12.5), wrench(), 12.5, 1.0 - 1.0 / 16.0),
        (CarriedLoad(), wrench(x=-25.0), wrench(), 25.0, 0.0),
        (YieldToAll(), wrench(x=-40.0, y=2.0), wrench(x=-40.0, y=2.0), 0.0, 1.0),
        # A door that has not moved may be as heavy as can be, and the clock goes on:
        # else the hand would press on at the limit, and never learn that it is locked.
        (LearnedLoad(), wrench(x=-24.0, y=2.0), wrench(y=2.0), 24.0, None),
        (LearnedLoad(), wrench(x=-31.0), wrench(x=-6.0), 25.0, 1.0),
    ],
)
def test_what_is_compensated_is_not_yielded_to(rule, force, left, compensated, pace):
    kept = force.copy()
    response = rule.begin(DEFAULT_PROFILE).update(contact(force))
    assert_array_equal(force, kept)
    assert_allclose(response.compliant_wrench, left, atol=1e-12)
    assert response.compensated_load == compensated
    assert response.path_lag == 0.0
    if pace is not None:
        assert response.pace == pytest.approx(pace)


def test_expected_resistance_is_that_of_the_turned_hand():
    """The oracle: mean and covariance turned by SciPy's rotation matrix."""
    rng = np.random.default_rng(2)
    mean, std, rotation = rng.normal(size=(3, 4, 3))
    direction = rng.normal(size=(4, 3))
    axes = Rotation.from_rotvec(rotation).as_matrix()
    expected = ExpectedForce(mean=mean, std=np.abs(std), axes=axes)
    moments = [column[:, 0] for column in expected.along(direction[..., None])]
    covariance = np.einsum("nij,nj,nkj->nik", axes, std**2, axes)
    along = np.einsum("ni,nij,nj->n", direction, axes, mean)
    variance = np.einsum("ni,nij,nj->n", direction, covariance, direction)
    assert_allclose(moments, (along, np.sqrt(variance)))


def expecting(mean, std=2.0, ahead=0.0, largest=1e3):
    """Expect forces along x, here and at the end of the path ahead."""
    here, behind = (
        ExpectedForce(
            mean=np.array([force, 0.0, 0.0]),
            std=np.full(3, std),
            axes=np.eye(3),
            largest=largest,
        )
        for force in (mean, ahead)
    )
    return {"expected": here, "expected_ahead": behind}


@pytest.mark.parametrize(
    ("expected", "hook_grasp", "resistance", "compensated"),
    [
        # Within the interval, beyond the constant limit.
        (expecting(30.0), False, 31.0, 31.0),
        # 28 N and two standard deviations.
        (expecting(28.0), False, 40.0, 32.0),
        # A friction grasp would slip.
        (expecting(40.0), False, 40.0, 33.0),
        (expecting(80.0), True, 90.0, 33.0 * 58.0 / 25.0),
        # Of a method without standard deviations, its mean.
        (expecting(28.0, std=np.nan), False, 40.0, 28.0),
        # Half as much again as was demonstrated.
        (expecting(30.0, largest=20.0), False, 40.0, 30.0),
        # A closer that begins to resist a little later.
        (expecting(3.0, ahead=26.0), False, 40.0, 30.0),
        # Never less than without demonstrated forces.
        (expecting(5.0), False, 24.0, 24.0),
    ],
)
def test_demonstrated_force_is_compensated(
    expected, hook_grasp, resistance, compensated
):
    load = LearnedLoad().begin(DEFAULT_PROFILE)
    held = contact(wrench(x=-resistance), hook_grasp=hook_grasp, **expected)
    assert load.update(held).compensated_load == pytest.approx(compensated)


def test_on_a_known_door_the_path_ahead_does_not_count():
    load = LearnedLoad().begin(DEFAULT_PROFILE)
    moved(load, 1.0, 0.3)
    expected = expecting(10.0, std=0.0, ahead=30.0)
    held = contact(wrench(x=-40.0), position=(0.3, 0.0, 0.0), **expected)
    assert load.update(held).compensated_load == pytest.approx(10.0, abs=0.01)


def test_a_hand_that_lags_still_bears_what_was_demonstrated():
    lagging = {"displacement": (-0.1, 0.0, 0.0)}
    with_forces, without = (
        LearnedLoad()
        .begin(DEFAULT_PROFILE)
        .update(contact(wrench(x=-30.0), **lagging, **more))
        for more in (expecting(30.0, std=1.0), {})
    )
    assert with_forces.compensated_load == 30.0
    assert without.compensated_load < 11.0


def moved(load, resistance, distance, steps=100):
    """Lead the hand on against a resistance."""
    for way in np.linspace(0.0, distance, steps):
        load.update(contact(wrench(x=-resistance), position=(way, 0.0, 0.0)))


def compensated_at(load, distance=0.0, force=20.0):
    """What is compensated of a force that would be too heavy for a light door."""
    held = contact(wrench(x=-force), position=(distance, 0.0, 0.0))
    return load.update(held).compensated_load


def test_a_door_is_expected_to_be_as_heavy_as_it_was():
    """r̂ goes to the resistance as exp(-way/stretch), by steps of about 5 mm.

    Once half of it is measured, it falls over `memory`, and rises as before.
    """
    load = LearnedLoad(limit=25.0, stretch=0.03, memory=0.1).begin(DEFAULT_PROFILE)
    moved(load, 6.0, 0.06, steps=600)
    half = 0.03 * np.log(2.0)
    assert compensated_at(load, 0.06) == pytest.approx(
        6.0 + 9.5 * np.exp((half - 0.06) / 0.1), rel=0.06
    )
    moved(load, 6.0, 0.9)
    held = load.update(contact(wrench(x=-20.0), position=(0.9, 0.0, 0.0)))
    assert held.compensated_load == pytest.approx(6.0, abs=0.05)
    left = wrench(x=held.compensated_load - 20.0)
    assert_allclose(held.compliant_wrench, left)
    moved(load, 20.0, 0.06, steps=600)
    risen = 20.0 - 14.0 * np.exp(-2.0)
    assert compensated_at(load, 0.06) == pytest.approx(risen, rel=0.06)
    moved(load, 6.0, 0.1, steps=1000)
    fallen = 6.0 + (risen - 6.0) * np.exp(-1.0)
    assert compensated_at(load, 0.1) == pytest.approx(fallen, rel=0.06)
    load.reset()
    assert compensated_at(load, force=24.0) == 24.0


def test_a_door_that_sticks_and_slips_is_as_heavy_as_where_it_sticks():
    """15 N start it every 4 mm, 3 N keep it moving; afterwards it is free to move."""
    load = LearnedLoad(limit=25.0, stretch=0.03).begin(DEFAULT_PROFILE)
    for step, way in enumerate(np.arange(0.0, 0.4, 1e-3)):
        resistance = 15.0 if step % 4 == 0 else 3.0
        load.update(contact(wrench(x=-resistance), position=(way, 0.0, 0.0)))
    assert compensated_at(load, 0.399) == pytest.approx(15.0, abs=0.05)
    moved(load, 3.0, 0.6, steps=600)
    assert compensated_at(load, 0.6) == pytest.approx(3.0, abs=0.05)


def test_a_hand_that_stands_still_learns_nothing():
    """Nor while it is led back; but on its way forward again."""
    load = LearnedLoad().begin(DEFAULT_PROFILE)
    rng = np.random.default_rng(0)
    for _ in range(500):
        load.update(contact(wrench(x=-5.0), position=rng.normal(0.0, 1e-3, 3)))
    assert compensated_at(load, force=24.0) == 24.0
    for way in np.linspace(0.0, -0.3, 50):
        load.update(contact(wrench(x=-5.0), position=(way, 0.0, 0.0)))
    assert compensated_at(load, -0.3, force=24.0) == 24.0
    for way in np.linspace(-0.3, 0.1, 80):
        load.update(contact(wrench(x=-5.0), position=(way, 0.0, 0.0)))
    assert compensated_at(load, 0.1, force=24.0) == pytest.approx(5.0, abs=0.1)


@pytest.mark.parametrize("lag", [0.0, 0.005, 0.02, 0.06])
def test_what_is_carried_falls_with_the_give(lag):
    """No more than k(g) ℓ, Eq. (24); a lag across the path or forward is none."""
    load = LearnedLoad(reach=0.02).begin(DEFAULT_PROFILE)
    response = load.update(contact(wrench(x=-24.0), displacement=(-lag, 0.01, 0.0)))
    stiffness = DEFAULT_PROFILE.stiffness(np.full(6, lag))[0]
    assert response.path_lag == lag
    assert response.compensated_load == pytest.approx(min(24.0, 0.02 * stiffness))
    ahead = load.update(contact(wrench(x=-24.0), displacement=(lag, 0.01, 0.0)))
    assert ahead.path_lag == 0.0


@pytest.mark.parametrize("lag", [0.0, 0.05, 0.5])
def test_a_weight_that_was_learned_is_carried_however_far_the_hand_lags(lag):
    """22 N, of which k(g) ℓ of a soft hand would be 10 N; and nothing beyond them."""
    load = LearnedLoad().begin(DEFAULT_PROFILE)
    moved(load, 22.0, 0.6, steps=600)
    held = {"position": (0.6, 0.0, 0.0), "displacement": (-lag, 0.0, 0.0)}
    for force, carried in ((15.0, 15.0), (22.0, 22.0), (40.0, 22.0)):
        response = load.update(contact(wrench(x=-force), **held))
        assert response.compensated_load == pytest.approx(carried, abs=0.01)


@pytest.mark.parametrize(
    ("lag", "pace"), [(0.0, 1.0), (0.03, 1.0 - 1.0 / 16.0), (0.06, 0.0), (0.1, -1.0)]
)
def test_the_clock_waits_for_a_hand_that_lags(lag, pace):
    load = LearnedLoad(limit=25.0, lag=0.06).begin(DEFAULT_PROFILE)
    response = load.update(contact(wrench(), displacement=(-lag, 0.0, 0.0)))
    assert response.pace == pytest.approx(pace)


@pytest.mark.parametrize(
    ("excess", "pace"), [(0.0, 1.0), (3.0, 1.0 - 1.0 / 16.0), (6.0, 0.0), (9.0, -1.0)]
)
def test_the_clock_waits_at_once_where_the_door_is_known(excess, pace):
    """To lag by 3 cm, and by 6 cm, at 100 N/m: 3 N and 6 N beyond the weight."""
    load = LearnedLoad(lag=0.06).begin(DEFAULT_PROFILE)
    moved(load, 5.0, 0.5)
    held = contact(wrench(x=-5.0 - excess), position=(0.5, 0.0, 0.0))
    assert load.update(held).pace == pytest.approx(pace, abs=0.01)


def test_what_holds_the_hand_bears_the_least_stiffness():
    """Statics of Eq. (22): k e = F with e = -lag; then force = k_min (reach + lag)."""
    load = LearnedLoad(reach=0.07, lag=0.06).begin(DEFAULT_PROFILE)
    force = 100.0 * (0.07 + 0.06)
    response = load.update(contact(wrench(x=-force), displacement=(-0.06, 0.0, 0.0)))
    assert response.pace == pytest.approx(0.0, abs=1e-3)
    assert response.compliant_wrench[0] == pytest.approx(-100.0 * 0.06, rel=1e-4)


@pytest.mark.parametrize(
    ("hook_grasp", "lag", "load"),
    [(False, 0.0, 25.0), (True, 0.0, 58.0), (True, 0.5, 100.0 * 0.232)],
)
def test_fingers_behind_a_handle_carry_what_the_arm_carries(hook_grasp, lag, load):
    """Up to 58 N instead of 25 N, also of the reach where the hand is held."""
    behind, rel = (-lag, 0.0, 0.0), 1e-3 if lag else 1e-6
    heavy = contact(wrench(x=-70.0), displacement=behind, hook_grasp=hook_grasp)
    response = LearnedLoad(reach=0.1, lag=0.03).begin(DEFAULT_PROFILE).update(heavy)
    assert response.compensated_load == pytest.approx(load, rel=rel)
    assert response.compliant_wrench[0] == pytest.approx(load - 70.0, rel=rel)
