"""Heteroscedastic Gaussian processes for one output, and for independent outputs.

Eqs. (10)–(13) and (15), which is Eq. (6) with a diagonal B.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gplfd_policies.arrays.records import short_repr
from gplfd_policies.arrays.resolution import FINEST
from gplfd_policies.arrays.shapes import Curves, Float, Times
from gplfd_policies.gp.evidence import Posterior, Replicates, fit_kernel
from gplfd_policies.gp.exact import ExactGP
from gplfd_policies.gp.kernels import RBF, LegendreBasis
from gplfd_policies.gp.noise import NoiseModel, NoiseProfile

Moment = Float[np.ndarray, "M d"]
"""One number per time and output."""


def offset_and_scale(samples: Curves, centred: bool) -> tuple[float, float]:
    """Return the average of an output, or zero if not centred, and its scale."""
    if centred:
        offset, size = float(np.mean(samples)), float(np.std(samples))
    else:
        offset, size = 0.0, float(np.sqrt(np.mean(samples**2)))
    return offset, max(size, FINEST)


@dataclass(frozen=True, kw_only=True)
class HeteroscedasticGP:
    """Mean f(t) and noise variance r(t) of one output, learned from D demonstrations.

    Replicates, kernel and noise are those of the output minus its offset, over its
    scale. The offset is the average of the output, or zero for the residual of a given
    prior mean. So the prior mean is the demonstrations' average; in the paper it is
    zero, which only matters outside the demonstrated interval.
    """

    offset: float
    scale: float
    replicates: Replicates
    kernel: RBF
    noise: NoiseProfile

    __repr__ = short_repr

    @classmethod
    def fit(
        cls, times: Times, samples: Curves, noise: NoiseModel, *, centred: bool = True
    ) -> "HeteroscedasticGP":
        """Learn one output from D curves; prior mean zero if it is not centred."""
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


@dataclass(frozen=True, kw_only=True, slots=True)
class OutputMoments:
    """Moments of the mean function f and of the noise at M times, per output.

    `mean` is Eq. (10), `latent` the variance of f, Eq. (11) without R, `noise` r(t);
    rates are time derivatives.
    """

    mean: Moment
    mean_rate: Moment
    latent: Moment
    latent_rate: Moment
    noise: Moment
    noise_rate: Moment


@dataclass(frozen=True, kw_only=True)
class MultiOutputGP:
    """Independent heteroscedastic processes on the same demonstrations."""

    outputs: tuple[HeteroscedasticGP, ...]

    __repr__ = short_repr

    @classmethod
    def fit(
        cls,
        times: Times,
        poses: Float[np.ndarray, "D M d"],
        noise: NoiseModel,
        *,
        centred: bool = True,
    ) -> "MultiOutputGP":
        """Learn each output independently; arguments as for `HeteroscedasticGP.fit`."""
        outputs = (
            HeteroscedasticGP.fit(times, samples, noise, centred=centred)
            for samples in np.moveaxis(poses, 2, 0)
        )
        return cls(outputs=tuple(outputs))

    @property
    def shortest_length_scale(self) -> float:
        """Shortest length-scale of any mean function, in the unit of time."""
        return min(output.kernel.length_scale for output in self.outputs)

    @cached_property
    def _spectral(self) -> tuple[LegendreBasis, list[Posterior]] | None:
        """The common basis and the posteriors in it; None for too short a scale."""
        times = self.outputs[0].replicates.times
        basis = LegendreBasis.for_length_scale(
            float(times[0]), float(times[-1]), self.shortest_length_scale
        )
        if basis is None:
            return None
        return basis, [
            output.replicates.condition_in(
                basis, output.kernel, output.noise.variance(times)
            )
            for output in self.outputs
        ]

    @cached_property
    def _tables(self) -> tuple[LegendreBasis, Float[np.ndarray, "Q C"]] | None:
        """The basis, and all curves of all outputs and their slopes in it, or None."""
        if self._spectral is None:
            return None
        coarse, posteriors = self._spectral
        # A variance is a square: twice the degree of the posterior it comes from.
        start, stop, size = coarse.start, coarse.stop, 2 * coarse.size
        basis = LegendreBasis(start=start, stop=stop, size=size)
        nodes = basis.nodes
        matrix = coarse.matrix(nodes)
        curves = (
            [matrix @ weights for weights, _ in posteriors]
            + [output.noise.log_variance(nodes) for output in self.outputs]
            + [np.sum((matrix @ factor) ** 2, axis=1) for _, factor in posteriors]
        )
        coefficients = basis.root_weights[:, None] * np.stack(curves, axis=1)
        slopes = basis.differentiate(coefficients)
        return basis, np.concatenate([coefficients, slopes], axis=1)

    def moments(self, times: Times) -> OutputMoments:
        """Means, variances and their rates; inside the demonstrations in O(M)."""
        if self._tables is not None and self._tables[0].covers(times):
            basis, block = self._tables
            parts = np.split(basis.matrix(times) @ block, 6, axis=1)
            mean, log_noise, latent, mean_rate, log_noise_rate, latent_rate = parts
            noise, latent = np.exp(log_noise), np.maximum(latent, 0.0)
            noise_rate = noise * log_noise_rate
        else:
            dense = [output.latent for output in self.outputs]
            profiles = [output.noise for output in self.outputs]
            rates = [process.rates(times) for process in dense]
            mean = np.stack([process.mean(times) for process in dense], axis=1)
            latent = np.stack([process.variance(times) for process in dense], axis=1)
            mean_rate = np.stack([rate for rate, _ in rates], axis=1)
            latent_rate = np.stack([rate for _, rate in rates], axis=1)
            noise = np.stack([profile.variance(times) for profile in profiles], axis=1)
            slopes = [profile.log_variance_rate(times) for profile in profiles]
            noise_rate = noise * np.stack(slopes, axis=1)
        scale = np.array([output.scale for output in self.outputs])
        offset = np.array([output.offset for output in self.outputs])
        return OutputMoments(
            mean=offset + scale * mean,
            mean_rate=scale * mean_rate,
            latent=scale**2 * latent,
            latent_rate=scale**2 * latent_rate,
            noise=scale**2 * noise,
            noise_rate=scale**2 * noise_rate,
        )

    def latent_covariance(self, times: Times) -> Float[np.ndarray, "d M M"]:
        """Covariance of f over time, per output, Eq. (11) without R."""
        if self._spectral is None or not self._spectral[0].covers(times):
            unscaled = [output.latent.covariance(times) for output in self.outputs]
        else:
            basis, posteriors = self._spectral
            matrix = basis.matrix(times)
            halves = [matrix @ factor for _, factor in posteriors]
            unscaled = [half @ half.T for half in halves]
        scale = np.array([output.scale for output in self.outputs])
        return np.asarray(scale[:, None, None] ** 2 * np.stack(unscaled))
