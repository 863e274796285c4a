"""Gaussian mixture regression: a joint density of phase and pose, conditioned on phase.

The GMM-GMR of Table 1 in Arduengo et al., arXiv:2002.09979; equation numbers refer to
Jaquier, Ginsbourger, Calinon, *Learning from demonstration with model-based Gaussian
process*, CoRL 2019, Section 2.1. Outputs are standardised per axis, because the
regularisation is an absolute number (``test_units_do_not_matter``).
"""

import warnings
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import scipy

from gplfd_env.validation.fields import Quantities, quantity
from gplfd_policies.arrays.records import FINEST
from gplfd_policies.arrays.shapes import Covariances, Float, Outputs, Pose, Times
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.movements.movement import MomentMovement, Moments, white_covariance

ConditionalMeans = Float[np.ndarray, "*N 6"]

TOLERANCE: Final = 1e-4
"""Expectation maximisation stops at this gain of the mean log-likelihood; published."""


@dataclass(frozen=True, kw_only=True, slots=True)
class GMRConfig(Quantities):
    """Settings of the fit; it starts from equal bins of time, so nothing is random."""

    components: int = quantity(10, low=1)
    """Number of Gaussians C, at most the number of phases."""
    regularisation: float = quantity(4e-6, above=0.0)
    """Added to the diagonal of every covariance, in squared phase and squared
    standardised output. Published is 1e-4 for letters that vary by 25 cm²."""
    max_iterations: int = quantity(300, low=1)
    """Number of iterations after which the fit stops with a warning."""

    def check_phases(self, count: int) -> None:
        """Raise a ValueError if demonstrations have fewer phases than components."""
        if self.components > count:
            raise ValueError(
                f"{self.components} components need as many phases, and the "
                f"demonstrations have {count}; ask for fewer or align with more."
            )


def warn_of_early_stop(config: GMRConfig) -> None:
    """Warn that expectation maximisation did not converge."""
    warnings.warn(
        f"Expectation maximisation did not converge in {config.max_iterations} "
        f"iterations; raise max_iterations, or ask for fewer components.",
        UserWarning,
        stacklevel=3,
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class Standardisation:
    """Outputs of order one: poses minus their average over their standard deviation."""

    offset: Pose
    scale: Pose

    @classmethod
    def of(cls, poses: Float[np.ndarray, "K M 6"]) -> "Standardisation":
        """The standardisation of these demonstrations."""
        scale = np.maximum(poses.std(axis=(0, 1)), FINEST)
        return cls(offset=poses.mean(axis=(0, 1)), scale=scale)

    def apply(self, poses: ConditionalMeans) -> ConditionalMeans:
        """Convert poses to standard deviations from their average."""
        return np.asarray((poses - self.offset) / self.scale)

    def undo(self, standardised: ConditionalMeans) -> ConditionalMeans:
        """Convert standardised poses to poses [m, rad]."""
        return np.asarray(self.offset + self.scale * standardised)

    def moments(self, mean: Outputs, variance: Outputs) -> tuple[Outputs, Outputs]:
        """Convert standardised mean and variance to mean and deviation [m, rad]."""
        return self.undo(mean), self.scale * np.sqrt(variance)

    def covariance(self, standardised: Covariances) -> Covariances:
        """Convert a standardised covariance over time to [m², rad²]."""
        return np.asarray(self.scale[:, None, None] ** 2 * standardised)


@dataclass(frozen=True, kw_only=True, repr=False)
class GaussianMixtureRegression(MomentMovement):
    """A learned movement without via-points; made by `fit_gmr`, immutable.

    The mixture holds phase and standardised pose, in this order; in that of a
    kernelised primitive the rate of the pose follows. Samples count as
    independent given their phase, so the covariance over time is diagonal. Outside the
    demonstrated range one component continues along its straight line.
    """

    standardisation: Standardisation
    weights: Float[np.ndarray, " C"]
    means: Float[np.ndarray, "C V"]
    covariances: Float[np.ndarray, "C V V"]
    """π_l, μ_l and Σ_l of C components."""

    @cached_property
    def slopes(self) -> Float[np.ndarray, "C D"]:
        """Σ_l^{yt} / Σ_l^{tt}: rate of every component's mean, standardised."""
        return np.asarray(self.covariances[:, 1:, 0] / self.covariances[:, :1, 0])

    @cached_property
    def conditional_covariances(self) -> Float[np.ndarray, "C D D"]:
        """Σ̂_l, Eq. (3): covariance of a component given the phase, standardised."""
        across = self.covariances[:, 0, 1:]
        explained = self.slopes[:, :, None] * across[:, None, :]
        return np.asarray(self.covariances[:, 1:, 1:] - explained)

    def responsibilities(self, times: Times) -> Float[np.ndarray, "M C"]:
        """h_l(t), the share of every component at a phase, normalised in logarithms."""
        variance = self.covariances[:, 0, 0]
        squared = np.subtract.outer(times, self.means[:, 0]) ** 2 / variance
        log_density = np.log(self.weights) - 0.5 * (squared + np.log(variance))
        return np.asarray(scipy.special.softmax(log_density, axis=1))

    def standardised_moments(
        self, times: Times
    ) -> tuple[Float[np.ndarray, "M D"], Float[np.ndarray, "M D D"]]:
        """Mean and covariance between outputs at every phase, Eqs. (2)–(3)."""
        shares = self.responsibilities(times)
        steps = np.subtract.outer(times, self.means[:, 0])
        centres = self.means[:, 1:] + steps[:, :, None] * self.slopes
        mean = np.einsum("mc,mcd->md", shares, centres)
        within = np.tensordot(shares, self.conditional_covariances, axes=1)
        # About the mean: the difference of second moments cancels digits.
        apart = centres - mean[:, None, :]
        between = np.einsum("mc,mcd,mce->mde", shares, apart, apart)
        return mean, within + between

    def moments(self, times: Times) -> tuple[Outputs, Float[np.ndarray, "M 6 6"]]:
        """Mean pose and covariance between outputs at every phase [m, rad]."""
        mean, covariance = self.standardised_moments(times)
        scale = self.standardisation.scale
        return self.standardisation.undo(mean), scale[:, None] * covariance * scale

    def _moments(self, times: Times) -> Moments:
        mean, covariance = self.moments(times)
        return mean, np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))

    def _covariance(self, times: Times) -> Covariances:
        _, covariance = self.moments(times)
        return white_covariance(np.diagonal(covariance, axis1=1, axis2=2))


