"""What a method learned from recordings, compared with the one it did not see.

The numbers are those of `gplfd_experiments.studies.learning_tests.scores` for one
recording that is left out; densities and coverage are those of the outputs that move,
so that recordings of positions alone are judged by positions. Besides, once 10, 25 and
50 % of it have been seen as via-points:

============================= ======================================================
``forecast_10_position_m``    root mean square error of the rest
``forecast_10_rotation_rad``  the same of the angle between orientations
``forecast_10_nlpd``          negative log predictive density per number of the rest
``forecast_10_coverage_95``   share of the rest within central normal intervals
============================= ======================================================
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gplfd_experiments.studies.learning_tests.folds import OnPhases, aligned_to
from gplfd_experiments.studies.learning_tests.methods import learn
from gplfd_experiments.studies.learning_tests.scores import (
    of_the_movement,
    of_the_prediction,
)
from gplfd_experiments.studies.learning_tests.via_points import adaptation, forecasts
from gplfd_policies.demonstrations.aligned import FINEST
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.movements.movement import Movement
from gplfd_policies.registry.method import Method

FEWEST: Final = 3
"""Recordings; one is left out, and a spread takes two."""

_UNEVEN: Final = 0.01
"""Steps of time that differ by a smaller share are even."""


def recorded_metrics(
    method: Method, recordings: Sequence[Demonstration], number: int
) -> dict[str, Any]:
    """Leave one recording out, learn from the others, and predict it.

    Args:
        method: How to learn and to adapt.
        recordings: At least `FEWEST`, in one frame.
        number: Which is left out; also seeds the learning.

    Raises:
        ValueError: The method cannot learn from the others.
    """
    movement, left_out, cpu_s = without(method, recordings, number)
    return {
        **of_the_prediction(movement, left_out),
        **adaptation(method, movement, [left_out]),
        **forecasts(method, movement, left_out),
        **of_the_movement(movement),
        "cpu_fit_s": cpu_s,
    }


def without(
    method: Method, recordings: Sequence[Demonstration], number: int
) -> tuple[Movement, OnPhases, float]:
    """Learn from all recordings but one.

    Args:
        method: How to learn.
        recordings: At least `FEWEST`, in one frame.
        number: Which is left out; also seeds the learning.

    Returns:
        What was learned, the one that was left out on its phases, and the CPU time [s].

    Raises:
        ValueError: The method cannot learn from the others.
    """
    given = [*recordings[:number], *recordings[number + 1 :]]
    movement, cpu_s = learn(method, given, number)
    left_out = aligned_to(_evenly(recordings[number]), movement.aligned)
    return movement, replace(left_out, moving=_moving(recordings)), cpu_s


def _moving(recordings: Sequence[Demonstration]) -> NDArray[np.bool_]:
    """Return which numbers of a pose move in some recording, (6,)."""
    every = np.concatenate([one.poses for one in recordings])
    return np.asarray(np.ptp(every, axis=0) > FINEST)


def _evenly(one: Demonstration) -> Demonstration:
    """Return a recording at equal steps of time, as it is if it has them."""
    steps = np.diff(one.times)
    if np.ptp(steps) <= _UNEVEN * np.median(steps):
        return one
    count = math.ceil((one.times[-1] - one.times[0]) / float(np.median(steps))) + 1
    times = np.linspace(one.times[0], one.times[-1], count)
    poses = [np.interp(times, one.times, output) for output in one.poses.T]
    return Demonstration(times=times, poses=np.column_stack(poses))
