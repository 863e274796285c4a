"""Gaussian processes for the mean and a Wishart process for the variability.

The method of Umlauft, Fanger and Hirche (*Bayesian Uncertainty Modeling for Programming
by Demonstration*, ICRA 2017). The uncertainty of the mean and the variation of the
demonstrations are learned separately: the former is the variance of a Gaussian process,
the latter a covariance matrix of all outputs that changes with time, inferred as a
generalised Wishart process (`gplfd_policies.movements.baselines.wishart_process`).

This is a **reconstruction** from the abstract and descriptions by others, written
without access to the original. Assumptions:

* The mean of every output is a Gaussian process over the phase, Eqs. (10)–(11), with
  one noise variance by maximum likelihood. The original reportedly drives a dynamic
  movement primitive by such a process. This is again a Gaussian process over poses with
  a kernel filtered by a linear system, and for a fixed goal it predicts nearly the same
  movement. But it learns from accelerations: for six demonstrations with 2 cm of white
  noise, differenced twice, its error was 25 cm; the error of this mean is 3 mm.
* The Wishart process is learned from the deviations of the demonstrations from their
  average at some of the phases, which are treated as independent in time. Its scale L
  is set so that the prior mean is their covariance over all phases. Length-scale and
  degrees of freedom are not learned.
* The posterior is sampled by elliptical slice sampling, and its mean is used.
* Rotations are rotation vectors; a repetition's deviations are white in time.

The method has no via-points.
"""

from dataclasses import dataclass

import numpy as np

from gplfd_env.validation.fields import Quantities, check_quantities, quantity
from gplfd_policies.arrays.resolution import FINEST, thinned
from gplfd_policies.arrays.shapes import Covariances, Float, Outputs, Times
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.gp.heteroscedastic import MultiOutputGP
from gplfd_policies.gp.noise import HomoscedasticNoise
from gplfd_policies.movements.baselines.wishart_process import (
    WishartLikelihood,
    WishartPosterior,
    WishartPrior,
    sample_posterior,
)
from gplfd_policies.movements.movement import MomentMovement, Moments


@dataclass(frozen=True, kw_only=True, slots=True)
class WishartGPConfig(Quantities):
    """Prior of the variability, and settings of its inference."""

    degrees: int = quantity(7, low=6)
    """Degrees of freedom ν of the Wishart process, at least as many as outputs."""
    length_scale: float = quantity(0.15, low=0.02, high=10.0)
    """Length-scale of the variability, in phase."""
    floor: float = quantity(1e-3, low=1e-8, below=1.0)
    """Share of the pooled covariance below which the variability never falls."""
    times: int = quantity(50, low=2)
    """Number of phases whose deviations are learned from; all of them if the
    demonstrations have fewer."""
    steps: int = quantity(1500, low=1)
    """Steps of the elliptical slice sampler."""
    discarded: int = quantity(500, low=0)
    """Number of first steps that are discarded, less than ``steps``."""
    mode_iterations: int = quantity(50, low=1)
    """Greatest number of iterations of the search for the mode where sampling
    starts."""
    shrinkage: float = quantity(1e-6, above=0.0, below=1.0)
    """Shrinkage of the pooled correlations to zero, because outputs may be
    proportional."""

    def __post_init__(self) -> None:
        check_quantities(self)
        if self.discarded >= self.steps:
            raise ValueError(
                f"discarded must be less than steps, got {self.discarded} and "
                f"{self.steps}."
            )


@dataclass(frozen=True, kw_only=True, repr=False)
class WishartProcessMovement(MomentMovement):
    """A movement with Wishart variability; made by `fit_wishart_gp`, immutable.

    The variance is that of the mean plus the diagonal of `aleatoric`.
    """

    processes: MultiOutputGP
    """The mean and its uncertainty."""
    variability: WishartPosterior
    """Variability of repetitions of the task."""

    def aleatoric(self, times: Times) -> Float[np.ndarray, "M 6 6"]:
        """Covariance between repetitions; constant outside the task."""
        return self.variability.covariance(times)

    def _moments(self, times: Times) -> Moments:
        moments = self.processes.moments(times)
        return moments.mean, np.sqrt(moments.latent + self._spread(times))

    def _spread(self, times: Times) -> Outputs:
        return np.diagonal(self.aleatoric(times), axis1=1, axis2=2)

    def _covariance(self, times: Times) -> Covariances:
        """Covariance over time: that of the mean plus white deviations."""
        total = self.processes.latent_covariance(times)
        diagonal = np.arange(len(times))
        total[:, diagonal, diagonal] += self._spread(times).T
        return total


def fit_wishart_gp(
    aligned: AlignedDemonstrations,
    config: WishartGPConfig,
    seed: int,
    *,
    centred: bool = True,
) -> WishartProcessMovement:
    """Learn mean and variability from aligned demonstrations."""
    times, poses = aligned.times, aligned.poses
    if len(poses) < 2:
        raise ValueError(
            "The variability of a task needs at least 2 demonstrations, got 1. Give "
            "more, or choose a policy without a spread."
        )
    deviations = poses - poses.mean(axis=0)
    # Their covariance over all phases, positive definite.
    free = (len(poses) - 1) * len(times)
    std = np.sqrt(np.sum(deviations**2, axis=(0, 1)) / free)
    std = np.maximum(std, FINEST)
    scaled = (deviations / std).reshape(-1, 6)
    correlation = scaled.T @ scaled / free
    correlation *= 1.0 - config.shrinkage
    # 1 where the output varies; also where it does not.
    np.fill_diagonal(correlation, 1.0)
    pooled = np.asarray(correlation * np.outer(std, std))
    processes = MultiOutputGP.fit(times, poses, HomoscedasticNoise(), centred=centred)
    prior = WishartPrior.over(
        (float(times[0]), float(times[-1])),
        config.length_scale,
        pooled,
        config.degrees,
        config.floor,
    )
    kept = thinned(len(times), config.times)
    variability = sample_posterior(
        WishartLikelihood.of(prior, times[kept], deviations[:, kept]),
        config.steps,
        config.discarded,
        np.random.default_rng(seed),
        config.mode_iterations,
    )
    return WishartProcessMovement(
        aligned=aligned, processes=processes, variability=variability
    )