def fit_gmr(
    aligned: AlignedDemonstrations, config: GMRConfig = GMRConfig()
) -> GaussianMixtureRegression:
    """Fit the mixture by expectation maximisation from equal bins of time."""
    standardisation = Standardisation.of(aligned.poses)
    outputs = standardisation.apply(aligned.poses)
    return fit_outputs(aligned, standardisation, outputs, config)


def fit_outputs(
    aligned: AlignedDemonstrations,
    standardisation: Standardisation,
    outputs: Float[np.ndarray, "K M D"],
    config: GMRConfig,
) -> GaussianMixtureRegression:
    """Fit the mixture to standardised outputs, the first six of which are poses."""
    config.check_phases(len(aligned.times))
    count, size = len(outputs), 1 + outputs.shape[2]
    phases = np.broadcast_to(aligned.times[:, None], (count, len(aligned.times), 1))
    samples = np.concatenate([phases, outputs], axis=2)
    # The import takes half a second.
    try:
        from sklearn.mixture import GaussianMixture
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "mixtures are fitted by scikit-learn, which is not installed; "
            "pip install scikit-learn",
            name=error.name,
        ) from None

    # Expectation maximisation from one component for each of C equal bins of time.
    parts = np.array_split(samples, config.components, axis=1)
    bins = [part.reshape(-1, size) for part in parts]
    floor = config.regularisation * np.eye(size)
    precisions = [np.linalg.inv(np.cov(part.T, bias=True) + floor) for part in bins]
    mixture = GaussianMixture(
        config.components,
        tol=TOLERANCE,
        reg_covar=config.regularisation,
        max_iter=config.max_iterations,
        weights_init=np.array([len(part) for part in bins]) / samples[..., 0].size,
        means_init=np.array([part.mean(axis=0) for part in bins]),
        precisions_init=np.array(
            [0.5 * (precision + precision.T) for precision in precisions]
        ),
    )
    with warnings.catch_warnings():
        # Its advice is about settings that do not exist here.
        warnings.filterwarnings("ignore", "Best performing init")
        mixture.fit(samples.reshape(-1, size))
    if not mixture.converged_:
        warn_of_early_stop(config)
    return GaussianMixtureRegression(
        aligned=aligned,
        standardisation=standardisation,
        weights=mixture.weights_,
        means=mixture.means_,
        covariances=mixture.covariances_,
    )
