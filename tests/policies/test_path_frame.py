"""Stiffness in the frame of the path: frame, law, governor, admittance, contact."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from gplfd_policies.control.rendering import Admittance
from gplfd_policies.control.stability import StiffnessGovernor, decay_rate
from gplfd_policies.control.stiffness import (
    DEFAULT_DYNAMICS,
    DEFAULT_PROFILE,
    PAPER_DYNAMICS,
    PAPER_PROFILE,
    VirtualDynamics,
    directional_std,
    path_frame,
)

# Of these d = max(2√(mk), 30) is constant below 225 N/m, and no monotone function of
# matrices: with K' ≤ K, D' may be larger than D.
KINKED = VirtualDynamics(mass=np.ones(6), least_damping=np.full(6, 30.0))
SETTINGS = [
    (PAPER_PROFILE, PAPER_DYNAMICS),
    (DEFAULT_PROFILE, DEFAULT_DYNAMICS),
    (PAPER_PROFILE, KINKED),
]
WIDTHS = np.array([9.0, 2.0, 7.0, 4.0, 5.0, 6.0]) * 1e-3
UNEVEN = replace(DEFAULT_PROFILE, alpha=6.0 / WIDTHS, beta=WIDTHS)


@st.composite
def tangents(draw, count):
    """A path that turns by any angle from step to step."""
    vectors = draw(arrays(np.float64, (count, 3), elements=st.floats(-1.0, 1.0)))
    vectors = draw(st.sampled_from([0.01, 0.1, 1.0])) * vectors + [1.001, 0.0, 0.0]
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def level(angles):
    return np.stack([np.cos(angles), 0.0 * angles, np.sin(angles)], axis=-1)


def matrix(frame, values):
    """T diag(k) Tᵀ."""
    return frame * values[..., None, :3] @ np.swapaxes(frame, -1, -2)


@given(path=tangents(20))
def test_frame_is_the_least_rotation_onto_the_tangent(path):
    frames = path_frame(path)
    sign = np.where(path[:, :1] < 0.0, -1.0, 1.0)
    assert_allclose(frames[..., 0], sign * path, atol=1e-12)
    assert_allclose(np.swapaxes(frames, 1, 2) @ frames, [np.eye(3)] * 20, atol=1e-12)
    angles = Rotation.from_matrix(frames).magnitude()
    assert_allclose(np.cos(angles), np.abs(path[:, 0]), atol=1e-9)


def test_frame_of_a_level_path_keeps_up_and_that_of_the_pull_is_the_axes():
    up = path_frame(level(np.linspace(-3.0, 3.0, 61)))[..., 1]
    assert_array_equal(up, [[0.0, 1.0, 0.0]] * 61)
    assert_array_equal(path_frame(np.array([1.0, 0.0, 0.0])), np.eye(3))
    assert_array_equal(path_frame(np.array([-1.0, 0.0, 0.0])), np.eye(3))


@given(
    path=tangents(1),
    std=arrays(np.float64, 6, elements=st.floats(0, 0.1)),
    correlation=st.floats(-1.0, 1.0),
)
def test_directional_law_is_that_of_the_variance_along_it(path, std, correlation):
    frame = path_frame(path[0])
    together = np.diag(std[:3] ** 2)
    together[0, 2] = together[2, 0] = correlation * std[0] * std[2]
    along = directional_std(frame, std, together[0, 2])
    covariance = frame.T @ together @ frame
    assert_allclose(along[:3] ** 2, np.diag(covariance), atol=1e-15)
    assert_array_equal(along[3:], std[3:])
    # αβ is 6 on all axes, and so it is between them.
    argument = 6.0 * (along[:3] / (UNEVEN.beta[:3] @ frame**2) - 1.0)
    stiffness = UNEVEN.stiffness(along, frame)
    assert_allclose(stiffness[:3], 500.0 - 400.0 / (1.0 + np.exp(-argument)))
    assert_allclose(stiffness[3:], UNEVEN.stiffness(std)[3:])
    # Of a frame of the axes themselves, it is theirs.
    order = [2, 0, 1, 3, 4, 5]
    permuted = UNEVEN.stiffness(std[order], np.eye(3)[:, order[:3]])
    assert_allclose(permuted, UNEVEN.stiffness(std)[order])


@pytest.mark.parametrize(("profile", "dynamics"), SETTINGS)
@pytest.mark.parametrize("dt", [1e-3, 0.01, 0.5])
def test_governor_holds_condition_2_for_matrices(profile, dynamics, dt):
    """Eigenvalues of (K' - K) + γ(D' - D) - 2γhK at frames turned by any angle."""
    rng, count = np.random.default_rng(7), 5000
    old = Rotation.random(count, rng=rng)
    axes = Rotation.random(count, rng=rng).as_matrix()[..., 0]
    turn = Rotation.from_rotvec(10.0 ** rng.uniform(-4.0, 0.5, (count, 1)) * axes)
    frame, turned = old.as_matrix(), (turn * old).as_matrix()
    share = np.clip(rng.uniform(-0.5, 1.5, (count, 6)), 0.0, 1.0)
    before = profile.k_min + share * (profile.k_max - profile.k_min)
    governor = StiffnessGovernor(profile, dynamics, (count,))
    governor.step(before, dt, frame=frame)
    governed = governor.step(np.tile(profile.k_max, (count, 1)), dt, frame=turned)
    gamma = decay_rate(profile.k_min, dynamics)[0]
    most = (1.0 + 2.0 * gamma * dt) * before + gamma * dynamics.damping(before)
    new = governed.stiffness + gamma * dynamics.damping(governed.stiffness)
    assert np.linalg.eigvalsh(matrix(turned, new) - matrix(frame, most)).max() < 0.0
    assert governed.margin.min() >= 0.0
    assert (governed.stiffness >= profile.k_min).all()


def energies(profile, dynamics, frames, units, dt, *, told=True):
    """Let a kicked hand go; return V = m|v + γe|²/2 + eᵀ(K + γD - γ²m)e/2."""
    governor, admittance = StiffnessGovernor(profile, dynamics), Admittance(dynamics)
    gamma, mass = decay_rate(profile.k_min, dynamics)[0], dynamics.mass[0]
    admittance.step(profile.k_min, np.array([50.0, -30.0, 80.0, 0, 0, 0]), dt)
    values = []
    for row, frame in zip(units * profile.beta, frames, strict=True):
        wished = profile.stiffness(row, frame)
        stiffness = governor.step(wished, dt, frame=frame if told else None).stiffness
        e, v = admittance.displacement[:3], admittance.velocity[:3]
        shape = stiffness + gamma * dynamics.damping(stiffness) - gamma**2 * mass
        speed = v + gamma * e
        values.append((mass * speed @ speed + e @ matrix(frame, shape) @ e) / 2.0)
        admittance.step(stiffness, np.zeros(6), dt, frame=frame)
    return np.array(values)


@given(
    setting=st.sampled_from(SETTINGS),
    path=tangents(25),
    units=arrays(np.float64, (25, 6), elements=st.floats(0.0, 3.0)),
    dt=st.sampled_from([1e-3, 0.01, 0.05, 0.5]),
)
def test_lyapunov_function_of_turning_frames(setting, path, units, dt):
    values = energies(*setting, path_frame(path), units, dt)
    assert np.all(np.diff(values) <= 1e-12 * values[:-1])


@pytest.mark.parametrize("setting", SETTINGS)
def test_lyapunov_function_grows_if_the_governor_does_not_know_the_frame(setting):
    """Soft along the path and stiff across it, which turns to and fro."""
    units = np.tile([3.0, 0.0, 0.0, 0.0, 0.0, 0.0], (60, 1))
    frames = path_frame(level(np.where(np.arange(60) % 2, 1.2, 0.0)))
    assert np.diff(energies(*setting, frames, units, 1e-3, told=False)).max() > 0.0
    assert np.diff(energies(*setting, frames, units, 1e-3)).max() <= 0.0


@pytest.mark.parametrize(("profile", "dynamics"), SETTINGS)
def test_governor_is_that_of_the_axes_without_a_turn_and_idle_on_a_door(
    profile, dynamics
):
    rng, frame = np.random.default_rng(4), path_frame(level(0.7))
    alone, turned = (StiffnessGovernor(profile, dynamics) for _ in range(2))
    for _ in range(50):
        target = rng.uniform(profile.k_min, profile.k_max)
        expected, other = alone.step(target, 0.01), turned.step(target, 0.01, (), frame)
        assert_allclose(other.stiffness, expected.stiffness, rtol=1e-12)
        assert_allclose(other.margin, expected.margin, rtol=1e-6)
    # A hand at 0.5 m/s on a radius of 0.3 m turns by 1 degree in a period.
    wished, governor = profile.k_max.copy(), StiffnessGovernor(profile, dynamics)
    wished[0] = profile.k_min[0]
    for axes in path_frame(level(np.radians(np.arange(90.0)))):
        assert_array_equal(governor.step(wished, 0.01, (), axes).stiffness, wished)


@given(path=tangents(1), wrench=arrays(np.float64, 6, elements=st.floats(-9, 9)))
def test_admittance_in_a_frame_is_the_one_of_the_axes_seen_from_there(path, wrench):
    frame = path_frame(path[0])
    task, seen = Admittance(PAPER_DYNAMICS), Admittance(PAPER_DYNAMICS)
    stiffness = np.array([100.0, 300.0, 500.0, 40.0, 30.0, 20.0])
    turned = np.concatenate([frame.T @ wrench[:3], wrench[3:]])
    for _ in range(20):
        stepped = task.step(stiffness, wrench, 0.01, frame=frame)
        expected = seen.step(stiffness, turned, 0.01)
        assert_allclose(frame.T @ stepped[:3], expected[:3], atol=1e-13)
        assert_array_equal(stepped[3:], expected[3:])
