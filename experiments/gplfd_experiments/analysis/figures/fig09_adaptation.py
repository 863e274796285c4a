"""Fig. 9, Section IV-B, which defines E[ε²]: adaptation while the door opens."""

from collections.abc import Mapping
from typing import Final

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from gplfd_experiments.analysis.figures import style
from gplfd_experiments.analysis.figures.hindsight import Opening, reviewed
from gplfd_experiments.analysis.figures.material import Material
from gplfd_policies.registry.catalogue import make_agent

TITLE: Final = "Adaptation while the door opens"
SHOWN: Final = "large"
DOORS: Final = ("small", "medium", "large", "0.42")
_STAGES: Final = (0.1, 0.25, 0.4)
"""Observed phases at which the posterior is shown."""
_OUTPUTS: Final = {0: "x", 2: "z"}
_DOTTED: Final = (0, (1.0, 1.0))


def measure(material: Material) -> dict[str, Opening]:
    """Note what the policy believed in each opening."""
    agent = make_agent("gp", material.demonstrations.demonstrations)
    return {door: reviewed(material.episodes[door], agent, _STAGES) for door in DOORS}


def draw(openings: Mapping[str, Opening]) -> Figure:
    """Draw posteriors and predictions of one door, and the errors on all."""
    figure = style.new_figure(style.PAGE, 4.9)
    rows = figure.subplots(3, 4, sharey="row")
    shown = openings[SHOWN]
    # Rows of the motion in the order of their phase, which may step back a little.
    motion = np.arange(shown.log.times.size)[shown.motion]
    order = motion[np.argsort(shown.log.observed_phase[motion], kind="stable")]
    phases = shown.log.observed_phase[order]
    for row, output in zip(rows, _OUTPUTS, strict=False):
        for panel, stage, phase in zip(row, shown.stages, _STAGES, strict=False):
            panel.axvspan(0.0, phase, color=style.SEEN, linewidth=0.0, zorder=0)
            before, after = style.BEFORE, style.ADAPTED
            style.mean_and_interval(
                panel, shown.initial, output, before, linestyle="--"
            )
            style.mean_and_interval(panel, stage, output, after)
        for prediction, colour, line in (
            (shown.fixed, style.BEFORE, "--"),
            (shown.adaptive, style.ADAPTED, "-"),
        ):
            low, high = (bound[order, output] for bound in prediction.interval())
            style.band(row[3], phases, low, high, colour)
            mean = prediction.mean[order, output]
            row[3].plot(phases, mean, color=colour, linestyle=line)
        for panel in row:
            panel.plot(
                phases,
                shown.log.handle_pose[order, output],
                color=style.TRUTH,
                linewidth=1.0,
                linestyle=_DOTTED,
                zorder=4,
            )
        row[0].set_ylabel(f"${_OUTPUTS[output]}$ [m]")
    for panel, opening in zip(rows[2], openings.values(), strict=True):
        adaptive, fixed = opening.errors()
        phases = opening.log.observed_phase[opening.motion]
        order = np.argsort(phases, kind="stable")
        for errors, colour in ((fixed, style.BEFORE), (adaptive, style.ADAPTED)):
            for output, line in zip(_OUTPUTS, ("-", ":"), strict=True):
                curve = phases[order], errors[order, output]
                panel.semilogy(*curve, color=colour, linestyle=line, linewidth=0.8)
    rows[2, 0].set_ylabel(r"$E[ε^2]$ [m²]")
    titles = [f"via-points to phase {phase}" for phase in _STAGES]
    titles += ["one step ahead"]
    titles += [f"door of {opening.log.radius:.2f} m" for opening in openings.values()]
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
    return figure


def caption(openings: Mapping[str, Opening]) -> str:
    """Say what is seen, and the numbers."""
    shown = openings[SHOWN]
    ratios = []
    for opening in openings.values():
        adaptive, fixed = (
            1e3 * np.sqrt(errors.mean(axis=0)) for errors in opening.errors()
        )
        numbers = " and ".join(
            f"{adaptive[o]:.1f} mm against {fixed[o]:.0f} mm in {name} "
            f"(ratio of E[ε²] {(fixed[o] / adaptive[o]) ** 2:.0f})"
            for o, name in _OUTPUTS.items()
        )
        ratios.append(f"{opening.log.radius:.2f} m: {numbers}")
    coverage = [
        " and ".join(f"{100.0 * share[o]:.0f} % ({n})" for o, n in _OUTPUTS.items())
        for share in map(shown.coverage, (shown.adaptive, shown.fixed))
    ]
    crossed = [
        np.mean(adaptive[:, list(_OUTPUTS)] > fixed[:, list(_OUTPUTS)])
        for adaptive, fixed in (opening.errors() for opening in openings.values())
    ]
    return (
        f"(a–c) The policy for x (top) and z (middle) while a door of "
        f"{shown.log.radius:.2f} m opens, conditioned on the via-points in the "
        "light-blue area, against the policy learned from demonstrations alone; means "
        "and 95 % intervals, and what the handle then did. (d) What both predicted for "
        "each step before seeing it. (e–h) Mean squared prediction error E[ε²] = (E f* "
        "- f)² + var f* in four openings; nobody demonstrated the door of 0.42 m. The "
        "paper's Fig. 9 shows one door. Both policies are asked for the phase at which "
        "the agent found itself on the path, not for the clock's. Root of the mean "
        f"E[ε²], adaptive against fixed: {'; '.join(ratios)}. Steps at which the "
        f"adaptive policy is the worse one: {100.0 * np.mean(crossed):.1f} %. Share of "
        f"the true motion inside the 95 % intervals of (d): {coverage[0]} adaptive, "
        f"{coverage[1]} fixed."
    )
