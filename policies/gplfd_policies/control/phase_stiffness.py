"""Stiffness at each phase of the task, from demonstrated forces.

`demonstrated_stiffness` makes a hand soft where the demonstrators yielded, and stiff
where they resisted. `stiffness_from_force` is the rule of Hou et al., *Adaptive
Compliance Policy*, 2024, arXiv:2410.09309.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from gplfd_env.spatial.se3 import into_axes
from gplfd_policies.adaptation.gridded import LOOK_AHEAD
from gplfd_policies.arrays.records import freeze, short_repr
from gplfd_policies.arrays.rows import PerRow
from gplfd_policies.arrays.shapes import Axes, Float, Outputs, Vectors
from gplfd_policies.control.frame import path_frame
from gplfd_policies.control.stiffness import StiffnessProfile
from gplfd_policies.demonstrations.impedance import PRIOR, estimate_impedance
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
        found = self.direction[self._index(phase)]
        return np.where(np.isnan(found), tangent, found)

    def combined(self, stiffness: Axes, phase: PerRow) -> Axes:
        """Return k^(1 - w) k_d^w: means of logarithms with the weights 1 - w and w."""
        index = self._index(phase)
        # Not `**`: for arrays its last bit depends on the processor.
        gain = np.float_power(self.stiffness[index] / stiffness, self.share[index])
        return np.asarray(stiffness * gain)

    def _index(self, phase: PerRow) -> np.ndarray:
        return np.asarray(np.rint(phase * (len(self.share) - 1)), dtype=np.intp)


def demonstrated_stiffness(
    movement: Movement, profile: StiffnessProfile
) -> PhaseStiffness:
    """Return the stiffness of the demonstrating hands, weighted by its certainty.

    Along each direction of the path's frame, w = 1 - (σ/σ_0)², with the posterior and
    prior standard deviations of the stiffness: the share of the data in the precision.
    k_d is limited to the profile's range.

    Raises:
        ValueError: Fewer than three demonstrations have wrenches.
    """
    aligned = movement.aligned
    impedance = estimate_impedance(aligned)
    count = impedance.times.size
    poses = movement.predict(impedance.times * aligned.end).mean
    length = max(round(LOOK_AHEAD * count), 1)
    start = np.minimum(np.arange(count), count - 1 - length)
    chord = poses[start + length, :3] - poses[start, :3]
    size = np.linalg.norm(chord, axis=1, keepdims=True)
    tangent = np.where(size > 0.0, chord / np.maximum(size, 1e-12), [1.0, 0.0, 0.0])
    # Beyond the demonstrations, the last stiffness is kept.
    phases = np.minimum(_PHASES / aligned.end, 1.0)
    samples = np.rint(phases * (count - 1)).astype(np.intp)
    known = []
    for part, frames in enumerate((path_frame(tangent), np.eye(3))):
        rows = np.broadcast_to(np.swapaxes(frames, -1, -2), (count, 3, 3))
        own = into_axes(poses[:, None, 3:], rows).swapaxes(-1, -2)
        found, std = (each[part, samples] for each in impedance.along(own))
        known.append((found, 1.0 - (std / PRIOR[part, 0]) ** 2))
    stiffness, share = (np.hstack(both) for both in zip(*known, strict=True))
    return PhaseStiffness(
        stiffness=np.clip(
            stiffness,
            profile.k_min,
            np.repeat(profile.k_max.reshape(2, 3).min(axis=1), 3),
        ),
        share=np.clip(share, 0.0, 1.0),
        direction=np.full((_PHASES.size, 3), np.nan),
    )


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
