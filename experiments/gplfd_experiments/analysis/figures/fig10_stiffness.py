"""Fig. 10, Section IV-B: stiffness, and the allowed decrease rate of uncertainty."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from gplfd_experiments.analysis.figures import style
from gplfd_experiments.analysis.figures.material import POLICY, Material
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.metrics import share_of_bound
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.agents.agent import CompliantAgent
from gplfd_policies.control.frame import directional_std
from gplfd_policies.control.stability import uncertainty_fall_bound
from gplfd_policies.control.stiffness import DEFAULT_DYNAMICS, StiffnessProfile
from gplfd_policies.registry.catalogue import make_agent

TITLE: Final = "Stiffness and its stability"
DOORS: Final = ("medium", "heavy")
AXES: Final = {0: ("along", style.AXIS_X), 2: ("across", style.AXIS_Z)}
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


@dataclass(frozen=True, kw_only=True, slots=True)
class Stability:
    """Data of Fig. 10 for one episode; arrays over its steps."""

    log: EpisodeLog
    fall: FloatArray
    """-dσ/dt of the σ that the controller used, (T, 6) [m/s, rad/s]."""
    fixed_stiffness: FloatArray
    fixed_fall: FloatArray
    """Stiffness by the law and -dσ/dt for σ without via-points, (T, 6)."""
    tight: float
    """Bound on -dσ/dt that suffices at every σ and on both axes."""
    printed: float
    """The same bound with the printed constant."""
    used: FloatArray
    """Stiffness rate over its bound at that stiffness, (T, 6): stable below 1."""
    governed: NDArray[np.bool_]
    """Where the governor limited the stiffness, (T, 6)."""


def measure(material: Material) -> dict[str, Stability]:
    """Compare the episode at each door with the bounds."""
    agent = make_agent(POLICY, material.demonstrations.demonstrations)
    if not isinstance(agent, CompliantAgent):
        raise TypeError(f"{POLICY} has no stiffness law: {agent!r}")
    profile = agent.config.profile
    return {door: stability(material.episodes[door], profile) for door in DOORS}


def stability(log: EpisodeLog, profile: StiffnessProfile) -> Stability:
    """Compare an episode, under a stiffness law, with the bounds."""
    _, fixed = log.forecasts.first(log.decisions.phase)
    fixed = directional_std(log.decisions.frame, fixed)
    wished = profile.stiffness(log.decisions.std, log.decisions.frame)
    fixed_rate = np.diff(fixed, axis=0, prepend=fixed[:1]) / log.dt

    def least(bound: FloatArray) -> float:
        return float(min(bound[output] for output in AXES))

    return Stability(
        log=log,
        fall=-log.decisions.std_rate,
        fixed_stiffness=profile.stiffness(fixed, log.decisions.frame),
        fixed_fall=-fixed_rate,
        tight=least(uncertainty_fall_bound(profile, DEFAULT_DYNAMICS)),
        printed=least(uncertainty_fall_bound(profile, DEFAULT_DYNAMICS, printed=True)),
        used=share_of_bound(log),
        governed=wished - log.decisions.stiffness > _INTERVENTION,
    )


def draw(shown: Mapping[str, Stability]) -> Figure:
    """Draw stiffness, decrease of uncertainty and use of the bound, by door."""
    figure = style.new_figure(style.PAGE, 4.7)
    rows = figure.subplots(3, len(shown), sharex="col", sharey="row", squeeze=False)
    titles = []
    for column, (door, episode) in zip(rows.T, shown.items(), strict=True):
        stiffness, fall, use = column
        times = episode.log.times
        for output, (_, colour) in AXES.items():
            fixed = episode.fixed_stiffness[:, output]
            stiffness.plot(times, fixed, color=colour, linestyle="--", linewidth=0.8)
            adapted = episode.log.decisions.stiffness[:, output]
            stiffness.plot(times, adapted, color=colour)
            # A dot per control step without interpolation.
            fall.plot(times, episode.fall[:, output], color=colour, **_DOT)
            use.plot(times, episode.used[:, output], color=colour, **_DOT)
        stiffness.set_ylim(0.0, 540.0)

        fall.axhline(episode.tight, color=style.LIMIT)
        fall.axhline(episode.printed, color=style.LIMIT, linestyle=":")
        # The drop at the first via-point may be fifty times the bound.
        fall.set_yscale("symlog", linthresh=_LINEAR, linscale=1.2)
        fall.set_yticks(_TICKS, [f"{tick:g}" for tick in _TICKS])
        fall.minorticks_off()

        use.axhline(1.0, color=style.LIMIT)
        for output in AXES:
            governed = episode.governed[:, output]
            marked = times[governed], episode.used[governed, output]
            use.plot(*marked, color=style.LIMIT, **_MARK)
        use.set(xlabel="time [s]", xlim=(0.0, float(times[-1])))
        titles += [f"stiffness, {door} door"]
        titles += ["fall of the uncertainty", "rate of the stiffness"]
    style.name_panels(rows.T.flat, titles)
    rows[0, 0].set_ylabel("$k_p$ [N/m]")
    rows[1, 0].set_ylabel(r"$-\mathrm{d}σ/\mathrm{d}t$ [m/s]")
    rows[2, 0].set(ylabel=r"$\dot{k}_p$ / its bound", ylim=(None, 1.15))
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
    return figure


def caption(shown: Mapping[str, Stability]) -> str:
    """Describe the figure and state its numbers."""
    outputs = list(AXES)
    first = next(iter(shown.values()))
    numbers = []
    for door, episode in shown.items():
        fall, stiffness = episode.fall[:, outputs], episode.log.decisions.stiffness
        above, printed = (
            int((fall > bound).any(axis=1).sum())
            for bound in (episode.tight, episode.printed)
        )
        numbers.append(
            f"{door} door: {above} of {episode.log.times.size} steps above it (and "
            f"{printed} above the printed one), at most {fall.max():.3f} m/s, and "
            f"without via-points at most {episode.fixed_fall[:, outputs].max():.3f} "
            f"m/s; stiffness from {stiffness[:, outputs].min():.0f} to "
            f"{stiffness[:, outputs].max():.0f} N/m, its rate at most "
            f"{100.0 * episode.used[:, outputs].max():.1f} % of its bound; "
            f"interventions of the governor: {int(episode.governed[:, outputs].sum())}"
        )
    return (
        "(a, d) Stiffness along and across the path while an ordinary and a heavy door "
        "open, and (dashed) by the same law for the uncertainty without via-points. "
        "(b, e) Decrease rate of the uncertainty that sets the stiffness, one dot per "
        f"control step, against Eq. (28) with the tight constant ({first.tight:.4f} "
        f"m/s) and the printed one ({first.printed:.4f} m/s). (c, f) Rate of the "
        "stiffness over the bound at the present stiffness, tight form of Eq. (23): "
        "below 1 the virtual dynamics are stable. The paper's Fig. 10 compares +dσ/dt "
        "with the bound; because decreasing uncertainty raises the stiffness, this "
        "figure uses -dσ/dt. Every via-point reduces σ at once, so that some steps "
        f"exceed Eq. (28). {'; '.join(numbers)}. Eq. (28) is sufficient, not "
        "necessary; the condition itself (c, f) holds, because the governor limits the "
        "stiffness."
    )
