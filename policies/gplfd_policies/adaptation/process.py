"""Exact Gaussian conditioning on via-points, in two forms.

`ProcessAdaptation` is ours: a repetition of the task deviates from the mean as the
demonstrations did (`gplfd_policies.gp.deviations`), so that the door's radius, once
known, is known for the rest of the motion. `ExactAdaptation` conditions the paper's
model, whose deviations are white.
"""

from dataclasses import replace

import numpy as np

from gplfd_policies.adaptation.conditioning import (
    ConditionedProcess,
    Repetition,
    basis_for_grid,
)
from gplfd_policies.arrays.one_thread import one_thread
from gplfd_policies.arrays.resolution import thinned
from gplfd_policies.arrays.shapes import Outputs, Pose, Times
from gplfd_policies.gp.deviations import conjugate_share
from gplfd_policies.gp.exact import factorise
from gplfd_policies.movements.skill import Skill
from gplfd_policies.movements.trajectory import GaussianTrajectory, ViaPoint

_SMOOTHING_GRID = 60
"""Samples of a demonstration from which its smooth curve is computed."""
_OWN_SHARE = 0.5
"""Size of a door's own force relative to the demonstrated ones."""
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
        variance = self._own_variance(skill)
        prior = demonstrated_repetition(skill, grid, empirical_share, variance)
        super().__init__(prior, float(skill.count - 1), grid)

    def _own_variance(self, skill: Skill) -> Pose:
        """Variance, by output, of what a repetition has beside the demonstrations'."""
        return np.zeros(6)


class ForceAdaptation(ProcessAdaptation):
    """The same for the force at a door that may be unlike all that were demonstrated.

    A door's force deviates beyond the demonstrations' spread by b + f(s): b, which is
    one number on the whole way, as the weight of a leaf or the pull of a closer, and f,
    which varies over a tenth of it, as the springs of handle and seal. Each has half of
    the variance, and both together have half the root mean square of the demonstrated
    forces, and moments, as standard deviation along every axis.
    """

    def _own_variance(self, skill: Skill) -> Pose:
        square = np.mean(skill.aligned.poses.reshape(-1, 2, 3) ** 2, axis=0)
        return np.repeat(_OWN_SHARE**2 * square.sum(axis=-1), 3)


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
    own_variance: Pose | None = None,
) -> Repetition:
    """The prior of a repetition; arguments as of `ProcessAdaptation`.

    The variance is that of `Skill.predict`: r + r/D, or more outside the
    demonstrations, and `own_variance` more, half of it constant. The smooth covariance
    mixes the model's with that of the
    demonstrations' own curves, which the model first frees of white noise.
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
        apart = (nodes[:, None] - nodes) / _OWN_SCALE
        shape = 0.5 + 0.5 * np.exp(-0.5 * apart**2)
        covariance += own_variance[:, None, None] * shape
    root = basis.root_weights[:, None]
    return Repetition.from_covariance(
        basis,
        mean=root * prediction.mean,
        covariance=basis.weigh(covariance),
        log_white=root * np.log(white),
    )
