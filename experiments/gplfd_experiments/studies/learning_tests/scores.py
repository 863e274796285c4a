"""Learning tests of a method: prediction of, and adaptation to, left-out motions.

They use neither robot nor simulator. `method_metrics` leaves out demonstrations of the
synthetic human, `recorded_metrics` one of the user's motion files. Both return:

* ``rmse_position_m``, ``rmse_rotation_rad``, ``nlpd`` per number (m and rad),
  ``coverage_50/90/95`` of the central normal intervals: at 200 equal steps of a
  left-out motion, over the outputs that move
* ``spread_followed``: correlation of std and the learned demonstrations' spread
* ``log_dimensionless_jerk``: of the mean, larger is smoother
* ``via_...``: see `adaptation`
* ``cpu_fit_s``, ``cpu_predict_s``, ``cpu_adapt_s``: CPU time to align, learn and
  predict once; for 200 phases; for a via-point of those of the first 30 %
* with demonstrated forces, ``force_error_n`` (rms [N]), ``force_nlpd`` (N and N m) and
  ``force_coverage_95`` of force and moment in the axes of the hand at known phases,
  and ``forecast_10_force_...`` after shares were measured

Tests with the synthetic human also return the scores of `beyond` with "demonstration"
left out, and of `tumbling`, a synthetic task with a known distribution, with "radius".
Tests on motion files also score the rest after 10, 25 and 50 % of the left-out
recording were observed as via-points (``forecast_10_...``), and the same if the
method's agent watches the recording (``online_10_...``, with ``path_m``, the rms
distance of the rest of the path). A number is None if a method does not have it.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from gplfd_env.spatial.se3 import into_axes
from gplfd_experiments.data.teacher import (
    DEMONSTRATED_RADII,
    ForceConfig,
    Teacher,
    TeacherConfig,
)
from gplfd_experiments.data.teacher.motion import smooth_functions
from gplfd_experiments.episodes.metrics import log_dimensionless_jerk, squared_distances
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.studies.learning_tests.folds import (
    Fold,
    OnPhases,
    accuracy,
    aligned_to,
    averaged,
    by_door,
    cpu_seconds,
    folds,
    learn,
    none_if_nan,
    rms_distance,
    rms_rotation,
    root_mean_square,
    spread_followed,
)
from gplfd_policies.adaptation import begin_adaptation
from gplfd_policies.adaptation.gridded import GriddedMovement
from gplfd_policies.agents.agent import CompliantAgent
from gplfd_policies.arrays.records import FINEST, interpolated
from gplfd_policies.control.compliance import ComplianceConfig
from gplfd_policies.demonstrations.alignment import task_completion_index
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.gp.exact import LOG_2PI
from gplfd_policies.movements.movement import (
    AdaptationForm,
    GaussianTrajectory,
    LearnedMovement,
    Movement,
    ViaPoint,
)
from gplfd_policies.movements.prior_mean import PosePath
from gplfd_policies.phase.phase_rule import POSE_ERROR
from gplfd_policies.registry.method import Method

GRID: Final = np.linspace(0.0, 1.0, 100)
"""Phases of an adaptation, as many as in the agents."""
_PLACES: Final = [25, 50, 74]  # Places of the via-points on the grid.
# Standard deviations of a via-point, and of one that outweighs the demonstrations.
_STD, _STRICT_STD = 1e-3, 1e-4  # [m, rad]
_FAR: Final = 0.3  # Distance from a via-point that counts as far [phase].
_SEEN: Final = 0.3  # Observed part whose via-points are timed [phase].
FORECASTS: Final = (0.10, 0.25, 0.50)
"""Observed shares of a recording, in order."""
_AGENTS_NOISE: Final = np.repeat(POSE_ERROR, 3)
_BEHIND: Final = 0.03
"""The path ahead begins this much before the estimated phase of an agent."""

Scores = dict[str, float | None]
"""Numbers by name; None for those that a method does not have."""


def adaptation(
    method: Method, movement: Movement, left_out: Sequence[OnPhases]
) -> Scores:
    """Adapt to left-out demonstrations; return averages by name.

    * Three via-points together: distance of the mean from them, with standard
      deviations of 1 mm and 1 mrad and, in "strict", a tenth of it.
    * Each alone, strict, farther away than 0.3 of the task: change of the mean [std
      before], and its distance from the demonstration as a share of that before.
    * One for every hundredth of the first 30 %: CPU time of a via-point.

    For methods without via-points all are None.
    """
    form, learned = method.adaptation(movement), movement.predict(GRID)
    if form is None:
        names = ["error_position_m", "error_rotation_rad", "far_change", "far_error"]
        names += ["error_strict_position_m", "error_strict_rotation_rad"]
        return dict.fromkeys([*(f"via_{name}" for name in names), "cpu_adapt_s"])
    scores: list[Scores] = []
    for demonstration in left_out:
        score: Scores = {"via_far_error": None}
        demanded, truth = demonstration.at(GRID[_PLACES]), demonstration.at(GRID)
        for name, std in (("via_error", _STD), ("via_error_strict", _STRICT_STD)):
            adapted = begin_adaptation(movement, form, GRID)
            for phase, pose in zip(GRID[_PLACES], demanded, strict=True):
                adapted.observe(ViaPoint(phase=float(phase), pose=pose, std=std))
            passed = adapted.mean[_PLACES]
            score[f"{name}_position_m"] = rms_distance(passed, demanded)
            score[f"{name}_rotation_rad"] = rms_rotation(passed, demanded)
        far_off: list[FloatArray] = []
        for phase, pose in zip(GRID[_PLACES], demanded, strict=True):
            adapted = begin_adaptation(movement, form, GRID)
            adapted.observe(ViaPoint(phase=float(phase), pose=pose, std=_STRICT_STD))
            changed = np.abs(adapted.mean - learned.mean)
            apart = changed, adapted.mean - truth, learned.mean - truth
            far = np.abs(GRID - phase) > _FAR
            far_off.append(np.stack([(d / learned.std)[far].ravel() for d in apart]))
        change, after, before = np.concatenate(far_off, axis=1)
        error, error_before = np.sqrt(np.mean(np.stack([after, before]) ** 2, axis=1))
        score["via_far_change"] = float(change.mean())
        if error_before:
            score["via_far_error"] = float(error / error_before)
        _, _, score["cpu_adapt_s"] = observed(form, movement, demonstration, _SEEN)
        scores.append(score)
    return averaged(scores)


def forecasts(method: Method, movement: Movement, left_out: OnPhases) -> Scores:
    """Return the accuracy of the rest after the shares `FORECASTS` were observed.

    A method without via-points does not adapt the movement.
    """
    scores: Scores = {}
    for share in FORECASTS:
        rest, _, _ = observed(method.adaptation(movement), movement, left_out, share)
        scores |= _rest_scores(f"forecast_{100 * share:.0f}", rest, left_out)
    return scores


def online_forecasts(
    method: Method, movement: Movement, left_out: OnPhases, period: float
) -> Scores:
    """Return the scores of `forecasts` for the method's agent with a period [s].

    The phases of the truth follow from its whole path and are unknown to the agent.
    ``path_m`` is the rms distance of the path ahead from its forecast, without timing.
    """
    counts = np.searchsorted(left_out.phases, FORECASTS, side="right").tolist()
    learned = movement.predict(GRID)
    watched: Mapping[int, Forecast] = {}
    if method.adaptation(movement) is not None:
        watched = watch(method, movement, left_out.poses, counts, period)
    scores: Scores = {}
    for share, count in zip(FORECASTS, counts, strict=True):
        forecast = watched.get(count) or Forecast(share, learned)
        rest, name = forecast.trajectory[share < GRID], f"online_{100 * share:.0f}"
        scores |= _rest_scores(name, rest, left_out)
        truth = left_out.at(rest.times)[:, :3]
        scores[f"{name}_path_m"] = path_distance(forecast, truth)
    return scores


def _rest_scores(name: str, rest: GaussianTrajectory, left_out: OnPhases) -> Scores:
    truth = left_out.at(rest.times)
    scores = accuracy(rest, truth, left_out.scored(truth))
    kept = ("rmse_position_m", "rmse_rotation_rad", "nlpd", "coverage_95")
    return {f"{name}_{kind.removeprefix('rmse_')}": scores[kind] for kind in kept}


class Forecast(NamedTuple):
    """Forecast for the whole task, on `GRID`, at an estimated phase of the hand."""

    phase: float
    trajectory: GaussianTrajectory


def watch(
    method: Method,
    movement: Movement,
    poses: FloatArray,
    counts: Collection[int],
    period: float,
) -> Mapping[int, Forecast]:
    """Let the method's agent, with its own phase rule and via-points, observe poses.

    Poses (N, 6) [m, rad] of the hand are one every period [s], without forces. Returns
    forecasts by number of observed poses, 1 to N; they depend on no later pose.
    """
    agent = CompliantAgent(
        GriddedMovement(movement, method.adaptation(movement), GRID.size),
        phases=method.pipeline.phases(movement),
        config=replace(method.pipeline.config, control_period=period),
    )
    watched = {}
    for count, pose in enumerate(poses[: max(counts)], start=1):
        step = agent.act({"ee_pose": pose, "wrench": np.zeros(6)})
        if count in counts:
            watched[count] = Forecast(float(step.observed_phase), agent.forecast())
    return watched


def path_distance(forecast: Forecast, positions: FloatArray) -> float:
    """Return the rms distance [m] of positions (M, 3) from the forecast path ahead."""
    path = forecast.trajectory.mean[forecast.phase - _BEHIND < GRID, :3]
    return root_mean_square(np.sqrt(squared_distances(positions, path)))


def observed(
    form: AdaptationForm | None,
    movement: Movement,
    left_out: OnPhases,
    share: float,
    noise: FloatArray = _AGENTS_NOISE,
) -> tuple[GaussianTrajectory, FloatArray, float | None]:
    """Adapt to the first share of a demonstration, like an agent that opens a door.

    The noise of its via-points is six standard deviations. Returns prediction and truth
    of the rest, and the CPU time of a via-point [s].
    """
    adapted, cpu_s = begin_adaptation(movement, form, GRID), None
    if form is not None:
        spacing = ComplianceConfig().via_spacing
        count = round(share / spacing)
        phases: FloatArray = spacing * np.arange(1.0, count + 1.0)
        via_points = [
            ViaPoint(phase=float(phase), pose=pose, std=noise)
            for phase, pose in zip(phases, left_out.at(phases), strict=True)
        ]

        def observe() -> None:
            for via_point in via_points:
                adapted.observe(via_point)
                _ = adapted.mean, adapted.std

        cpu_s = cpu_seconds(observe)[1] / count
    ahead = share < GRID
    return adapted.trajectory()[ahead], left_out.at(GRID)[ahead], cpu_s


def force_scores(
    method: Method, movement: Movement, left_out: OnPhases, demonstration: Demonstration
) -> Scores:
    """Return the accuracy of the wrench, in the axes of the hand, at known phases.

    Empty if no forces were learned or recorded.
    """
    learned = movement.forces if isinstance(movement, LearnedMovement) else None
    if learned is None or demonstration.wrenches is None:
        return {}
    rotations = demonstration.poses[:, None, 3:]
    apart = into_axes(rotations, demonstration.wrenches.reshape(-1, 2, 3))
    felt = OnPhases(phases=left_out.phases, poses=apart.reshape(-1, 6))
    asked = felt.thinned(200)
    predictions = {"force": (learned.predict(asked.phases), asked.poses)}
    form = method.force_adaptation(learned)
    noise = np.repeat(np.array(ComplianceConfig().force_std), 3)
    for share in FORECASTS:
        rest, truth, _ = observed(form, learned, felt, share, noise)
        predictions[f"forecast_{100 * share:.0f}_force"] = rest, truth
    scores: Scores = {}
    for name, (predicted, truth) in predictions.items():
        scores[f"{name}_error_n"] = rms_distance(predicted.mean, truth)
        scores[f"{name}_nlpd"] = none_if_nan(predicted.nlpd(truth))
        coverage = predicted.coverage(truth, normal=True)
        scores[f"{name}_coverage_95"] = none_if_nan(coverage)
    return scores


FEWEST: Final = 3
"""Smallest number of recordings; one is left out, and a spread needs two."""

_SAMPLES: Final = 200
_REPEATS: Final = 3
_GROWN: Final = 0.1  # Phase before which demonstrations hardly differ.
_UNEVEN: Final = 0.01  # Relative difference of time steps that count as equal.


def method_metrics(
    method: Method,
    *,
    seed: int,
    demonstrations_per_door: int,
    teacher: Mapping[str, float],
    held_out: str,
    demonstrated_forces: bool = False,
) -> dict[str, Any]:
    """Measure a method on the synthetic human's demonstrations."""
    forces = ForceConfig() if demonstrated_forces else None
    recorded = Teacher(TeacherConfig(**teacher), forces=forces).demonstrate_doors(
        DEMONSTRATED_RADII, demonstrations_per_door, rng=np.random.default_rng(seed)
    )
    every = folds(by_door(recorded, demonstrations_per_door), held_out, seed)
    scores: list[Mapping[str, float | None]] = []
    for fold in every:
        movement, cpu_s = learn(method, fold.training, seed)
        left_out = [aligned_to(whole, movement.aligned) for whole in fold.left_out]
        shared = {
            **adaptation(method, movement, left_out),
            **_movement_scores(movement),
            "cpu_fit_s": cpu_s,
        }
        for on_phases, whole in zip(left_out, fold.left_out, strict=True):
            predicted = prediction_scores(movement, on_phases)
            wrenches = force_scores(method, movement, on_phases, whole)
            scores.append({**predicted, **shared, **wrenches})
    if held_out == "demonstration":
        return {**averaged(scores), **beyond(method, every[0], seed)}
    return {**averaged(scores), **tumbling(method, seed)}


