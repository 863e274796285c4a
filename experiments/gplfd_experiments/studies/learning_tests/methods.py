"""Learning in the learning tests, with the CPU time it takes."""

import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
import scipy

from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.movements.movement import Movement
from gplfd_policies.movements.prior_mean import PriorMean
from gplfd_policies.registry.method import Method, TrainingInput

_LOADED = (
    *(scipy.fft, scipy.interpolate, scipy.linalg, scipy.ndimage, scipy.optimize),
    *(scipy.signal, scipy.special),
)
"""Parts of SciPy that methods load on first use: no part of their learning."""


ResultT = TypeVar("ResultT")


def learn(
    method: Method,
    demonstrations: Sequence[Demonstration],
    seed: int,
    prior_mean: PriorMean | None = None,
) -> tuple[Movement, float]:
    """Learn, and return the movement and the CPU time of this thread [s].

    It includes alignment and a first prediction, to which some methods defer work.
    Warnings of few or noisy demonstrations are suppressed, because their effect is
    what is measured.
    """
    training = TrainingInput(
        demonstrations=demonstrations, seed=seed, prior_mean=prior_mean
    )
    # Left-out demonstrations end where the others end.
    within = replace(method, beyond=0.0)

    def able_to_predict() -> Movement:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            movement = within.learn(training)
            movement.predict(np.array([0.0, 1.0]))
        return movement

    return cpu_seconds(able_to_predict)


def cpu_seconds(action: Callable[[], ResultT]) -> tuple[ResultT, float]:
    """Return what an action returns and the CPU time it took of this thread [s]."""
    started = time.thread_time()
    result = action()
    return result, time.thread_time() - started
