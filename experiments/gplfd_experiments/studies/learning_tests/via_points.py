"""Adaptation by via-points: at the via-points, far from them, and after them."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from gplfd_env.spatial.se3 import into_axes
from gplfd_experiments.episodes.forecast_error import squared_distances
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.studies.learning_tests.accuracy import (
    accuracy,
    averaged,
    none_if_nan,
    rms_distance,
    rms_rotation,
    root_mean_square,
)
from gplfd_experiments.studies.learning_tests.folds import OnPhases, cpu_seconds
from gplfd_policies.adaptation import begin_adaptation
from gplfd_policies.adaptation.gridded import GriddedMovement
from gplfd_policies.agents.agent import CompliantAgent
from gplfd_policies.control.compliance import ComplianceConfig
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.movements.movement import (
    AdaptationForm,
    GaussianTrajectory,
    LearnedMovement,
    Movement,
    ViaPoint,
)
from gplfd_policies.phase.phase_rule import POSE_ERROR
from gplfd_policies.registry.method import Method

GRID: Final = np.linspace(0.0, 1.0, 100)
"""Phases of an adaptation, as many as in the agents."""
_PLACES: Final = [25, 50, 74]
"""Places of the via-points on the grid."""
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

    * Three via-points in one adaptation: distance of the mean from them, with standard
      deviations of 1 mm and 1 mrad and, in "strict", a tenth of it.
    * Each of them alone, strict: change of the mean farther away than 0.3 of the task,
      in units of the standard deviation before; and distance of the mean from the
      demonstration there, as a share of that before.
    * The first 30 % of the demonstration, one via-point for every hundredth, as the
      agents observe it: CPU time of a via-point.

    For methods without via-points all are None.
    """
    form, learned = method.adaptation, movement.predict(GRID)
    if form is None:
        kinds = ("error_position_m", "error_rotation_rad", "far_change", "far_error")
        strict = ("error_strict_position_m", "error_strict_rotation_rad")
        names = [f"via_{name}" for name in (*kinds, *strict)]
        return dict.fromkeys([*names, "cpu_adapt_s"])
    scores: list[Scores] = []
    for demonstration in left_out:
        score: Scores = {"via_far_error": None}
        demanded = demonstration.at(GRID[_PLACES])
        for name, std in (("via_error", _STD), ("via_error_strict", _STRICT_STD)):
            adapted = begin_adaptation(movement, form, GRID)
            for phase, pose in zip(GRID[_PLACES], demanded, strict=True):
                adapted.observe(ViaPoint(phase=float(phase), pose=pose, std=std))
            passed = adapted.mean[_PLACES]
            score[f"{name}_position_m"] = rms_distance(passed, demanded)
            score[f"{name}_rotation_rad"] = rms_rotation(passed, demanded)
        truth = demonstration.at(GRID)
        far_off: list[FloatArray] = []
        for phase, pose in zip(GRID[_PLACES], demanded, strict=True):
            adapted = begin_adaptation(movement, form, GRID)
            adapted.observe(ViaPoint(phase=float(phase), pose=pose, std=_STRICT_STD))
            far = np.abs(GRID - phase) > _FAR
            differences = (
                np.abs(adapted.mean - learned.mean),
                adapted.mean - truth,
                learned.mean - truth,
            )
            far_off.append(
                np.stack([(d / learned.std)[far].ravel() for d in differences])
            )
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
        rest, _, _ = observed(method.adaptation, movement, left_out, share)
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
    if method.adaptation is not None:
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
    return {
        f"{name}_position_m": scores["rmse_position_m"],
        f"{name}_rotation_rad": scores["rmse_rotation_rad"],
        f"{name}_nlpd": scores["nlpd"],
        f"{name}_coverage_95": scores["coverage_95"],
    }


class Forecast(NamedTuple):
    """Forecast of an agent for the whole task, on `GRID`."""

    phase: float
    """Estimated phase of the hand."""
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
        GriddedMovement(movement, method.adaptation, GRID.size),
        phases=method.phases(movement),
        config=replace(method.config, control_period=period),
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
    adapted = begin_adaptation(movement, form, GRID)
    cpu_s = None
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

        _, total = cpu_seconds(observe)
        cpu_s = total / count
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
    form = method.force_adaptation or method.adaptation
    noise = np.repeat(np.array(ComplianceConfig().force_std), 3)
    for share in FORECASTS:
        rest, truth, _ = observed(form, learned, felt, share, noise)
        predictions[f"forecast_{100 * share:.0f}_force"] = rest, truth
    scores: Scores = {}
    for name, (predicted, truth) in predictions.items():
        scores[f"{name}_error_n"] = rms_distance(predicted.mean, truth)
        scores[f"{name}_nlpd"] = none_if_nan(predicted.nlpd(truth))
        scores[f"{name}_coverage_95"] = none_if_nan(
            predicted.coverage(truth, normal=True)
        )
    return scores
