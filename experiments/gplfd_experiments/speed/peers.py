"""Other libraries on the same task, each used as documented.

They are imported by name when used, because they are optional and untyped.
"""

import importlib
import importlib.util
import warnings
from collections.abc import Callable
from functools import partial
from typing import Final

import numpy as np
from scipy.special import digamma, polygamma

from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.movements.trajectory import GaussianTrajectory, white_covariance

NOT_INSTALLED: Final = "not installed"
"""Cell of a table for a library that is missing."""

DISTRIBUTIONS: Final = {
    "hetgpy": "hetgpy",
    "sklearn": "scikit-learn",
    "dtw": "dtw-python",
}
"""Name on the package index by import name."""


def installed(module: str) -> bool:
    """Whether a library can be imported."""
    return importlib.util.find_spec(module) is not None


def hetgpy_fit(given: AlignedDemonstrations) -> GaussianTrajectory:
    """Fit hetGP, with replicates, to every output and predict at the phases."""
    hetgp = importlib.import_module("hetgpy").hetGP
    inputs = np.tile(given.times, len(given.poses))[:, None]

    def fit(samples: FloatArray) -> tuple[FloatArray, FloatArray]:
        model = hetgp()
        model.mleHetGP(inputs, samples.ravel(), covtype="Gaussian")
        predicted = model.predict(given.times[:, None])
        variance = predicted["sd2"] + predicted["nugs"]
        return np.ravel(predicted["mean"]), np.sqrt(np.ravel(variance))

    return _output_by_output(given, fit)


def sklearn_fit(given: AlignedDemonstrations) -> GaussianTrajectory:
    """Fit scikit-learn's regressor to averages and log-variances of every output.

    The D·M observations are reduced to M averages before the fit; with all observations
    it would take D³ times as long.
    """
    count, phases = len(given.poses), given.times
    half = 0.5 * (count - 1)
    bias = float(digamma(half)) - np.log(half)
    known = np.full(len(phases), float(polygamma(1, half)))

    def fit(samples: FloatArray) -> tuple[FloatArray, FloatArray]:
        observed = np.log(samples.var(axis=0, ddof=1)) - bias
        level = observed.mean()
        log_noise, _ = _sklearn_gp(phases, observed - level, known)
        noise = np.exp(level + log_noise)
        mean, std = _sklearn_gp(phases, samples.mean(axis=0), noise / count)
        return mean, np.sqrt(std**2 + noise)

    return _output_by_output(given, fit)


def _sklearn_gp(
    phases: FloatArray, values: FloatArray, noise: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Posterior mean and standard deviation at the phases, for known noise."""
    gp = importlib.import_module("sklearn.gaussian_process")
    kernel = gp.kernels.ConstantKernel(1.0, (1e-6, 1e4)) * gp.kernels.RBF(
        0.2, (0.05, 3.0)
    )
    model = gp.GaussianProcessRegressor(kernel=kernel, alpha=noise)
    model.fit(phases[:, None], values)
    mean, std = model.predict(phases[:, None], return_std=True)
    return mean, std


def _output_by_output(
    given: AlignedDemonstrations,
    fit: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
) -> GaussianTrajectory:
    """Fit every output, (D, M), normalised to mean 0 and standard deviation 1."""
    offset = given.poses.mean(axis=(0, 1))
    scale = given.poses.std(axis=(0, 1))
    scaled = (given.poses - offset) / scale
    with warnings.catch_warnings():
        # Warnings of optimisers that stop at a bound.
        warnings.simplefilter("ignore")
        fitted = [fit(scaled[:, :, output]) for output in range(len(scale))]
    mean, std = (np.stack(each, axis=1) for each in zip(*fitted, strict=True))
    mean, std = offset + scale * mean, scale * std
    return GaussianTrajectory.from_moments(
        given.times, mean, std, partial(white_covariance, std**2)
    )


def dtw_python(a: FloatArray, b: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Match two completion indices with dtw-python; returns the matched indices."""
    dtw = importlib.import_module("dtw")
    path = dtw.dtw(a, b, dist_method="cityblock", step_pattern="symmetric1")
    return path.index1, path.index2
