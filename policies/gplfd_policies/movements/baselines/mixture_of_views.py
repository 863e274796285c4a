"""Gaussian mixtures of movements that are seen from several frames at once.

The expectation maximisation of Calinon, *A tutorial on task-parameterized movement
learning and retrieval*, Intelligent Service Robotics 9, 2016: the views of a sample are
independent given its component. With one view it is that of
`gplfd_policies.movements.baselines.gmr.fit_gmr`
(``test_one_frame_is_gaussian_mixture_regression``).
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.special import logsumexp

from gplfd_policies.movements.baselines.gmr import GMRConfig, warn_of_early_stop
from gplfd_policies.movements.baselines.standardisation import Standardisation


def fit_mixture_of_views(
    times: Float[np.ndarray, " M"],
    views: Sequence[Float[np.ndarray, "K M 6"]],
    config: GMRConfig,
) -> tuple[
    Float[np.ndarray, " C"], Float[np.ndarray, "P C 7"], Float[np.ndarray, "P C 7 7"]
]:
    """Fit C components of phase and pose, from equal bins of time.

    Args:
        times: common phases.
        views: the poses as seen from each of P frames; standardised for the fit.
        config: how.

    Returns:
        Weights, and centres and covariances in the units of the views.

    Warns:
        UserWarning: if expectation maximisation did not converge.
    """
    standardisations = [Standardisation.of(view) for view in views]
    standardised = [
        each.apply(view).reshape(-1, 6)
        for each, view in zip(standardisations, views, strict=True)
    ]
    phases = np.tile(times, len(views[0]))
    samples = np.stack([np.column_stack([phases, view]) for view in standardised])
    bins = np.array_split(np.arange(len(times)), config.components)
    binned = np.concatenate([np.full(len(part), i) for i, part in enumerate(bins)])
    shares = np.eye(config.components)[np.tile(binned, len(views[0]))]
    bound = -np.inf
    weights, means, covariances = _maximised(samples, shares, config)
    for _ in range(config.max_iterations):
        densities = np.log(weights) + _log_densities(samples, means, covariances)
        totals = logsumexp(densities, axis=1, keepdims=True)
        shares, previous, bound = np.exp(densities - totals), bound, totals.mean()
        weights, means, covariances = _maximised(samples, shares, config)
        if abs(bound - previous) < config.tolerance:
            break
    else:
        # For the caller of a fit that calls this function.
        warn_of_early_stop(config, stacklevel=5)
    scales = np.stack([np.append(1.0, each.scale) for each in standardisations])
    offsets = np.stack([np.append(0.0, each.offset) for each in standardisations])
    units = scales[:, None, :, None] * scales[:, None, None, :]
    return weights, offsets[:, None] + scales[:, None] * means, units * covariances


def _maximised(
    samples: Float[np.ndarray, "P N 7"],
    shares: Float[np.ndarray, "N C"],
    config: GMRConfig,
) -> tuple[
    Float[np.ndarray, " C"], Float[np.ndarray, "P C 7"], Float[np.ndarray, "P C 7 7"]
]:
    """The most likely components for the samples' shares in them."""
    # A component that has lost all its samples keeps a weight.
    counts = shares.sum(axis=0) + 10.0 * np.finfo(np.float64).eps
    means = shares.T @ samples / counts[:, None]
    apart = samples[:, None] - means[:, :, None]
    covariances = (apart * shares.T[:, :, None]).mT @ apart / counts[:, None, None]
    covariances += config.regularisation * np.eye(samples.shape[2])
    return counts / counts.sum(), means, covariances


def _log_densities(
    samples: Float[np.ndarray, "P N 7"],
    means: Float[np.ndarray, "P C 7"],
    covariances: Float[np.ndarray, "P C 7 7"],
) -> Float[np.ndarray, "N C"]:
    """Log Π_j N(X_nj; μ_ij, Σ_ij), without its constant."""
    lower = np.linalg.cholesky(covariances)
    apart = samples[:, None] - means[:, :, None]
    white = np.linalg.solve(lower, apart.mT)
    log_root = np.log(np.diagonal(lower, axis1=2, axis2=3)).sum(axis=2)
    each = log_root[:, :, None] + 0.5 * np.sum(white**2, axis=2)
    densities: np.ndarray = -each.sum(axis=0).T
    return densities
