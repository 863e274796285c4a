"""Adapting a skill to via-points: three forms, one interface.

Paper: Arduengo et al., *Gaussian-Process-based Robot Learning from Demonstration*,
arXiv:2002.09979, Section III-D. "product" is the paper's, Eqs. (19)–(21); "exact"
conditions the same model without the product's approximation; "process" is ours and the
default: it models the demonstrations' deviations as smooth, so that a via-point also
informs the rest of the motion.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from policies.adaptation.exact import ExactAdaptation
from policies.adaptation.process import ProcessAdaptation
from policies.adaptation.product import ProductAdaptation
from policies.skill import Skill
from policies.trajectory import GaussianTrajectory, ViaPoint

__all__ = [
    "ADAPTATIONS",
    "Adaptation",
    "AdaptationForm",
    "AdaptedSkill",
    "ExactAdaptation",
    "ProcessAdaptation",
    "ProductAdaptation",
    "adaptation_form",
]


@runtime_checkable
class Adaptation(Protocol):
    """A distribution over poses on a fixed grid, updated online."""

    def observe(self, via_point: ViaPoint) -> None:
        """Take one more via-point, in place."""
        ...

    @property
    def mean(self) -> np.ndarray:
        """Current mean on the grid, (M, 6), read-only."""
        ...

    @property
    def std(self) -> np.ndarray:
        """Current standard deviation on the grid, (M, 6)."""
        ...

    def trajectory(self) -> GaussianTrajectory:
        """The current distribution; later via-points do not change it."""
        ...


AdaptationForm = Callable[[Skill, np.ndarray], Adaptation]
"""Builds an adaptation of a skill on a grid of phases."""

ADAPTATIONS: dict[str, AdaptationForm] = {
    "process": ProcessAdaptation,
    "product": ProductAdaptation,
    "exact": ExactAdaptation,
}
"""Forms by name."""


def adaptation_form(form: str | AdaptationForm) -> AdaptationForm:
    """Look a form up by name; callables pass through.

    Raises:
        ValueError: for an unknown name.
    """
    if not isinstance(form, str):
        return form
    if form not in ADAPTATIONS:
        raise ValueError(
            f"Unknown adaptation form {form!r}; choose from {sorted(ADAPTATIONS)}."
        )
    return ADAPTATIONS[form]


@dataclass(frozen=True, kw_only=True, slots=True)
class AdaptedSkill:
    """A skill conditioned on via-points; predicts like a `Skill`."""

    skill: Skill
    """The demonstrated skill."""
    via_points: Sequence[ViaPoint]
    """What it was conditioned on."""
    form: AdaptationForm
    """How."""

    def predict(self, times: Float[np.ndarray, " M"]) -> GaussianTrajectory:
        """The conditioned distribution at ``times``.

        For the product these are also the phases it multiplies at, so they matter.

        Raises:
            ValueError: if a via-point or a time is outside what the form can handle.
        """
        adaptation = self.form(self.skill, times)
        for via_point in self.via_points:
            adaptation.observe(via_point)
        return adaptation.trajectory()
