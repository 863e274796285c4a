"""Fig. 4, Section III-D: a strong and a weak via-point."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure
from scipy.special import ndtri

from gplfd_experiments.analysis.figures import style
from gplfd_experiments.analysis.figures.material import Material
from gplfd_experiments.analysis.figures.pick_and_place import (
    HEIGHT,
    PHASES,
    constrained_set,
)
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.adaptation import (
    AdaptationForm,
    ProcessAdaptation,
    ProductAdaptation,
    adapt,
)
from gplfd_policies.movements.movement import GaussianTrajectory, ViaPoint
from gplfd_policies.movements.skill import fit_skill

TITLE: Final = "Strong and weak via-points"
DOORS: Final = ()
DEMONSTRATED, PROCESS, PRODUCT = "demonstrated", "process", "product"
COARSE, PRINTED = "coarse", "printed"
_GRID: Final = PHASES[::2]
_COARSE_GRID: Final = PHASES[::20]
_FORMS: Final[Mapping[str, tuple[AdaptationForm, FloatArray]]] = {
    PROCESS: (ProcessAdaptation, _GRID),
    PRODUCT: (ProductAdaptation, _GRID),
    COARSE: (ProductAdaptation, _COARSE_GRID),
    PRINTED: (partial(ProductAdaptation, prior_mean="zero"), _GRID),
}
_DEMONSTRATIONS: Final = 10
_STRONG: Final = (0.3, 0.04, 0.001)
"""Phase, shift from the demonstrations' mean [m], standard deviation [m]."""
_WEAK: Final = (0.7, -0.04, 0.03)
_HALF_WIDTH: Final = float(ndtri(0.975))
"""Half of a normal 95 % interval, in standard deviations."""
_ERROR_BAR: Final[Mapping[str, Any]] = {
    "color": style.TRUTH,
    "marker": "o",
    "markersize": 3.0,
    "elinewidth": 0.9,
    "capsize": 2.0,
    "zorder": 5,
}
_FAR: Final = 0.95
"""Beyond this phase, a via-point at phase 0.7 should change nothing: the end is
fixed."""


@dataclass(frozen=True, kw_only=True, slots=True)
class ViaPoints:
    """Data of Fig. 4, for the height of the hand."""

    demonstrations: FloatArray
    """Heights at `PHASES` [m], (D, M)."""
    via_points: tuple[ViaPoint, ViaPoint]
    policies: Mapping[str, GaussianTrajectory]
    """The policy as demonstrated and under each form of adaptation."""

    def miss(self, policy: str, via_point: ViaPoint) -> float:
        """Distance of a policy's mean from a via-point [m]."""
        mean = self.policies[policy].mean[:, HEIGHT]
        reached = np.interp(via_point.phase, self.policies[policy].times, mean)
        return abs(float(reached) - float(via_point.pose[HEIGHT]))

    def far_change(self, policy: str) -> float:
        """Largest change of the mean in phases without via-points [m]."""
        change = self.policies[policy].mean - self.policies[DEMONSTRATED].mean
        return float(np.abs(change[_GRID >= _FAR, HEIGHT]).max())

    def std(self, policy: str, phase: float) -> float:
        """Standard deviation of a policy at a phase of its grid [m]."""
        trajectory = self.policies[policy]
        return float(np.interp(phase, trajectory.times, trajectory.std[:, HEIGHT]))


def measure(material: Material) -> ViaPoints:
    """Adapt one skill to the two via-points in each form."""
    rng = np.random.default_rng(material.seed)
    demonstrations = constrained_set(_DEMONSTRATIONS, rng)
    skill = fit_skill(demonstrations)

    def via_point(phase: float, shift: float, std: float) -> ViaPoint:
        """A via-point for the height alone."""
        pose = np.full(6, np.nan)
        mean = skill.predict(np.array([phase])).mean[0]
        pose[HEIGHT] = mean[HEIGHT] + shift
        return ViaPoint(phase=phase, pose=pose, std=std)

    via_points = (via_point(*_STRONG), via_point(*_WEAK))
    adapted = {
        name: adapt(skill, via_points, form).predict(grid)
        for name, (form, grid) in _FORMS.items()
    }
    return ViaPoints(
        demonstrations=demonstrations.poses[:, :, HEIGHT],
        via_points=via_points,
        policies={DEMONSTRATED: skill.predict(_GRID), **adapted},
    )