def recorded_metrics(
    method: Method, recordings: Sequence[Demonstration], number: int
) -> dict[str, Any]:
    """Leave one recording out, learn from the others, and predict it."""
    movement, left_out, cpu_s = without(method, recordings, number)
    recording = _evenly_sampled(recordings[number])
    period = float(np.ptp(recording.times)) / (len(left_out.phases) - 1)
    return {
        **prediction_scores(movement, left_out),
        **adaptation(method, movement, [left_out]),
        **forecasts(method, movement, left_out),
        **online_forecasts(method, movement, left_out, period),
        **force_scores(method, movement, left_out, recording),
        **_movement_scores(movement),
        "cpu_fit_s": cpu_s,
    }


def without(
    method: Method, recordings: Sequence[Demonstration], number: int
) -> tuple[Movement, OnPhases, float]:
    """Learn from all recordings except one."""
    others = [*recordings[:number], *recordings[number + 1 :]]
    movement, cpu_s = learn(method, others, number)
    left_out = _evenly_sampled(recordings[number])
    every = np.concatenate([recording.poses for recording in recordings])
    moving = np.asarray(np.ptp(every, axis=0) > FINEST)
    on_phases = replace(aligned_to(left_out, movement.aligned), moving=moving)
    return movement, on_phases, cpu_s


