"""Not in the paper: forecasts of an opening by three forms of adaptation."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from gplfd_experiments.analysis.figures import style
from gplfd_experiments.analysis.figures.fig07_region import PLANE, arc, shade_region
from gplfd_experiments.analysis.figures.fig09_adaptation import decisions, expectation
from gplfd_experiments.analysis.figures.material import Material
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies import Demonstration
from gplfd_policies.adaptation import ADAPTATIONS
from gplfd_policies.agents.agent import Agent, as_agent
from gplfd_policies.arrays.resolution import interpolated
from gplfd_policies.movements.movement import GaussianTrajectory
from gplfd_policies.registry.built_in import GP
from gplfd_policies.registry.method import TrainingInput

TITLE: Final = "Forecasts of the rest of the opening"
FORMS: Final = ("product", "exact", "process")
"""Forms of adaptation of `gp` that are compared."""
SHARES: Final = (0.05, 0.15, 0.30)
"""Observed share of the opening angle."""
DOORS: Final = ("small", "medium", "large", "0.42")
SHOWN: Final = "large"


@dataclass(frozen=True, kw_only=True, slots=True)
class Forecast:
    """Forecast of the rest of an opening by one form, and the true poses."""

    rest: GaussianTrajectory
    """Forecast at the remaining phases, (M',)."""
    truth: FloatArray
    """True poses of the handle at these phases, (M', 6); to the end of the episode."""

    def rms_error(self) -> float:
        """Rms distance of the mean from the truth in the plane [m]."""
        error = (self.rest.mean[: len(self.truth)] - self.truth)[:, PLANE]
        return float(np.sqrt((error**2).sum(axis=1).mean()))

    def coverage(self) -> float:
        """Share of the true x and z inside their 95 % intervals."""
        known = self.rest[: len(self.truth)]
        return float(known.inside(self.truth)[:, PLANE].mean())


@dataclass(frozen=True, kw_only=True, slots=True)
class Forecasts:
    """All forecasts in one opening, one per observed phase and policy."""

    log: EpisodeLog
    phases: tuple[float, ...]
    by_form: Mapping[str, tuple[Forecast, ...]]


def measure(material: Material) -> dict[str, Forecasts]:
    """Let every form forecast every opening."""
    agents = agents_of_forms(material.demonstrations.demonstrations)
    return {door: foretold(material.episodes[door], agents) for door in DOORS}


def agents_of_forms(demonstrations: Sequence[Demonstration]) -> dict[str, Agent]:
    """Return agents of `gp` that differ in the form of adaptation, by form."""
    training = TrainingInput(demonstrations=demonstrations)
    agents = {}
    for form in FORMS:
        method = GP
        if form != "process":
            method = replace(GP, adaptation=ADAPTATIONS[form], door_adaptation=None)
        agents[form] = as_agent(method(training))
    return agents


def foretold(log: EpisodeLog, agents: Mapping[str, Agent]) -> Forecasts:
    """Replay an opening to each form and store the forecast at each share of it."""
    wanted = [share * float(log.opening.door_angle.max()) for share in SHARES]
    rows = [int(np.argmax(log.opening.door_angle >= angle)) for angle in wanted]
    reached, first = np.unique(
        np.maximum.accumulate(log.decisions.observed_phase), return_index=True
    )

    by_form = {}
    for name, agent in agents.items():
        forecasts: list[Forecast] = []
        for row, decision in zip(
            range(rows[-1] + 1), decisions(log, agent), strict=False
        ):
            if row in rows:
                policy = expectation(agent)
                rest = policy[policy.times > float(decision.observed_phase)]
                # Up to the end of the episode.
                to_come = rest.times[rest.times <= reached[-1]]
                truth = interpolated(to_come, reached, log.opening.handle_pose[first])
                forecasts.append(Forecast(rest=rest, truth=truth))
        by_form[name] = tuple(forecasts)
    phases = tuple(float(log.decisions.observed_phase[row]) for row in rows)
    return Forecasts(log=log, phases=phases, by_form=by_form)


def draw(openings: Mapping[str, Forecasts]) -> Figure:
    """Draw one door: forms in columns, shares of the opening in rows, equal scales."""
    shown = openings[SHOWN]
    figure = style.new_figure(style.PAGE, 5.9)
    rows = figure.subplots(3, 3, sharex=True, sharey=True)
    angles = np.linspace(0.0, float(shown.log.opening.door_angle.max()), 200)
    path = arc(shown.log.radius, angles)
    titles = []
    for index, share in enumerate(SHARES):
        for panel, form in zip(rows[index], FORMS, strict=True):
            forecast = shown.by_form[form][index]
            shade_region(panel, forecast.rest, style.ADAPTED)
            seen = round(share * (len(path) - 1)) + 1
            panel.plot(*path[:seen].T, color=style.TRUTH, linewidth=2.4)
            panel.plot(*path.T, color=style.TRUTH, linewidth=1.2)
            mean = forecast.rest.mean[:, PLANE]
            panel.plot(*mean.T, color=style.ADAPTED, linestyle="--")
            panel.set_aspect("equal")
            error, inside = 1e3 * forecast.rms_error(), 100.0 * forecast.coverage()
            titles.append(f"{form}: {error:.0f} mm off, {inside:.0f} % inside")
        rows[index, 0].set_ylabel(f"after {100.0 * share:.0f} %\n$z$ [m]")
    style.name_panels(rows.flat, titles)
    for panel in rows[-1]:
        panel.set_xlabel("$x$ [m]")
    rows[0, 0].set(xlim=(-0.06, 0.92), ylim=(-0.62, 0.06))
    style.legend_above(
        figure,
        {
            "true arc (thick: seen)": style.legend_line(style.TRUTH),
            "mean of the forecast": style.legend_line(style.ADAPTED, "--"),
            "its 95 % region": Patch(color=style.ADAPTED, alpha=0.2),
        },
    )
    return figure


def caption(openings: Mapping[str, Forecasts]) -> str:
    """Describe the figure and state its numbers."""
    shown = openings[SHOWN]
    numbers = []
    for index, share in enumerate(SHARES):
        forms = []
        for form in FORMS:
            made = [opening.by_form[form][index] for opening in openings.values()]
            error = np.mean([forecast.rms_error() for forecast in made])
            inside = np.mean([forecast.coverage() for forecast in made])
            forms.append(f"{form} {1e3 * error:.0f} mm, {100.0 * inside:.0f} %")
        numbers.append(f"after {100.0 * share:.0f} %: {'; '.join(forms)}")
    radii = ", ".join(f"{opening.log.radius:.2f}" for opening in openings.values())
    phases = ", ".join(f"{phase:.2f}" for phase in shown.phases)
    return (
        f"Forecasts of the rest of the opening of a door of {shown.log.radius:.2f} m "
        "in the plane in which it opens, after 5, 15 and 30 % of its angle (phases "
        f"{phases}), by three forms of adaptation with the same observations: the "
        "paper's product of Gaussians, exact conditioning of its model, and "
        "conditioning of the demonstrated process (the default). Dashed: mean; "
        "shaded: union of the joint 95 % regions of x and z; green: the true arc. "
        "Above the panels: rms distance of the mean from the rest of the true path, "
        "and share of the true x and z inside the 95 % intervals of their phase. Means "
        f"over doors of {radii} m: {'. '.join(numbers)}. The true pose is taken at the "
        "phase that the agent later estimates, so that phase errors count as errors of "
        "x and z."
    )
