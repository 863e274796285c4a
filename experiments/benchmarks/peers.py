"""Other libraries on the same task, each used as its documentation says.

They are imported by name where they are used: an optional extra brings them, and they
ship no types.
"""

from __future__ import annotations

import importlib
import importlib.util
import warnings
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import digamma, polygamma

Array = NDArray[np.float64]
Gaussians = tuple[Array, Array]
"""Mean and standard deviation, (M, 6) each."""

DISTRIBUTIONS: Final = {
    "hetgpy": "hetgpy",
    "sklearn": "scikit-learn",
    "dtw": "dtw-python",
}
"""Import name → name on the package index; together the extra ``bench``."""


def installed(module: str) -> bool:
    """Whether a library can be imported."""
    return importlib.util.find_spec(module) is not None


def require(modules: Sequence[str]) -> None:
    """Check that libraries are there.

    Raises:
        ValueError: One is missing; the message says what to type.
    """
    missing = [DISTRIBUTIONS[module] for module in modules if not installed(module)]
    if missing:
        raise ValueError(
            f"this comparison needs {', '.join(missing)}, which is not installed; "
            "pip install 'gplfd[bench]' brings it"
        )


def hetgpy_fit(times: Array, poses: Array) -> Gaussians:
    """Fit hetGP, with replicates, to every output.

    Args:
        times: Common phases, (M,).
        poses: Demonstrations, (D, M, 6).
    """
    hetgp = importlib.import_module("hetgpy").hetGP

    inputs = np.tile(times, len(poses))[:, None]
    mean, std = np.empty(poses.shape[1:]), np.empty(poses.shape[1:])
    for output in range(poses.shape[2]):
        samples = poses[:, :, output]
        offset, scale = samples.mean(), samples.std()
        model = hetgp()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            model.mleHetGP(
                inputs, ((samples - offset) / scale).ravel(), covtype="Gaussian"
            )
            predicted = model.predict(times[:, None])
        variance = predicted["sd2"] + predicted["nugs"]
        mean[:, output] = offset + scale * np.ravel(predicted["mean"])
        std[:, output] = scale * np.sqrt(np.ravel(variance))
    return mean, std


def sklearn_fit(times: Array, poses: Array) -> Gaussians:
    """Fit scikit-learn's regressor to averages and log-variances of every output.

    The reduction from D·M observations to M averages is done for it by hand: with all
    observations it would take D³ times as long.

    Args:
        times: Common phases, (M,).
        poses: Demonstrations, (D, M, 6).
    """
    count = len(poses)
    half = 0.5 * (count - 1)
    bias = float(digamma(half)) - np.log(half)
    known = np.full(len(times), float(polygamma(1, half)))
    mean, std = np.empty(poses.shape[1:]), np.empty(poses.shape[1:])
    for output in range(poses.shape[2]):
        samples = poses[:, :, output]
        offset, scale = samples.mean(), samples.std()
        scaled = (samples - offset) / scale
        observed = np.log(scaled.var(axis=0, ddof=1)) - bias
        level = observed.mean()
        log_noise, _ = _sklearn_gp(times, observed - level, known)
        noise = np.exp(level + log_noise)
        latent, latent_std = _sklearn_gp(times, scaled.mean(axis=0), noise / count)
        mean[:, output] = offset + scale * latent
        std[:, output] = scale * np.sqrt(latent_std**2 + noise)
    return mean, std


def _sklearn_gp(times: Array, values: Array, noise: Array) -> tuple[Array, Array]:
    """Posterior mean and standard deviation at ``times``, for known noise."""
    gp = importlib.import_module("sklearn.gaussian_process")
    kernel = gp.kernels.ConstantKernel(1.0, (1e-6, 1e4)) * gp.kernels.RBF(
        0.2, (0.05, 3.0)
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = gp.GaussianProcessRegressor(kernel=kernel, alpha=noise)
        model.fit(times[:, None], values)
        mean, std = model.predict(times[:, None], return_std=True)
    return mean, std


def dtw_python(a: Array, b: Array) -> tuple[Array, Array]:
    """Match two completion indices with dtw-python; returns the matched indices."""
    dtw = importlib.import_module("dtw")
    path = dtw.dtw(a, b, dist_method="cityblock", step_pattern="symmetric1")
    return path.index1, path.index2