def _evenly_sampled(recording: Demonstration) -> Demonstration:
    steps = np.diff(recording.times)
    if np.ptp(steps) <= _UNEVEN * np.median(steps):
        return recording
    first, last = recording.times[[0, -1]]
    count = math.ceil((last - first) / float(np.median(steps))) + 1
    times = np.linspace(first, last, count)
    sampled = partial(interpolated, times, recording.times)
    wrenches = None if recording.wrenches is None else sampled(recording.wrenches)
    return Demonstration(times=times, poses=sampled(recording.poses), wrenches=wrenches)


def prediction_scores(
    movement: Movement, left_out: OnPhases
) -> Mapping[str, float | None]:
    """Return the accuracy of a movement at a left-out demonstration."""
    asked = left_out.thinned(_SAMPLES)
    predicted = movement.predict(asked.phases)
    return accuracy(predicted, asked.poses, asked.scored(asked.poses))


def _movement_scores(movement: Movement) -> Mapping[str, float | None]:
    """Return smoothness, agreement with the demonstrations' spread, and speed."""
    aligned, step = movement.aligned, movement.duration / (_SAMPLES - 1)
    grown = aligned.times > _GROWN
    std = movement.predict(aligned.times).std
    # Different phases each time, so that no result is cached.
    asked = [np.linspace(1e-6 * n, 1.0, _SAMPLES) for n in range(1, 1 + _REPEATS)]
    seconds = [cpu_seconds(partial(movement.predict, phases))[1] for phases in asked]
    path = movement.predict(np.linspace(0.0, 1.0, _SAMPLES)).mean[:, :3]
    return {
        "log_dimensionless_jerk": log_dimensionless_jerk(path, step),
        "spread_followed": spread_followed(std[grown], aligned.poses[:, grown]),
        "cpu_predict_s": min(seconds),
    }


