"""Fig. 9, Section IV-B: adaptation while the door opens; forecasts of three forms."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from gplfd_experiments.analysis.figures import style
from gplfd_experiments.analysis.figures.learned import PLANE, arc, shade_region
from gplfd_experiments.analysis.figures.material import Material
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.metrics import opening_motion, prediction_errors
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies import Demonstration
from gplfd_policies.adaptation import ADAPTATIONS
from gplfd_policies.agents.agent import Agent, as_agent
from gplfd_policies.arrays.resolution import interpolated
from gplfd_policies.control.steps import AgentStep, Observation
from gplfd_policies.movements.movement import GaussianTrajectory
from gplfd_policies.registry.built_in import GP
from gplfd_policies.registry.catalogue import make_agent
from gplfd_policies.registry.method import TrainingInput

SHOWN: Final = "large"
DOORS: Final = ("small", "medium", "large", "0.42")
_STAGES: Final = (0.1, 0.25, 0.4)
"""Observed phases at which the posterior is shown."""
_OUTPUTS: Final = {0: "x", 2: "z"}
_DOTTED: Final = (0, (1.0, 1.0))


def decisions(log: EpisodeLog, agent: Agent) -> Iterator[AgentStep]:
    """Show an agent the observations of a logged episode, row by row.

    Nothing is simulated. The agent of the log repeats its decisions; another agent
    decides on the same observations. The agent is reset immediately and acts when the
    next decision is requested; between decisions, `expectation` returns its forecast.
    """

    def observation(row: int) -> Observation:
        names = ("ee_pose", "ee_twist", "joint_pos", "joint_vel")
        seen = {name: getattr(log.motion, name)[row] for name in names}
        wrench = log.forces.wrench[row]
        return seen | {"wrench": wrench, "time": log.times[row : row + 1]}

    agent.reset(observation(0))
    return (agent.act(observation(row)) for row in range(log.times.size))


def expectation(agent: Agent) -> GaussianTrajectory:
    """Return the present forecast of the whole task; raise if an agent has none."""
    forecast = agent.forecast()
    if forecast is None:
        raise ValueError("the agent makes no forecasts; use a Gaussian-process policy")
    return forecast


@dataclass(frozen=True, slots=True)
class Prediction:
    """Predictions of a policy at T phases of an opening, one step ahead [m, rad]."""

    mean: FloatArray
    std: FloatArray
    width: FloatArray
    """Half of the 95 % interval over ``std``, (T,)."""

    def interval(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds, (T, 6)."""
        half = self.width[:, None] * self.std
        return self.mean - half, self.mean + half


@dataclass(frozen=True, kw_only=True, slots=True)
class Opening:
    """The opening of one door and predictions in it, with and without via-points."""

    log: EpisodeLog
    motion: slice
    """Rows of the log in which the door moves."""
    initial: GaussianTrajectory
    """The policy before any via-point."""
    stages: tuple[GaussianTrajectory, ...]
    """The policy as adapted at each stage."""
    adaptive: Prediction
    fixed: Prediction

    def errors(self) -> tuple[FloatArray, FloatArray]:
        """E[ε²] of the adaptive and of the fixed policy in the motion, (T', 6)."""
        bias = self.fixed.mean - self.log.opening.handle_pose
        fixed = bias**2 + self.fixed.std**2
        return prediction_errors(self.log)[self.motion], fixed[self.motion]

    def coverage(self, prediction: Prediction) -> FloatArray:
        """Share of the motion's true poses inside the 95 % interval, (6,)."""
        low, high = prediction.interval()
        inside = (self.log.opening.handle_pose >= low) & (
            self.log.opening.handle_pose <= high
        )
        share: FloatArray = inside[self.motion].mean(axis=0)
        return share


def reviewed(log: EpisodeLog, agent: Agent, phases: Sequence[float]) -> Opening:
    """Replay the opening to its policy and store the forecast at some phases.

    The log lacks the width of the 95 % interval; the policy provides it.
    """
    width = np.empty(log.times.size)
    stages: list[GaussianTrajectory] = []
    decided = decisions(log, agent)
    initial = belief = expectation(agent)
    for row, decision in enumerate(decided):
        _, high = belief.interval()
        width[row] = (high[-1, 0] - belief.mean[-1, 0]) / belief.std[-1, 0]
        if decision.via_point:
            belief = expectation(agent)
        reached = sum(decision.observed_phase >= phase for phase in phases)
        stages.extend([belief] * (reached - len(stages)))
    mean, std = log.forecasts.first(log.decisions.observed_phase)
    return Opening(
        log=log,
        motion=opening_motion(log),
        stages=tuple(stages),
        initial=initial,
        adaptive=Prediction(
            log.decisions.predicted_mean, log.decisions.predicted_std, width
        ),
        fixed=Prediction(mean, std, np.full(width.size, width[0])),
    )


