"""Six independent outputs evaluated together.

Eqs. (12)–(13): outputs independent a priori, which is Eq. (6) with a diagonal B.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from gplfd_policies.arrays.records import short_repr
from gplfd_policies.gp.heteroscedastic import HeteroscedasticGP
from gplfd_policies.gp.legendre import LegendreBasis
from gplfd_policies.gp.noise_profile import NoiseModel
from gplfd_policies.gp.spectral import SpectralPosterior


@dataclass(frozen=True, kw_only=True, slots=True)
class OutputMoments:
    """Moments of the mean function f and of the noise at M times."""

    mean: Float[np.ndarray, "M d"]
    """Posterior mean of f, Eq. (10), in the unit of each output."""
    mean_rate: Float[np.ndarray, "M d"]
    """Time derivative of the mean."""
    latent: Float[np.ndarray, "M d"]
    """Variance of f given the demonstrations, Eq. (11) without R."""
    latent_rate: Float[np.ndarray, "M d"]
    """Time derivative of that variance."""
    noise: Float[np.ndarray, "M d"]
    """Noise variance r(t)."""
    noise_rate: Float[np.ndarray, "M d"]
    """Time derivative of r(t)."""


@dataclass(frozen=True, kw_only=True)
class MultiOutputGP:
    """Independent heteroscedastic processes on the same demonstrations."""

    outputs: tuple[HeteroscedasticGP, ...]
    """One process per output."""

    __repr__ = short_repr

    @classmethod
    def fit(
        cls,
        times: Float[np.ndarray, " M"],
        poses: Float[np.ndarray, "D M d"],
        noise: NoiseModel,
        *,
        centred: bool = True,
    ) -> "MultiOutputGP":
        """Learn every output by itself; arguments as of `HeteroscedasticGP.fit`."""
        outputs = (
            HeteroscedasticGP.fit(times, samples, noise, centred=centred)
            for samples in np.moveaxis(poses, 2, 0)
        )
        return cls(outputs=tuple(outputs))

    @cached_property
    def _scales(self) -> Float[np.ndarray, " d"]:
        return np.array([output.scale for output in self.outputs])

    @cached_property
    def _offsets(self) -> Float[np.ndarray, " d"]:
        return np.array([output.offset for output in self.outputs])

    @property
    def shortest_length_scale(self) -> float:
        """Shortest length-scale of any mean function, in the unit of time."""
        return min(output.kernel.length_scale for output in self.outputs)

    @cached_property
    def _basis(self) -> LegendreBasis | None:
        """The common basis; None if some length-scale is too short for any."""
        times = self.outputs[0].replicates.times
        return LegendreBasis.for_length_scale(
            float(times[0]), float(times[-1]), self.shortest_length_scale
        )

    @cached_property
    def _posteriors(self) -> tuple[SpectralPosterior, ...]:
        if self._basis is None:
            raise ValueError("No basis represents these length-scales.")
        return tuple(output.spectral(self._basis) for output in self.outputs)

    @cached_property
    def _tables(self) -> tuple[LegendreBasis, Float[np.ndarray, "Q C"]] | None:
        """A basis, and every curve of every output in it; None without a basis.

        One matrix product evaluates all: means, log-noises and latent variances of all
        outputs; then their slopes.
        """
        coarse = self._basis
        if coarse is None:
            return None
        # A variance is a square: twice the degree of the posterior it comes from.
        basis = LegendreBasis(
            start=coarse.start, stop=coarse.stop, size=2 * coarse.size
        )
        nodes = basis.nodes
        matrix = coarse.matrix(nodes)
        curves = (
            [matrix @ posterior.weights for posterior in self._posteriors]
            + [output.noise.log_variance(nodes) for output in self.outputs]
            + [np.sum((matrix @ p.factor) ** 2, axis=1) for p in self._posteriors]
        )
        coefficients = basis.root_weights[:, None] * np.stack(curves, axis=1)
        slopes = basis.differentiate(coefficients)
        return basis, np.concatenate([coefficients, slopes], axis=1)

    def moments(self, times: Float[np.ndarray, " M"]) -> OutputMoments:
        """Means, variances and their rates; inside the demonstrations in O(M)."""
        if self._tables is None or not self._tables[0].covers(times):
            return self._dense_moments(times)
        basis, block = self._tables
        parts = np.split(basis.matrix(times) @ block, 6, axis=1)
        mean, log_noise, latent, mean_rate, log_noise_rate, latent_rate = parts
        noise = np.exp(log_noise)
        positive, noise_rate = np.maximum(latent, 0.0), noise * log_noise_rate
        return self._in_units(mean, mean_rate, positive, latent_rate, noise, noise_rate)

    def _dense_moments(self, times: Float[np.ndarray, " M"]) -> OutputMoments:
        columns = []
        for output in self.outputs:
            mean_rate, variance_rate = output.latent.rates(times)
            noise = output.noise.variance(times)
            columns.append(
                (
                    output.latent.mean(times),
                    mean_rate,
                    output.latent.variance(times),
                    variance_rate,
                    noise,
                    noise * output.noise.log_variance_rate(times),
                )
            )
        return self._in_units(
            *(np.stack(part, axis=1) for part in zip(*columns, strict=True))
        )

    def _in_units(self, *scaled: Float[np.ndarray, "M d"]) -> OutputMoments:
        """Moments of the outputs from those of the scaled ones, in the same order."""
        mean, mean_rate, latent, latent_rate, noise, noise_rate = scaled
        scale, square = self._scales, self._scales**2
        return OutputMoments(
            mean=self._offsets + scale * mean,
            mean_rate=scale * mean_rate,
            latent=square * latent,
            latent_rate=square * latent_rate,
            noise=square * noise,
            noise_rate=square * noise_rate,
        )

    def latent_covariance(
        self, times: Float[np.ndarray, " M"]
    ) -> Float[np.ndarray, "d M M"]:
        """Covariance of f over time, per output, Eq. (11) without R."""
        basis = self._basis
        if basis is None or not basis.covers(times):
            unscaled = [output.latent.covariance(times) for output in self.outputs]
        else:
            matrix = basis.matrix(times)
            halves = [matrix @ posterior.factor for posterior in self._posteriors]
            unscaled = [half @ half.T for half in halves]
        return np.asarray(self._scales[:, None, None] ** 2 * np.stack(unscaled))
