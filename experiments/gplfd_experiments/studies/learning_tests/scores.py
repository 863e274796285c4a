"""Learning tests of a method: prediction of, and adaptation to, left-out motions.

They use neither robot nor simulator. `method_metrics` leaves out demonstrations of the
synthetic human, `recorded_metrics` one of the user's motion files. Both return:

* ``rmse_position_m``, ``rmse_rotation_rad``: of the mean, at 200 equal steps of a
  left-out motion
* ``nlpd``: negative log predictive density per number, m and rad
* ``coverage_50/90/95``: share within the central normal intervals
* ``spread_followed``: correlation of std and the learned demonstrations' spread
* ``log_dimensionless_jerk``: of the mean, larger is smoother
* ``via_...``: see `adaptation` in the module ``via_points``
* ``cpu_fit_s``, ``cpu_predict_s``, ``cpu_adapt_s``: CPU time to align, learn and
  predict once; for 200 phases; for a via-point of those of the first 30 %

Tests with demonstrations of the synthetic human also return the scores of the module
``synthetic``, which need additional movements: those of `beyond` with "demonstration"
left out, and those of `tumbling` with "radius".

Tests on motion files also return errors in position and rotation, NLPD and coverage of
the rest after 10, 25 and 50 % of the left-out recording were observed as via-points
(``forecast_10_...``), and the same if the method's agent watches the recording and
finds the phase from the samples so far (``online_10_...``, with ``path_m``, the rms
distance of the rest of the path). Densities and coverage are over the outputs that
move, so that recordings of positions alone are scored by positions.

With demonstrated forces, ``force_error_n`` (rms [N]), ``force_nlpd`` (N and N m) and
``force_coverage_95`` are of force and moment in the axes of the hand at known phases,
before any force was measured, and ``forecast_10_force_...`` after shares were measured.

A number is None if a method does not have it.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np

from gplfd_experiments.data.teacher import (
    DEMONSTRATED_RADII,
    ForceConfig,
    Teacher,
    TeacherConfig,
)
from gplfd_experiments.episodes.metrics import log_dimensionless_jerk
from gplfd_experiments.studies.learning_tests.accuracy import (
    accuracy,
    averaged,
    spread_followed,
)
from gplfd_experiments.studies.learning_tests.folds import (
    OnPhases,
    aligned_to,
    by_door,
    cpu_seconds,
    folds,
    learn,
)
from gplfd_experiments.studies.learning_tests.synthetic import beyond, tumbling
from gplfd_experiments.studies.learning_tests.via_points import (
    adaptation,
    force_scores,
    forecasts,
    online_forecasts,
)
from gplfd_policies.arrays.records import FINEST, interpolated
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.movements.movement import Movement
from gplfd_policies.registry.method import Method

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
        left_out = [
            aligned_to(demonstration, movement.aligned)
            for demonstration in fold.left_out
        ]
        shared = {
            **adaptation(method, movement, left_out),
            **_movement_scores(movement),
            "cpu_fit_s": cpu_s,
        }
        scores += [
            {
                **prediction_scores(movement, on_phases),
                **shared,
                **force_scores(method, movement, on_phases, demonstration),
            }
            for on_phases, demonstration in zip(left_out, fold.left_out, strict=True)
        ]
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