def fig09(material: Material) -> tuple[Figure, str]:
    """Draw posteriors and predictions of one door, and the errors on all."""
    agent = make_agent("gp", material.demonstrations.demonstrations)
    openings = [reviewed(material.episodes[door], agent, _STAGES) for door in DOORS]
    shown = openings[DOORS.index(SHOWN)]
    figure = style.new_figure(style.PAGE, 4.9)
    rows = figure.subplots(3, 4, sharey="row")
    draw_opening(rows[:2], shown)
    ratios, crossed = [], []
    for panel, opening in zip(rows[2], openings, strict=True):
        adaptive, fixed = (errors[:, [*_OUTPUTS]] for errors in opening.errors())
        phases = opening.log.decisions.observed_phase[opening.motion]
        order = np.argsort(phases, kind="stable")
        for errors, colour in ((fixed, style.BEFORE), (adaptive, style.ADAPTED)):
            for curve, line in zip(errors[order].T, ("-", ":"), strict=True):
                look: dict[str, Any] = {"color": colour, "linestyle": line}
                panel.semilogy(phases[order], curve, linewidth=0.8, **look)
        roots = (1e3 * np.sqrt(errors.mean(axis=0)) for errors in (adaptive, fixed))
        numbers = " and ".join(
            f"{small:.1f} mm against {large:.0f} mm in {name} (ratio of E[ε²] "
            f"{(large / small) ** 2:.0f})"
            for small, large, name in zip(*roots, _OUTPUTS.values(), strict=True)
        )
        ratios.append(f"{opening.log.radius:.2f} m: {numbers}")
        crossed.append(np.mean(adaptive > fixed))
    rows[2, 0].set_ylabel(r"$E[ε^2]$ [m²]")
    titles = [f"via-points to phase {phase}" for phase in _STAGES]
    titles += ["one step ahead"]
    titles += [f"door of {opening.log.radius:.2f} m" for opening in openings]
    style.name_panels(rows[[0, 2]].flat, titles)
    for panel in rows.flat:
        panel.set_xlim(0.0, 1.0)
        panel.set_xticks([0.0, 0.5, 1.0], ["0", "0.5", "1"])
    for panel in rows[1:].flat:
        panel.set_xlabel("phase")
    style.legend_above(
        figure,
        {
            "adaptive": style.legend_line(style.ADAPTED),
            "demonstrations only": style.legend_line(style.BEFORE, "--"),
            "true motion": style.legend_line(style.TRUTH, _DOTTED),
            "via-points": Patch(color=style.SEEN),
            "$x$ (e to h)": style.legend_line("0.3"),
            "$z$ (e to h)": style.legend_line("0.3", ":"),
        },
    )
    coverage = [
        " and ".join(f"{100.0 * share[o]:.0f} % ({n})" for o, n in _OUTPUTS.items())
        for share in map(shown.coverage, (shown.adaptive, shown.fixed))
    ]
    return figure, (
        f"(a–c) The policy for x (top) and z (middle) while a door of "
        f"{shown.log.radius:.2f} m opens, conditioned on the via-points in the "
        "light-blue area, against the policy learned from demonstrations alone; means "
        "and 95 % intervals, and the true motion of the handle. (d) One-step "
        "predictions of both. (e–h) Mean squared prediction error E[ε²] = (E f* - f)² "
        "+ var f* in four openings; the paper's Fig. 9 shows one door. Both are "
        "evaluated at the phase that the agent estimates. Root of the mean E[ε²], "
        f"adaptive against fixed: {'; '.join(ratios)}. Steps at which the adaptive "
        f"policy is worse: {100.0 * np.mean(crossed):.1f} %. Share of the true motion "
        f"inside the 95 % intervals of (d): {coverage[0]} adaptive, {coverage[1]} "
        "fixed."
    )


def draw_opening(rows: NDArray[np.object_], opening: Opening) -> None:
    """Draw x and z, each in a row: the policy at three stages, and its predictions."""
    # Rows of the motion, sorted by phase, which may decrease slightly over time.
    log = opening.log
    motion = np.arange(log.times.size)[opening.motion]
    order = motion[np.argsort(log.decisions.observed_phase[motion], kind="stable")]
    phases = log.decisions.observed_phase[order]
    for row, output in zip(rows, _OUTPUTS, strict=True):
        for panel, stage, phase in zip(row[:3], opening.stages, _STAGES, strict=True):
            panel.axvspan(0.0, phase, color=style.SEEN, linewidth=0.0, zorder=0)
            before, after = style.BEFORE, style.ADAPTED
            first = panel, opening.initial, output, before
            style.mean_and_interval(*first, linestyle="--")
            style.mean_and_interval(panel, stage, output, after)
        for prediction, colour, line in (
            (opening.fixed, style.BEFORE, "--"),
            (opening.adaptive, style.ADAPTED, "-"),
        ):
            low, high = (bound[order, output] for bound in prediction.interval())
            style.band(row[3], phases, low, high, colour)
            mean = prediction.mean[order, output]
            row[3].plot(phases, mean, color=colour, linestyle=line)
        truth = phases, log.opening.handle_pose[order, output]
        look: dict[str, Any] = {"color": style.TRUTH, "linestyle": _DOTTED, "zorder": 4}
        for panel in row:
            panel.plot(*truth, linewidth=1.0, **look)
        row[0].set_ylabel(f"${_OUTPUTS[output]}$ [m]")


