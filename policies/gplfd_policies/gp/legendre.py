"""Smooth kernels on an interval as a small matrix: the spectral form.

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
from numpy.polynomial.legendre import leggauss, legvander

from gplfd_policies.arrays.records import read_only
from gplfd_policies.arrays.shapes import Float, Times
from gplfd_policies.gp.kernels import RBF

SIZES = {48: 0.1, 96: 0.05, 192: 0.02}
"""Basis sizes and the shortest RBF length-scale, as a fraction of the interval, that
each represents to rounding (``test_basis_represents_rbf_to_rounding``)."""


@dataclass(frozen=True, kw_only=True, slots=True)
class _UnitTables:
    """Tables that depend on the size of the basis only; interval [−1, 1]."""

    nodes: Float[np.ndarray, " Q"]
    root_weights: Float[np.ndarray, " Q"]
    barycentric: Float[np.ndarray, " Q"]
    """Barycentric interpolation weights of the nodes."""
    slope: Float[np.ndarray, "Q Q"]
    """Coefficients of a curve ↦ coefficients of its derivative."""


@lru_cache(maxsize=16)
def _unit_tables(size: int) -> _UnitTables:
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
    return _UnitTables(
        nodes=read_only(nodes),
        root_weights=read_only(roots),
        barycentric=read_only(signs * np.sqrt(1.0 - nodes**2) * roots),
        slope=read_only(modes.T @ (np.where(below, 2.0 * ratio, 0.0) @ modes)),
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class LegendreBasis:
    """Orthonormal polynomials a_i(t) on [start, stop], one per Gauss–Legendre node."""

    start: float
    """Left end of the interval."""
    stop: float
    """Right end of the interval."""
    size: int
    """Number of nodes q."""

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
        return centre + half * _unit_tables(self.size).nodes

    @property
    def root_weights(self) -> Float[np.ndarray, " Q"]:
        """√w_i; a smooth g is Σ_i a_i(t) · √w_i g(x_i)."""
        return _unit_tables(self.size).root_weights

    def matrix(self, times: Times) -> Float[np.ndarray, "M Q"]:
        """a_i(t) at ``times`` inside the interval, by barycentric interpolation."""
        if not self.covers(times):
            raise ValueError(
                f"Times must lie in [{self.start}, {self.stop}], got a range of "
                f"[{np.min(times)}, {np.max(times)}]."
            )
        tables = _unit_tables(self.size)
        x = (2.0 * times - (self.start + self.stop)) / (self.stop - self.start)
        distance = np.subtract.outer(x, tables.nodes)
        at_node = distance == 0.0
        distance[at_node] = 1.0
        table: np.ndarray = tables.barycentric / distance
        rows = at_node.any(axis=1)
        table[rows] = at_node[rows]
        table /= table.sum(axis=1, keepdims=True)
        table *= 1.0 / tables.root_weights
        return table

    def row(self, phase: float) -> Float[np.ndarray, " Q"]:
        """a_i(t) at one time inside the interval; three times faster than `matrix`."""
        tables = _unit_tables(self.size)
        x = (2.0 * phase - (self.start + self.stop)) / (self.stop - self.start)
        distance = x - tables.nodes
        at_node = distance == 0.0
        if at_node.any():
            return np.asarray(at_node / tables.root_weights)
        row: np.ndarray = tables.barycentric / distance
        row /= np.add.reduce(row) * tables.root_weights
        return row

    def shared_matrix(self, times: Times) -> Float[np.ndarray, "M Q"]:
        """`matrix`, cached and read-only: all outputs share their times."""
        return _remembered_matrix(self, times.tobytes())

    def differentiate(
        self, coefficients: Float[np.ndarray, "Q ..."]
    ) -> Float[np.ndarray, "Q ..."]:
        """Coefficients of the time derivatives of curves given by coefficients."""
        chain = 2.0 / (self.stop - self.start)
        return np.asarray(chain * (_unit_tables(self.size).slope @ coefficients))

    def covers(self, times: Times) -> bool:
        """Whether all ``times`` lie inside the interval."""
        return bool(np.min(times) >= self.start and np.max(times) <= self.stop)

    def kernel_matrix(self, kernel: RBF) -> Float[np.ndarray, "Q Q"]:
        """√w_i k(x_i, x_j) √w_j: the kernel in this basis."""
        return self.weigh(kernel(self.nodes, self.nodes))

    def weigh(
        self, values: Float[np.ndarray, "... Q Q"]
    ) -> Float[np.ndarray, "... Q Q"]:
        """Convert covariances between nodes to coefficients of this basis."""
        root = self.root_weights
        return np.asarray(root[:, None] * values * root)


@lru_cache(maxsize=4)
def _remembered_matrix(basis: LegendreBasis, times: bytes) -> Float[np.ndarray, "M Q"]:
    table = basis.matrix(np.frombuffer(times))
    table.setflags(write=False)
    return table
