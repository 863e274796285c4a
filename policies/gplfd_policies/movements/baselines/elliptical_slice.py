"""Elliptical slice sampling: posteriors of standard normal variables, nothing to tune.

Murray, Adams and MacKay, *Elliptical slice sampling*, AISTATS 2010, their Figure 2. For
a prior N(0, I) and any likelihood p(y | x), a step moves x along an ellipse through x
and a draw from the prior, to a point that is uniform on the part of the ellipse where
the likelihood exceeds a random level below its present one. It leaves the posterior as
it is (``test_sampler_meets_a_gaussian_posterior``).
"""

from collections.abc import Callable, Iterator

import numpy as np
from jaxtyping import Float

LogLikelihood = Callable[[np.ndarray], float]
"""x (N,) → log p(y | x), minus infinity where it is impossible."""


def elliptical_slice_chain(
    log_likelihood: LogLikelihood,
    start: Float[np.ndarray, " N"],
    steps: int,
    rng: np.random.Generator,
) -> Iterator[Float[np.ndarray, " N"]]:
    """Yield the ``steps`` states that follow ``start``.

    Args:
        log_likelihood: x ↦ log p(y | x); the prior of x is N(0, I).
        start: first state, shape (N,); not yielded.
        steps: number of states.
        rng: source of randomness.

    Raises:
        ValueError: if the likelihood of the start is zero or undefined.
    """
    state, value = start, log_likelihood(start)
    if not np.isfinite(value):
        raise ValueError(
            f"A chain must start where the log-likelihood is finite, got {value}."
        )
    for _ in range(steps):
        state, value = _step(log_likelihood, state, value, rng)
        yield state


def _step(
    log_likelihood: LogLikelihood,
    state: Float[np.ndarray, " N"],
    value: float,
    rng: np.random.Generator,
) -> tuple[Float[np.ndarray, " N"], float]:
    """The next state and its log-likelihood."""
    other = rng.standard_normal(state.shape)
    level = value - rng.standard_exponential()
    angle = rng.uniform(0.0, 2.0 * np.pi)
    low, high = angle - 2.0 * np.pi, angle
    while True:
        candidate = np.cos(angle) * state + np.sin(angle) * other
        candidate_value = log_likelihood(candidate)
        # Equal counts too: rounding may leave the level where the state itself is.
        if candidate_value >= level:
            return candidate, candidate_value
        # Angle 0 is the state itself, which is always allowed: shrink towards it.
        if angle < 0.0:
            low = angle
        else:
            high = angle
        angle = rng.uniform(low, high)