_MOVING: Final = [0, 2, 4]
"""Outputs that move when a door opens: x, z and θu_y; the others are constant."""
# Phases at the end of the learned part, beyond it, and so far beyond it that it has no
# influence, because length-scales are at most three.
_BORDER, _BEYOND = np.linspace(0.95, 1.0, 11), np.linspace(1.4, 1.5, 11)
_REMOTE: Final = np.linspace(20.0, 21.0, 11)
_OFFSET: Final = np.array([0.1, 0.0, -0.1, 0.0, 0.3, 0.0])
"""Distance of the prior mean from the demonstrations' mean [m, rad]."""


def beyond(method: Method, fold: Fold, seed: int) -> Mapping[str, float | None]:
    """Learn the first 70 % of a task and predict beyond it.

    Phase 1 is where the shortened demonstrations end. ``uncertainty_growth`` is the
    standard deviation at phases 1.4 to 1.5 over that at 0.95 to 1, as the geometric
    mean of x, z and θu_y. A method that keeps the last spread has 1.
    """
    starts = []
    for whole in fold.training:
        size = int(np.searchsorted(task_completion_index(whole)[0], 0.7)) + 1
        start = Demonstration(times=whole.times[:size], poses=whole.poses[:size])
        starts.append(start)
    movement, _ = learn(method, starts, seed)
    border = movement.predict(_BORDER).std[:, _MOVING]
    outside = movement.predict(_BEYOND).std[:, _MOVING]
    scores: dict[str, float | None] = {
        "uncertainty_growth": None,
        "prior_mean_used": prior_mean_used(method, starts, seed, movement),
    }
    if np.isfinite(border).all():
        ratios = outside.mean(axis=0) / border.mean(axis=0)
        scores["uncertainty_growth"] = float(np.exp(np.mean(np.log(ratios))))
    return scores


