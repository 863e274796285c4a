"""Stiffness learned from demonstrated forces, and what hands make of it."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from gplfd_env.spatial.arc import handle_pose_on_arc
from gplfd_env.spatial.se3 import into_axes
from gplfd_policies import (
    POLICIES,
    AlignedDemonstrations,
    Demonstration,
    TrainingInput,
    align,
    batch_agents,
    make_agent,
)
from gplfd_policies.control.compliance import ComplianceConfig
from gplfd_policies.control.phase_stiffness import (
    PhaseStiffness,
    demonstrated_stiffness,
)
from gplfd_policies.control.stiffness import DEFAULT_PROFILE
from gplfd_policies.demonstrations.impedance import PRIOR, estimate_impedance
from gplfd_policies.movements.baselines.promp import fit_promp

SECONDS = 6.0
PHASES = np.linspace(0.0, 1.0, 300)


def grown(matrix):
    """A matrix in the axes of the hand that grows by half along the task."""
    return (1.0 + 0.5 * PHASES[:, None, None]) * matrix


def springs(
    seed,
    count=8,
    stiffness=(150, 400, 900),
    damping=(20, 40, 60),
    *,
    size=1e-2,
    noise=5e-4,
):
    """Openings of a door by hands on a spring and a damper; K and D at the phases.

    They deviate by `size` [m] and are measured with `noise` [m], 2 mrad and 0.2 N.
    """
    rng = np.random.default_rng(seed)
    turns = Rotation.random(2, random_state=seed).as_matrix()
    k, d = (
        grown(turn @ np.diag(np.array(values, float)) @ turn.T)
        for turn, values in zip(turns, (stiffness, damping), strict=True)
    )
    times = SECONDS * PHASES
    progress = PHASES**3 * (10.0 - 15.0 * PHASES + 6.0 * PHASES**2)
    mean = handle_pose_on_arc(0.5, np.radians(70.0) * progress)
    demonstrations = []
    for _ in range(count):
        rate, start = rng.uniform(1.0, 4.0, (2, 3)), rng.uniform(0.0, 7.0, (2, 3))
        height = size * rng.normal(size=(2, 3))
        angle = times[:, None, None] * rate + start
        shift = np.sum(height * np.sin(angle), axis=1)
        speed = np.sum(height * rate * np.cos(angle), axis=1)
        own = into_axes(mean[:, None, 3:], np.stack([shift, speed], axis=1))
        force = [8.0, 0.0, 2.0] - np.einsum("mab,mb->ma", k, own[:, 0])
        force -= np.einsum("mab,mb->ma", d, own[:, 1])
        force = into_axes(-mean[:, 3:], force) + 0.2 * rng.normal(size=(300, 3))
        poses = mean + np.repeat([noise, 2e-3], 3) * rng.normal(size=(300, 6))
        poses[:, :3] += shift
        wrenches = np.hstack([force, 0.02 * rng.normal(size=(300, 3))])
        demonstrations.append(
            Demonstration(times=times, poses=poses, wrenches=wrenches)
        )
    return demonstrations, k, d


def on_known_phases(demonstrations):
    """Align demonstrations that are on one clock."""
    wrenches = [
        into_axes(one.poses[:, None, 3:], one.wrenches.reshape(-1, 2, 3)).reshape(-1, 6)
        for one in demonstrations
    ]
    return AlignedDemonstrations(
        times=PHASES,
        poses=np.stack([one.poses for one in demonstrations]),
        wrenches=np.stack(wrenches),
        duration=SECONDS,
    )


def error(found, true):
    """Relative error in Frobenius' norm at every phase."""
    return np.linalg.norm(found - true, axis=(1, 2)) / np.linalg.norm(true, axis=(1, 2))


@pytest.mark.parametrize("count", [6, 12])
@pytest.mark.parametrize("seed", range(4))
def test_springs_and_dampers_are_recovered(seed, count):
    demonstrations, k, d = springs(seed, count)
    found = estimate_impedance(on_known_phases(demonstrations))
    assert error(found.stiffness[0], k).max() < 0.1
    assert error(found.damping[0], d).mean() < 0.1


@pytest.mark.filterwarnings("ignore:sensor noise")
def test_springs_are_recovered_from_aligned_demonstrations():
    # Alignment takes part of the deviations along the path for progress.
    errors = []
    for seed in range(6):
        demonstrations, k, _ = springs(seed, 12)
        aligned = align(demonstrations, n_samples=300)
        errors.append(error(estimate_impedance(aligned).stiffness[0], k))
    assert np.mean(errors) < 0.1


def test_noise_of_poses_does_not_make_a_hand_seem_soft():
    # 3 mm of noise on 3 mm of deviations. Uncorrected, the estimate is 30 % low.
    demonstrations, k, _ = springs(1, 12, (600,) * 3, size=3e-3, noise=3e-3)
    found = estimate_impedance(on_known_phases(demonstrations)).stiffness[0]
    ratio = np.trace(found, axis1=1, axis2=2) / np.trace(k, axis1=1, axis2=2)
    assert_allclose(ratio.mean(), 1.0, atol=0.1)


