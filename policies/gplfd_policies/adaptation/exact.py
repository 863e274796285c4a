"""Conditioning the Gaussian process on demonstrations and via-points together."""

import numpy as np
from jaxtyping import Float

from gplfd_policies.adaptation.conditioning import (
    ConditionedProcess,
    Repetition,
    basis_for_grid,
)
from gplfd_policies.arrays.one_thread import one_thread
from gplfd_policies.movements.skill import Skill
from gplfd_policies.movements.trajectory import GaussianTrajectory, ViaPoint


class ExactAdaptation(ConditionedProcess):
    """p(f | D ∪ V): the via-points join the demonstrations as data, Eqs. (10)–(11).

    This is what Eq. (19) of Arduengo et al., arXiv:2002.09979, approximates by a
    product. The spread r(t) stays white, so a via-point only corrects what is unknown
    about the *mean*: it bends the policy nearby and says nothing about the rest, and
    the uncertainty there does not fall. Independent of the grid
    (``test_exact_equals_gp_on_demonstrations_and_via_points``).
    """

    @one_thread
    def __init__(self, skill: Skill, grid: Float[np.ndarray, " M"]) -> None:
        """Start from the demonstrations.

        Args:
            skill: the demonstrated skill.
            grid: phases at which the distribution is reported, shape (M,).

        Raises:
            ValueError: if the grid is empty, not finite, or far outside the
                demonstrations.
        """
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
    def std(self) -> Float[np.ndarray, "M 6"]:
        """Current standard deviation on the grid, spread r(t) included."""
        return np.asarray(np.sqrt(self.variance()))

    def trajectory(self) -> GaussianTrajectory:
        """The current distribution on the grid, with rates and covariance."""
        return self.distribution(np.ones(6), self._degrees_of_freedom)
