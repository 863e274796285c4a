"""Exact Gaussian conditioning on via-points, in two forms.

`ProcessAdaptation` is ours: a repetition of the task deviates from the mean as the
demonstrations did (`gplfd_policies.gp.deviations`), so that the door's radius, once
known, is known for the rest of the motion. `ExactAdaptation` conditions the paper's
model, whose deviations are white.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from gplfd_policies.adaptation.conditioning import (
    ConditionedProcess,
    Repetition,
    basis_for_grid,
)
from gplfd_policies.arrays.one_thread import one_thread
from gplfd_policies.arrays.resolution import thinned
from gplfd_policies.arrays.shapes import Covariances, Float, Outputs, Pose, Times
from gplfd_policies.gp.deviations import conjugate_share
from gplfd_policies.gp.exact import factorise
from gplfd_policies.movements.skill import Skill
from gplfd_policies.movements.trajectory import GaussianTrajectory, ViaPoint

_SMOOTHING_GRID = 60
"""Samples of a demonstration from which its smooth curve is computed."""
_OWN_SHARE = 0.5
"""Size of a door's own force relative to the demonstrated ones."""
_OWN_PRIOR = (0.98, 0.01, 0.01)
"""Probability that a door has no force of its own, a constant one, or one that varies.
Chosen on doors: of 50 %, intervals at doors as demonstrated are too wide."""
_OWN_SCALE = 0.1
"""Length scale of the part of it that varies, in phase."""


class StudentProcess(ConditionedProcess):
    """A conditioned process whose size is itself learned from few demonstrations.

    With ν degrees of freedom, n observations and their squared Mahalanobis distance δ²,
    the scale of a Student-t process grows to (ν + δ²)/(ν + n), by output. Each
    observation enters by its distance from the prediction given the other outputs, so
    that an error along the path does not count. The scale is never taken below one:
    matching via-points with a generous σ_v must not make the robot over-confident, or
    stiff. Intervals keep ν degrees of freedom, because the via-points of one repetition
    all observe the same deviation.
    """

    def __init__(self, prior: Repetition, free: float, grid: Times) -> None:
        super().__init__(prior, grid)
        self._free = free
        self._observed, self._distance = np.zeros(6), np.zeros(6)
        self._sequential, self._log_variance = 0.0, 0.0

    @one_thread
    def observe(self, via_point: ViaPoint) -> None:
        """Condition on one more via-point, in place, in O(n² + M n)."""
        here, along = self.at(via_point.phase), np.asarray(via_point.along)
        surprise = self.update(
            here, via_point.pose, via_point.own_variance + here.white, along
        )
        self._observed += surprise.observed
        self._distance += surprise.given_others
        self._sequential += surprise.joint
        self._log_variance += surprise.log_variance

    @property
    def log_evidence(self) -> float:
        """Log Student-t density of all via-points, up to a constant of their number.

        One scale for all outputs makes it independent of their order.
        """
        power = 0.5 * (self._free + float(np.sum(self._observed)))
        surprise = np.log1p(self._sequential / self._free)
        return -0.5 * self._log_variance - power * float(surprise)

    @property
    def std(self) -> Outputs:
        """Current standard deviation on the grid."""
        return np.asarray(np.sqrt(self.stretched_variance()))

    def stretched_variance(self) -> Outputs:
        """Its square."""
        return np.asarray(self._scale() * self.variance())

    def trajectory(self) -> GaussianTrajectory:
        """The current distribution on the grid, with rates and covariance."""
        return self.distribution(np.sqrt(self._scale()), self._free)

    def _scale(self) -> Pose:
        """Factor on the variances from how surprising the via-points were."""
        scale = (self._free + self._distance) / (self._free + self._observed)
        return np.asarray(np.maximum(scale, 1.0))