def test_hands_that_yield_are_soft_and_rigid_ones_stiff():
    free = on_known_phases(springs(0, stiffness=(0, 0, 0), damping=(0, 0, 0))[0])
    values = np.linalg.eigvalsh(estimate_impedance(free).stiffness)
    assert values.min() > -1e-9
    assert values[0].max() < 10.0
    demonstrations, _, _ = springs(0, stiffness=(2e4,) * 3, size=1e-3, noise=5e-5)
    rigid = estimate_impedance(on_known_phases(demonstrations))
    assert np.linalg.eigvalsh(rigid.stiffness[0]).min() > 1e4


def test_where_demonstrations_do_not_deviate_the_prior_is_left():
    demonstrations, _, _ = springs(0, size=0.0)
    aligned = on_known_phases(demonstrations)
    rng = np.random.default_rng(0)
    pushed = aligned.wrenches + 5.0 * rng.normal(size=(8, 1, 6))
    found = estimate_impedance(replace(aligned, wrenches=pushed))
    k, std = found.along(np.broadcast_to(np.eye(3), (300, 3, 3)))
    expected = np.broadcast_to(PRIOR[:, None, :1], k.shape)
    assert_allclose(k, expected, rtol=1e-6)
    assert_allclose(std, expected, rtol=1e-6)


def test_standard_deviation_is_small_only_along_demonstrated_deviations():
    # Up is an axis of the hand of a door at every phase.
    demonstrations, k, _ = springs(2, size=np.array([0.0, 1e-2, 0.0]))
    found = estimate_impedance(on_known_phases(demonstrations))
    along, std = found.along(np.broadcast_to(np.eye(3), (300, 3, 3)))
    assert_allclose(along[0, :, 1], k[:, 1, 1], rtol=0.1)
    assert std[0, :, 1].max() < 0.1 * PRIOR[0, 0]
    assert std[0, :, [0, 2]].min() > 0.9 * PRIOR[0, 0]


def test_standard_deviation_covers_the_variability_of_intended_forces():
    # Teachers also mean to pull with other forces: 2 N that change slowly.
    misses = []
    for seed in range(8):
        demonstrations, k, _ = springs(seed, 8)
        aligned = on_known_phases(demonstrations)
        rng = np.random.default_rng(seed)
        angle = rng.uniform(3.0, 9.0, (8, 1, 6)) * PHASES[:, None]
        meant = 2.0 * np.sin(angle + rng.uniform(0.0, 7.0, (8, 1, 6)))
        own = replace(aligned, wrenches=aligned.wrenches + meant)
        axes = np.broadcast_to(np.eye(3), (300, 3, 3))
        found, std = estimate_impedance(own).along(axes)
        misses.append((found[0] - np.diagonal(k, axis1=1, axis2=2)) / std[0])
    assert 0.6 < np.sqrt(np.mean(np.square(misses))) < 1.8


def test_turning_the_task_turns_the_stiffness():
    aligned = on_known_phases(springs(3)[0])
    q = Rotation.from_rotvec([0.4, -0.7, 1.1]).as_matrix()

    def turned_by_q(six):
        return (six.reshape(-1, 3) @ q.T).reshape(six.shape)

    # The hand of the new task frame has axes turned alike: R' = Q R Qᵀ.
    poses, wrenches = turned_by_q(aligned.poses), turned_by_q(aligned.wrenches)
    found = estimate_impedance(aligned)
    turned = estimate_impedance(replace(aligned, poses=poses, wrenches=wrenches))
    assert_allclose(turned.stiffness, q @ found.stiffness @ q.T, rtol=1e-6, atol=1e-5)
    assert_allclose(turned.damping, q @ found.damping @ q.T, rtol=1e-6, atol=1e-5)


@pytest.mark.filterwarnings("ignore:sensor noise")
def test_too_few_demonstrations_with_wrenches_raise():
    demonstrations, _, _ = springs(0, 3)
    without = replace(demonstrations[0], wrenches=None)
    with pytest.raises(ValueError, match=r"at least 3 demonstrations .* got 2"):
        estimate_impedance(align([without, *demonstrations[1:]]))
    with pytest.raises(ValueError, match="got 0; record forces"):
        estimate_impedance(align([without] * 3))


LAW = np.repeat([250.0, 25.0], 3)


def table(share, direction=(np.nan,) * 3):
    """Learned stiffness of 160 N/m and 16 N m/rad at every phase."""
    values = np.repeat([160.0, 16.0], 3)
    return PhaseStiffness(
        stiffness=np.tile(values, (5, 1)),
        share=np.full((5, 6), share),
        direction=np.tile(direction, (5, 1)),
    )


@pytest.mark.parametrize(("share", "expected"), [(0.0, 250), (0.5, 200), (1.0, 160)])
def test_learned_stiffness_and_law_are_combined_by_their_logarithms(share, expected):
    combined = table(share).combined(LAW, np.float64(0.3))
    assert_allclose(combined, expected * np.repeat([1.0, 0.1], 3), rtol=1e-12)
    assert share > 0.0 or np.array_equal(combined, LAW)


