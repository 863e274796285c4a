"""Stiffness at each phase of the task, from demonstrated forces.

The rule is that of Hou et al., *Adaptive Compliance Policy*, 2024, arXiv:2410.09309.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from gplfd_env.spatial.se3 import into_axes
from gplfd_policies.arrays.records import freeze, short_repr
from gplfd_policies.arrays.rows import PerRow
from gplfd_policies.arrays.shapes import Axes, Float, Outputs, Vectors
from gplfd_policies.control.stiffness import StiffnessProfile
from gplfd_policies.movements.movement import LearnedMovement, Movement

_PHASES: Final = np.linspace(0.0, 1.0, 101)
_FORCES: Final = (0.5, 5.0)
"""Forces between which `stiffness_from_force` falls [N]."""


@dataclass(frozen=True, kw_only=True, slots=True)
class PhaseStiffness:
    """Stiffness at M equally spaced phases from 0 to 1, and its share; read-only."""

    stiffness: Outputs
    """k_d along the three directions of the frame and about the axes of the task frame
    [N/m, N m/rad]."""
    share: Outputs
    """w, from 0 (only `StiffnessProfile`) to 1 (only k_d)."""
    direction: Float[np.ndarray, "M 3"]
    """Unit vectors that replace the path's tangent in the frame; NaN for none."""

    __repr__ = short_repr

    def __post_init__(self) -> None:
        freeze(self, "stiffness", "share", "direction")

    def direction_at(self, phase: PerRow, tangent: Vectors) -> Vectors:
        """Return the first direction of the frame at a phase, or the tangent."""
        direction = self.direction[np.rint(phase * (len(self.share) - 1)).astype(int)]
        return np.where(np.isnan(direction), tangent, direction)

    def combined(self, stiffness: Axes, phase: PerRow) -> Axes:
        """Return k^(1 - w) k_d^w: means of logarithms with the weights 1 - w and w."""
        index = np.rint(phase * (len(self.share) - 1)).astype(int)
        # Not `**`: for arrays its last bit depends on the processor.
        gain = np.float_power(self.stiffness[index] / stiffness, self.share[index])
        return np.asarray(stiffness * gain)


def stiffness_from_force(
    movement: Movement, profile: StiffnessProfile
) -> PhaseStiffness:
    """Return a stiffness along the learned force that falls with the force.

    It falls linearly from k_max at 0.5 N to k_min at 5 N, as in the published code;
    across the force and in rotation it is k_max.

    Raises:
        ValueError: No demonstration has wrenches.
    """
    learned = movement.forces if isinstance(movement, LearnedMovement) else None
    if learned is None:
        raise ValueError(
            "stiffness from force needs demonstrations with wrenches, got none; record "
            "forces (Demonstration(wrenches=...)), or choose another policy, such as gp"
        )
    poses = movement.predict(_PHASES).mean
    force = into_axes(-poses[:, 3:], learned.predict(_PHASES).mean[:, :3])
    size = np.linalg.norm(force, axis=1)
    highest = np.repeat(profile.k_max.reshape(2, 3).min(axis=1), 3)
    stiffness = np.tile(highest, (_PHASES.size, 1))
    stiffness[:, 0] = np.interp(size, _FORCES, (highest[0], profile.k_min[0]))
    felt = (size > _FORCES[0])[:, None]
    return PhaseStiffness(
        stiffness=stiffness,
        share=np.ones_like(stiffness),
        direction=np.where(felt, force / np.maximum(size, 1e-12)[:, None], np.nan),
    )
