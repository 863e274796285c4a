"""A product of local Gaussian processes: variability through locality.

The method of Schneider and Ertel (*Robot Learning by Demonstration with Local Gaussian
Process Regression*, IROS 2010). A process with one noise level cannot tell where
demonstrations agree from where they differ. Many processes can, each with its own noise
level and its own stretch of the task.

This is a **reconstruction**: it was written without access to the original, from how
others describe it. Assumed here:

* The phase is cut into clusters by k-means. Demonstrations that share their phases and
  sample them evenly give stretches of equal length.
* A cluster has one process per output with a radial basis function kernel, Eq. (13),
  and all three hyper-parameters (l, σ_f, σ_n) by maximum likelihood, Eq. (7). It learns
  from the samples of its own cluster only, and σ_n is where variability lives.
* Local predictions N(μ_k, v_k), σ_n,k² included in v_k, are multiplied as densities to
  the powers w_k(t) ∝ exp(−(t − c_k)² / (2 W²)), Σ_k w_k = 1, with the centres c_k of
  the clusters (the weights of Nguyen-Tuong's local Gaussian processes):

      1/v = Σ_k w_k/v_k,   μ = v Σ_k w_k μ_k/v_k.

  Without the powers C processes that know nothing would agree on a variance C times
  too small (``test_plain_product_is_over_confident``).
* Outputs are independent and rotations are rotation vectors.

The method has no via-points.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import softmax

from gplfd_env.validation.fields import check_quantities, quantity
from gplfd_policies.arrays.one_thread import one_thread
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.gp.heteroscedastic import HeteroscedasticGP, offset_and_scale
from gplfd_policies.gp.hyperparameters import fit_kernel_and_noise
from gplfd_policies.gp.noise_profile import NoiseProfile
from gplfd_policies.gp.replicates import Replicates
from gplfd_policies.movements.baselines.moments import MomentMovement, Moments

_FEWEST_SAMPLES = 4
"""A cluster needs more samples than its process has hyper-parameters."""


@dataclass(frozen=True, kw_only=True, slots=True)
class LocalGPConfig:
    """How the task is cut and the local predictions are joined.

    Raises:
        ValueError: if a value is outside its range.
    """

    clusters: int = quantity(8, low=1)
    """Number of clusters C; one is a single Gaussian process."""
    width: float = quantity(0.35, low=0.1, high=10.0)
    """Standard deviation W of a cluster's weight, in distances between neighbouring
    centres. Small values switch abruptly from process to process; large
    ones trust a process far from its own samples, where it errs with confidence."""

    def __post_init__(self) -> None:
        check_quantities(self)


@dataclass(frozen=True, kw_only=True, repr=False)
class LocalGaussianProcesses(MomentMovement):
    """A movement of local Gaussian processes; made by `fit_local_gp`, immutable.

    Its standard deviation includes σ_n,k, so it is that of a repetition. Outside the
    demonstrated range the processes of the outermost clusters return to their priors.
    """

    centres: Float[np.ndarray, " C"]
    """Centres c_k of the clusters, in phase."""
    width: float
    """Standard deviation W of a cluster's weight, in phase."""
    processes: tuple[tuple[HeteroscedasticGP, ...], ...]
    """Per cluster the six processes (x, y, z, θu_x, θu_y, θu_z), each with one noise
    variance."""

    def weights(self, times: Float[np.ndarray, " M"]) -> Float[np.ndarray, "C M"]:
        """The weights w_k(t) of the clusters, which sum to one."""
        distance = np.subtract.outer(self.centres, times) / self.width
        return np.asarray(softmax(-0.5 * distance**2, axis=0))

    def _product(
        self, times: Float[np.ndarray, " M"]
    ) -> tuple[
        Float[np.ndarray, "M 6"], Float[np.ndarray, "M 6"], Float[np.ndarray, "C M 6"]
    ]:
        """The weighted product: μ, v, and √w_k v / v_k, how local errors add up."""
        means = np.empty((len(self.centres), len(times), 6))
        variances = np.empty_like(means)
        for cluster, outputs in enumerate(self.processes):
            for column, process in enumerate(outputs):
                mean = process.latent.mean(times)
                variance = process.latent.variance(times) + process.noise.variance(
                    times
                )
                means[cluster, :, column] = process.offset + process.scale * mean
                variances[cluster, :, column] = process.scale**2 * variance
        weights = self.weights(times)[:, :, None]
        precisions = weights / variances
        variance = 1.0 / precisions.sum(axis=0)
        mean = variance * np.sum(precisions * means, axis=0)
        return mean, variance, np.sqrt(weights) * variance / variances

    def _moments(self, times: Float[np.ndarray, " M"]) -> Moments:
        mean, variance, _ = self._product(times)
        return mean, np.sqrt(variance)

    def _covariance(self, times: Float[np.ndarray, " M"]) -> Float[np.ndarray, "6 M M"]:
        """Covariance over time of the product.

        Its mean is Σ_k (w_k v/v_k) μ_k. Errors of the local predictions that are
        independent between clusters and have the covariances C_k(t, t')/√(w_k w_k'),
        the power's effect on a Gaussian, give Σ_k s_k(t) s_k(t') C_k(t, t') with the
        shares s_k: v on the diagonal, and the covariance of a plain process for C = 1.
        """
        total = np.zeros((6, len(times), len(times)))
        *_, shares = self._product(times)
        for share, outputs in zip(shares, self.processes, strict=True):
            for column, process in enumerate(outputs):
                local = process.latent.covariance(times)
                local[np.diag_indices_from(local)] += process.noise.variance(times)
                scaled = process.scale * share[:, column]
                total[column] += np.outer(scaled, scaled) * local
        return total


