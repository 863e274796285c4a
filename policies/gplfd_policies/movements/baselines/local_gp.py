"""A product of local Gaussian processes: variability through locality.

The method of Schneider and Ertel (*Robot Learning by Demonstration with Local Gaussian
Process Regression*, IROS 2010): many processes, each with its own noise level and
interval of the task. A **reconstruction** from descriptions by others. Assumptions:

* The phase is divided into clusters by k-means. For demonstrations on the same, evenly
  spaced phases these are intervals of equal length.
* A cluster has one process per output with a radial basis function kernel, Eq. (13),
  and all three hyper-parameters (l, σ_f, σ_n) by maximum likelihood, Eq. (7). It learns
  only from the samples of its cluster, and σ_n represents the variability.
* Local predictions N(μ_k, v_k), with σ_n,k² included in v_k, are multiplied as
  densities with the exponents w_k(t) ∝ exp(−(t − c_k)² / (2 W²)), Σ_k w_k = 1, with the
  centres c_k of the clusters (the weights of Nguyen-Tuong's local Gaussian processes):

      1/v = Σ_k w_k/v_k,   μ = v Σ_k w_k μ_k/v_k.

Without the exponents, the variance would be C times too small without data
(``test_plain_product_is_over_confident``). Outputs are independent; no via-points.
"""

from dataclasses import dataclass

import numpy as np
import scipy

from gplfd_env.validation.fields import Quantities, quantity
from gplfd_policies.arrays.shapes import Covariances, Float, Outputs, Times
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.gp.exact import Replicates, fit_kernel_and_noise
from gplfd_policies.gp.heteroscedastic import (
    HeteroscedasticGP,
    NoiseProfile,
    offset_and_scale,
)
from gplfd_policies.movements.movement import MomentMovement, Moments

_FEWEST_SAMPLES = 4
"""Least number of samples of a cluster: more than the hyper-parameters of a process."""


@dataclass(frozen=True, kw_only=True, slots=True)
class LocalGPConfig(Quantities):
    """Settings of the division of the task and the combination of predictions."""

    clusters: int = quantity(8, low=1)
    """Number of clusters C; one is a single Gaussian process."""
    width: float = quantity(0.35, low=0.1, high=10.0)
    """Standard deviation W of a cluster's weight, in distances between centres."""


@dataclass(frozen=True, kw_only=True, repr=False)
class LocalGaussianProcesses(MomentMovement):
    """A movement of local Gaussian processes; made by `fit_local_gp`, immutable.

    The standard deviation includes σ_n,k, so it is the deviation of a repetition.
    """

    centres: Float[np.ndarray, " C"]
    width: float
    """Standard deviation W of a cluster's weight, as the centres c_k in phase."""
    processes: tuple[tuple[HeteroscedasticGP, ...], ...]
    """Per cluster the six processes, each with one noise variance."""

    def weights(self, times: Times) -> Float[np.ndarray, "C M"]:
        """The weights w_k(t) of the clusters, which sum to one."""
        distance = np.subtract.outer(self.centres, times) / self.width
        return np.asarray(scipy.special.softmax(-0.5 * distance**2, axis=0))

    def _product(
        self, times: Times
    ) -> tuple[Outputs, Outputs, Float[np.ndarray, "C M 6"]]:
        """The weighted product: μ, v, and the weights √w_k v / v_k of local errors."""
        means = np.empty((len(self.centres), len(times), 6))
        variances = np.empty_like(means)
        for cluster, outputs in enumerate(self.processes):
            for column, process in enumerate(outputs):
                mean = process.latent.mean(times)
                variance = process.latent.variance(times)
                variance = variance + process.noise.variance(times)
                means[cluster, :, column] = process.offset + process.scale * mean
                variances[cluster, :, column] = process.scale**2 * variance
        weights = self.weights(times)[:, :, None]
        precisions = weights / variances
        variance = 1.0 / precisions.sum(axis=0)
        mean = variance * np.sum(precisions * means, axis=0)
        return mean, variance, np.sqrt(weights) * variance / variances

    def _moments(self, times: Times) -> Moments:
        mean, variance, _ = self._product(times)
        return mean, np.sqrt(variance)

    def _covariance(self, times: Times) -> Covariances:
        """Covariance of Σ_k (w_k v/v_k) μ_k; clusters have C_k(t, t')/√(w_k w_k')."""
        total = np.zeros((6, len(times), len(times)))
        *_, shares = self._product(times)
        for share, outputs in zip(shares, self.processes, strict=True):
            for column, process in enumerate(outputs):
                local = process.latent.covariance(times)
                local[np.diag_indices_from(local)] += process.noise.variance(times)
                scaled = process.scale * share[:, column]
                total[column] += np.outer(scaled, scaled) * local
        return total


def fit_local_gp(
    aligned: AlignedDemonstrations,
    config: LocalGPConfig = LocalGPConfig(),
    *,
    centred: bool = True,
) -> LocalGaussianProcesses:
    """Learn local Gaussian processes; for one demonstration, the scatter of samples."""
    times, poses = aligned.times, aligned.poses
    # Lloyd's k-means, starting from clusters of equal size.
    count = config.clusters
    labels = np.arange(len(times)) * count // len(times)
    counts = np.bincount(labels, minlength=count)
    if counts.all():
        means = np.bincount(labels, weights=times) / counts
        _, labels = scipy.cluster.vq.kmeans2(
            times, means, minit="matrix", iter=len(times)
        )
        counts = np.bincount(labels, minlength=count)
    if counts.min() < _FEWEST_SAMPLES:
        raise ValueError(
            f"{count} clusters of {len(times)} phases leave one with "
            f"{counts.min()} samples, fewer than {_FEWEST_SAMPLES}. Choose fewer "
            "clusters or align to more samples."
        )
    members = [labels == cluster for cluster in range(count)]
    centres = np.array([times[member].mean() for member in members])
    spacing = float(np.median(np.diff(centres))) if count > 1 else 1.0

    # One process per cluster and output, with maximum-likelihood (l, σ_f, σ_n).
    processes = []
    for member in members:
        phases, outputs = times[member], []
        for samples in np.moveaxis(poses[:, member], 2, 0):
            offset, scale = offset_and_scale(samples, centred)
            replicates = Replicates.from_samples(phases, (samples - offset) / scale)
            kernel, variance = fit_kernel_and_noise(replicates)
            process = HeteroscedasticGP(
                offset=offset,
                scale=scale,
                replicates=replicates,
                kernel=kernel,
                noise=NoiseProfile.constant(phases, variance),
            )
            outputs.append(process)
        processes.append(tuple(outputs))
    return LocalGaussianProcesses(
        aligned=aligned,
        centres=centres,
        width=config.width * spacing,
        processes=tuple(processes),
    )
