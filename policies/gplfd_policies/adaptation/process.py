"""Conditioning the demonstrated process, whose deviations are smooth.

This form is ours; the paper's is `gplfd_policies.adaptation.product`. A repetition of
the task deviates from the mean as the demonstrations did
(`gplfd_policies.gp.deviations`): where the door's radius is once known, it is known for
the rest of the motion.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from gplfd_policies.adaptation.conditioning import (
    ConditionedProcess,
    Repetition,
    basis_for_grid,
)
from gplfd_policies.arrays.one_thread import one_thread
from gplfd_policies.demonstrations.aligned import thinned
from gplfd_policies.gp.deviations import DeviationProcess, conjugate_share
from gplfd_policies.gp.factorisation import factorise
from gplfd_policies.movements.skill import Skill
from gplfd_policies.movements.trajectory import GaussianTrajectory, ViaPoint

_SMOOTHING_GRID = 60


class StudentProcess(ConditionedProcess):
    """A conditioned process whose size is itself learned from few demonstrations.

    With ν degrees of freedom, n observations and their squared Mahalanobis distance δ²,
    the scale of a Student-t process grows to (ν + δ²)/(ν + n), by output. Each
    observation counts as far as it is from what the other outputs lead to expect, so
    that an error along the path surprises none of them. The scale is never taken below
    one: matching via-points with a generous σ_v must not make the robot over-confident,
    or stiff. Intervals keep ν degrees of freedom: the via-points of one repetition all
    look at the same wobble, and say little of how far others wander.

    Args:
        prior: what is believed before any via-point.
        free: ν.
        grid: phases at which the distribution is reported, shape (M,).
    """

    def __init__(
        self, prior: Repetition, free: float, grid: Float[np.ndarray, " M"]
    ) -> None:
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
        """Logarithm of the Student-t density of all via-points together.

        Up to a constant that depends on their number only, with one scale for all
        outputs, so that their order does not matter.
        """
        power = 0.5 * (self._free + float(np.sum(self._observed)))
        surprise = np.log1p(self._sequential / self._free)
        return -0.5 * self._log_variance - power * float(surprise)

    @property
    def std(self) -> Float[np.ndarray, "M 6"]:
        """Current standard deviation on the grid."""
        return np.asarray(np.sqrt(self.stretched_variance()))

    def stretched_variance(self) -> Float[np.ndarray, "M 6"]:
        """Its square."""
        return np.asarray(self._scale() * self.variance())

    def trajectory(self) -> GaussianTrajectory:
        """The current distribution on the grid, with rates and covariance."""
        return self.distribution(np.sqrt(self._scale()), self._free)

    def _scale(self) -> Float[np.ndarray, "6"]:
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

    Phases are those of the alignment, as where they are told from the path. For
    via-points by a clock see `gplfd_policies.adaptation.own_clock`.
    """

    @one_thread
    def __init__(
        self,
        skill: Skill,
        grid: Float[np.ndarray, " M"],
        empirical_share: float | None = None,
    ) -> None:
        """Start from the demonstrations.

        Args:
            skill: the demonstrated skill, from at least two demonstrations.
            grid: phases at which the distribution is reported, shape (M,).
            empirical_share: share of the deviations' covariance taken from the
                demonstrations' own curves, within [0, 1]; without, what their number
                says (`gplfd_policies.gp.deviations.conjugate_share`).

        Raises:
            ValueError: for a share outside [0, 1], a single demonstration, or a grid
                that is empty, not finite, or far outside the demonstrations.
        """
        prior = demonstrated_repetition(skill, grid, empirical_share)
        super().__init__(prior, float(skill.count - 1), grid)


class IndependentPhaseAdaptation(ProcessAdaptation):
    """The same, with the error along the path as noise of each output's own.

    An error of the phase then weakens every output as if the six were wrong by chance.
    For comparison: a via-point says less across the path than it could
    (``test_shared_error_leaves_what_is_across_the_path_certain``).
    """

    @one_thread
    def observe(self, via_point: ViaPoint) -> None:
        """Condition on one more via-point, in place."""
        std = np.sqrt(via_point.noise_variance)
        super().observe(replace(via_point, std=std, along=0.0))


def demonstrated_repetition(
    skill: Skill,
    grid: Float[np.ndarray, " M"],
    empirical_share: float | None = None,
) -> Repetition:
    """What the demonstrations say of a repetition; arguments as above."""
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
    mean, covariance, white = _prior(skill, basis.nodes, empirical_share)
    root = basis.root_weights[:, None]
    return Repetition.from_covariance(
        basis,
        mean=root * mean,
        covariance=basis.weigh(covariance),
        log_white=root * np.log(white),
    )


def _prior(
    skill: Skill, nodes: Float[np.ndarray, " Q"], empirical_share: float
) -> tuple[
    Float[np.ndarray, "Q 6"], Float[np.ndarray, "6 Q Q"], Float[np.ndarray, "Q 6"]
]:
    """Mean, smooth covariance and white variance of a repetition, at the nodes.

    Both the repetition and the mean of D demonstrations deviate, so the variance is
    that of `Skill.predict`: r + r/D, or more outside the demonstrations.
    """
    prediction = skill.predict(nodes)
    noise = skill.processes.moments(nodes).noise
    covariance = np.empty((6, len(nodes), len(nodes)))
    white = np.empty((len(nodes), 6))
    for output, deviation in enumerate(skill.deviations):
        total = prediction.std[:, output] ** 2
        share = deviation.white_variance(noise[:, output]) / noise[:, output]
        white[:, output] = total * share
        smooth = _mixed_covariance(skill, output, deviation, nodes, empirical_share)
        stretch = np.sqrt(total * (1.0 - share) / np.diag(smooth))
        covariance[output] = stretch[:, None] * smooth * stretch
    return prediction.mean, covariance, white


def _mixed_covariance(
    skill: Skill,
    output: int,
    deviation: DeviationProcess,
    nodes: Float[np.ndarray, " Q"],
    empirical_share: float,
) -> Float[np.ndarray, "Q Q"]:
    """Model covariance at the nodes, mixed with that of the demonstrations' own curves.

    The curves are first freed of white noise by the model itself.
    """
    times, poses = skill.aligned.times, skill.aligned.poses[:, :, output]
    thin = thinned(len(times), _SMOOTHING_GRID)
    sampled = times[thin]
    together = np.concatenate([nodes, sampled])
    noise = skill.processes.moments(together).noise[:, output]
    joint = deviation.smooth_covariance(together, noise)
    size = len(nodes)
    observed = joint[size:, size:] + np.diag(
        deviation.white_variance(noise[size:]) + 1e-6 * noise[size:]
    )
    curves = (poses - poses.mean(axis=0))[:, thin]
    smoothed = joint[:size, size:] @ factorise(observed).solve(curves.T)
    empirical = smoothed @ smoothed.T / (len(poses) - 1)
    mixed: np.ndarray = (1.0 - empirical_share) * joint[:size, :size]
    mixed += empirical_share * empirical
    return mixed
