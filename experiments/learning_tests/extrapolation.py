"""What a policy does where nothing was demonstrated."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from experiments.learning_tests.folds import Fold
from experiments.learning_tests.methods import learn
from experiments.learning_tests.prior_mean import prior_mean_used
from policies.completion import task_completion_index
from policies.demonstrations import Demonstration
from policies.method import Method

_MOVING: Final = [0, 2, 4]
"""Outputs that a door moves: x, z and θu_y. The others stay where they are beyond the
demonstrations, too, and their spread as it is."""
_KEPT: Final = 0.7
"""Share of the task that is learned before asking beyond."""
_BORDER: Final = np.linspace(0.95, 1.0, 11)
_BEYOND: Final = np.linspace(1.4, 1.5, 11)
"""Phases, in lengths of what was learned."""


def beyond(method: Method, fold: Fold, seed: int) -> Mapping[str, float | None]:
    """Learn the first 70 % of a task and ask beyond.

    The demonstrations end where 70 % of their path is done, and phase 1 is there. How
    much the standard deviation grows is its value half as far again beyond, at phases
    1.4 to 1.5, over that at the end of what was learned, 0.95 to 1: geometric mean of
    x, z and θu_y. That of the end, not of all phases, because demonstrations of
    different doors spread more and more: a method that just holds the last spread
    has 1. What was left out goes on in its own time; the share of it within the
    normal 95 % interval there is counted. What becomes of a prior mean is asked much
    farther beyond (`experiments.learning_tests.prior_mean.prior_mean_used`).

    Args:
        method: How to learn.
        fold: What to learn from, and what to predict.
        seed: Seeds whatever is random in the learning.
    """
    starts = [_start(demonstration) for demonstration in fold.given]
    movement = learn(method, starts, seed).movement
    border = movement.predict(_BORDER).std[:, _MOVING]
    outside = movement.predict(_BEYOND).std[:, _MOVING]
    used = prior_mean_used(method, starts, seed, movement)
    if not np.isfinite(border).all():
        return {
            "uncertainty_growth": None,
            "coverage_95_beyond": None,
            "prior_mean_used": used,
        }
    ratios = outside.mean(axis=0) / border.mean(axis=0)
    shares = []
    for demonstration in fold.left_out:
        size = len(_start(demonstration).times)
        times = demonstration.times - demonstration.times[0]
        ahead = slice(size, None)
        asked = times[ahead] / times[size - 1]
        truth = demonstration.poses[ahead]
        shares.append(movement.predict(asked).coverage(truth, normal=True))
    return {
        "uncertainty_growth": float(np.exp(np.mean(np.log(ratios)))),
        "coverage_95_beyond": float(np.mean(shares)),
        "prior_mean_used": used,
    }


def _start(demonstration: Demonstration) -> Demonstration:
    index = task_completion_index(demonstration)
    size = int(np.searchsorted(index, _KEPT)) + 1
    return Demonstration(
        times=demonstration.times[:size], poses=demonstration.poses[:size]
    )
