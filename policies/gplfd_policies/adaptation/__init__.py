"""Adapting movements to via-points; for a skill, four forms with one interface.

Paper: Arduengo et al., *Gaussian-Process-based Robot Learning from Demonstration*,
arXiv:2002.09979, Section III-D. "product" is the form of the paper, Eqs. (19)–(21).
"exact" conditions the same model without the product's approximation. "process" is
ours: it models the demonstrations' deviations as smooth, so that a via-point also
informs the rest of the motion. "similarity", for agents at doors, models that paths in
the x-z plane differ in size. Other movements are conditioned by their own ``adapt``.
"""

import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np

from gplfd_policies.adaptation.process import ExactAdaptation, ProcessAdaptation
from gplfd_policies.adaptation.product import ProductAdaptation
from gplfd_policies.adaptation.similarity import SimilarityAdaptation
from gplfd_policies.arrays.shapes import Outputs, Times
from gplfd_policies.movements.movement import (
    Adaptable,
    Adaptation,
    AdaptationForm,
    GaussianTrajectory,
    Movement,
    Predictor,
    ViaPoint,
    as_movement,
    checked_times,
)
from gplfd_policies.movements.prior_mean import ResidualAdaptation, ResidualMovement
from gplfd_policies.movements.skill import Skill

ADAPTATIONS: Final[Mapping[str, AdaptationForm]] = MappingProxyType(
    {
        "process": ProcessAdaptation,
        "product": ProductAdaptation,
        "exact": ExactAdaptation,
        "similarity": SimilarityAdaptation,
    }
)
"""Forms of a skill's adaptation by name."""
_APART: Final = 1e-3  # least distance of other phases from a single predicted phase


@dataclass(frozen=True, kw_only=True, slots=True)
class AdaptedMovement:
    """A movement conditioned on via-points; made by `adapt`."""

    movement: Movement
    via_points: tuple[ViaPoint, ...]
    form: AdaptationForm

    def predict(self, times: Times) -> GaussianTrajectory:
        """Return the conditioned distribution; "product" depends on the times."""
        times = grid = checked_times(times)
        others = self.movement.aligned.times
        partial = times.size == 1 or times[0] > others[0]
        if partial and self.form is SimilarityAdaptation:
            # This form needs the path from its start; close phases spoil the rates.
            apart = np.abs(others[:, None] - times).min(axis=1) > _APART
            grid = np.sort(np.append(others[apart], times))
        adaptation = begin_adaptation(self.movement, self.form, grid)
        for via_point in self.via_points:
            adaptation.observe(via_point)
        trajectory = adaptation.trajectory()
        return trajectory if grid is times else trajectory[np.isin(grid, times)]


def adapt(
    movement: Movement,
    via_points: Sequence[ViaPoint],
    form: str | AdaptationForm | None = None,
) -> AdaptedMovement:
    """Condition a movement on via-points.

    Args:
        movement: The learned movement.
        via_points: Poses to be reached, in any order; possibly none.
        form: For a skill, a name of `ADAPTATIONS` ("process" by default, "similarity"
            for a single demonstration), or a callable (movement, grid) → `Adaptation`.
            Other movements have only their own form, which is the default.

    Raises:
        TypeError: if the via-points are not a sequence of via-points.
        ValueError: if the movement cannot adapt, or not in this form.
    """
    several = tuple(via_points) if isinstance(via_points, Iterable) else (None,)
    if not all(isinstance(point, ViaPoint) for point in several):
        raise TypeError(
            "via_points must be a sequence of gplfd_policies.ViaPoint, got "
            f"{textwrap.shorten(repr(via_points), 80, placeholder=' ...')}; put a "
            "single one into a list: [via_point]"
        )
    if form is None or isinstance(form, str):
        learned = getattr(movement, "residual", movement)
        kind, own = type(learned).__name__, own_adaptation(movement)
        if isinstance(learned, Skill):
            name = form or ("process" if learned.count > 1 else "similarity")
            if name not in ADAPTATIONS:
                raise ValueError(
                    f"Unknown adaptation form {form!r}; choose from "
                    f"{sorted(ADAPTATIONS)}."
                )
            form = ADAPTATIONS[name]
        elif own and form is None:
            form = own
        else:
            raise ValueError(
                f"{kind} has its own form of adaptation: leave form={form!r} out"
                if own
                else f"{kind} has no via-points: it is no Skill, and has no adapt()"
            )
    # The scale of σ depends on the innovation of each via-point given the earlier ones.
    ordered = sorted(several, key=lambda point: (point.phase, tuple(point.pose)))
    chosen = form if ordered else NoAdaptation
    return AdaptedMovement(movement=movement, via_points=tuple(ordered), form=chosen)


def begin_adaptation(
    movement: Movement, form: AdaptationForm | None, grid: Times
) -> Adaptation:
    """Start a form of adaptation, around the prior mean if any; None for no form."""
    if form is None:
        return NoAdaptation(movement, grid)
    # The size of a path is defined by the whole motion, including its prior mean.
    if isinstance(movement, ResidualMovement) and form is not SimilarityAdaptation:
        return ResidualAdaptation(form, movement, grid)
    return form(movement, grid)


class NoAdaptation:
    """The learned movement on a grid of phases, without any effect of via-points."""

    def __init__(self, movement: Predictor, grid: Times) -> None:
        self._predict(movement, grid)

    def _predict(self, movement: Predictor, grid: Times) -> None:
        self._trajectory = movement.predict(grid)
        self.mean: Outputs = self._trajectory.mean
        self.std: Outputs = self._trajectory.std
        """Current mean and standard deviation on the grid [m, rad]."""

    def observe(self, via_point: ViaPoint) -> None:
        """Ignore a via-point."""

    def trajectory(self) -> GaussianTrajectory:
        """The current distribution on the grid."""
        return self._trajectory


def own_adaptation(movement: Movement) -> AdaptationForm | None:
    """Return the form that calls the ``adapt`` of a movement; None without it."""
    learned = getattr(movement, "residual", movement)
    return OwnAdaptation if isinstance(learned, Adaptable) else None


class OwnAdaptation(NoAdaptation):
    """Adapts a movement by its own ``adapt``, once for every via-point."""

    def __init__(self, movement: Adaptable, grid: Times) -> None:
        super().__init__(movement, grid)
        self._movement, self._grid = movement, grid

    def observe(self, via_point: ViaPoint) -> None:
        """Condition on one more via-point."""
        adapted = self._movement.adapt((via_point,))
        movement = as_movement(adapted, self._movement.aligned)
        if not isinstance(movement, Adaptable):
            raise ValueError(f"adapt() returned {adapted!r:.80}, which cannot adapt")
        self._movement = movement
        self._predict(movement, self._grid)
