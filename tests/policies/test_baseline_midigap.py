"""Mixtures of discrete-time GPs: moments on the manifold, modes, conditioning."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation
from scipy.stats import multivariate_normal

from gplfd_env.spatial.se3 import handle_pose_on_arc
from gplfd_policies import AlignedDemonstrations, ViaPoint
from gplfd_policies.movements.baselines.midigap import (
    MiDiGaPConfig,
    fit_midigap,
    partition_by_angle,
    rotvec_jacobian,
)

TIMES = np.linspace(0.0, 1.0, 21)
OTHER_SIDE = np.array([1.0, 1.0, -1.0, -1.0, -1.0, 1.0])
PUSHED = np.array([-1.0, 1.0, 1.0, 1.0, -1.0, 1.0])


def doors(radii, seed=0, end=1.2):
    """Openings of doors, with a millimetre and five milliradians of noise."""
    rng = np.random.default_rng(seed)
    poses = np.stack([handle_pose_on_arc(radius, end * TIMES) for radius in radii])
    wobble = np.sin(np.pi * TIMES)[:, None] * rng.normal(size=(len(radii), 1, 6))
    return poses + np.repeat([1e-3, 5e-3], 3) * wobble


def aligned_of(*poses):
    return AlignedDemonstrations(times=TIMES, poses=np.concatenate(poses))


def rotations(rotvecs):
    return Rotation.from_rotvec(np.array(rotvecs))  # it refuses read-only arrays


@pytest.fixture(scope="module")
def tumbling():
    """Large turns about changing axes, of which no rotation vectors are averaged."""
    rng = np.random.default_rng(3)
    poses = rng.normal(size=(5, 21, 6)) * 0.1 + np.outer(TIMES, np.arange(6.0) / 3.0)
    mean = rotations(np.outer(TIMES, [1.0, -1.5, 1.2]))
    for path in poses:
        path[:, 3:] = (rotations(0.3 * rng.normal(size=3)) * mean).as_rotvec()
    return AlignedDemonstrations(times=TIMES, poses=poses)


def test_a_step_has_the_moments_of_its_demonstrations_on_the_manifold(tumbling):
    """One mode and independent steps, as published."""
    config = MiDiGaPConfig(mode_angle=np.pi, length_scale=1e-6)
    movement = fit_midigap(tumbling, config)
    assert len(movement.modes) == 1
    predicted, poses = movement.predict(TIMES), tumbling.poses
    assert_allclose(predicted.mean[:, :3], poses[:, :, :3].mean(axis=0), atol=1e-14)
    assert_allclose(
        predicted.std[:, :3], poses[:, :, :3].std(axis=0, ddof=1), rtol=1e-6
    )
    for step, mean in enumerate(predicted.mean):
        turns = rotations(poses[:, step, 3:]) * rotations(mean[3:]).inv()
        deviations = turns.as_rotvec()
        assert_allclose(deviations.mean(axis=0), 0.0, atol=1e-11)
        shifts = 1e-6 * np.eye(3)
        up, down = (rotations(s * shifts) * rotations(mean[3:]) for s in (1, -1))
        slopes = (up.as_rotvec() - down.as_rotvec()).T / 2e-6
        assert_allclose(rotvec_jacobian(mean[3:]), slopes, atol=1e-8)
        covariance = slopes @ np.cov(deviations.T) @ slopes.T
        assert_allclose(predicted.std[step, 3:] ** 2, np.diag(covariance), rtol=1e-6)
    assert_array_equal(predicted.covariance[:, ~np.eye(21, dtype=bool)], 0.0)


@pytest.mark.parametrize("other", [OTHER_SIDE, PUSHED])
def test_modes_are_found_without_labels_and_hold_their_demonstrations(other):
    pulled, foreign = doors((0.35, 0.5, 0.65), 1), other * doors((0.35, 0.5), 2)
    mixed = np.concatenate([foreign[:1], pulled, foreign[1:]])
    parts = partition_by_angle(mixed, MiDiGaPConfig().mode_angle)
    assert [part.tolist() for part in parts] == [[1, 2, 3], [0, 4]]
    movement = fit_midigap(aligned_of(mixed))
    assert_allclose(movement.weights, [0.6, 0.4])
    for mode, members in zip(movement.modes, (pulled, foreign), strict=True):
        alone = fit_midigap(aligned_of(members)).predict(TIMES)
        assert_array_equal(mode.predict(TIMES).mean, alone.mean)
        assert_array_equal(mode.predict(TIMES).std, alone.std)


def test_observations_choose_the_mode_that_is_followed():
    pulled, pushed = doors((0.35, 0.5, 0.65), 1), PUSHED * doors((0.35, 0.5), 2)
    movement = fit_midigap(aligned_of(pulled, pushed))
    seen = PUSHED * doors((0.42,), 4)[0]
    points = [ViaPoint(phase=TIMES[k], pose=seen[k], std=5e-3) for k in (2, 4, 6)]
    after = movement.adapt(points)
    assert movement.predict(TIMES).mean[-1, 0] > 0.2
    assert after.weights[1] > 0.999
    assert after.predict(TIMES).mean[-1, 0] < -0.2
    # Bayes' rule with the densities of the modes, here of a position.
    place = np.where(np.arange(6) < 3, seen[4], np.nan)
    unsure = movement.adapt([ViaPoint(phase=TIMES[4], pose=place, std=0.1)])
    densities = []
    for mode in movement.modes:
        here = mode.places(TIMES[[4]])
        spread = mode.seen.covariance(here, here)[0, :3, 0, :3]
        density = multivariate_normal(mode.mean[4, :3], spread + 0.01 * np.eye(3))
        densities.append(density.pdf(seen[4, :3]))
    assert_allclose(np.exp([mode.log_evidence for mode in unsure.modes]), densities)
    expected = [0.6, 0.4] * np.array(densities)
    assert_allclose(unsure.weights, expected / expected.sum())


@pytest.mark.parametrize("length_scale", [0.1, 1.0])
def test_conditioning_equals_that_of_a_dense_gaussian(aligned, length_scale):
    """Positions exactly, with two demands, one of them on some outputs alone."""
    movement = fit_midigap(aligned, MiDiGaPConfig(length_scale=length_scale))
    mode, times, grid = movement.modes[0], aligned.times, aligned.times[::20]
    rows = np.append(np.arange(0, 200, 20), [50, 150])
    taper = np.exp(-0.5 * (np.subtract.outer(times, times) / length_scale) ** 2)
    jacobian = rotvec_jacobian(mode.mean[:, 3:])
    deviations = mode.roots.copy()
    deviations[:, :, 3:] = np.einsum("tij,ktj->kti", jacobian, deviations[:, :, 3:])
    joint = np.einsum("kti,ksj->tisj", deviations, deviations) * taper[:, None, :, None]
    joint = joint[rows][:, :, rows].reshape(6 * rows.size, -1)
    pose = np.where([1, 0, 1, 0, 0, 0], aligned.poses[0, 150], np.nan)
    points = [
        ViaPoint(phase=times[50], pose=aligned.poses[0, 50], std=1e-3, along=0.01),
        ViaPoint(phase=times[150], pose=pose, std=2e-3),
    ]
    seen = np.append(np.arange(60, 66), [66, 68])
    noise = np.diag(np.repeat([1e-6, 4e-6], [6, 2]))
    noise[:6, :6] += 1e-4
    turn = rotations(points[0].pose[3:]) * rotations(mode.mean[50, 3:]).inv()
    missed = np.concatenate(
        [
            points[0].pose[:3] - mode.mean[50, :3],
            jacobian[50] @ turn.as_rotvec(),
            (pose - mode.mean[150])[[0, 2]],
        ]
    )
    gain = joint[:, seen] @ np.linalg.inv(joint[np.ix_(seen, seen)] + noise)
    change = (gain @ missed).reshape(-1, 6)[:-2]
    after = (joint - gain @ joint[seen]).reshape(rows.size, 6, rows.size, 6)
    after = np.einsum("tisi->its", after)[:, :-2, :-2]
    adapted = movement.adapt(points).predict(grid)
    assert_allclose(adapted.covariance, after, atol=2e-10)  # 1e-8 of it is white
    mean = mode.mean[::20]
    assert_allclose(adapted.mean[:, :3], (mean + change)[:, :3], atol=1e-9)
    tangent = np.linalg.solve(jacobian[::20], change[:, 3:, None])[:, :, 0]
    turned = rotations(tangent) * rotations(mean[:, 3:])
    assert_allclose(adapted.mean[:, 3:], turned.as_rotvec(), atol=1e-9)
