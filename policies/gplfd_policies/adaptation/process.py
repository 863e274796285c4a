"""Exact Gaussian conditioning of six smooth curves together, via-point by via-point.

A repetition of the task is the mean, plus deviations given by a few standard-normal
numbers z_i per output, which are independent a priori:

    y_i(t) = m_i(t) + φ_i(t)ᵀ z_i + white noise.

A via-point at *any* phase observes all outputs at once, each with its own noise and one
shared error (`ViaPoint.along`), exactly and on any grid
(`gplfd_policies.gp.conditioning`, ``test_shared_error_equals_dense_conditioning``).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np
import scipy

from gplfd_policies.arrays.records import read_only, thinned
from gplfd_policies.arrays.shapes import Covariances, Float, Outputs, Pose, Times
from gplfd_policies.gp.conditioning import Innovation
from gplfd_policies.gp.deviations import conjugate_share
from gplfd_policies.gp.exact import factorise
from gplfd_policies.gp.kernels import LegendreBasis
from gplfd_policies.movements.movement import GaussianTrajectory, ViaPoint
from gplfd_policies.movements.skill import Skill

_STRONGEST = 1e-8
"""Least via-point variance, relative to the largest variance of the output."""
_LEFT_OUT = 1e-7
"""Share of the largest eigenvalue below which no via-point can observe a curve."""
_SMOOTHING_GRID = 60
"""Samples of a demonstration from which its smooth curve is computed."""
_OWN_SHARE = 0.5  # size of a door's own force relative to the demonstrated forces
_OWN_PRIOR = (0.98, 0.01, 0.01)
"""Probability that a door has no own force, a constant one, or a varying one."""
_OWN_SCALE = 0.1  # length scale of the varying part of a door's own force, in phase
_OUTPUTS = np.arange(6)[:, None]

Local = tuple[Pose, Pose, Float[np.ndarray, "6 R"]]
"""m_i, the white variance and φ_i at one phase, before any via-point."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Repetition:
    """The prior of a repetition, before any via-point, in a basis."""

    basis: LegendreBasis
    mean: Float[np.ndarray, "Q 6"]
    """Coefficients of the mean m_i in the basis."""
    deviations: Float[np.ndarray, "6 Q R"]
    """Coefficients of the curves φ_i, R of each output."""
    log_white: Float[np.ndarray, "Q 6"]
    """Coefficients of the logarithm of the white variance."""

    @classmethod
    def from_covariance(
        cls,
        basis: LegendreBasis,
        mean: Float[np.ndarray, "Q 6"],
        covariance: Float[np.ndarray, "6 Q Q"],
        log_white: Float[np.ndarray, "Q 6"],
    ) -> "Repetition":
        """Return the prior for moments at the nodes of the basis."""
        root = basis.root_weights[:, None]
        # φ_i are the eigenvectors times roots of the eigenvalues.
        values, vectors = np.linalg.eigh(root * covariance * root.T)
        values = np.maximum(values, 0.0)
        kept = values > _LEFT_OUT * values[..., -1:]
        most = max(int(np.max(np.sum(kept, axis=-1))), 1)
        return cls(
            basis=basis,
            mean=root * mean,
            deviations=vectors[..., -most:] * np.sqrt(values[..., None, -most:]),
            log_white=root * log_white,
        )


def basis_for_grid(
    times: Float[np.ndarray, " N"], grid: Times, shortest_scale: float
) -> LegendreBasis:
    """Return a basis over demonstrations and grid; raise if the grid is impossible."""
    if len(grid) == 0 or not np.isfinite(grid).all():
        raise ValueError(f"Adaptation needs finite grid phases, got {grid}.")
    start = float(min(times[0], np.min(grid)))
    stop = float(max(times[-1], np.max(grid)))
    basis = LegendreBasis.for_length_scale(start, stop, shortest_scale)
    if basis is None:
        raise ValueError(
            f"The grid reaches from {np.min(grid)} to {np.max(grid)}, too far beyond "
            f"the demonstrated [{times[0]}, {times[-1]}]; keep it near that range."
        )
    return basis


