"""Kernelized movement primitives: a reference trajectory, kernel-smoothed, adaptable.

Equation numbers refer to Huang, Rozo, Silvério, Caldwell, *Kernelized movement
primitives*, IJRR 2019: a mixture regression gives a reference of means and covariances,
Eqs. (21) and (26) smooth it, and a via-point is one more entry of the reference, or
takes the place of one.

What was published for letters in centimetres over two seconds is translated to phase
and standardised outputs; `KMPConfig` says how. Left out is the velocity, which the
published time-driven form stacks under the position: via-points here are poses.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from gplfd_env.validation.fields import check_quantities, quantity
from gplfd_policies.arrays.one_thread import one_thread
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.movements.baselines.gmr import (
    GaussianMixtureRegression,
    GMRConfig,
    fit_gmr,
)
from gplfd_policies.movements.baselines.moments import MomentMovement, Moments
from gplfd_policies.movements.baselines.smoothed_reference import (
    Reference,
    SmoothedReference,
)
from gplfd_policies.movements.trajectory import ViaPoint

_STRONGEST = 1e-4
"""Least standard deviation of a via-point, standardised. A demand of zero would have
infinite weight; this one is missed by less than a thousandth of an output's spread."""
_SAME_PHASE = 0.1
"""Phases closer than this share of the reference's spacing coincide; as published."""


@dataclass(frozen=True, kw_only=True, slots=True)
class KMPConfig:
    """How the reference is made and smoothed; published values, translated.

    Only the ratios λ/N and λ_c/N matter: twice the references under twice the
    regularisation is the same primitive.

    Raises:
        ValueError: if a value is outside its range.
    """

    mixture: GMRConfig = field(default_factory=lambda: GMRConfig(components=8))
    """The mixture behind the reference; 8 components as published."""
    references: int = quantity(400, low=2)
    """Number N of equally spaced reference phases; as published. The cost of a
    prediction hardly depends on it."""
    length_scale: float = quantity(0.144, above=0.0)
    """Length-scale of the kernel [phase]. Published is exp(−6 (t − t')²) over 2 s."""
    mean_regularisation: float = quantity(25.0, above=0.0)
    """λ. Published is 1 for letters that vary by 25 cm²: λ multiplies covariances in
    the squared unit of the outputs, so in standardised outputs it is 25. It also pulls
    the mean towards the average pose where demonstrations differ much: doors of 0.35
    to 0.65 m by 5 cm at the end of the motion, which a λ of 1 does not."""
    covariance_regularisation: float = quantity(1500.0, above=0.0)
    """λ_c. Published is 60, times 25 for the same reason. Nothing ties the resulting
    spread to that of the demonstrations, so λ_c is what calibrates it: N/λ_c is the
    variance far from the reference. The published value is over-confident; λ_c = N
    makes that variance the demonstrations' own."""

    def __post_init__(self) -> None:
        check_quantities(self)


@dataclass(frozen=True, kw_only=True, repr=False)
class KernelizedMovementPrimitive(MomentMovement):
    """A learned movement that via-points adapt; made by `fit_kmp`, immutable.

    Far outside the reference the mean is the demonstrations' average and the variance
    N/λ_c times their own; via-points count in this N.
    """

    regression: GaussianMixtureRegression
    """The mixture from which the reference was taken."""
    config: KMPConfig
    """Length-scale and regularisations."""
    reference: Reference
    """What is smoothed, via-points included; standardised."""

    def adapt(self, via_points: Sequence[ViaPoint]) -> "KernelizedMovementPrimitive":
        """The primitive with via-points in its reference.

        A via-point replaces the entry whose phase coincides with its own, be it an
        earlier via-point, and is appended where there is none. With standard deviation
        σ it is given the covariance σ²/N: in Eqs. (21) and (26) every entry counts for
        one N-th, and only so is σ what the primitive predicts at a via-point that
        dominates its surroundings. In this measure the published 1e-6 cm² of a
        via-point among 400 entries asks for 0.2 mm. An error that outputs share counts
        as one of each: as a covariance, the primitive followed it into the sensors'
        noise (under ``"hard"`` 8 of 18 doors opened, for 13).

        Args:
            via_points: poses to be reached, in any order; NaN or an infinite standard
                deviation leaves an output free.
        """
        standardisation = self.regression.standardisation
        count = self.config.references
        tolerance = _SAME_PHASE * float(np.ptp(self.aligned.times)) / (count - 1)
        reference = self.reference
        for via_point in via_points:
            variance = via_point.noise_variance / standardisation.scale**2
            precision = count / np.maximum(variance, _STRONGEST**2)
            pose = standardisation.apply(via_point.pose)
            reference = reference.insert(
                via_point.phase,
                np.where(precision > 0.0, pose, 0.0),
                np.diag(precision),
                tolerance,
            )
        return replace(self, reference=reference)

    @cached_property
    def _smoothed(self) -> SmoothedReference:
        return SmoothedReference.fit(
            self.reference,
            length_scale=self.config.length_scale,
            mean_regularisation=self.config.mean_regularisation,
            covariance_regularisation=self.config.covariance_regularisation,
        )

    def _moments(self, times: Float[np.ndarray, " M"]) -> Moments:
        """Eq. (21), and the diagonal of Eq. (26)."""
        return self.regression.standardisation.moments(*self._smoothed.moments(times))

    def _covariance(self, times: Float[np.ndarray, " M"]) -> Float[np.ndarray, "6 M M"]:
        """Eq. (26)."""
        smoothed = self._smoothed.covariance(times)
        return self.regression.standardisation.covariance(smoothed)


@one_thread
def fit_kmp(
    aligned: AlignedDemonstrations, config: KMPConfig | None = None
) -> KernelizedMovementPrimitive:
    """Learn a primitive: fit the mixture and take the reference from it.

    Args:
        aligned: demonstrations on common phases.
        config: how; the defaults of `KMPConfig` if None.

    Raises:
        ValueError: if there are more components than phases.

    Warns:
        UserWarning: if expectation maximisation did not converge.
    """
    config = KMPConfig() if config is None else config
    regression = fit_gmr(aligned, config.mixture)
    phases = np.linspace(aligned.times[0], aligned.times[-1], config.references)
    means, covariances = regression.standardised_moments(phases)
    reference = Reference(
        phases=phases, means=means, precisions=np.linalg.inv(covariances)
    )
    return KernelizedMovementPrimitive(
        aligned=aligned, regression=regression, config=config, reference=reference
    )