def prior_mean_used(
    method: Method, demonstrations: Sequence[Demonstration], seed: int, plain: Movement
) -> float | None:
    """Give a method a prior mean and predict far beyond the demonstrations.

    The prior mean is the demonstrations' mean, displaced by 0.1 m and 0.3 rad, and
    constant after its last pose. A method that corrects it everywhere does not return
    to it. Returns the displacement of the prediction from that of the movement without
    a prior mean, as a share of the distance to the prior mean in [0, 1]; None if the
    method accepts no prior mean.
    """
    if not method.learner.accepts_prior_mean:
        return None
    aligned = plain.aligned
    prior = PosePath(phases=aligned.times, poses=aligned.poses.mean(axis=0) + _OFFSET)
    informed, _ = learn(method, demonstrations, seed, prior)
    without = plain.predict(_REMOTE).mean
    moved = informed.predict(_REMOTE).mean - without
    whole = prior.mean(_REMOTE) - without
    share = float(np.sum(moved * whole) / np.sum(whole**2))
    return min(max(share, 0.0), 1.0)


_COUNT, _DURATION = 6, 6.0  # of demonstrations, and of each [s]
_CLOCK: Final = np.linspace(0.0, 1.0, 301)
_CORRELATION: Final = 0.25
TUMBLE_STD: Final = 0.05
"""Standard deviation of the orientation about each of its axes [rad]."""
_JUDGED: Final = np.linspace(0.1, 1.0, 91)


