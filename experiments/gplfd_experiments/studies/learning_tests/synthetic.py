"""Learning tests for rows of Table 1 that left-out demonstrations cannot show.

`beyond` predicts after the end of the demonstrations, with and without a prior mean.
`tumbling` learns a synthetic task with a known distribution: the outputs of a hand
along a line vary independently by known amounts, while it turns by more than π.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from gplfd_experiments.data.teacher.random_motion import smooth_functions
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.studies.learning_tests.accuracy import none_if_nan, rms_rotation
from gplfd_experiments.studies.learning_tests.folds import Fold, learn
from gplfd_policies.demonstrations.alignment import task_completion_index
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.movements.movement import Movement
from gplfd_policies.movements.prior_mean import PosePath
from gplfd_policies.registry.method import Method

_MOVING: Final = [0, 2, 4]
"""Outputs that move when a door opens: x, z and θu_y; the others are constant."""
# Phases at the end of the learned part, beyond it, and so far beyond it that it has no
# influence, because length-scales are at most three.
_BORDER, _BEYOND = np.linspace(0.95, 1.0, 11), np.linspace(1.4, 1.5, 11)
_FAR: Final = np.linspace(20.0, 21.0, 11)
_DISPLACEMENT: Final = np.array([0.1, 0.0, -0.1, 0.0, 0.3, 0.0])
"""Distance of the prior mean from the demonstrations' mean [m, rad]."""


def beyond(method: Method, fold: Fold, seed: int) -> Mapping[str, float | None]:
    """Learn the first 70 % of a task and predict beyond it.

    Phase 1 is where the shortened demonstrations end. ``uncertainty_growth`` is the
    standard deviation at phases 1.4 to 1.5 over that at 0.95 to 1, as the geometric
    mean of x, z and θu_y. A method that keeps the last spread has 1.
    """
    starts = []
    for whole in fold.training:
        size = int(np.searchsorted(task_completion_index(whole), 0.7)) + 1
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
        positions = np.zeros((_CLOCK.size, 3))
        # Equal lengths [m], so that the clocks agree.
        positions[:, 0] = _CLOCK
        positions[:, 1] = 0.01 * wobble[:, 0]
        positions[:, 2] = _spread(_CLOCK) * wobble[:, 1]
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
    drawn = std * wobble
    predicted = movement.predict(_JUDGED)
    got = norm.logpdf(drawn, predicted.mean[:, [2]], predicted.std[:, [2]])
    return none_if_nan(float(np.mean(norm.logpdf(drawn, 0.0, std)) - np.mean(got)))