class ConditionedProcess:
    """Six curves on a grid of phases, conditioned in place.

    With few demonstrations the scale of the process is uncertain. With ν degrees of
    freedom, n observations and their squared Mahalanobis distance δ² given the other
    outputs, the scale of a Student-t process grows to (ν + δ²)/(ν + n) per output. It
    is at least one: via-points that match must not make the robot stiff.
    """

    _white_is_seen: ClassVar = True  # whether a via-point has this noise, too

    def __init__(self, prior: Repetition, free: float | None, grid: Times) -> None:
        self.grid, self._basis, self._free = grid, prior.basis, free
        # Coefficients of every curve: m, log white, ṁ, and φ by output.
        flat = prior.deviations.transpose(1, 0, 2).reshape(prior.basis.size, -1)
        slope = prior.basis.differentiate(prior.mean)
        self._table = np.concatenate([prior.mean, prior.log_white, slope, flat], axis=1)
        self._rows = prior.basis.matrix(grid) @ self._table
        self._mean, self._white = self._rows[:, :6].copy(), np.exp(self._rows[:, 6:12])
        self._curves = _curves(self._rows)
        self._variance = np.sum(self._curves**2, axis=2).T
        self._floor = _STRONGEST * np.max(self._variance + self._white, axis=0)
        # Entries of the state that belong to each output.
        size = 6 * self._curves.shape[2]
        self._places = np.arange(size).reshape(6, -1)
        self._state = np.zeros(size)
        self._covariance = np.asfortranarray(np.eye(size))
        self._design = np.zeros((6, size))
        self._observed, self._distance = np.zeros(6), np.zeros(6)
        self._sequential, self._log_variance = 0.0, 0.0

    @property
    def mean(self) -> Outputs:
        """Current mean on the grid, a read-only view."""
        view: np.ndarray = self._mean.view()
        view.setflags(write=False)
        return view

    @property
    def std(self) -> Outputs:
        """Current standard deviation on the grid, white part included."""
        return np.asarray(np.sqrt(self.variance()))

    def variance(self) -> Outputs:
        """Square of the current standard deviation."""
        unscaled = np.maximum(self._variance, 0.0) + self._white
        return np.asarray(self._scale() * unscaled)

    @property
    def log_evidence(self) -> float:
        """Log Student-t density of all via-points, up to a constant of their number."""
        assert self._free is not None
        power = 0.5 * (self._free + float(np.sum(self._observed)))
        distance = np.log1p(self._sequential / self._free)
        return -0.5 * self._log_variance - power * float(distance)

    def observe(self, via_point: ViaPoint) -> None:
        """Condition on one more via-point, in place, in O(n² + M n)."""
        here, along = self.at(via_point.phase), np.asarray(via_point.along)
        white = here[1] if self._white_is_seen else 0.0
        self.update(here, via_point.pose, via_point.own_variance + white, along)

    def at(self, phase: float) -> Local:
        """Return the prior at a phase within demonstrations and grid."""
        basis = self._basis
        if not basis.start <= phase <= basis.stop:
            raise ValueError(
                f"The via-point's phase {phase} is outside the range [{basis.start}, "
                f"{basis.stop}] of demonstrations and grid; clip it, or widen the grid."
            )
        row = basis.row(phase) @ self._table
        return row[:6], np.exp(row[6:12]), _curves(row[None])[:, 0]

    def update(
        self, here: Local, pose: Pose, noise_variance: Pose, along: Pose
    ) -> None:
        """Condition on a pose, given `at`; infinite noise is for free outputs."""
        mean, _, curves = here
        design, places = self._design, self._places
        design[_OUTPUTS, places] = curves
        gain = self._covariance @ design.T
        missed = pose - (mean + design @ self._state)
        variance = np.maximum(noise_variance, self._floor)
        new = Innovation.of(design @ gain, missed, variance, along)
        half = (gain * new.observed) @ new.inverse_root.T
        self._state += half @ new.whitened
        self._covariance = scipy.linalg.blas.dgemm(
            -1.0, half, half, trans_b=1, beta=1.0, c=self._covariance, overwrite_c=1
        )
        on_grid = self._curves @ half[places]
        self._mean += (on_grid @ new.whitened).T
        self._variance -= np.einsum("imk,imk->mi", on_grid, on_grid)
        # Squared innovation of each output over its variance, given the other five.
        alone = new.whitened @ new.inverse_root
        precision = np.einsum("ki,ki->i", new.inverse_root, new.inverse_root)
        self._observed += new.observed
        self._distance += alone * alone / precision
        self._sequential += float(new.whitened @ new.whitened)
        self._log_variance += 2.0 * float(np.sum(np.log(np.diag(new.root))))

    def trajectory(self) -> GaussianTrajectory:
        """The current distribution on the grid, with rates and covariance."""
        blocks = self._covariance[self._places[:, :, None], self._places[:, None, :]]
        rates = self._basis.matrix(self.grid) @ self._basis.differentiate(self._table)
        slopes, stretch = _curves(rates), np.sqrt(self._scale())
        spread = np.sqrt(np.maximum(self._variance, 0.0) + self._white)
        smooth_rate = 2.0 * np.sum(slopes @ blocks * self._curves, axis=2).T
        variance_rate = smooth_rate + self._white * rates[:, 6:12]
        state = self._state[self._places]
        return GaussianTrajectory(
            times=self.grid,
            mean=self._mean,
            std=stretch * spread,
            mean_rate=self._rows[:, 12:18] + np.einsum("imr,ir->mi", slopes, state),
            std_rate=stretch * variance_rate / (2.0 * spread),
            covariance_function=partial(
                _covariance_on_grid, self._curves, blocks, spread**2, stretch
            ),
            degrees_of_freedom=self._free,
        )

    def _scale(self) -> Pose:
        """Factor on the variances, from the innovations of the via-points."""
        if self._free is None:
            return np.ones(6)
        scale = (self._free + self._distance) / (self._free + self._observed)
        return np.asarray(np.maximum(scale, 1.0))