@one_thread
def fit_local_gp(
    aligned: AlignedDemonstrations, config: LocalGPConfig, *, centred: bool = True
) -> LocalGaussianProcesses:
    """Learn local Gaussian processes from aligned demonstrations.

    The replicates collapse exactly (`gplfd_policies.gp.replicates`), so the cost does
    not grow with the number of demonstrations. With a single one the noise is the
    scatter
    of its samples around smooth curves: nothing is known about repetitions.

    Args:
        aligned: D demonstrations on common phases.
        config: clusters and weights.
        centred: whether the prior mean of a cluster's processes is the average of their
            samples, or zero.

    Raises:
        ValueError: if a cluster has too few samples for its processes.
    """
    times, poses = aligned.times, aligned.poses
    labels = _cluster(times, config.clusters)
    counts = np.bincount(labels, minlength=config.clusters)
    if counts.min() < _FEWEST_SAMPLES:
        raise ValueError(
            f"{config.clusters} clusters of {len(times)} phases leave one with "
            f"{counts.min()} samples, fewer than {_FEWEST_SAMPLES}. Choose fewer "
            "clusters or align to more samples."
        )
    members = [labels == cluster for cluster in range(config.clusters)]
    centres = np.array([times[member].mean() for member in members])
    spacing = float(np.median(np.diff(centres))) if config.clusters > 1 else 1.0
    processes = tuple(
        tuple(
            _local_process(times[member], poses[:, member, output], centred)
            for output in range(6)
        )
        for member in members
    )
    return LocalGaussianProcesses(
        aligned=aligned,
        centres=centres,
        width=config.width * spacing,
        processes=processes,
    )


def _local_process(
    times: Float[np.ndarray, " M"], samples: Float[np.ndarray, "D M"], centred: bool
) -> HeteroscedasticGP:
    """The process of one output in one cluster: (l, σ_f, σ_n) most likely together."""
    offset, scale = offset_and_scale(samples, centred)
    replicates = Replicates.from_samples(times, (samples - offset) / scale)
    kernel, variance = fit_kernel_and_noise(replicates)
    return HeteroscedasticGP(
        offset=offset,
        scale=scale,
        replicates=replicates,
        kernel=kernel,
        noise=NoiseProfile.constant(times, variance),
    )


def _cluster(times: Float[np.ndarray, " M"], count: int) -> np.ndarray:
    """Lloyd's k-means on sorted phases, from clusters of equally many: labels (M,)."""
    labels = np.arange(len(times)) * count // len(times)
    for _ in range(len(times)):
        counts = np.bincount(labels, minlength=count)
        if not counts.all():
            break
        centres = np.bincount(labels, weights=times, minlength=count) / counts
        borders = 0.5 * (centres[1:] + centres[:-1])
        nearest = np.searchsorted(borders, times)
        if np.array_equal(nearest, labels):
            break
        labels = nearest
    return labels
