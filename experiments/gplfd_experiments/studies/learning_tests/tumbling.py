"""A synthetic task with a known distribution: a hand that tumbles along a line.

Its outputs vary independently by known amounts, and its orientation turns by more than
π about changing axes. Unlike the teacher's doors, it shows whether learning several
outputs together reduces accuracy, and whether large rotations are learned.
"""

import math
from collections.abc import Mapping
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import norm

from gplfd_experiments.data.teacher.random_motion import smooth_functions
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.studies.learning_tests.accuracy import none_if_nan, rms_rotation
from gplfd_experiments.studies.learning_tests.folds import learn
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.movements.movement import Movement
from gplfd_policies.registry.method import Method

_COUNT: Final = 6
_CLOCK: Final = np.linspace(0.0, 1.0, 301)
_DURATION: Final = 6.0
_LENGTH: Final = 1.0
"""Path length along x [m]; equal in all demonstrations, so that their clocks agree."""
_CORRELATION: Final = 0.25
TUMBLE_STD: Final = 0.05
"""Standard deviation of the orientation about each of its axes [rad]."""
_HELD_OUT: Final = 100
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
        positions[:, 0] = _LENGTH * _CLOCK
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
    wobble = smooth_functions(_JUDGED, _CORRELATION, _HELD_OUT, rng)
    std = _spread(_JUDGED)[:, None]
    drawn = std * wobble
    predicted = movement.predict(_JUDGED)
    got = norm.logpdf(drawn, predicted.mean[:, [2]], predicted.std[:, [2]])
    return none_if_nan(float(np.mean(norm.logpdf(drawn, 0.0, std)) - np.mean(got)))
