"""The task completion index and temporal alignment."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.signal import butter, sosfiltfilt

from gplfd_env.spatial.se3 import handle_pose_on_arc
from gplfd_policies import POLICIES, Demonstration, align, policy_named
from gplfd_policies.demonstrations.aligned import continued
from gplfd_policies.demonstrations.alignment import (
    dynamic_time_warping,
    task_completion_index,
)
from gplfd_policies.registry.method import TrainingInput

METHODS = ["interpolation", "dtw", "dtw-euclidean"]


def minimum_jerk(time):
    time = np.clip(time, 0.0, 1.0)
    return time**3 * (10 - 15 * time + 6 * time**2)


def door_arc(progress, radius=0.5):
    return handle_pose_on_arc(radius, 1.2 * progress)


def demonstration(
    clock=minimum_jerk, path=door_arc, n=200, duration=3.0, noise=0.0, seed=0
):
    time = np.linspace(0.0, 1.0, n)
    sensor = noise * np.random.default_rng(seed).normal(size=(n, 6))
    return Demonstration(times=duration * time, poses=path(clock(time)) + sensor)


def completion_errors(recorded, clock):
    """Errors of the index of an opening, with and without its denoising."""
    fine = np.linspace(0.0, 1.0, 20_001)
    step = np.linalg.norm(np.diff(door_arc(clock(fine)), axis=0), axis=1)
    length = np.append(0.0, np.cumsum(step))
    times = recorded.times / recorded.times[-1]
    truth = np.interp(times, fine, length / length[-1])
    return [
        np.sqrt(np.mean((task_completion_index(recorded, 0.5, on)[0] - truth) ** 2))
        for on in (True, False)
    ]


# --- Task completion index ---------------------------------------------------


def test_eq16_is_the_share_of_the_path_covered():
    poses = np.zeros((5, 6))
    poses[:, 0] = [0.0, 0.1, 0.1, 0.4, 0.5]
    recorded = Demonstration(times=np.array([0, 1, 5, 6, 7.0]), poses=poses)
    index, _ = task_completion_index(recorded)
    assert_allclose(index, [0.0, 0.2, 0.2, 0.8, 1.0], atol=1e-15)


def test_eq16_weights_rotation_as_eq17():
    poses = np.zeros((3, 6))
    poses[1:, 0] = 0.3  # first a shift,
    poses[2, 4] = 0.6  # then a turn
    recorded = Demonstration(times=np.arange(3.0), poses=poses)
    assert task_completion_index(recorded, 0.0)[0][1] == 1.0
    assert task_completion_index(recorded, 1.0)[0][1] == 0.0
    shift, turn = np.sqrt(0.8) * 0.3, np.sqrt(0.2) * 0.6
    (_, share, _), _ = task_completion_index(recorded, 0.2)
    assert share == pytest.approx(shift / (shift + turn))


@settings(max_examples=40)
@given(
    n=st.integers(3, 400),
    noise=st.sampled_from([0.0, 1e-5, 1e-3, 1e-1]),
    seed=st.integers(0, 99),
)
def test_eq16_runs_from_zero_to_one_without_falling(n, noise, seed):
    completion, _ = task_completion_index(demonstration(n=n, noise=noise, seed=seed))
    assert completion[0] == 0.0
    assert completion[-1] == 1.0
    assert np.all(np.diff(completion) >= 0.0)


def rests_at_both_ends(time):
    return minimum_jerk((time - 0.4) / 0.2)


@pytest.mark.parametrize(
    ("clock", "limit"), [(minimum_jerk, 0.006), (rests_at_both_ends, 0.02)]
)
@pytest.mark.parametrize(("n", "noise"), [(200, 2e-3), (1000, 1e-3), (5000, 2e-3)])
def test_phase_error_with_noise_stays_below(clock, limit, n, noise):
    recorded = demonstration(clock, n=n, noise=noise, seed=3)
    denoised, raw = completion_errors(recorded, clock)
    assert denoised < limit
    assert raw > 5 * denoised


@pytest.mark.parametrize("seed", range(3))
def test_phase_error_with_filtered_noise_stays_below(seed):
    # What a suit reports: 60 Hz, low-passed at 8 Hz, 1 mm and 0.3 degrees.
    n = 360
    white = np.random.default_rng(seed).normal(size=(n, 6))
    filtered = sosfiltfilt(butter(2, 8.0, fs=60.0, output="sos"), white, axis=0)
    poses = door_arc(minimum_jerk(np.linspace(0.0, 1.0, n)))
    poses += filtered / filtered.std(axis=0) * np.repeat([1e-3, 5e-3], 3)
    recorded = Demonstration(times=np.arange(n) / 60.0, poses=poses)
    denoised, raw = completion_errors(recorded, minimum_jerk)
    assert denoised < 0.02
    assert raw > 3 * denoised


@pytest.mark.parametrize("n", [6, 20, 200])
@pytest.mark.parametrize(
    ("clock", "cost"),
    [(minimum_jerk, 1.3e-3), (rests_at_both_ends, 0.03), (lambda time: time, 1e-5)],
)
def test_denoising_costs_clean_demonstrations_little(n, clock, cost):
    recorded = demonstration(clock, n=n)
    clean, _ = task_completion_index(recorded)
    raw, _ = task_completion_index(recorded, denoise=False)
    assert_allclose(clean, raw, atol=cost)


def test_noisy_path_warns_with_ratio_and_remedy():
    noisy = demonstration(n=1000, noise=1e-3)
    with pytest.warns(UserWarning, match=r"1 of 1 .*up to \d\.\d\d times.*denoised"):
        align([noisy])
    with pytest.warns(UserWarning, match=r"raw path.*pass denoise=True"):
        align([noisy], denoise=False)


# --- Alignment ---------------------------------------------------------------


def slow_start(time):
    return minimum_jerk(time**1.8)


def test_common_clock_keeps_the_shared_timing():
    recorded = [
        demonstration(path=lambda s, r=radius: door_arc(s, r), n=n, duration=duration)
        for radius, n, duration in ((0.35, 150, 2.0), (0.65, 400, 6.0))
    ]
    aligned = align(recorded, n_samples=101)
    expected = np.stack(
        [door_arc(minimum_jerk(aligned.times), radius) for radius in (0.35, 0.65)]
    )
    assert_allclose(aligned.poses, expected, atol=5e-4)


def test_rest_shared_by_all_is_a_rest_of_the_result():
    # One rests for 30 % of its time at the start, the other for 50 %.
    clocks = [lambda time: minimum_jerk((time - 0.3) / 0.7), lambda time: 2 * time - 1]
    recorded = [
        demonstration(lambda time, c=clock: np.clip(c(time), 0, 1), n=500)
        for clock in clocks
    ]
    aligned = align(recorded, n_samples=101, trim_rests=False)
    resting = aligned.times < 0.39  # the mean rest lasts 0.4
    assert np.abs(aligned.poses[:, resting]).max() < 2e-3
    assert np.abs(aligned.poses[:, aligned.times > 0.5]).max(axis=(1, 2)).min() > 0.1


def test_rotations_of_all_demonstrations_share_one_branch():
    def turned(angle):
        poses = door_arc(np.linspace(0.0, 1.0, 60))
        poses[:, 3:] = [0.0, 0.0, 1.0] * (angle + poses[:, 4:5])
        return Demonstration(times=np.arange(60.0), poses=poses)

    aligned = align([turned(3.0), turned(3.02 - 2 * np.pi), turned(3.04 + 4 * np.pi)])
    assert_allclose(
        aligned.poses[1:, :, 5] - aligned.poses[0, :, 5],
        [[0.02] * 200, [0.04] * 200],
        atol=1e-3,
    )


# --- Dynamic time warping ----------------------------------------------------


def naive_cost(costs):
    total = np.full(costs.shape, np.inf)
    for i in range(costs.shape[0]):
        for j in range(costs.shape[1]):
            before = [total[i - 1, j]] if i else []
            before += [total[i, j - 1]] if j else []
            before += [total[i - 1, j - 1]] if i and j else []
            total[i, j] = costs[i, j] + (min(before) if before else 0.0)
    return total[-1, -1]


@settings(max_examples=60)
@given(
    rows=st.integers(1, 12),
    columns=st.integers(1, 12),
    seed=st.integers(0, 2**31),
    ties=st.booleans(),
)
def test_dtw_cost_equals_the_naive_recursion(rows, columns, seed, ties):
    rng = np.random.default_rng(seed)
    costs = rng.uniform(size=(rows, columns))
    if ties:
        costs = np.round(2 * costs)
    path = dynamic_time_warping(lambda row: costs[row], rows)
    assert costs[path].sum() == pytest.approx(naive_cost(costs), abs=1e-12)
    # The path is admissible.
    cells = np.column_stack(path)
    assert set(map(tuple, np.diff(cells, axis=0).tolist())) <= {(0, 1), (1, 0), (1, 1)}
    assert_array_equal(cells[[0, -1]], [[0, 0], [rows - 1, columns - 1]])


def test_dtw_on_rising_completion_is_interpolation_within_half_a_sample():
    first, second = (
        task_completion_index(demonstration(lambda time, p=power: time**p, n=n))[0]
        for power, n in ((1.0, 200), (1.4, 260))
    )
    rows, columns = dynamic_time_warping(
        lambda row: np.abs(second - first[row]), len(first)
    )
    matched = np.bincount(rows, weights=columns) / np.bincount(rows)
    exact = np.interp(first, second, np.arange(len(second)))
    # At the ends a run of matches is averaged; elsewhere half a sample is the bound.
    assert np.abs(matched - exact)[1:-1].max() <= 0.5 + 1e-9


def test_dtw_makes_staircases_and_interpolation_does_not():
    recorded = [demonstration(n=200), demonstration(slow_start, n=210)]
    roughness = {
        method: np.abs(
            np.diff(align(recorded, method=method, trim_rests=False).poses, 2, axis=1)
        ).max()
        for method in ("interpolation", "dtw")
    }
    assert roughness["dtw"] > 5 * roughness["interpolation"]


def shelf(height):
    """Lift an object to a shelf and put it in; higher is also deeper."""

    def path(progress):
        poses = np.zeros((len(progress), 6))
        poses[:, 1] = height * np.clip(progress / 0.6, 0, 1)
        poses[:, 0] = height * np.clip((progress - 0.6) / 0.9, 0, 0.4 / 0.9)
        return poses

    return path


def test_fig3_euclidean_cost_misaligns_two_shelves_and_completion_aligns_them():
    recorded = [
        demonstration(lambda time: time, path=shelf(0.4), n=201),
        demonstration(slow_start, path=shelf(0.8), n=200),
    ]
    gap, high_when_low_is_lifted = {}, {}
    for method in METHODS:
        aligned = align(
            recorded, method=method, rotation_weight=0.0, trim_rests=False
        ).poses
        covered = aligned[:, :, :2].sum(axis=2)  # both axes only grow
        low, high = covered / covered[:, -1:]
        gap[method] = np.abs(low - high).max()
        high_when_low_is_lifted[method] = high[np.argmax(low > 0.68)]
    assert gap["interpolation"] < 0.012
    assert gap["dtw"] < 0.02
    assert gap["dtw-euclidean"] > 0.2
    # Points half-way up the high path are taken for the top of the low one.
    assert high_when_low_is_lifted["dtw-euclidean"] < 0.4
    assert high_when_low_is_lifted["dtw"] > 0.66


@pytest.mark.parametrize("method", ["interpolation", "dtw"])
def test_clocks_say_when_each_demonstration_was_there(method):
    """Straight paths at paces t and t²: what is reached at a phase has its clock."""
    clock = np.linspace(0.0, 1.0, 301)
    paths = [np.outer(clock**power, [0.5, 0, 0, 0, 0, 0]) for power in (1.0, 2.0)]
    recorded = [
        Demonstration(times=duration * clock, poses=poses)
        for duration, poses in zip((4.0, 7.0), paths, strict=True)
    ]
    aligned = align(recorded, method=method, n_samples=50, denoise=False)
    for times, poses, path in zip(aligned.clocks, aligned.poses, paths, strict=True):
        reached = np.interp(times, clock, path[:, 0])
        assert_allclose(reached, poses[:, 0], atol=4e-3)
    if method == "interpolation":
        assert_allclose(aligned.clocks.mean(axis=0), aligned.times)


def test_aligned_forces_are_those_of_the_hand_at_the_phase():
    """A hand that turns and pulls along its own x-axis, beside one without forces."""
    times = np.linspace(0.0, 2.0, 80)
    angles = 0.6 * times
    poses = np.zeros((80, 6))
    poses[:, 0], poses[:, 4] = 0.2 * times, angles
    pull = np.stack([np.cos(angles), 0.0 * angles, -np.sin(angles)], axis=1)
    wrenches = np.hstack([pull * (5.0 + times)[:, None], np.zeros((80, 3))])
    felt = Demonstration(times=times, poses=poses, wrenches=wrenches)
    plain = Demonstration(times=times, poses=poses)
    aligned = align([felt, plain], n_samples=41)
    assert np.isnan(aligned.wrenches[1]).all()
    assert_allclose(aligned.wrenches[0, :, 0], 5.0 + 2.0 * aligned.times, atol=1e-9)
    assert_allclose(aligned.wrenches[0, :, 1:], 0.0, atol=1e-9)
    assert aligned.forces.poses.shape == (1, 41, 6)
    assert align([plain], n_samples=41).forces is None
    longer = continued(aligned, 0.5)
    assert_allclose(longer.wrenches[0, -1, 0], 7.0)
    assert_allclose(longer.demonstrated.wrenches[0, :, 0].max(), 7.0, atol=0.1)


def test_forces_are_learned_in_the_way_of_the_motion(demonstrations):
    felt = tuple(
        replace(motion, wrenches=np.full(motion.poses.shape, 2.0))
        for motion in demonstrations
    )
    for name in ("gp", "promp"):
        movement = POLICIES[name].method.learn(TrainingInput(demonstrations=felt))
        assert type(movement.forces) is type(movement)
        mean = movement.forces.predict(np.linspace(0.0, 1.0, 5)).mean
        assert_allclose(mean[:, 1], 2.0, atol=0.2)  # up, about which the hand turns
    without = policy_named("gp@no-forces").method
    assert without.learn(TrainingInput(demonstrations=felt)).forces is None
