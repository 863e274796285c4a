"""Forms of adaptation by name, those of any movement, and how one is chosen."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np
from jaxtyping import Float

from gplfd_policies.adaptation.exact import ExactAdaptation
from gplfd_policies.adaptation.own_clock import OwnClockAdaptation
from gplfd_policies.adaptation.process import ProcessAdaptation
from gplfd_policies.adaptation.product import ProductAdaptation
from gplfd_policies.arrays.one_thread import one_thread
from gplfd_policies.movements.movement import (
    Adaptable,
    Adaptation,
    AdaptationForm,
    Movement,
    Predictor,
)
from gplfd_policies.movements.residual import ResidualAdaptation, ResidualMovement
from gplfd_policies.movements.skill import Skill
from gplfd_policies.movements.trajectory import GaussianTrajectory, ViaPoint

ADAPTATIONS: Final[Mapping[str, AdaptationForm]] = MappingProxyType(
    {
        "own-clock": OwnClockAdaptation,
        "process": ProcessAdaptation,
        "product": ProductAdaptation,
        "exact": ExactAdaptation,
    }
)
"""Forms of a skill's adaptation by name."""


@dataclass(frozen=True, kw_only=True, slots=True)
class AdaptedMovement:
    """A movement conditioned on via-points; made by `adapt`."""

    movement: Movement
    """What was learned."""
    via_points: tuple[ViaPoint, ...]
    """What it was conditioned on."""
    form: AdaptationForm
    """In which form."""

    @one_thread
    def predict(self, times: Float[np.ndarray, " M"]) -> GaussianTrajectory:
        """The conditioned distribution at ``times``.

        For the product these are also the phases it multiplies at, so they matter.

        Raises:
            ValueError: if a via-point or a time is outside what the form can handle.
        """
        adaptation = begin_adaptation(self.movement, self.form, times)
        for via_point in self.via_points:
            adaptation.observe(via_point)
        return adaptation.trajectory()


def adapt(
    movement: Movement,
    via_points: Sequence[ViaPoint],
    form: str | AdaptationForm | None = None,
) -> AdaptedMovement:
    """Condition a movement on via-points.

    Args:
        movement: What was learned.
        via_points: Poses to be reached, in any order: they are taken in the order of
            their phases. Without any, the movement is predicted as it was learned.
        form: Of a skill, "own-clock" (its default where the demonstrations' clocks are
            known), for via-points by the clock of a repetition, whose timing is
            unknown, too; "process" (its default elsewhere), for phases that are
            certain; "product" (the paper's Eqs. 19–21) or "exact"; or a callable
            (movement, grid) → `Adaptation`, such as
            ``partial(ProductAdaptation, prior_mean="zero")``. Other movements adapt in
            one form of their own, which is their default.

    Returns:
        Something that predicts like the movement.

    Raises:
        ValueError: if the movement cannot adapt, or not in this form.
    """
    chosen = _form(movement, form) if form is None or isinstance(form, str) else form
    # How surprising a via-point is, and so the scale of σ, depends on those before it.
    ordered = sorted(via_points, key=lambda one: (one.phase, tuple(one.pose)))
    return AdaptedMovement(
        movement=movement,
        via_points=tuple(ordered),
        form=chosen if ordered else NoAdaptation,
    )


@one_thread
def begin_adaptation(
    movement: Movement, form: AdaptationForm | None, grid: Float[np.ndarray, " M"]
) -> Adaptation:
    """Start the adaptation of a movement, around its prior mean if it has one.

    Args:
        movement: What was learned.
        form: Adapts a movement without prior mean; None for one without via-points.
        grid: Phases at which the distribution is reported, shape (M,).
    """
    if form is None:
        return NoAdaptation(movement, grid)
    if isinstance(movement, ResidualMovement):
        return ResidualAdaptation(form, movement, grid)
    return form(movement, grid)


class NoAdaptation:
    """The movement as demonstrated: via-points change nothing.

    Args:
        movement: What was learned.
        grid: Phases (M,).
    """

    def __init__(self, movement: Predictor, grid: Float[np.ndarray, " M"]) -> None:
        self._trajectory = movement.predict(grid)

    @property
    def mean(self) -> Float[np.ndarray, "M 6"]:
        """The demonstrations' mean, (M, 6) [m, rad]."""
        return self._trajectory.mean

    @property
    def std(self) -> Float[np.ndarray, "M 6"]:
        """The demonstrations' standard deviation, (M, 6) [m, rad]."""
        return self._trajectory.std

    def observe(self, via_point: ViaPoint) -> None:
        """Ignore a via-point."""

    def trajectory(self) -> GaussianTrajectory:
        """Return the demonstrated distribution."""
        return self._trajectory


class OwnAdaptation:
    """Adapts a movement by its own ``adapt``, which takes all via-points at once.

    Every new via-point conditions the movement anew on all that were seen. The
    distribution on the grid is computed when it is next asked for.

    Args:
        movement: What was learned.
        grid: Phases at which the distribution is reported, shape (M,).
    """

    def __init__(self, movement: Adaptable, grid: Float[np.ndarray, " M"]) -> None:
        self._movement = movement
        self._grid = grid
        self._via_points: list[ViaPoint] = []
        self._trajectory: GaussianTrajectory | None = None

    def observe(self, via_point: ViaPoint) -> None:
        """Take one more via-point."""
        self._via_points.append(via_point)
        self._trajectory = None

    @property
    def mean(self) -> Float[np.ndarray, "M 6"]:
        """Current mean on the grid [m, rad]."""
        return self.trajectory().mean

    @property
    def std(self) -> Float[np.ndarray, "M 6"]:
        """Current standard deviation on the grid [m, rad]."""
        return self.trajectory().std

    def trajectory(self) -> GaussianTrajectory:
        """The current distribution on the grid."""
        if self._trajectory is None:
            seen = tuple(self._via_points)
            adapted = self._movement.adapt(seen) if seen else self._movement
            self._trajectory = adapted.predict(self._grid)
        return self._trajectory


def _form(movement: Movement, name: str | None) -> AdaptationForm:
    """The form of this name; by default that of the movement."""
    learned = movement.residual if isinstance(movement, ResidualMovement) else movement
    if isinstance(learned, Skill):
        if name is None:
            name = "process" if learned.aligned.clocks is None else "own-clock"
        if name in ADAPTATIONS:
            return ADAPTATIONS[name]
        raise ValueError(
            f"Unknown adaptation form {name!r}; choose from {sorted(ADAPTATIONS)}."
        )
    kind = type(learned).__name__
    if not isinstance(learned, Adaptable):
        raise ValueError(
            f"{kind} has no via-points: it is neither a Skill nor has it a method "
            "adapt(via_points), so what it learned cannot be conditioned"
        )
    if name is not None:
        raise ValueError(
            f"{kind} adapts in a form of its own: leave form={name!r} out, which is "
            "for a Skill"
        )
    return OwnAdaptation
