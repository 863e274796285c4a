"""Dynamic movement primitives: learning, rollout, goals, and the orientation's form."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from gplfd_env.spatial.se3 import compose_rotvecs, rotation_distance
from gplfd_policies import AlignedDemonstrations
from gplfd_policies.control.rendering import Admittance
from gplfd_policies.control.stiffness import VirtualDynamics
from gplfd_policies.movements.baselines.dmp import DMPConfig, fit_dmp

GRID = np.linspace(0.0, 1.0, 101)
TURN = np.array([1.5, -1.0, 0.8])
"""A rotation vector of 2 rad about a skew axis."""


@pytest.fixture(scope="module")
def dmp(aligned):
    return fit_dmp(aligned)


def movement(poses):
    """One demonstration, evenly sampled."""
    return AlignedDemonstrations(
        times=np.linspace(0.0, 1.0, len(poses)), poses=poses[None]
    )


def minimum_jerk(end):
    """From zero to ``end`` along a straight line of coordinates, (201, 6)."""
    s = np.linspace(0.0, 1.0, 201)[:, None]
    return s**3 * (10.0 - 15.0 * s + 6.0 * s**2) * end


def turning(weights=None):
    """A turn by ``TURN`` with given weights of the orientation, (n_basis, 3)."""
    dmp = fit_dmp(movement(minimum_jerk(np.append([0.3, 0.0, -0.2], TURN))))
    full = np.zeros_like(dmp.weights)
    if weights is not None:
        full[:, 3:] = weights
    return replace(dmp, weights=full)


def errors(dmp, times):
    """e = 2 log(q_g q*) along the rollout, (M, 3)."""
    return compose_rotvecs(dmp.goal[3:], -dmp.predict(times).mean[:, 3:])


def fading(times, config):
    """1 - h(t), solution of r̈ + α ṙ + αβ r = αβ x from rest at 1, in closed form."""
    natural, decay = 0.5 * config.alpha, config.alpha_x
    share = natural**2 / (natural - decay) ** 2
    slope = decay * share + natural * (1.0 - share)
    transient = (1.0 - share + slope * times) * np.exp(-natural * times)
    return transient + share * np.exp(-decay * times)


def forcing(dmp, clock):
    """f(x), by the definition, (6,)."""
    config = dmp.config
    x = np.exp(-config.alpha_x * clock)
    centres = np.exp(-config.alpha_x * np.linspace(0.0, 1.0, config.n_basis))
    gap = np.abs(np.diff(centres))
    heights = config.overlap ** ((x - centres) / np.append(gap, gap[-1])) ** 2
    return x * (heights / heights.sum()) @ dmp.weights


def push(clock):
    """A force that varies in time [N, N m]."""
    return np.sin(9.0 * clock + np.arange(6.0))


@pytest.mark.parametrize("coupling", [0.0, 10.0])
def test_rollout_solves_the_transformation_system(dmp, coupling):
    """An independent integrator of the equation in the module's heading.

    A coupling term c F displaces it like the admittance, Eq. (22), of mass 1/c.
    """
    gain = 0.25 * dmp.config.alpha**2
    start = np.append(dmp.start[:3], dmp.start_error)
    goal = np.append(dmp.goal[:3], np.zeros(3))

    def rate(clock, state):
        x = np.exp(-dmp.config.alpha_x * clock)
        pull = gain * (goal - state[:6] - (goal - start) * x)
        drive = pull - dmp.config.alpha * state[6:] + forcing(dmp, clock)
        return np.append(state[6:], drive + coupling * push(clock))

    initial, ends = np.append(start, np.zeros(6)), (0.0, 1.0)
    solved = solve_ivp(rate, ends, initial, t_eval=GRID, rtol=1e-9, atol=1e-9)
    predicted = dmp.predict(GRID).mean
    if coupling:
        dynamics = VirtualDynamics(mass=np.full(6, 1.0 / coupling), damping_ratio=1.0)
        admittance, stiffness = Admittance(dynamics), np.full(6, gain / coupling)
        for now in np.linspace(0.0, 1.0, 10_000, endpoint=False) + 1e-4:
            admittance.step(stiffness, push(now), 1e-4)
        assert_allclose(
            solved.y[:3, -1], predicted[-1, :3] + admittance.displacement[:3], atol=1e-4
        )
        assert np.abs(admittance.displacement[:3]).max() > 0.02
        return
    assert_allclose(predicted[:, :3], solved.y[:3].T, atol=2e-6)
    turned = Rotation.from_rotvec(-solved.y[3:6].T) * Rotation.from_rotvec(goal_of(dmp))
    assert rotation_distance(turned.as_rotvec(), predicted[:, 3:]).max() < 2e-5


def goal_of(dmp):
    return np.array(dmp.goal[3:])


def ude_rotations(dmp, clock):
    """The form of Ude et al.: the same constants, with the angular velocity as rate.

    ω̇ = αβ (e - e_0 x) - α ω - f, for the sign of f that agrees with -ë at e = 0.
    """
    gain, goal = 0.25 * dmp.config.alpha**2, Rotation.from_rotvec(goal_of(dmp))
    step = clock[1] - clock[0]
    rotation, velocity, rotations = Rotation.identity(), np.zeros(3), []
    for now in clock:
        rotations.append(rotation)
        error = (goal * rotation.inv()).as_rotvec()
        pull = error - dmp.start_error * np.exp(-dmp.config.alpha_x * now)
        push = gain * pull - dmp.config.alpha * velocity - forcing(dmp, now)[3:]
        velocity = velocity + step * push
        rotation = Rotation.from_rotvec(step * velocity) * rotation
    return Rotation.concatenate(rotations)


def test_forcing_superposes_in_the_error_and_not_in_the_angular_velocity():
    clock = np.linspace(0.0, 1.0, 1001)
    coarse = slice(None, None, 10)
    across = np.linalg.svd(TURN[None])[2][1:]  # two axes at right angles to the turn
    pushes = [np.tile(600.0 * axis, (30, 1)) for axis in across]
    cases = [turning(push) for push in (pushes[0], pushes[1], sum(pushes), None)]
    first, second, both, none = (errors(push, clock[coarse]) for push in cases)
    assert_allclose(both + none, first + second, atol=1e-6)
    assert np.abs(first - none).max() > 0.1  # the forcing does something
    goal = Rotation.from_rotvec(TURN)
    first, second, both, none = (
        (goal * ude_rotations(push, clock)[coarse].inv()).as_rotvec() for push in cases
    )
    assert np.abs(both + none - first - second).max() > 0.05


def test_another_goal_enters_along_the_step_response(dmp):
    shift = np.array([0.1, -0.05, 0.02])
    turn = Rotation.from_rotvec([0.1, 0.3, -0.2]) * Rotation.from_rotvec(goal_of(dmp))
    goal = np.append(dmp.goal[:3] + shift, turn.as_rotvec())
    error = compose_rotvecs(goal[3:], -dmp.start[3:])
    moved = replace(dmp, goal=goal, start_error=error)
    before, after = dmp.predict(GRID), moved.predict(GRID)
    gone = fading(GRID, dmp.config)[:, None]
    assert_allclose(
        after.mean[:, :3] - before.mean[:, :3], (1.0 - gone) * shift, atol=1e-6
    )
    change = errors(moved, GRID) - errors(dmp, GRID)
    expected = gone * (turn.as_rotvec() - goal_of(dmp))
    assert_allclose(change, expected, atol=2e-5)
    assert_allclose(after.mean[0], dmp.start, atol=1e-12)


def test_turns_beyond_half_a_turn_stay_continuous():
    end = np.array([0.0, 0.0, 0.0, 0.5, 4.0, 0.0])
    dmp = fit_dmp(movement(minimum_jerk(end)))
    assert_allclose(dmp.start_error, end[3:], atol=1e-12)
    poses = dmp.predict(np.linspace(0.0, 1.0, 201)).mean
    assert_allclose(poses, minimum_jerk(end), atol=2e-3)


@pytest.fixture(scope="module")
def as_in_the_library(library):
    """Learned from its demonstrations, with its constants; its x ends at 0.01."""
    config = DMPConfig(
        n_basis=library["dmp_weights"].shape[1],
        alpha=float(library["dmp_alpha"]),
        alpha_x=float(library["dmp_alpha_x"]),
        overlap=float(library["dmp_overlap"]),
    )
    assert np.exp(-config.alpha_x) == pytest.approx(0.01)
    aligned = AlignedDemonstrations(times=library["phases"], poses=library["poses"])
    return fit_dmp(aligned, config)


def test_rollout_tends_to_the_library_s_for_small_steps(as_in_the_library, library):
    weights = np.zeros_like(as_in_the_library.weights)
    weights[:, :3] = library["dmp_weights"].T
    ours = replace(as_in_the_library, weights=weights)
    gaps = [
        np.abs(theirs - ours.predict(times).mean[:, :3]).max()
        for times, theirs in zip(
            library["dmp_times"], library["dmp_rollouts"], strict=True
        )
    ]
    # Its forcing term is a step late: the gap shrinks with the step, by half here.
    steps = library["dmp_steps"]
    assert_allclose(np.divide(gaps[1:], gaps[:-1]), steps[1:] / steps[:-1], rtol=0.1)
    assert gaps[-1] < 1e-3
