"""The spread of the demonstrations as a function of time, and who may estimate it.

The noise r(t) of Eqs. (10)–(11), kept as z(t) = log r(t), Eq. (15).
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from gplfd_policies.arrays.records import short_repr
from gplfd_policies.gp.legendre import LegendreBasis

LEAST_VARIANCE = 1e-10
"""Smallest observation of exp z(t), relative to the variance of the output."""
SHORTEST_SCALE = 0.15
"""Shortest length-scale of z(t) by default, as a fraction of the time span."""
LEAST_SCALE = 0.1
"""Least value of it that the basis can express."""
_BASIS_SIZE = 48


@dataclass(frozen=True, kw_only=True, slots=True)
class NoiseProfile:
    """A noise variance r(t) = exp z(t) + floor > 0, smooth in time.

    Outside the interval of its basis it keeps the value of the nearer end: a spread
    that was never demonstrated must not shrink.
    """

    level: float
    """Constant part of z(t)."""
    basis: LegendreBasis
    """Basis of the varying part."""
    coefficients: Float[np.ndarray, " Q"]
    """Coefficients of the varying part of z(t)."""
    floor: float = 0.0
    """What is added to exp z(t)."""

    __repr__ = short_repr

    @staticmethod
    def basis_over(times: Float[np.ndarray, " M"]) -> LegendreBasis:
        """The basis of a profile over demonstrations at ``times``."""
        return LegendreBasis(
            start=float(times[0]), stop=float(times[-1]), size=_BASIS_SIZE
        )

    @classmethod
    def constant(
        cls, times: Float[np.ndarray, " M"], variance: float
    ) -> "NoiseProfile":
        """The same variance everywhere."""
        basis = cls.basis_over(times)
        return cls(
            level=float(np.log(variance)),
            basis=basis,
            coefficients=np.zeros(basis.size),
        )

    def log_variance(self, times: Float[np.ndarray, " M"]) -> Float[np.ndarray, " M"]:
        """Its logarithm at ``times``."""
        with np.errstate(divide="ignore"):
            floor = np.log(self.floor)  # -inf for none
        return np.asarray(np.logaddexp(self._varying(times), floor))

    def _varying(self, times: Float[np.ndarray, " M"]) -> Float[np.ndarray, " M"]:
        """z(t) at ``times``."""
        inside = np.clip(times, self.basis.start, self.basis.stop)
        return np.asarray(self.level + self.basis.matrix(inside) @ self.coefficients)

    def variance(self, times: Float[np.ndarray, " M"]) -> Float[np.ndarray, " M"]:
        """The noise variance r(t) at ``times``."""
        return np.asarray(np.exp(self.log_variance(times)))

    def log_variance_rate(
        self, times: Float[np.ndarray, " M"]
    ) -> Float[np.ndarray, " M"]:
        """Its logarithm's derivative; zero outside the demonstrated interval."""
        inside = np.clip(times, self.basis.start, self.basis.stop)
        slope = self.basis.matrix(inside) @ self.basis.differentiate(self.coefficients)
        share = np.exp(self._varying(times) - self.log_variance(times))
        return np.where(inside == times, share * slope, 0.0)


@runtime_checkable
class NoiseModel(Protocol):
    """A rule that turns aligned demonstrations of one output into r(t)."""

    def fit(
        self, times: Float[np.ndarray, " M"], samples: Float[np.ndarray, "D M"]
    ) -> NoiseProfile:
        """Estimate r(t) from D curves of order one on M common times."""
        ...
