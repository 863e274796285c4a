"""Whether a policy returns to what was known before any demonstration."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from experiments.learning_tests.methods import Method, learn
from policies.demonstrations import Demonstration
from policies.learning import NO_PRIOR_MEAN
from policies.movement import Movement
from policies.prior_mean import PosePath

_DISPLACEMENT: Final = np.array([0.1, 0.0, -0.1, 0.0, 0.3, 0.0])
"""How far the prior mean is from the demonstrations' [m, rad]."""
_FAR: Final = np.linspace(20.0, 21.0, 11)
"""Phases, in lengths of what was learned. Length-scales are at most three of them, so
that nothing demonstrated has a say there."""


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
        it. Metres and radians count alike. None for a method that refuses.
    """
    aligned = plain.aligned
    prior = PosePath(
        phases=aligned.times, poses=aligned.poses.mean(axis=0) + _DISPLACEMENT
    )
    try:
        learned = learn(method, demonstrations, seed, prior)
    except ValueError as refusal:
        if NO_PRIOR_MEAN not in str(refusal):
            raise
        return None
    without = plain.predict(_FAR).mean
    moved, whole = learned.movement.predict(_FAR).mean - without, prior.mean(_FAR)
    whole = whole - without
    share = float(np.sum(moved * whole) / np.sum(whole**2))
    return min(max(share, 0.0), 1.0)