def _curves(rows: Float[np.ndarray, "M C"]) -> Float[np.ndarray, "6 M R"]:
    """Return φ_i, or its derivatives, by output, from rows of the table."""
    curves = rows[:, 18:].reshape(len(rows), 6, -1)
    return np.ascontiguousarray(curves.transpose(1, 0, 2))


def _covariance_on_grid(
    curves: Float[np.ndarray, "6 M R"],
    covariance: Float[np.ndarray, "6 R R"],
    variance: Outputs,
    stretch: Pose,
) -> Covariances:
    """Return the covariance over time of smooth and white part together."""
    full: np.ndarray = curves @ covariance @ np.swapaxes(curves, 1, 2)
    np.einsum("imm->im", full)[:] = variance.T
    return np.asarray(stretch[:, None, None] ** 2 * full)


class ProcessAdaptation(ConditionedProcess):
    """Exact Gaussian conditioning of the demonstrated process at registered phases.

    A repetition deviates smoothly from the mean, like the demonstrations
    (`gplfd_policies.gp.deviations`), so that the observed radius of a door informs the
    rest of the motion. Before any via-point it equals `Skill.predict`. A via-point has
    its own noise, an error along the path and the white part of the spread.
    """

    def __init__(self, skill: Skill, grid: Times) -> None:
        """Start from at least two demonstrations."""
        prior = demonstrated_repetition(skill, grid)
        super().__init__(prior, float(skill.count - 1), grid)


class ExactAdaptation(ConditionedProcess):
    """p(f | D ∪ V): via-points as data, like demonstrations, Eqs. (10)–(11).

    Eq. (19) approximates this by a product. The spread r(t) stays white, so a via-point
    only corrects the uncertainty of the *mean*: it bends the policy nearby and does not
    inform the rest (``test_exact_equals_gp_on_demonstrations_and_via_points``).
    """

    _white_is_seen = False

    def __init__(self, skill: Skill, grid: Times) -> None:
        """Start from the demonstrations; arguments as for `ProcessAdaptation`."""
        processes, times = skill.processes, skill.aligned.times
        basis = basis_for_grid(times, grid, processes.shortest_length_scale)
        moments = processes.moments(basis.nodes)
        covariance = processes.latent_covariance(basis.nodes)
        log_white = np.log(moments.noise)
        prior = Repetition.from_covariance(basis, moments.mean, covariance, log_white)
        super().__init__(prior, skill.degrees_of_freedom, grid)

    def _scale(self) -> Pose:
        return np.ones(6)


