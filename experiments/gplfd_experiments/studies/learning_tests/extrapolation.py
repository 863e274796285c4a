"""Predictions beyond the demonstrations, with and without a prior mean."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from gplfd_experiments.studies.learning_tests.folds import Fold, learn
from gplfd_policies.demonstrations.completion import task_completion_index
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.movements.movement import Movement
from gplfd_policies.movements.prior_mean import PosePath
from gplfd_policies.registry.method import Method

_MOVING: Final = [0, 2, 4]
"""Outputs that move when a door opens: x, z and θu_y; the others are constant."""
_KEPT: Final = 0.7
"""Learned share of the task."""
_BORDER: Final = np.linspace(0.95, 1.0, 11)
_BEYOND: Final = np.linspace(1.4, 1.5, 11)
"""Phases, in lengths of the learned part."""
_DISPLACEMENT: Final = np.array([0.1, 0.0, -0.1, 0.0, 0.3, 0.0])
"""Distance of the prior mean from the demonstrations' mean [m, rad]."""
_FAR: Final = np.linspace(20.0, 21.0, 11)
"""Phases far beyond the demonstrations, which have no influence there, because
length-scales are at most three."""


def beyond(method: Method, fold: Fold, seed: int) -> Mapping[str, float | None]:
    """Learn the first 70 % of a task and predict beyond it.

    Phase 1 is where the shortened demonstrations end. ``uncertainty_growth`` is the
    standard deviation at phases 1.4 to 1.5 over that at 0.95 to 1, as the geometric
    mean of x, z and θu_y. A method that keeps the last spread has 1.
    """
    starts = [_start(demonstration) for demonstration in fold.given]
    movement, _ = learn(method, starts, seed)
    border = movement.predict(_BORDER).std[:, _MOVING]
    outside = movement.predict(_BEYOND).std[:, _MOVING]
    found: dict[str, float | None] = {
        "uncertainty_growth": None,
        "prior_mean_used": prior_mean_used(method, starts, seed, movement),
    }
    if np.isfinite(border).all():
        ratios = outside.mean(axis=0) / border.mean(axis=0)
        found["uncertainty_growth"] = float(np.exp(np.mean(np.log(ratios))))
    return found


def _start(demonstration: Demonstration) -> Demonstration:
    """Return the first part of a demonstration, up to 70 % of its path."""
    index = task_completion_index(demonstration)
    size = int(np.searchsorted(index, _KEPT)) + 1
    return Demonstration(
        times=demonstration.times[:size], poses=demonstration.poses[:size]
    )


def prior_mean_used(
    method: Method, demonstrations: Sequence[Demonstration], seed: int, plain: Movement
) -> float | None:
    """Give a method a prior mean and predict far beyond the demonstrations.

    The prior mean is the demonstrations' mean, displaced by 0.1 m and 0.3 rad, and
    constant after its last pose. It contradicts the demonstrations, and twenty of their
    lengths later it is the only information. A method that corrects it everywhere,
    because it treats it as a description of the demonstrations, does not return to it.

    Returns the displacement of the prediction from that of the movement without a prior
    mean, as a share of the distance to the prior mean in [0, 1]; None if the method
    accepts no prior mean.
    """
    if not method.accepts_prior_mean:
        return None
    aligned = plain.aligned
    prior = PosePath(
        phases=aligned.times, poses=aligned.poses.mean(axis=0) + _DISPLACEMENT
    )
    informed, _ = learn(method, demonstrations, seed, prior)
    without = plain.predict(_FAR).mean
    moved, whole = informed.predict(_FAR).mean - without, prior.mean(_FAR) - without
    share = float(np.sum(moved * whole) / np.sum(whole**2))
    return min(max(share, 0.0), 1.0)
