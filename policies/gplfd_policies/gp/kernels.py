"""The radial basis function kernel of Eq. (13), and its spectral form on an interval.

Eq. (14), the multi-output kernel, is printed without the minus sign and the ½: it grows
with distance and is not a covariance
(``test_printed_multi_output_kernel_is_not_a_covariance``). Outputs use Eq. (13).

On an interval, the Gram matrix of a smooth kernel has a small numerical rank. With
q Gauss–Legendre nodes x_i, weights w_i, and the polynomials a_i(t) = ℓ_i(t)/√w_i
(ℓ_i the Lagrange polynomial of node i; the a_i are orthonormal),

    k(t, t') = Σ_ij a_i(t) [√w_i k(x_i, x_j) √w_j] a_j(t') + ε,

and ε falls faster than exponentially in q: it is rounding once the length-scale is
long enough for q. Everything that costs O(M³) with the Gram matrix then costs O(q³).
Polynomials do not extrapolate, so a basis may only be evaluated inside its interval.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy
from numpy.polynomial.legendre import leggauss, legvander

from gplfd_policies.arrays.records import read_only
from gplfd_policies.arrays.shapes import Float, Times

SIZES = {48: 0.1, 96: 0.05, 192: 0.02}
"""Basis sizes and the shortest RBF length-scale, as a fraction of the interval, that
each represents to rounding (``test_basis_represents_rbf_to_rounding``)."""


@dataclass(frozen=True, kw_only=True, slots=True)
class RBF:
    """k(t, t') = σ_f² exp(−(t − t')² / (2 l²)), Eq. (13)."""

    length_scale: float
    """Length-scale l, in the unit of time (phase once aligned)."""
    signal_std: float
    """Signal standard deviation σ_f, in the unit of the output."""

    def __post_init__(self) -> None:
        for name in ("length_scale", "signal_std"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise ValueError(f"{name} must be positive and finite, got {value}.")

    def __call__(
        self, a: Float[np.ndarray, " A"], b: Float[np.ndarray, " B"]
    ) -> Float[np.ndarray, "A B"]:
        """Covariance k(a_i, b_j)."""
        distance = np.subtract.outer(a, b)
        distance *= distance
        distance *= -0.5 / self.length_scale**2
        np.exp(distance, out=distance)
        distance *= self.signal_std**2
        return np.asarray(distance)

    def features(
        self, times: Float[np.ndarray, " A"], centre: float, terms: int
    ) -> Float[np.ndarray, "A terms"]:
        """φ with k(a, b) = φ(a) φ(b)ᵀ, from the power series of exp(u_a u_b).

        φ_n(t) = σ_f exp(−u²/2) uⁿ/√n! with u = (t − centre)/l, for u² ≪ ``terms``.
        """
        scaled = (times - centre)[:, None] / self.length_scale
        powers = np.arange(terms)
        logarithm = scipy.special.xlogy(powers, np.abs(scaled))
        logarithm -= 0.5 * (scipy.special.gammaln(powers + 1.0) + scaled**2)
        sign = np.where(powers % 2, np.sign(scaled), 1.0)
        return np.asarray(self.signal_std * sign * np.exp(logarithm))

    def feature_rates(
        self, times: Float[np.ndarray, " A"], centre: float, terms: int
    ) -> Float[np.ndarray, "A terms"]:
        """φ', so that ∂k/∂a = φ'(a) φ(b)ᵀ and ∂²k/∂a∂b = φ'(a) φ'(b)ᵀ."""
        features = self.features(times, centre, terms)
        rates = (centre - times)[:, None] / self.length_scale * features
        rates[:, 1:] += np.sqrt(np.arange(1.0, terms)) * features[:, :-1]
        return np.asarray(rates / self.length_scale)

    def time_derivative(
        self, a: Float[np.ndarray, " A"], b: Float[np.ndarray, " B"]
    ) -> Float[np.ndarray, "A B"]:
        """∂k(a_i, b_j)/∂a_i = −(a_i − b_j)/l² · k(a_i, b_j)."""
        return np.asarray(-np.subtract.outer(a, b) / self.length_scale**2 * self(a, b))

    def log_gradients(
        self, a: Float[np.ndarray, " A"], b: Float[np.ndarray, " B"]
    ) -> Float[np.ndarray, "2 A B"]:
        """∂k/∂log l = (a − b)²/l² · k and ∂k/∂log σ_f = 2 k."""
        values = self(a, b)
        scaled = np.subtract.outer(a, b) / self.length_scale
        return np.stack([scaled**2 * values, 2.0 * values])


Nodes = Float[np.ndarray, " Q"]
Square = Float[np.ndarray, "Q Q"]


@lru_cache(maxsize=16)
def _unit_tables(size: int) -> tuple[Nodes, Nodes, Nodes, Square]:
    """Return nodes, √w, barycentric weights and differentiation on [−1, 1]."""
    nodes, _ = leggauss(size)
    table = legvander(nodes, size)
    # From P_q' = q (x P_q − P_{q−1}) / (x² − 1); NumPy's own weights would make slopes
    # a hundred times less accurate, because differentiation magnifies errors by q².
    slope = size * (nodes * table[:, size] - table[:, size - 1]) / (nodes**2 - 1.0)
    roots = np.sqrt(2.0 / (1.0 - nodes**2)) / np.abs(slope)
    degrees = np.arange(size)
    # Coefficients of a curve in the orthonormal polynomials √(j + ½) P_j.
    modes = (table[:, :size] * np.sqrt(degrees + 0.5)).T * roots
    # P_j' = Σ (2 k + 1) P_k over k = j − 1, j − 3, …
    odd = (degrees[None, :] - degrees[:, None]) % 2 == 1
    below = odd & (degrees[:, None] < degrees[None, :])
    ratio = np.sqrt(np.multiply.outer(degrees + 0.5, degrees + 0.5))
    signs = np.where(degrees % 2, -1.0, 1.0)
    barycentric = signs * np.sqrt(1.0 - nodes**2) * roots
    slopes = modes.T @ (np.where(below, 2.0 * ratio, 0.0) @ modes)
    return read_only(nodes), read_only(roots), read_only(barycentric), read_only(slopes)


@dataclass(frozen=True, kw_only=True, slots=True)
class LegendreBasis:
    """Orthonormal polynomials a_i(t) on [start, stop], one per node; `size` is q."""

    start: float
    stop: float
    size: int

    @classmethod
    def for_length_scale(
        cls, start: float, stop: float, length_scale: float
    ) -> "LegendreBasis | None":
        """The smallest basis exact for ``length_scale``; None if there is none."""
        for size, shortest in SIZES.items():
            if length_scale >= shortest * (stop - start):
                return cls(start=start, stop=stop, size=size)
        return None

    @property
    def nodes(self) -> Float[np.ndarray, " Q"]:
        """Gauss–Legendre nodes in [start, stop]."""
        centre, half = 0.5 * (self.start + self.stop), 0.5 * (self.stop - self.start)
        return centre + half * _unit_tables(self.size)[0]

    @property
    def root_weights(self) -> Float[np.ndarray, " Q"]:
        """√w_i; a smooth g is Σ_i a_i(t) · √w_i g(x_i)."""
        return _unit_tables(self.size)[1]

    def matrix(self, times: Times) -> Float[np.ndarray, "M Q"]:
        """a_i(t) at ``times`` inside the interval, by barycentric interpolation."""
        if not self.covers(times):
            raise ValueError(f"Times outside [{self.start}, {self.stop}]: {times}")
        nodes, roots, barycentric, _ = _unit_tables(self.size)
        x = (2.0 * times - (self.start + self.stop)) / (self.stop - self.start)
        distance = np.subtract.outer(x, nodes)
        at_node = distance == 0.0
        distance[at_node] = 1.0
        table: np.ndarray = barycentric / distance
        rows = at_node.any(axis=1)
        table[rows] = at_node[rows]
        table /= table.sum(axis=1, keepdims=True)
        table *= 1.0 / roots
        return table

    def row(self, phase: float) -> Float[np.ndarray, " Q"]:
        """`matrix` at one time inside the interval, three times faster."""
        nodes, roots, barycentric, _ = _unit_tables(self.size)
        x = (2.0 * phase - (self.start + self.stop)) / (self.stop - self.start)
        distance = x - nodes
        at_node = distance == 0.0
        if at_node.any():
            return np.asarray(at_node / roots)
        row: np.ndarray = barycentric / distance
        row /= np.add.reduce(row) * roots
        return row

    def differentiate(
        self, coefficients: Float[np.ndarray, "Q ..."]
    ) -> Float[np.ndarray, "Q ..."]:
        """Coefficients of the time derivatives of curves given by coefficients."""
        chain = 2.0 / (self.stop - self.start)
        return np.asarray(chain * (_unit_tables(self.size)[3] @ coefficients))

    def covers(self, times: Times) -> bool:
        """Whether all ``times`` lie inside the interval."""
        return bool(np.min(times) >= self.start and np.max(times) <= self.stop)

    def kernel_matrix(self, kernel: RBF) -> Float[np.ndarray, "Q Q"]:
        """√w_i k(x_i, x_j) √w_j: the kernel in this basis."""
        nodes, roots = self.nodes, self.root_weights
        return np.asarray(roots[:, None] * kernel(nodes, nodes) * roots)