class ForceAdaptation:
    """Conditioning of the force at a door that may differ from all demonstrated doors.

    In addition to the demonstrations' spread, a door's force deviates in one of three
    ways, weighted by the evidence of the via-points: not at all; by a constant b, like
    the pull of a closer; or by b + f(s), where f varies over a tenth of the way, like
    springs. The standard deviation of these is half the root mean square of the
    demonstrated forces, or moments, along each axis.
    """

    def __init__(self, skill: Skill, grid: Times) -> None:
        """Start from at least two demonstrations, with wrenches instead of poses."""
        square = np.mean(skill.aligned.poses.reshape(-1, 2, 3) ** 2, axis=0)
        variance = np.repeat(_OWN_SHARE**2 * square.sum(axis=-1), 3)
        free = float(skill.count - 1)
        self._parts = [
            ConditionedProcess(demonstrated_repetition(skill, grid, extra), free, grid)
            for extra in (None, (variance, 0.0 * variance), (0.5 * variance,) * 2)
        ]

    def observe(self, via_point: ViaPoint) -> None:
        """Condition on one more via-point, in place."""
        for part in self._parts:
            part.observe(via_point)

    @property
    def shares(self) -> Float[np.ndarray, " P"]:
        """Probability of each process."""
        evidence = np.log(_OWN_PRIOR) + [part.log_evidence for part in self._parts]
        likely = np.exp(evidence - evidence.max())
        return np.asarray(likely / likely.sum())

    @property
    def mean(self) -> Outputs:
        """Current mean on the grid, read-only."""
        return read_only(_mixed(self.shares, [part.mean for part in self._parts]))

    @property
    def std(self) -> Outputs:
        """Current standard deviation on the grid."""
        shares, means = self.shares, np.stack([part.mean for part in self._parts])
        variance = _mixed(shares, [part.variance() for part in self._parts])
        apart = means - _mixed(shares, means)
        return np.asarray(np.sqrt(variance + _mixed(shares, apart**2)))

    def trajectory(self) -> GaussianTrajectory:
        """The current distribution on the grid, with rates and covariance."""
        shares, parts = self.shares, [part.trajectory() for part in self._parts]
        means, rates = (
            np.stack([getattr(part, name) for part in parts])
            for name in ("mean", "mean_rate")
        )
        mean, mean_rate = _mixed(shares, means), _mixed(shares, rates)
        apart, apart_rate = means - mean, rates - mean_rate
        variance = _mixed(shares, [part.std**2 for part in parts])
        std = np.sqrt(variance + _mixed(shares, apart**2))
        rate = _mixed(shares, [part.std * part.std_rate for part in parts])
        rate += _mixed(shares, apart * apart_rate)
        return replace(
            parts[0],
            mean=mean,
            std=std,
            mean_rate=mean_rate,
            std_rate=rate / std,
            covariance_function=partial(_mixed_covariance, shares, apart, parts),
        )


def _mixed(
    shares: Float[np.ndarray, " P"], values: Sequence[np.ndarray] | np.ndarray
) -> np.ndarray:
    # No BLAS product: its order of summation depends on the processor.
    parts = zip(shares, values, strict=True)
    return np.asarray(sum(share * value for share, value in parts))


def _mixed_covariance(
    shares: Float[np.ndarray, " P"],
    apart: Float[np.ndarray, "P M 6"],
    parts: Sequence[GaussianTrajectory],
) -> Covariances:
    covariance = _mixed(shares, [part.covariance for part in parts])
    covariance += np.einsum("p,pmi,pni->imn", shares, apart, apart)
    return covariance


def demonstrated_repetition(
    skill: Skill, grid: Times, own_variance: tuple[Pose, Pose] | None = None
) -> Repetition:
    """Return the prior of a repetition; arguments as for `ProcessAdaptation`.

    The variance is that of `Skill.predict`, plus the two in `own_variance`: of a
    constant, and of a part that varies over a tenth of the task. The smooth covariance
    mixes the model's and that of the demonstrations' curves, smoothed by the model.
    """
    empirical_share = conjugate_share(skill.count)
    processes, times = skill.processes, skill.aligned.times
    scales = [deviation.short_scale for deviation in skill.deviations]
    shortest = min(processes.shortest_length_scale, *scales)
    basis = basis_for_grid(times, grid, shortest)
    nodes, size = basis.nodes, basis.size
    prediction = skill.predict(nodes)
    noise = processes.moments(nodes).noise
    thin = thinned(len(times), _SMOOTHING_GRID)
    together = np.concatenate([nodes, times[thin]])
    noise_together = processes.moments(together).noise
    covariance, white = np.empty((6, size, size)), np.empty((size, 6))
    for output, deviation in enumerate(skill.deviations):
        # Model covariance between the nodes and the samples of the demonstrations.
        spread = noise_together[:, output]
        joint = deviation.smooth_covariance(together, spread)
        observed = joint[size:, size:] + np.diag(
            deviation.white_variance(spread[size:]) + 1e-6 * spread[size:]
        )
        poses = skill.aligned.poses[:, :, output]
        curves = (poses - poses.mean(axis=0))[:, thin]
        smoothed = joint[:size, size:] @ factorise(observed).solve(curves.T)
        empirical = smoothed @ smoothed.T / (len(poses) - 1)
        smooth = (1.0 - empirical_share) * joint[:size, :size]
        smooth += empirical_share * empirical
        # Smooth and white part together have the predicted variance.
        total = prediction.std[:, output] ** 2
        share = deviation.white_variance(noise[:, output]) / noise[:, output]
        white[:, output] = total * share
        stretch = np.sqrt(total * (1.0 - share) / np.diag(smooth))
        covariance[output] = stretch[:, None] * smooth * stretch
    if own_variance is not None:
        constant, smooth = (part[:, None, None] for part in own_variance)
        apart = (nodes[:, None] - nodes) / _OWN_SCALE
        covariance += constant + smooth * np.exp(-0.5 * apart**2)
    log_white = np.log(white)
    return Repetition.from_covariance(basis, prediction.mean, covariance, log_white)
