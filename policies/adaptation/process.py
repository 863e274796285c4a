"""Conditioning the demonstrated process, whose deviations are smooth.

This form is ours; the paper's is `policies.adaptation.product`. A repetition of the
task deviates from the mean as the demonstrations did (`policies.gp.deviations`): where
the door's radius is once known, it is known for the rest of the motion.
"""

import numpy as np
from jaxtyping import Float

from policies.adaptation.conditioning import ConditionedProcess, basis_for_grid
from policies.aligned import thinned
from policies.gp.deviations import DeviationProcess
from policies.gp.factorisation import factorise
from policies.skill import Skill
from policies.trajectory import GaussianTrajectory, ViaPoint

EMPIRICAL_SHARE = 0.3
"""Share of the deviation covariance taken from the demonstrations' own curves: it knows
the shape of what varies, the model knows what else could."""
_SMOOTHING_GRID = 60


class ProcessAdaptation(ConditionedProcess):
    """Exact Gaussian conditioning of the demonstrated process; the default.

    * Before any via-point it is `Skill.predict`.
    * A via-point observes the path with its own noise σ_v and the white part of the
      demonstrations' spread, which for smooth demonstrations is negligible.
    * The spread was estimated from D demonstrations, so its size is itself uncertain.
      Via-points correct it: with ν = D − 1, n observations and their squared
      Mahalanobis distance δ², the scale of a Student-t process grows to
      (ν + δ²)/(ν + n). It is never taken below one: matching via-points with a
      generous σ_v must not make the robot over-confident, or stiff.
    * Mean and covariance do not depend on the order of the via-points or on the grid.
    """

    def __init__(
        self,
        skill: Skill,
        grid: Float[np.ndarray, " M"],
        empirical_share: float = EMPIRICAL_SHARE,
    ) -> None:
        """Start from the demonstrations.

        Args:
            skill: the demonstrated skill, from at least two demonstrations.
            grid: phases at which the distribution is reported, shape (M,).
            empirical_share: share of the deviations' covariance taken from the
                demonstrations' own curves, within [0, 1].

        Raises:
            ValueError: for a share outside [0, 1], a single demonstration, or a grid
                that is empty, not finite, or far outside the demonstrations.
        """
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
        super().__init__(
            basis,
            mean=root * mean,
            covariance=basis.weigh(covariance),
            log_white=root * np.log(white),
            grid=grid,
        )
        self._free = float(skill.count - 1)
        self._distance = np.zeros(6)
        self._observed = np.zeros(6)

    def observe(self, via_point: ViaPoint) -> None:
        """Condition on one more via-point, in place, in O(q² + M q)."""
        white = self.white_at(via_point.phase)
        distance, observed = self.update(
            via_point.phase, via_point.pose, via_point.noise_variance + white
        )
        self._distance += distance
        self._observed += observed

    def _stretch(self) -> Float[np.ndarray, "6"]:
        """Factor on the standard deviations from how surprising the via-points were."""
        scale = (self._free + self._distance) / (self._free + self._observed)
        return np.sqrt(np.maximum(scale, 1.0))

    @property
    def std(self) -> Float[np.ndarray, "M 6"]:
        """Current standard deviation on the grid."""
        return np.asarray(self._stretch() * np.sqrt(self.variance()))

    def trajectory(self) -> GaussianTrajectory:
        """The current distribution on the grid, with rates and covariance."""
        free = self._free + float(np.min(self._observed))
        return self.distribution(self._stretch(), free)


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
