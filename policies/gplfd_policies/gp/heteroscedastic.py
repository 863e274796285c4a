"""One output: a Gaussian process whose noise depends on time.

Eqs. (10)–(11) and (15).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from gplfd_policies.arrays.records import short_repr
from gplfd_policies.demonstrations.aligned import FINEST
from gplfd_policies.gp.exact import ExactGP
from gplfd_policies.gp.hyperparameters import fit_kernel
from gplfd_policies.gp.kernels import RBF
from gplfd_policies.gp.legendre import LegendreBasis
from gplfd_policies.gp.noise_profile import NoiseModel, NoiseProfile
from gplfd_policies.gp.replicates import Replicates
from gplfd_policies.gp.spectral import SpectralPosterior


def offset_and_scale(
    samples: Float[np.ndarray, "D M"], centred: bool
) -> tuple[float, float]:
    """Where an output is, and its size around that.

    Args:
        samples: the output in every demonstration, shape (D, M).
        centred: whether it is where its average is, or at zero.
    """
    if centred:
        offset, size = float(np.mean(samples)), float(np.std(samples))
    else:
        offset, size = 0.0, float(np.sqrt(np.mean(samples**2)))
    return offset, max(size, FINEST)


@dataclass(frozen=True, kw_only=True)
class HeteroscedasticGP:
    """Mean f(t) and noise variance r(t) of one output, learned from D demonstrations.

    Inside, the output is centred and scaled to order one; `offset` and `scale` map
    back. The prior mean is therefore the average of the demonstrations, where the
    paper's is zero: it only matters outside the demonstrated interval. What is left
    over by a prior mean (`gplfd_policies.movements.residual`) is not centred: its prior
    mean is zero.
    """

    offset: float
    """The prior mean: average of the output, or zero, in its unit."""
    scale: float
    """Size of the output, in its unit."""
    replicates: Replicates
    """The scaled demonstrations, reduced."""
    kernel: RBF
    """Prior covariance of the scaled f."""
    noise: NoiseProfile
    """Noise variance of the scaled output."""

    __repr__ = short_repr

    @classmethod
    def fit(
        cls,
        times: Float[np.ndarray, " M"],
        samples: Float[np.ndarray, "D M"],
        noise: NoiseModel,
        *,
        centred: bool = True,
    ) -> "HeteroscedasticGP":
        """Learn one output from D curves on M common times.

        Args:
            times: common times, strictly increasing, shape (M,).
            samples: the output in every demonstration, shape (D, M).
            noise: how r(t) is estimated.
            centred: whether the prior mean is the output's average, or zero.

        Raises:
            ValueError: if the noise model cannot use so few demonstrations.
        """
        offset, scale = offset_and_scale(samples, centred)
        scaled = (samples - offset) / scale
        profile = noise.fit(times, scaled)
        replicates = Replicates.from_samples(times, scaled)
        variance = profile.variance(times) / replicates.count
        return cls(
            offset=offset,
            scale=scale,
            replicates=replicates,
            kernel=fit_kernel(times, replicates.mean, variance),
            noise=profile,
        )

    @cached_property
    def latent(self) -> ExactGP:
        """Posterior of the scaled f, in the dense form that can extrapolate."""
        times = self.replicates.times
        return self.replicates.condition(self.kernel, self.noise.variance(times))

    def spectral(self, basis: LegendreBasis) -> SpectralPosterior:
        """Posterior of the scaled f in a basis that can represent its kernel."""
        noise = self.noise.variance(self.replicates.times)
        return self.replicates.condition_in(basis, self.kernel, noise)
