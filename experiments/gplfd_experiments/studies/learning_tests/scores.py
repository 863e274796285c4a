"""A policy's skill in numbers: what it learned, compared with what it did not see.

No robot and no simulator: demonstrations are left out, predicted, and adapted to. The
same for every method, by name.

=========================== ==========================================================
``rmse_position_m``         of the mean, at 200 equal steps of a left-out motion
``rmse_rotation_rad``       the same of the angle between orientations
``nlpd``                    negative log predictive density per number, m and rad
``coverage_50/90/95``       share within the central normal intervals
``coverage_95_stated``      share within the 95 % intervals of the method itself
``spread_followed``         correlation of std and the learned demonstrations' spread
``log_dimensionless_jerk``  of the mean, larger is smoother
``via_...``                 see `adaptation` in the module ``via_points`` beside this
``..._rest_...``            the same
``cpu_fit_s``               to align, learn and predict once
``cpu_predict_s``           200 phases
``cpu_adapt_s``             one via-point of those of the first 30 %
``uncertainty_growth``      see `beyond` in the module ``extrapolation`` beside this
``coverage_95_beyond``      the same
``prior_mean_used``         see `prior_mean_used` of the same module
``outputs_...``             see `tumbling` in the module ``tumbling`` beside this
``tumbling_error``          the same
=========================== ==========================================================

A number is None where a method has no such thing. Two tests need movements of their
own, and are made with one kind of left-out demonstrations each, for time: beyond the
demonstrations with "demonstration", tumbling with "radius". In the other kind their
names are missing.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from gplfd_experiments.data.teacher import DEMONSTRATED_RADII, Teacher, TeacherConfig
from gplfd_experiments.episodes.metrics import log_dimensionless_jerk
from gplfd_experiments.studies.learning_tests.accuracy import (
    accuracy,
    averaged,
    spread_followed,
)
from gplfd_experiments.studies.learning_tests.extrapolation import beyond
from gplfd_experiments.studies.learning_tests.folds import (
    Fold,
    OnPhases,
    aligned_to,
    folds,
)
from gplfd_experiments.studies.learning_tests.methods import cpu_seconds, learn
from gplfd_experiments.studies.learning_tests.tumbling import tumbling
from gplfd_experiments.studies.learning_tests.via_points import adaptation
from gplfd_policies.movements.movement import Movement
from gplfd_policies.registry.method import Method

_SAMPLES: Final = 200
_REPEATS: Final = 3
_GROWN: Final = 0.1
"""Before this phase demonstrations have hardly begun to differ."""


def method_metrics(
    method: Method,
    *,
    seed: int,
    demonstrations_per_door: int,
    teacher: Mapping[str, float],
    held_out: str,
) -> dict[str, Any]:
    """Measure a method on the synthetic human's demonstrations.

    Args:
        method: How to learn and to adapt.
        seed: Seeds teacher and learning, and chooses what is left out.
        demonstrations_per_door: How often each of the three doors is demonstrated.
        teacher: Fields of `gplfd_experiments.data.teacher.TeacherConfig`.
        held_out: "demonstration" or "radius"; see `folds` of `learning_tests.folds`.

    Returns:
        Numbers by name, as this module lists them; plain data without NaN.

    Raises:
        ValueError: Another ``held_out``, or demonstrations that the method cannot learn
            from.
    """
    recorded = Teacher(TeacherConfig(**teacher)).demonstrate_doors(
        DEMONSTRATED_RADII, demonstrations_per_door, rng=np.random.default_rng(seed)
    )
    doors = [
        recorded[first : first + demonstrations_per_door]
        for first in range(0, len(recorded), demonstrations_per_door)
    ]
    every = folds(doors, held_out, seed)
    metrics: dict[str, Any] = averaged(
        [score for fold in every for score in _scores(method, fold, seed)]
    )
    if held_out == "demonstration":
        return {**metrics, **beyond(method, every[0], seed)}
    return {**metrics, **tumbling(method, seed)}


def _scores(
    method: Method, fold: Fold, seed: int
) -> Sequence[Mapping[str, float | None]]:
    """Every score of every demonstration that a fold leaves out."""
    movement, cpu_s = learn(method, fold.given, seed)
    left_out = [aligned_to(one, movement.aligned) for one in fold.left_out]
    shared = {
        **adaptation(method, movement, left_out),
        **of_the_movement(movement),
        "cpu_fit_s": cpu_s,
    }
    return [{**of_the_prediction(movement, one), **shared} for one in left_out]


def of_the_prediction(
    movement: Movement, left_out: OnPhases
) -> Mapping[str, float | None]:
    """Return how near a movement is to a demonstration that it did not learn from."""
    asked = left_out.thinned(_SAMPLES)
    predicted = movement.predict(asked.phases)
    return accuracy(predicted, asked.poses, asked.scored(asked.poses))


def of_the_movement(movement: Movement) -> Mapping[str, float | None]:
    """Return how smooth a movement is, how it follows the spread, and how fast."""
    phases = np.linspace(0.0, 1.0, _SAMPLES)
    step = movement.duration / (_SAMPLES - 1)
    aligned = movement.aligned
    grown = aligned.times > _GROWN
    std = movement.predict(aligned.times).std
    return {
        "log_dimensionless_jerk": log_dimensionless_jerk(
            movement.predict(phases).mean[:, :3], step
        ),
        "spread_followed": spread_followed(std[grown], aligned.poses[:, grown]),
        "cpu_predict_s": _prediction_time(movement),
    }


def _prediction_time(movement: Movement) -> float:
    """CPU time of 200 phases that were never asked before [s]."""
    seconds = []
    for repeat in range(1, 1 + _REPEATS):
        phases = np.linspace(1e-6 * repeat, 1.0, _SAMPLES)
        _, elapsed = cpu_seconds(lambda phases=phases: movement.predict(phases))  # type: ignore[misc]
        seconds.append(elapsed)
    return min(seconds)