class MixedProcesses:
    """Conditioned processes, as probable as they make the via-points."""

    def __init__(self, parts: Sequence[StudentProcess], prior: Sequence[float]) -> None:
        """Mix processes of which each has a probability before any via-point."""
        self._parts, self._log_prior = tuple(parts), np.log(prior)

    @one_thread
    def observe(self, via_point: ViaPoint) -> None:
        """Condition on one more via-point, in place."""
        for part in self._parts:
            part.observe(via_point)

    @property
    def shares(self) -> Float[np.ndarray, " P"]:
        """Probability of each."""
        evidence = self._log_prior + [part.log_evidence for part in self._parts]
        likely = np.exp(evidence - evidence.max())
        return np.asarray(likely / likely.sum())

    @property
    def mean(self) -> Outputs:
        """Current mean on the grid, read-only."""
        mean: np.ndarray = _mixed(self.shares, [part.mean for part in self._parts])
        mean.setflags(write=False)
        return mean

    @property
    def std(self) -> Outputs:
        """Current standard deviation on the grid."""
        shares, means = self.shares, np.stack([part.mean for part in self._parts])
        variance = _mixed(shares, [part.stretched_variance() for part in self._parts])
        apart = means - _mixed(shares, means)
        return np.asarray(np.sqrt(variance + _mixed(shares, apart**2)))

    @one_thread
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


class ProcessAdaptation(StudentProcess):
    """Exact Gaussian conditioning of the demonstrated process, phases being registered.

    * Before any via-point it is `Skill.predict`.
    * A via-point observes the path with its own noise σ_v, an error along the path that
      all outputs share (`ViaPoint.along`), and the white part of the demonstrations'
      spread, which for smooth demonstrations is negligible.
    * The size of the spread is uncertain, see `StudentProcess`.
    * Mean and covariance do not depend on the grid, and the mean not on the order of
      the via-points. Where they share an error along the path, the scale of the
      covariance depends on their order; `gplfd_policies.adapt` takes them by phase.

    Phases are those of the alignment, as estimated from the path. For via-points by a
    clock see `gplfd_policies.adaptation.own_clock`.
    """

    @one_thread
    def __init__(
        self, skill: Skill, grid: Times, empirical_share: float | None = None
    ) -> None:
        """Start from the demonstrations.

        Args:
            skill: the demonstrated skill, from at least two demonstrations.
            grid: phases at which the distribution is reported.
            empirical_share: share of the deviations' covariance taken from the
                demonstrations' own curves, within [0, 1]; by default it follows from
                their number (`gplfd_policies.gp.deviations.conjugate_share`).

        Raises:
            ValueError: for a share outside [0, 1], a single demonstration, or a grid
                that is empty, not finite, or far outside the demonstrations.
        """
        prior = demonstrated_repetition(skill, grid, empirical_share)
        super().__init__(prior, float(skill.count - 1), grid)


class ForceAdaptation(MixedProcesses):
    """Conditioning of the force, at a door that may be unlike all demonstrated ones.

    Beyond the demonstrations' spread a door's force deviates by nothing, by a number b
    on the whole way, as the weight of a leaf or the pull of a closer has it, or by
    b + f(s) with f that varies over a tenth of the way, as springs of handle and seal
    do. The first is probable before any force was measured. The standard deviation of
    the others is half the root mean square of the demonstrated forces, or moments,
    along every axis.
    """

    @one_thread
    def __init__(self, skill: Skill, grid: Times) -> None:
        """Start from at least two demonstrations; wrenches take the place of poses."""
        square = np.mean(skill.aligned.poses.reshape(-1, 2, 3) ** 2, axis=0)
        variance = np.repeat(_OWN_SHARE**2 * square.sum(axis=-1), 3)
        priors = (
            demonstrated_repetition(skill, grid, own_variance=own)
            for own in (None, (variance, 0.0 * variance), (0.5 * variance,) * 2)
        )
        free = float(skill.count - 1)
        parts = [StudentProcess(prior, free, grid) for prior in priors]
        super().__init__(parts, _OWN_PRIOR)


class IndependentPhaseAdaptation(ProcessAdaptation):
    """The same, with the error along the path as noise of each output's own.

    An error of the phase then weakens every output as if the six errors were
    independent. For comparison: a via-point then constrains the motion across the path
    less than it could (``test_shared_error_leaves_what_is_across_the_path_certain``).
    """

    @one_thread
    def observe(self, via_point: ViaPoint) -> None:
        """Condition on one more via-point, in place."""
        std = np.sqrt(via_point.noise_variance)
        super().observe(replace(via_point, std=std, along=0.0))


