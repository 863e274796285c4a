"""Time series and coloured lanes beside the scene, all on the same time axis."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray
from rerun.chunk import Chunk

from gplfd_env.conventions.constants import SUCCESS_ANGLE
from gplfd_env.task.opening import STALL_ANGLE
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.metrics import share_of_bound
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.recording import colours
from gplfd_experiments.recording.colours import Colour
from gplfd_experiments.recording.stream import moving, static
from gplfd_policies.arrays.records import interpolated

ROOT: Final = "/plots"
ZERO: Final = f"{ROOT}/zero"
"""Entity of a line at zero, which keeps zero in the range of a panel."""

QUANTILE: Final = 1.96
"""Half-width of all bands in standard deviations: the normal quantile of the central
95 % of one output. With few demonstrations such a band contains less than 95 %."""
AXES: Final = ("along", "across")
"""Horizontal directions of σ and k, last parts of the entities of their panels."""


class Line(NamedTuple):
    """Style of a curve of a panel, or of the centre line of a band."""

    name: str
    colour: Colour
    width: float = 2.0


class Panel(NamedTuple):
    """A panel of all time series below an entity; a legend would hide curves."""

    entity: str
    title: str  # Quantity and unit, and the colours of several curves.
    from_zero: bool = False
    """Whether the axis includes zero, so that heights are proportional."""
    limits: tuple[float, float] | None = None
    """Limits of the axis; None for automatic limits."""

    def view(self, root: str = ROOT) -> rrb.TimeSeriesView:
        """Return the panel, whose entity is below another."""
        return rrb.TimeSeriesView(
            origin=f"{root}/{self.entity}",
            name=self.title,
            contents=["$origin/**", ZERO] if self.from_zero else "$origin/**",
            axis_y=None if self.limits is None else rrb.ScalarAxis(range=self.limits),
            plot_legend=rrb.PlotLegend(visible=False),
        )


def _along_and_across(
    entity: str, title: str, limits: tuple[float, float] | None = None
) -> tuple[Panel, ...]:
    """Panels of both directions side by side, because σ differs tenfold."""
    return tuple(
        Panel(f"{entity}/{axis}", title.format(axis), limits is None, limits)
        for axis in AXES
    )


TABS: Final = {
    "Uncertainty and stiffness": (
        Panel("angle", "Door angle [deg], lines at 15, 30, 60", limits=(-3.0, 75.0)),
        *_along_and_across("uncertainty", "1. Uncertainty σ {} [mm]"),
        *_along_and_across("stiffness", "2. Stiffness k {} [N/m]"),
        Panel(
            "force", "3. Force [N]: along green, compensated violet, radial red", True
        ),
        Panel(
            "expected", "4. Force along [N]: expected violet ±1.96 σ, measured yellow"
        ),
    ),
    "Motion and policy": (
        Panel("x", "x, pull [m]: true green, hand yellow, policy violet, before blue"),
        Panel("z", "z, across it [m], ±1.96 σ"),
        Panel("turn", "θu_y, rotation of the hand [deg], ±1.96 σ"),
        Panel("size", "Size [% of demonstrated], ±1.96 σ", limits=(40, 200)),
    ),
    # Values of the control loop in every period.
    "Unsmoothed, rates": (
        *_along_and_across("uncertainty_raw", "σ {} [mm]"),
        *_along_and_across("uncertainty_rate", "dσ/dt {} [mm/s]"),
        *_along_and_across("stiffness_raw", "Stiffness k {} [N/m]"),
        # Negative during softening.
        *_along_and_across("stability", "dk/dt {} [% of its bound]", (-40.0, 110.0)),
        Panel("misfit", "Misfit of the phase: 1 expected, 3 lost", True),
    ),
}
"""Panels of every recording, by tab; those of a quantity are side by side."""


def all_series(log: EpisodeLog, demonstrated_radius: float) -> Iterator[Chunk]:
    """Return every time series of the layout; those without finite values are left out.

    ``demonstrated_radius`` is the mean radius of the demonstrated paths [m]; NaN if
    they are not circles.
    """
    agent, forces = log.decisions, log.forces
    angles = np.degrees(log.opening.door_angle)
    curves: dict[str, dict[Line, FloatArray]] = {
        "angle/door": {Line("door", colours.TRUTH, 2.5): angles},
        "force/parts": {
            # Wide and first, because the force along the path is almost equal.
            Line("load compensated", colours.ADAPTED, 5.0): agent.compensated_load,
            Line("along the path", colours.TRUTH): forces.force_tangential,
            Line("radial: against the hinge", colours.FORCE): forces.force_radial,
        },
        "misfit/phase": {Line("misfit", colours.HAND, 1.5): agent.phase_misfit},
        "misfit/mode": {
            Line("active mode", colours.OUTSIDE): agent.mode,
            Line("its probability", colours.ADAPTED): agent.mode_probability,
        },
    }
    for panel, values in (
        ("uncertainty", recent_mean(1e3 * agent.std, log.dt)),
        ("stiffness", recent_mean(agent.stiffness, log.dt)),
        ("uncertainty_raw", 1e3 * agent.std),
        ("uncertainty_rate", 1e3 * agent.std_rate),
        ("stiffness_raw", agent.stiffness),
        ("stability", 100.0 * share_of_bound(log)),
    ):
        for axis, output, colour in zip(AXES, (0, 2), colours.AXES, strict=True):
            curves[f"{panel}/{axis}/policy"] = {Line(axis, colour): values[:, output]}
    lag = {Line("lag of the hand", colours.OUTSIDE, 1.0): 1e3 * agent.path_lag}
    curves["uncertainty/along/lag"] = lag

    # Each output before the door moved and now.
    beliefs = {}
    if log.forecasts.times.size:
        before = Line("before", colours.BEFORE, 1.0)
        beliefs[before] = log.forecasts.first(agent.observed_phase)
    now = Line("policy now", colours.ADAPTED, 1.0)
    beliefs[now] = agent.predicted_mean, agent.predicted_std
    for name, output, scale in (("x", 0, 1.0), ("z", 2, 1.0), ("turn", 4, 180 / np.pi)):
        curves[f"{name}/motion"] = {
            Line("true", colours.TRUTH, 3.0): scale
            * log.opening.handle_pose[:, output],
            Line("hand", colours.HAND, 1.0): scale * log.motion.ee_pose[:, output],
        }
        belief = {
            line: (scale * mean[:, output], scale**2 * (QUANTILE * std[:, output]) ** 2)
            for line, (mean, std) in beliefs.items()
        }
        yield from bands(f"{ROOT}/{name}/belief", log.times, belief)

    # Size of the path in % of the demonstrations' mean, ±1.96 σ of its logarithm. The
    # median is not the middle of the band, so it has its own curve.
    bounds = QUANTILE * np.stack([-agent.path_size_std, agent.path_size_std])
    low, high = 100.0 * agent.path_size * np.exp(bounds)
    band = Line("±1.96 σ", colours.ADAPTED, 0.0)
    size = {band: (0.5 * (low + high), 0.25 * (high - low) ** 2)}
    yield from bands(f"{ROOT}/size/belief", log.times, size)
    if np.isfinite(low).any():
        median = Line("policy now", colours.ADAPTED)
        curves["size/curves"] = {median: 100.0 * agent.path_size}
        if log.config.handle == "bar" and math.isfinite(demonstrated_radius):
            truth = 100.0 * log.config.hand_radius / demonstrated_radius
            true = Line("true", colours.TRUTH)
            curves["size/curves"][true] = np.full_like(low, truth)

    # Force along the path: the expected one acts on the handle, the log's on the hand.
    expected, std = agent.expected_force[:, 0], agent.expected_force_std[:, 0]
    force = {Line("expected", colours.ADAPTED): (expected, (QUANTILE * std) ** 2)}
    yield from bands(f"{ROOT}/expected/belief", log.times, force)
    if np.isfinite(expected).any():
        measured = -np.sum(agent.frame[:, :, 0] * forces.wrench[:, :3], axis=1)
        curves["expected/force"] = {Line("measured", colours.HAND, 1.5): measured}

    for path, lines in curves.items():
        yield from series(f"{ROOT}/{path}", log.times, lines)
    # The marks of the forces fix the scale, so that a few newtons look small.
    yield from levels(log, f"{ROOT}/angle/marks", (15.0, 30.0, 60.0), colours.MARK)
    yield from levels(log, f"{ROOT}/force/marks", (-10.0, 10.0), colours.MARK)
    if np.isfinite(agent.stiffness).any():
        for axis in AXES:
            path = f"{ROOT}/stability/{axis}/bound"
            yield from levels(log, path, (100.0,), colours.LIMIT)
    yield from levels(log, ZERO, (0.0,), colours.MARK)


def series(
    path: str, times: FloatArray, curves: Mapping[Line, FloatArray]
) -> list[Chunk]:
    """Curves (T,) of one panel; none without finite values."""
    values = np.stack(list(curves.values()), axis=1)
    if not np.isfinite(values).any():
        return []
    data = moving(path, times, rr.Scalars.columns(scalars=values))
    return [_style(path, [*curves], rr.SeriesLines), data]


def bands(
    path: str, times: FloatArray, beliefs: Mapping[Line, tuple[FloatArray, FloatArray]]
) -> list[Chunk]:
    """Means and variances (T,) of one panel as bands of ±σ; none if not finite."""
    means, variances = np.stack([*beliefs.values()], axis=2)
    if not np.isfinite(means).any():
        return []
    columns = rr.Measurements.columns(values=means.ravel(), variances=variances.ravel())
    data = moving(path, times, columns.partition(np.full(times.size, len(beliefs))))
    return [_style(path, [*beliefs], rr.Measurements), data]


def levels(
    log: EpisodeLog, path: str, values: tuple[float, ...], colour: Colour
) -> list[Chunk]:
    """Horizontal lines through the whole episode."""
    curves = {Line(f"{at:g}", colour, 1.0): np.full(2, at) for at in values}
    return series(path, log.times[[0, -1]], curves)


def _style(path: str, lines: Sequence[Line], archetype: Any) -> Chunk:
    names, tints, widths = zip(*lines, strict=True)
    return static(path, archetype.from_fields(colors=tints, widths=widths, names=names))


# --- Coloured lanes: stages of the task, and stiffness of the hand

STAGES: Final = "/stage"  # Entity of the stages, above that of every other lane.
SCALE: Final[Mapping[float, Colour]] = {
    100.0: (120, 90, 255),
    300.0: (235, 85, 160),
    500.0: (255, 236, 120),
}
"""Colour by stiffness [N/m], interpolated linearly: violet is soft, yellow is stiff."""
LEVELS: Final[Mapping[str, Colour]] = dict(
    zip(("soft, < 200 N/m", "medium", "stiff, > 400 N/m"), SCALE.values(), strict=True)
)
"""States of the lane of the stiffness, and their colours."""

_EDGES: Final = (200.0, 400.0)  # Between the states of the stiffness [N/m].
# σ grows between via-points and drops at each, three to ten times per second.
_AVERAGED: Final = 0.25  # Averaging time of displayed values [s].
_ROOM: Final = 1.02  # End of the lane of stages, in durations of the episode.
_STAGES: Final = {
    "reach": (150, 140, 255),
    "grasp": colours.BEFORE,
    "open": colours.HAND,
    "hold": (84, 190, 255),
    "stuck": (222, 120, 60),
    "success": colours.TRUTH,
    "failure": colours.FORCE,
}


def lane(
    entity: str,
    looks: Mapping[str, Colour],
    states: Sequence[tuple[float, str]],
    failure: str = "",
) -> list[Chunk]:
    """Return a lane of states that begin at times [s]; one is labelled `failure`."""
    labels = [f"failure: {failure}" if name == "failure" else name for name in looks]
    tints = np.array([*looks.values()], dtype=np.uint8)
    style = rr.StateConfiguration(values=[*looks], labels=labels, colors=tints)
    times, names = zip(*states, strict=True)
    changes = rr.StateChange.columns(state=names)
    return [static(entity, style), moving(entity, np.array(times), changes)]


def stage_lane(log: EpisodeLog) -> list[Chunk]:
    """Return the stages of an episode; the last one gets a visible width."""
    began = [(float(log.times[row]), name) for row, name in stages(log)]
    began.append((_ROOM * float(log.times[-1]), began[-1][1]))
    return lane(STAGES, _STAGES, began, log.failure)


def stages(log: EpisodeLog) -> list[tuple[int, str]]:
    """Return row and name of each stage that began, in order.

    ``reach`` if the hand did not hold the handle at the start, ``grasp``, ``open``,
    ``hold`` at the task's angle, ``stuck`` after the last progress of a stalled door,
    ``success`` from the first solved step or ``failure`` in the last.
    """
    angle, taken = log.opening.door_angle, log.opening.capability > 0
    stalled = log.failure in ("stalled", "latched") and angle.max() < SUCCESS_ANGLE
    conditions = {
        "reach": ~taken & ~taken[0],
        "grasp": taken,
        "open": angle >= math.radians(1.0),
        "stuck": stalled & (angle >= angle.max() - STALL_ANGLE),
        "hold": angle >= SUCCESS_ANGLE,
        "success": log.opening.solved.astype(bool),
    }
    began = [(int(np.argmax(at)), name) for name, at in conditions.items() if at.any()]
    if not log.opening.solved.any() and not log.success:
        began.append((log.times.size - 1, "failure"))
    # A stage that did not begin before its successor did not happen.
    followed = zip(began, [*began[1:], (log.times.size, "")], strict=True)
    return [stage for stage, following in followed if stage[0] < following[0]]


def stiffness_lane(log: EpisodeLog) -> list[Chunk]:
    """Return when the hand became soft or stiff; empty for policies without σ."""
    stiffness = mean_stiffness(log)
    finite = np.isfinite(stiffness)
    if not finite.any():
        return []
    level = np.where(finite, np.digitize(stiffness, _EDGES), -1)
    changes = np.flatnonzero((np.diff(level, prepend=-1) != 0) & finite)
    states = [(float(log.times[row]), [*LEVELS][level[row]]) for row in changes]
    return lane(f"{STAGES}/stiffness", LEVELS, states)


def recent_mean(values: FloatArray, dt: float) -> FloatArray:
    """Mean of finite values in the last 0.25 s up to every row of (T, ...), or NaN."""
    window = max(1, round(_AVERAGED / dt))
    finite = np.isfinite(values)
    start = np.zeros((window, *values.shape[1:]))
    sums = np.cumsum(np.concatenate([start, np.where(finite, values, 0.0)]), axis=0)
    counts = np.cumsum(np.concatenate([start, finite]), axis=0)
    total, count = sums[window:] - sums[:-window], counts[window:] - counts[:-window]
    return np.asarray(np.where(finite, total / np.maximum(count, 1.0), np.nan))


def mean_stiffness(log: EpisodeLog) -> FloatArray:
    """Return the mean stiffness along and across, averaged over time, (T,) [N/m]."""
    return recent_mean(log.decisions.stiffness[:, [0, 2]].mean(axis=1), log.dt)


def colour_of(stiffness: FloatArray, unknown: Colour) -> NDArray[np.uint8]:
    """Colours of stiffnesses (N,) [N/m], ``unknown`` where NaN, (N, 3) in 0 to 255."""
    finite = np.isfinite(stiffness)
    scale, ends = np.array([*SCALE]), np.array([*SCALE.values()], float)
    shades = interpolated(np.where(finite, stiffness, 0.0), scale, ends)
    return np.where(finite[:, None], shades, unknown).round().astype(np.uint8)
