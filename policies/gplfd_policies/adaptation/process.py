"""Exact Gaussian conditioning on via-points, in two forms.

`ProcessAdaptation` is ours: a repetition of the task deviates smoothly from the mean,
like the demonstrations (`gplfd_policies.gp.deviations`), so that the observed radius of
a door informs the rest of the motion. `ExactAdaptation` conditions the paper's model,
whose deviations are white.
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
from gplfd_policies.arrays.resolution import thinned
from gplfd_policies.arrays.shapes import Covariances, Float, Outputs, Pose, Times
from gplfd_policies.gp.deviations import conjugate_share
from gplfd_policies.gp.exact import factorise
from gplfd_policies.movements.skill import Skill
from gplfd_policies.movements.trajectory import GaussianTrajectory, ViaPoint

_SMOOTHING_GRID = 60
"""Samples of a demonstration from which its smooth curve is computed."""
_OWN_SHARE = 0.5
"""Size of a door's own force relative to the demonstrated forces."""
_OWN_PRIOR = (0.98, 0.01, 0.01)
"""Probability that a door has no force of its own, a constant one, or a varying one.
Chosen by experiments: with 50 %, intervals are too wide at doors like the demonstrated
ones."""
_OWN_SCALE = 0.1
"""Length scale of the varying part of a door's own force, in phase."""


class StudentProcess(ConditionedProcess):
    """A conditioned process whose scale is estimated from few demonstrations.

    With ν degrees of freedom, n observations and their squared Mahalanobis distance δ²,
    the scale of a Student-t process grows to (ν + δ²)/(ν + n) per output. The distance
    of each observation is computed given the other outputs, so that an error along the
    path does not count. The scale is at least one: via-points that match with a large
    σ_v must not make the robot over-confident or stiff. Intervals keep ν degrees of
    freedom, because the via-points of one repetition all observe the same deviation.
    """

    def __init__(self, prior: Repetition, free: float, grid: Times) -> None:
        super().__init__(prior, grid)
        self._free = free
        self._observed, self._distance = np.zeros(6), np.zeros(6)
        self._sequential, self._log_variance = 0.0, 0.0

    def observe(self, via_point: ViaPoint) -> None:
        """Condition on one more via-point, in place, in O(n² + M n)."""
        here, along = self.at(via_point.phase), np.asarray(via_point.along)
        innovation = self.update(
            here, via_point.pose, via_point.own_variance + here.white, along
        )
        self._observed += innovation.observed
        self._distance += innovation.given_others
        self._sequential += innovation.joint
        self._log_variance += innovation.log_variance

    @property
    def log_evidence(self) -> float:
        """Log Student-t density of all via-points, up to a constant for their number.

        With one scale for all outputs it does not depend on the order of the
        via-points.
        """
        power = 0.5 * (self._free + float(np.sum(self._observed)))
        distance = np.log1p(self._sequential / self._free)
        return -0.5 * self._log_variance - power * float(distance)

    @property
    def std(self) -> Outputs:
        """Current standard deviation on the grid."""
        return np.asarray(np.sqrt(self.stretched_variance()))

    def stretched_variance(self) -> Outputs:
        """Square of the current standard deviation."""
        return np.asarray(self._scale() * self.variance())

    def trajectory(self) -> GaussianTrajectory:
        """The current distribution on the grid, with rates and covariance."""
        return self.distribution(np.sqrt(self._scale()), self._free)

    def _scale(self) -> Pose:
        """Factor on the variances, from the innovations of the via-points."""
        scale = (self._free + self._distance) / (self._free + self._observed)
        return np.asarray(np.maximum(scale, 1.0))


class MixedProcesses:
    """Mixture of conditioned processes, weighted by the evidence of the via-points."""

    def __init__(self, parts: Sequence[StudentProcess], prior: Sequence[float]) -> None:
        """Mix processes with given prior probabilities."""
        self._parts, self._log_prior = tuple(parts), np.log(prior)

    def observe(self, via_point: ViaPoint) -> None:
        """Condition on one more via-point, in place."""
        for part in self._parts:
            part.observe(via_point)

    @property
    def shares(self) -> Float[np.ndarray, " P"]:
        """Probability of each process."""
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
    """Exact Gaussian conditioning of the demonstrated process at registered phases.

    * Before any via-point it equals `Skill.predict`.
    * A via-point observes the path with its own noise σ_v, an error along the path that
      all outputs share (`ViaPoint.along`), and the white part of the demonstrations'
      spread, which for smooth demonstrations is negligible.
    * The size of the spread is uncertain, see `StudentProcess`.
    * Mean and covariance do not depend on the grid; the mean does not depend on the
      order of the via-points. If they share an error along the path, the scale of the
      covariance depends on their order; `gplfd_policies.adapt` sorts them by phase.

    Phases must be estimated from the path, as in the alignment.
    """

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
    """Conditioning of the force at a door that may differ from all demonstrated doors.

    In addition to the demonstrations' spread, a door's force deviates in one of three
    ways: not at all; by a constant b on the whole way, like the weight of a leaf or the
    pull of a closer; or by b + f(s), where f varies over a tenth of the way, like
    springs of handle and seal. The first is the most probable before any force is
    measured. The standard deviation of the others is half the root mean square of the
    demonstrated forces, or moments, along each axis.
    """

    def __init__(self, skill: Skill, grid: Times) -> None:
        """Start from at least two demonstrations, with wrenches instead of poses."""
        square = np.mean(skill.aligned.poses.reshape(-1, 2, 3) ** 2, axis=0)
        variance = np.repeat(_OWN_SHARE**2 * square.sum(axis=-1), 3)
        priors = (
            demonstrated_repetition(skill, grid, own_variance=variances)
            for variances in (None, (variance, 0.0 * variance), (0.5 * variance,) * 2)
        )
        free = float(skill.count - 1)
        parts = [StudentProcess(prior, free, grid) for prior in priors]
        super().__init__(parts, _OWN_PRIOR)


class ExactAdaptation(ConditionedProcess):
    """p(f | D ∪ V): via-points as data, like demonstrations, Eqs. (10)–(11).

    Eq. (19) of Arduengo et al., arXiv:2002.09979, approximates this by a product. The
    spread r(t) stays white, so a via-point only corrects the uncertainty of the *mean*:
    it bends the policy nearby and does not inform the rest. The result does not depend
    on the grid (``test_exact_equals_gp_on_demonstrations_and_via_points``).
    """

    def __init__(self, skill: Skill, grid: Times) -> None:
        """Start from the demonstrations; arguments as for `ProcessAdaptation`."""
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
    """Return the prior of a repetition; arguments as for `ProcessAdaptation`.

    The variance is that of `Skill.predict`, r + r/D or more outside the demonstrations,
    plus the two variances in `own_variance`: of a constant, and of a part that varies
    over a tenth of the task. The smooth covariance is a mixture of the model's
    covariance and that of the demonstrations' own curves, smoothed by the model.
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
        constant, smooth = (part[:, None, None] for part in own_variance)
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
    # No BLAS product: its order of summation depends on the processor.
    return np.asarray(
        sum(share * value for share, value in zip(shares, values, strict=True))
    )


def _mixed_covariance(
    shares: Float[np.ndarray, " P"],
    apart: Float[np.ndarray, "P M 6"],
    parts: Sequence[GaussianTrajectory],
) -> Covariances:
    covariance = _mixed(shares, [part.covariance for part in parts])
    covariance += np.einsum("p,pmi,pni->imn", shares, apart, apart)
    return covariance