class ExactAdaptation(ConditionedProcess):
    """p(f | D ∪ V): the via-points join the demonstrations as data, Eqs. (10)–(11).

    Eq. (19) of Arduengo et al., arXiv:2002.09979, approximates this by a product. The
    spread r(t) stays white, so a via-point only corrects the uncertainty of the *mean*:
    it bends the policy nearby and does not inform the rest. Independent of the grid
    (``test_exact_equals_gp_on_demonstrations_and_via_points``).
    """

    @one_thread
    def __init__(self, skill: Skill, grid: Times) -> None:
        """Start from the demonstrations; arguments as of `ProcessAdaptation`."""
        processes, times = skill.processes, skill.aligned.times
        basis = basis_for_grid(times, grid, processes.shortest_length_scale)
        moments = processes.moments(basis.nodes)
        root = basis.root_weights[:, None]
        prior = Repetition.from_covariance(
            basis,
            mean=root * moments.mean,
            covariance=basis.weigh(processes.latent_covariance(basis.nodes)),
            log_white=root * np.log(moments.noise),
        )
        super().__init__(prior, grid)
        self._degrees_of_freedom = skill.degrees_of_freedom

    @one_thread
    def observe(self, via_point: ViaPoint) -> None:
        """Condition on one more via-point, in place, in O(n² + M n)."""
        here, along = self.at(via_point.phase), np.asarray(via_point.along)
        self.update(here, via_point.pose, via_point.own_variance, along)

    @property
    def std(self) -> Outputs:
        """Current standard deviation on the grid, spread r(t) included."""
        return np.asarray(np.sqrt(self.variance()))

    def trajectory(self) -> GaussianTrajectory:
        """The current distribution on the grid, with rates and covariance."""
        return self.distribution(np.ones(6), self._degrees_of_freedom)


def demonstrated_repetition(
    skill: Skill,
    grid: Times,
    empirical_share: float | None = None,
    own_variance: tuple[Pose, Pose] | None = None,
) -> Repetition:
    """The prior of a repetition; arguments as of `ProcessAdaptation`.

    The variance is that of `Skill.predict`: r + r/D, or more outside the
    demonstrations, and more by the two of `own_variance`, a constant's and that of
    what varies over a tenth of the task. The smooth covariance mixes the model's with
    that of the demonstrations' own curves, which the model first frees of white noise.
    """
    if empirical_share is None:
        empirical_share = conjugate_share(skill.count)
    if not 0.0 <= empirical_share <= 1.0:
        raise ValueError(
            f"empirical_share must be within [0, 1], got {empirical_share}."
        )
    processes, times = skill.processes, skill.aligned.times
    shortest = min(
        processes.shortest_length_scale,
        *(deviation.short_scale for deviation in skill.deviations),
    )
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
        constant, smooth = (each[:, None, None] for each in own_variance)
        apart = (nodes[:, None] - nodes) / _OWN_SCALE
        covariance += constant + smooth * np.exp(-0.5 * apart**2)
    root = basis.root_weights[:, None]
    return Repetition.from_covariance(
        basis,
        mean=root * prediction.mean,
        covariance=basis.weigh(covariance),
        log_white=root * np.log(white),
    )


def _mixed(
    shares: Float[np.ndarray, " P"], values: Sequence[np.ndarray] | np.ndarray
) -> np.ndarray:
    # No BLAS product: its order of sums depends on the processor.
    return np.asarray(
        sum(share * each for share, each in zip(shares, values, strict=True))
    )


def _mixed_covariance(
    shares: Float[np.ndarray, " P"],
    apart: Float[np.ndarray, "P M 6"],
    parts: Sequence[GaussianTrajectory],
) -> Covariances:
    covariance = _mixed(shares, [part.covariance for part in parts])
    covariance += np.einsum("p,pmi,pni->imn", shares, apart, apart)
    return covariance
