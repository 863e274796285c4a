"""Fig. 10, Section IV-B: stiffness, and the allowed decrease rate of uncertainty."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gplfd_experiments.analysis.figures import style
from gplfd_experiments.analysis.figures.style import POLICY, Material
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.metrics import share_of_bound
from gplfd_policies.agents.agent import CompliantAgent
from gplfd_policies.control.stability import uncertainty_fall_bound
from gplfd_policies.control.stiffness import (
    DEFAULT_DYNAMICS,
    StiffnessProfile,
    directional_std,
)
from gplfd_policies.registry.catalogue import make_agent

DOORS: Final = ("medium", "heavy")
AXES: Final = {0: ("along", style.AXIS_X), 2: ("across", style.AXIS_Z)}
_OUTPUTS: Final = [*AXES]
_LINEAR: Final = 0.03
"""The axis of -dσ/dt is linear up to this value and logarithmic beyond [m/s]."""
_TICKS: Final = (-0.02, 0.0, 0.02, 0.1, 1.0)
_MARK: Final[Mapping[str, Any]] = {"marker": "v", "linestyle": "", "markersize": 5.0}
_DOT: Final[Mapping[str, Any]] = {
    "marker": "o",
    "linestyle": "",
    "markersize": 1.7,
    "markeredgewidth": 0.0,
    "zorder": 3,
}
_INTERVENTION: Final = 1e-6
"""The governor intervenes if the stiffness is this far below the profile [N/m]."""


def draw_door(
    panels: Sequence[Axes], log: EpisodeLog, profile: StiffnessProfile
) -> str:
    """Draw stiffness, fall of uncertainty and use of the bound; return the numbers."""
    stiffness, fall, use = panels
    _, fixed = log.forecasts.first(log.decisions.phase)
    fixed = directional_std(log.decisions.frame, fixed)
    by_law = profile.stiffness(fixed, log.decisions.frame)
    fixed_fall = -np.diff(fixed, axis=0, prepend=fixed[:1]) / log.dt
    wished = profile.stiffness(log.decisions.std, log.decisions.frame)
    governed = wished - log.decisions.stiffness > _INTERVENTION
    falls, used = -log.decisions.std_rate, share_of_bound(log)
    tight, printed = bounds(profile)
    for output, (_, colour) in AXES.items():
        dashed: dict[str, Any] = {"color": colour, "linestyle": "--", "linewidth": 0.8}
        stiffness.plot(log.times, by_law[:, output], **dashed)
        stiffness.plot(log.times, log.decisions.stiffness[:, output], color=colour)
        # A dot per control step without interpolation.
        fall.plot(log.times, falls[:, output], color=colour, **_DOT)
        use.plot(log.times, used[:, output], color=colour, **_DOT)
    stiffness.set_ylim(0.0, 540.0)
    fall.axhline(tight, color=style.LIMIT)
    fall.axhline(printed, color=style.LIMIT, linestyle=":")
    # The drop at the first via-point may be fifty times the bound.
    fall.set_yscale("symlog", linthresh=_LINEAR, linscale=1.2)
    fall.set_yticks(_TICKS, [f"{tick:g}" for tick in _TICKS])
    fall.minorticks_off()
    use.axhline(1.0, color=style.LIMIT)
    for output in AXES:
        rows = governed[:, output]
        use.plot(log.times[rows], used[rows, output], color=style.LIMIT, **_MARK)
    use.set(xlabel="time [s]", xlim=(0.0, float(log.times[-1])))

    both, gains = falls[:, _OUTPUTS], log.decisions.stiffness[:, _OUTPUTS]
    above = [int((both > bound).any(axis=1).sum()) for bound in (tight, printed)]
    return (
        f"{above[0]} of {log.times.size} steps above it (and {above[1]} above the "
        f"printed one), at most {both.max():.3f} m/s, and without via-points at most "
        f"{fixed_fall[:, _OUTPUTS].max():.3f} m/s; stiffness from {gains.min():.0f} to "
        f"{gains.max():.0f} N/m, its rate at most "
        f"{100.0 * used[:, _OUTPUTS].max():.1f} % of its bound; interventions of the "
        f"governor: {int(governed[:, _OUTPUTS].sum())}"
    )


def bounds(profile: StiffnessProfile) -> tuple[float, float]:
    """Return the bounds on -dσ/dt that suffice on both axes: tight, and as printed."""
    tight, printed = (
        float(
            uncertainty_fall_bound(profile, DEFAULT_DYNAMICS, printed=p)[_OUTPUTS].min()
        )
        for p in (False, True)
    )
    return tight, printed


def fig10(material: Material) -> tuple[Figure, str]:
    """Draw the stiffness at two doors and its bounds."""
    agent = make_agent(POLICY, material.demonstrations.demonstrations)
    if not isinstance(agent, CompliantAgent):
        raise TypeError(f"{POLICY} has no stiffness law: {agent!r}")
    profile = agent.config.profile
    figure = style.new_figure(style.PAGE, 4.7)
    panels = figure.subplots(3, len(DOORS), sharex="col", sharey="row")
    numbers, titles = [], []
    for column, door in zip(panels.T, DOORS, strict=True):
        text = draw_door(column, material.episodes[door], profile)
        numbers.append(f"{door} door: {text}")
        titles += [f"stiffness, {door} door"]
        titles += ["fall of the uncertainty", "rate of the stiffness"]
    style.name_panels(panels.T.flat, titles)
    panels[0, 0].set_ylabel("$k_p$ [N/m]")
    panels[1, 0].set_ylabel(r"$-\mathrm{d}σ/\mathrm{d}t$ [m/s]")
    panels[2, 0].set(ylabel=r"$\dot{k}_p$ / its bound", ylim=(None, 1.15))
    style.legend_above(
        figure,
        {name: style.legend_line(colour) for name, colour in AXES.values()}
        | {
            "without via-points": style.legend_line("0.4", "--"),
            "bound": style.legend_line(style.LIMIT),
            "bound, printed constant": style.legend_line(style.LIMIT, ":"),
            "governor intervenes": style.legend_line(style.LIMIT, **_MARK),
        },
    )
    tight, printed = bounds(profile)
    return figure, (
        "(a, d) Stiffness while an ordinary and a heavy door open, and (dashed) by the "
        "same law without via-points. (b, e) Decrease rate of the uncertainty, one dot "
        f"per control step, against Eq. (28) with the tight constant ({tight:.4f} m/s) "
        f"and the printed one ({printed:.4f} m/s); the paper's Fig. 10 compares "
        "+dσ/dt, but decreasing uncertainty raises the stiffness. (c, f) Rate of the "
        "stiffness over the bound, tight form of Eq. (23): below 1 the virtual "
        "dynamics are stable. "
        f"{'; '.join(numbers)}. Eq. (28) is sufficient, not necessary; the condition "
        "itself (c, f) holds, because the governor limits the stiffness."
    )