def tumbling(method: Method, seed: int) -> Mapping[str, float | None]:
    """Learn the task with two outputs, and with six.

    Every method has six outputs and one input, the phase. x and z are learned while the
    four other outputs are constant, and again while all six move.
    """
    two, _ = learn(method, tumble(seed, active=(0, 2)), seed)
    six, _ = learn(method, tumble(seed, active=range(6)), seed)
    mean = six.predict(_JUDGED).mean
    truth = np.zeros_like(mean)
    truth[:, 3:] = tumbled_rotations(_JUDGED).as_rotvec()
    alone, beside = _excess(two, seed), _excess(six, seed)
    change = None if alone is None or beside is None else beside - alone
    return {
        "outputs_nlpd_change": change,
        "tumbling_error": rms_rotation(mean, truth) / (math.sqrt(3.0) * TUMBLE_STD),
    }


def tumbled_rotations(phases: FloatArray) -> Rotation:
    """Return the true orientations: 1.4 π about y, and 0.5 π about x of the hand."""
    about_y = Rotation.from_rotvec(np.outer(1.4 * np.pi * phases, [0.0, 1.0, 0.0]))
    about_x = Rotation.from_rotvec(np.outer(0.5 * np.pi * phases**2, [1.0, 0.0, 0.0]))
    return about_y * about_x


def _spread(phases: FloatArray) -> FloatArray:
    """Standard deviation of z [m]; its mean is zero, so alignment has no effect."""
    return 0.002 + 0.02 * phases**2


def tumble(seed: int, active: range | tuple[int, ...]) -> tuple[Demonstration, ...]:
    """Draw demonstrations of the task."""
    rng = np.random.default_rng(seed)
    resting = [output for output in range(6) if output not in active]
    demonstrations = []
    for _ in range(_COUNT):
        # All start at the same pose, as in demonstrations in a task frame.
        wobble = smooth_functions(_CLOCK, _CORRELATION, 5, rng)
        wobble *= np.minimum(1.0, 10.0 * _CLOCK)[:, None]
        # Equal lengths along x [m], so that the clocks agree.
        y, z = 0.01 * wobble[:, 0], _spread(_CLOCK) * wobble[:, 1]
        positions = np.column_stack([_CLOCK, y, z])
        turn = Rotation.from_rotvec(TUMBLE_STD * wobble[:, 2:])
        turned = (tumbled_rotations(_CLOCK) * turn).as_quat()
        whole = Demonstration.from_quaternions(_CLOCK, positions, turned, order="xyzw")
        poses = whole.poses.copy()
        poses[:, resting] = 0.0
        demonstrations.append(Demonstration(times=_DURATION * _CLOCK, poses=poses))
    return tuple(demonstrations)


def _excess(movement: Movement, seed: int) -> float | None:
    """Negative log density of z in other repetitions, above that of the truth."""
    rng = np.random.default_rng([seed, 1])
    wobble = smooth_functions(_JUDGED, _CORRELATION, 100, rng)
    std = _spread(_JUDGED)[:, None]
    drawn, predicted = std * wobble, movement.predict(_JUDGED)
    # `scipy.stats.norm.logpdf`, whose import takes a second, has the same bits.
    truth, got = (
        np.mean(-(((drawn - mean) / of) ** 2) / 2.0 - 0.5 * LOG_2PI - np.log(of))
        for mean, of in ((0.0, std), (predicted.mean[:, [2]], predicted.std[:, [2]]))
    )
    return none_if_nan(float(truth - got))