def test_demonstrated_stiffness_is_that_along_the_frame_of_the_path():
    demonstrations, k, _ = springs(39, 12, (110, 200, 330))
    movement = fit_promp(on_known_phases(demonstrations))
    found = demonstrated_stiffness(movement, DEFAULT_PROFILE)
    assert np.isnan(found.direction).all()
    for row, index in ((30, 90), (50, 150), (70, 209)):
        # The hand of a door turns with the path, whose frame has its axes.
        true = np.diagonal(k[index])
        assert_allclose(found.stiffness[row, :3], true, rtol=0.1)
    assert found.share[10:90, :3].min() > 0.9
    assert found.share[:, 3:].max() < 0.1  # their rotations do not deviate


def test_demonstrated_stiffness_stays_within_the_range_of_the_profile():
    for values, limit in (((0,) * 3, 100.0), ((5e3,) * 3, 500.0)):
        movement = fit_promp(on_known_phases(springs(0, 8, values, (0,) * 3)[0]))
        found = demonstrated_stiffness(movement, DEFAULT_PROFILE)
        assert_allclose(found.stiffness[:, :3], limit)


def pulled(demonstrations, force):
    """The same motions with a constant force in the axes of the hand [N]."""
    return [
        replace(
            one, wrenches=np.pad(into_axes(-one.poses[:, 3:], given), ((0, 0), (0, 3)))
        )
        for one in demonstrations
        for given in [np.broadcast_to(force, (200, 3))]
    ]


@pytest.mark.parametrize(("newtons", "k"), [(0.4, 500), (2.75, 300), (20.0, 100)])
def test_stiffness_from_force_is_low_along_the_force_alone(newtons, k, demonstrations):
    force = newtons * np.array([0.6, 0.0, 0.8])
    agent = make_agent("stiffness-from-force", pulled(demonstrations, force))
    observation = {"ee_pose": np.zeros(6), "wrench": np.zeros(6)}
    agent.reset(observation)
    step = agent.act(observation)
    matrix = step.frame @ np.diag(step.stiffness[:3]) @ step.frame.T
    across = np.eye(3) - np.outer(force, force) / newtons**2
    expected = 500.0 * across + k * (np.eye(3) - across)
    # The first phase is a period ahead of the closed door, where the hand has turned.
    assert_allclose(matrix, expected, atol=5.0)
    assert_allclose(step.stiffness[3:], 50.0)
    # The force turns with the hand.
    pose = agent.movement.learned.predict(np.array([0.5])).mean[0]
    along = agent.config.phase_stiffness.direction[50]
    turned = into_axes(-pose[3:], force / newtons)
    assert np.isnan(along).all() if k == 500 else np.allclose(along, turned, atol=0.02)


def test_stiffness_from_force_refuses_demonstrations_without(demonstrations):
    with pytest.raises(ValueError, match=r"with wrenches, got none; .* such as gp"):
        make_agent("stiffness-from-force", demonstrations)


def test_hands_together_have_the_learned_stiffness_of_each_alone(demonstrations):
    method = POLICIES["stiffness-from-force"].method
    lesson = pulled(demonstrations, [3.0, 0.0, 1.0])
    movement = method.learn(TrainingInput(demonstrations=lesson))
    alone, *together = (method.follow(movement) for _ in range(3))
    batch = batch_agents(together)
    assert type(batch).__name__ == "_VectorisedBatch"
    observation = {"ee_pose": np.zeros((2, 6)), "wrench": np.zeros((2, 6))}
    batch.reset(observation)
    alone.reset({name: each[1] for name, each in observation.items()})
    for angle in np.linspace(0.0, 0.5, 20):
        pose = handle_pose_on_arc(0.5, angle)
        observation["ee_pose"] = np.stack([np.zeros(6), pose])
        steps = batch.act(observation)
        step = alone.act({name: each[1] for name, each in observation.items()})
        assert np.array_equal(steps.stiffness[1], step.stiffness)
        assert np.array_equal(steps.frame[1], step.frame)


def test_learned_stiffness_is_that_of_the_commanded_phase(demonstrations, monkeypatch):
    """The hand is held at the closed door, and the command goes on."""
    asked = []

    def noted(self, stiffness, phase):
        asked.append(float(phase))
        return stiffness

    monkeypatch.setattr(PhaseStiffness, "combined", noted)
    agent = make_agent("stiffness-from-force", pulled(demonstrations, [3.0, 0.0, 1.0]))
    held = {"ee_pose": np.zeros(6), "wrench": np.zeros(6)}
    agent.reset(held)
    steps = [agent.act(held) for _ in range(20)]
    assert asked == [step.phase for step in steps]
    assert steps[-1].phase > steps[-1].observed_phase + 0.01


def test_learned_stiffness_needs_the_frame_of_the_path():
    with pytest.raises(ValueError, match='choose stiffness_frame="path"'):
        ComplianceConfig(stiffness_frame="axes", phase_stiffness=table(1.0))
