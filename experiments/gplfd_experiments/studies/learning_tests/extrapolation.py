"""What a policy does where nothing was demonstrated, and with what it knew before."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from gplfd_experiments.studies.learning_tests.folds import Fold
from gplfd_experiments.studies.learning_tests.methods import learn
from gplfd_policies.demonstrations.completion import task_completion_index
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.movements.movement import Movement
from gplfd_policies.movements.prior_mean import PosePath
from gplfd_policies.registry.method import Method

_MOVING: Final = [0, 2, 4]
"""Outputs that a door moves: x, z and θu_y. The others stay where they are beyond the
demonstrations, too, and their spread as it is."""
_KEPT: Final = 0.7
"""Share of the task that is learned before asking beyond."""
_BORDER: Final = np.linspace(0.95, 1.0, 11)
_BEYOND: Final = np.linspace(1.4, 1.5, 11)
"""Phases, in lengths of what was learned."""
_DISPLACEMENT: Final = np.array([0.1, 0.0, -0.1, 0.0, 0.3, 0.0])
"""How far the prior mean is from the demonstrations' [m, rad]."""
_FAR: Final = np.linspace(20.0, 21.0, 11)
"""Length-scales are at most three of them, so
that nothing demonstrated has a say there."""


def beyond(method: Method, fold: Fold, seed: int) -> Mapping[str, float | None]:
    """Learn the first 70 % of a task and ask beyond.

    The demonstrations end where 70 % of their path is done, and phase 1 is there. How
    much the standard deviation grows is its value half as far again beyond, at phases
    1.4 to 1.5, over that at the end of what was learned, 0.95 to 1: geometric mean of
    x, z and θu_y. That of the end, not of all phases, because demonstrations of
    different doors spread more and more: a method that just holds the last spread
    has 1. What was left out goes on in its own time; the share of it within the
    normal 95 % interval there is counted. What becomes of a prior mean is asked much
    farther beyond (`prior_mean_used`).

    Args:
        method: How to learn.
        fold: What to learn from, and what to predict.
        seed: Seeds whatever is random in the learning.
    """
    starts = [_start(demonstration) for demonstration in fold.given]
    movement, _ = learn(method, starts, seed)
    border = movement.predict(_BORDER).std[:, _MOVING]
    outside = movement.predict(_BEYOND).std[:, _MOVING]
    found: dict[str, float | None] = {
        "uncertainty_growth": None,
        "coverage_95_beyond": None,
        "prior_mean_used": prior_mean_used(method, starts, seed, movement),
    }
    if np.isfinite(border).all():
        ratios = outside.mean(axis=0) / border.mean(axis=0)
        shares = [_coverage(movement, one) for one in fold.left_out]
        found["uncertainty_growth"] = float(np.exp(np.mean(np.log(ratios))))
        found["coverage_95_beyond"] = float(np.mean(shares))
    return found


def _coverage(movement: Movement, demonstration: Demonstration) -> float:
    """Share of what goes on after the start within the normal 95 % interval."""
    size = len(_start(demonstration).times)
    times = demonstration.times - demonstration.times[0]
    asked = movement.predict(times[size:] / times[size - 1])
    return asked.coverage(demonstration.poses[size:], normal=True)


def _start(demonstration: Demonstration) -> Demonstration:
    index = task_completion_index(demonstration)
    size = int(np.searchsorted(index, _KEPT)) + 1
    return Demonstration(
        times=demonstration.times[:size], poses=demonstration.poses[:size]
    )


def prior_mean_used(
    method: Method, demonstrations: Sequence[Demonstration], seed: int, plain: Movement
) -> float | None:
    """Give a method a prior mean and ask far beyond the demonstrations.

    The prior mean is the demonstrations' own, 0.1 m and 0.3 rad beside them, and rests
    at its last pose: what is known of the task contradicts the demonstrations where
    there are any, and is all there is twenty of their lengths later. A method that
    takes it for a description of the demonstrations, and corrects it everywhere, does
    not return to it.

    Args:
        method: How to learn.
        demonstrations: From what.
        seed: Seeds whatever is random in the learning.
        plain: What the method learns from them without a prior mean.

    Returns:
        The way of the prediction from where it is without the prior mean towards the
        latter, as a share of the whole way, within [0, 1]: 1 returns to it, 0 ignores
        it. Metres and radians count alike. None for a method that takes none.
    """
    if not method.accepts_prior_mean:
        return None
    aligned = plain.aligned
    prior = PosePath(
        phases=aligned.times, poses=aligned.poses.mean(axis=0) + _DISPLACEMENT
    )
    informed, _ = learn(method, demonstrations, seed, prior)
    without = plain.predict(_FAR).mean
    moved, whole = informed.predict(_FAR).mean - without, prior.mean(_FAR)
    whole = whole - without
    share = float(np.sum(moved * whole) / np.sum(whole**2))
    return min(max(share, 0.0), 1.0)