# --- Not in the paper: forecasts by three forms of adaptation -------------------------

FORMS: Final = ("product", "exact", "process")
"""Forms of adaptation of `gp` that are compared."""
SHARES: Final = (0.05, 0.15, 0.30)
"""Observed share of the opening angle."""


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
        future = self.rest[: len(self.truth)]
        return float(future.inside(self.truth)[:, PLANE].mean())


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


def foretold(log: EpisodeLog, agent: Agent) -> list[Forecast]:
    """Replay an opening to an agent and return its forecast at each share of it."""
    angles = log.opening.door_angle
    rows = [int(np.argmax(angles >= share * float(angles.max()))) for share in SHARES]
    reached, first = np.unique(
        np.maximum.accumulate(log.decisions.observed_phase), return_index=True
    )
    forecasts: list[Forecast] = []
    decided = decisions(log, agent)
    for row, decision in zip(range(rows[-1] + 1), decided, strict=False):
        if row in rows:
            policy = expectation(agent)
            rest = policy[policy.times > float(decision.observed_phase)]
            # Up to the end of the episode.
            to_come = rest.times[rest.times <= reached[-1]]
            truth = interpolated(to_come, reached, log.opening.handle_pose[first])
            forecasts.append(Forecast(rest=rest, truth=truth))
    return forecasts


def forecasts(material: Material) -> tuple[Figure, str]:
    """Draw forms in columns and shares of the opening in rows, at equal scales."""
    agents = agents_of_forms(material.demonstrations.demonstrations)
    by_door = {
        door: {form: foretold(material.episodes[door], agents[form]) for form in FORMS}
        for door in DOORS
    }
    log = material.episodes[SHOWN]
    figure = style.new_figure(style.PAGE, 5.9)
    rows = figure.subplots(len(SHARES), len(FORMS), sharex=True, sharey=True)
    angles = np.linspace(0.0, float(log.opening.door_angle.max()), 200)
    path = arc(log.radius, angles)
    titles, numbers = [], []
    for index, share in enumerate(SHARES):
        means = []
        for panel, form in zip(rows[index], FORMS, strict=True):
            forecast = by_door[SHOWN][form][index]
            shade_region(panel, forecast.rest, style.ADAPTED)
            seen = round(share * (len(path) - 1)) + 1
            panel.plot(*path[:seen].T, color=style.TRUTH, linewidth=2.4)
            panel.plot(*path.T, color=style.TRUTH, linewidth=1.2)
            mean = forecast.rest.mean[:, PLANE]
            panel.plot(*mean.T, color=style.ADAPTED, linestyle="--")
            panel.set_aspect("equal")
            error, inside = 1e3 * forecast.rms_error(), 100.0 * forecast.coverage()
            titles.append(f"{form}: {error:.0f} mm off, {inside:.0f} % inside")
            every = [by_form[form][index] for by_form in by_door.values()]
            error = 1e3 * float(np.mean([one.rms_error() for one in every]))
            inside = 100.0 * float(np.mean([one.coverage() for one in every]))
            means.append(f"{form} {error:.0f} mm, {inside:.0f} %")
        rows[index, 0].set_ylabel(f"after {100.0 * share:.0f} %\n$z$ [m]")
        numbers.append(f"after {100.0 * share:.0f} %: {'; '.join(means)}")
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
    radii = ", ".join(f"{material.episodes[door].radius:.2f}" for door in DOORS)
    return figure, (
        f"Forecasts of the rest of the opening of a door of {log.radius:.2f} m in the "
        "plane in which it opens, after 5, 15 and 30 % of its angle, by three forms of "
        "adaptation with the same observations: the paper's product of Gaussians, "
        "exact conditioning of its model, and conditioning of the demonstrated process "
        "(the default). Dashed: mean; shaded: union of the joint 95 % regions of x and "
        "z; green: the true arc. Above the panels: rms distance of the mean from the "
        "rest of the true path, and share of the true x and z inside the 95 % "
        f"intervals of their phase. Means over doors of {radii} m: "
        f"{'. '.join(numbers)}. The true pose is taken at the phase that the agent "
        "later estimates, so that phase errors count as errors of x and z."
    )