def draw(shown: ViaPoints) -> Figure:
    """Draw the demonstrated policy and the adapted ones."""
    figure = style.new_figure(style.PAGE, 2.1)
    panels = figure.subplots(1, 4, sharex=True, sharey=True)
    titles = {
        DEMONSTRATED: "demonstrated",
        PROCESS: "process",
        PRODUCT: f"product, {_GRID.size} phases",
        COARSE: f"product, {_COARSE_GRID.size} phases",
    }
    for panel, name in zip(panels, titles, strict=True):
        policy = shown.policies[name]
        if name == DEMONSTRATED:
            curves = shown.demonstrations.T
            panel.plot(PHASES, curves, color=style.DEMONSTRATION, linewidth=0.5)
            style.mean_and_interval(panel, policy, HEIGHT, style.BEFORE)
        else:
            mean = shown.policies[DEMONSTRATED].mean[:, HEIGHT]
            panel.plot(_GRID, mean, color=style.BEFORE, linestyle="--")
            dot = "." if name == COARSE else None
            style.mean_and_interval(
                panel, policy, HEIGHT, style.ADAPTED, marker=dot, markersize=4.0
            )
            for via_point in shown.via_points:
                half = _HALF_WIDTH * float(np.asarray(via_point.std)[HEIGHT])
                pose = via_point.pose[HEIGHT]
                panel.errorbar(via_point.phase, pose, half, **_ERROR_BAR)
        panel.set_xlabel("phase")
    style.name_panels(panels, titles.values())
    panels[0].set(xlim=(0.0, 1.0), ylabel="height [m]")
    return figure


def caption(shown: ViaPoints) -> str:
    """Describe the figure and state its numbers."""
    names = {PROCESS: "(b)", PRODUCT: "(c)", COARSE: "(d)", PRINTED: "prior mean zero"}
    spreads = ", ".join(
        f"{1e3 * shown.std(name, 0.5):.0f} mm {panel}"
        for name, panel in names.items()
        if name != PRINTED
    )
    misses = ", ".join(
        f"{1e3 * shown.miss(name, shown.via_points[0]):.1f} mm and "
        f"{1e3 * shown.miss(name, shown.via_points[1]):.0f} mm {panel}"
        for name, panel in names.items()
        if name != COARSE
    )
    changes = ", ".join(
        f"{1e3 * shown.far_change(name):.1f} mm {panel}"
        for name, panel in names.items()
        if name != COARSE
    )
    return (
        "Height of the hand in the pick-and-place task of Fig. 2, learned from "
        f"{len(shown.demonstrations)} demonstrations (a) and adapted to a strong "
        f"via-point ({1e3 * _STRONG[2]:.0f} mm) at phase {_STRONG[0]} and a weak one "
        f"({1e3 * _WEAK[2]:.0f} mm) at phase {_WEAK[0]}, {1e3 * abs(_STRONG[1]):.0f} "
        "mm off the mean (green, with 95 %). Dashed: the mean before. (b) Conditioning "
        "of the demonstrated process, the default; (c) the paper's product of "
        "Gaussians, Eqs. (20)–(21), with the demonstrations' mean as prior mean; (d) "
        f"the same at {_COARSE_GRID.size} phases, each of which counts as one more "
        "observation. σ at phase 0.5, without a via-point: "
        f"{1e3 * shown.std(DEMONSTRATED, 0.5):.0f} mm before, {spreads}. Distance from "
        f"the strong and from the weak via-point: {misses}. Largest change of the mean "
        "in the last twentieth, where the end is fixed (σ = "
        f"{1e3 * shown.std(DEMONSTRATED, 1.0):.1f} mm): {changes}."
    )
