"""Time series beside the scene, all on the same time axis."""

import itertools
import math
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np
import rerun as rr
from rerun.chunk import Chunk

from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.metrics import share_of_bound
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.recording import colours
from gplfd_experiments.recording.colours import Colour
from gplfd_experiments.recording.lanes import recent_mean
from gplfd_experiments.recording.stream import moving, static
from gplfd_experiments.recording.tube import QUANTILE

ROOT: Final = "/plots"
ANGLE_MARKS_DEG: Final = (15.0, 30.0, 60.0)
FORCE_MARKS: Final = (-10.0, 10.0)
"""Lines in the panel of forces [N]; they fix the scale, so that forces of a few newtons
look small."""
ZERO: Final = f"{ROOT}/zero"
"""Entity of a line at zero, which keeps zero in the range of a panel."""

OUTPUTS: Final = (("x", 0, 1.0), ("z", 2, 1.0), ("turn", 4, 180.0 / np.pi))
"""Entity, output number and scale factor of the policy panels, for the three outputs
that move when a door opens."""


class Line(NamedTuple):
    """Style of a curve of a panel, or of the centre line of a band."""

    name: str
    colour: Colour
    width: float = 2.0


def panels(log: EpisodeLog, demonstrated_radius: float) -> list[Chunk]:
    """Return every time series of the layout; values that are not finite are not drawn.

    A series without finite values, such as the stiffness of a policy without stiffness,
    is left out. ``demonstrated_radius`` is the mean radius of the demonstrated paths
    [m]; NaN if they are not circles.
    """
    agent, forces, opening = log.decisions, log.forces, log.opening
    curves = {
        "angle/door": {
            Line("door", colours.TRUTH, 2.5): np.degrees(opening.door_angle)
        },
        "force/parts": {
            Line("along the path", colours.TRUTH): forces.force_tangential,
            Line("radial: against the hinge", colours.FORCE): forces.force_radial,
            Line("load compensated", colours.ADAPTED, 1.0): agent.compensated_load,
        },
        "misfit/phase": {Line("misfit", colours.HAND, 1.5): agent.phase_misfit},
        "misfit/mode": {
            Line("active mode", colours.OUTSIDE): agent.mode,
            Line("its probability", colours.ADAPTED): agent.mode_probability,
        },
    }
    in_task_frame = np.all(agent.frame == np.eye(3))
    along = Line("x, pull" if in_task_frame else "along the path", colours.AXIS_X)
    across = Line("z, side" if in_task_frame else "across it", colours.AXIS_Z)
    for panel, values in (
        ("uncertainty", recent_mean(1e3 * agent.std, log.dt)),
        ("stiffness", recent_mean(agent.stiffness, log.dt)),
        ("uncertainty_raw", 1e3 * agent.std),
        ("uncertainty_rate", 1e3 * agent.std_rate),
        ("stiffness_raw", agent.stiffness),
        ("stability", 100.0 * share_of_bound(log)),
    ):
        curves[f"{panel}/axes"] = {along: values[:, 0], across: values[:, 2]}
    lag = Line("lag of the hand", colours.OUTSIDE, 1.0)
    curves["uncertainty/axes"][lag] = 1e3 * agent.path_lag

    # Mean and ±1.96 σ of each output, before the door moved and now.
    bands: dict[str, dict[Line, tuple[FloatArray, FloatArray]]] = {}
    now = Line("policy now", colours.ADAPTED, 1.0)
    beliefs = {now: (agent.predicted_mean, agent.predicted_std)}
    if log.forecasts.times.size:
        before = Line("before", colours.BEFORE, 1.0)
        beliefs = {before: log.forecasts.first(agent.observed_phase)} | beliefs
    for name, output, scale in OUTPUTS:
        curves[f"{name}/motion"] = {
            Line("true", colours.TRUTH, 3.0): scale * opening.handle_pose[:, output],
            Line("hand", colours.HAND, 1.0): scale * log.motion.ee_pose[:, output],
        }
        bands[f"{name}/belief"] = {
            line: (scale * mean[:, output], scale**2 * (QUANTILE * std[:, output]) ** 2)
            for line, (mean, std) in beliefs.items()
        }

    # Size of the path in % of the demonstrations' mean, ±1.96 σ of its logarithm. The
    # median is not the middle of the band, so it has its own curve.
    bounds = QUANTILE * np.stack([-agent.path_size_std, agent.path_size_std])
    low, high = 100.0 * agent.path_size * np.exp(bounds)
    sizes = Line("±1.96 σ", colours.ADAPTED, 0.0)
    bands["size/belief"] = {sizes: (0.5 * (low + high), 0.25 * (high - low) ** 2)}
    if np.isfinite(low).any():
        median = Line("policy now", colours.ADAPTED)
        curves["size/curves"] = {median: 100.0 * agent.path_size}
        if log.config.handle == "bar" and math.isfinite(demonstrated_radius):
            truth = 100.0 * log.config.hand_radius / demonstrated_radius
            true = Line("true", colours.TRUTH)
            curves["size/curves"][true] = np.full_like(low, truth)

    # Force of the hand along the path: expected ±1.96 σ, and measured.
    expected, std = (
        agent.expected_force[:, 0],
        agent.expected_force_std[:, 0],
    )
    line = Line("expected", colours.ADAPTED)
    bands["expected/belief"] = {line: (expected, (QUANTILE * std) ** 2)}
    if np.isfinite(expected).any():
        # The expected force acts on the handle, the measured force on the hand.
        measured = -np.sum(agent.frame[:, :, 0] * forces.wrench[:, :3], axis=1)
        curves["expected/force"] = {Line("measured", colours.HAND, 1.5): measured}

    chunks = [_bands(log, f"{ROOT}/{path}", of) for path, of in bands.items()]
    chunks += [lines(log, f"{ROOT}/{path}", of) for path, of in curves.items()]
    return [
        *itertools.chain.from_iterable(chunks),
        *levels(log, f"{ROOT}/angle/marks", ANGLE_MARKS_DEG, colours.MARK),
        *levels(log, f"{ROOT}/force/marks", FORCE_MARKS, colours.MARK),
        *levels(log, f"{ROOT}/stability/bound", (100.0,), colours.LIMIT),
        *levels(log, ZERO, (0.0,), colours.MARK),
    ]


def lines(log: EpisodeLog, path: str, curves: Mapping[Line, FloatArray]) -> list[Chunk]:
    """Curves (T,) of one panel; none without finite values."""
    values = np.stack(list(curves.values()), axis=1)
    if not np.isfinite(values).any():
        return []
    columns = rr.Scalars.columns(scalars=values)
    return [line_style(path, *curves), moving(path, log.times, columns)]


def levels(
    log: EpisodeLog, path: str, levels: tuple[float, ...], colour: Colour
) -> list[Chunk]:
    """Horizontal lines through the whole episode."""
    columns = rr.Scalars.columns(scalars=np.tile(levels, (2, 1)))
    style = line_style(path, *(Line(f"{at:g}", colour, 1.0) for at in levels))
    return [style, moving(path, log.times[[0, -1]], columns)]


def _bands(
    log: EpisodeLog, path: str, bands: Mapping[Line, tuple[FloatArray, FloatArray]]
) -> list[Chunk]:
    """Means (T,) with bands of one panel; the width is the root of a variance (T,)."""
    means, variances = np.stack([*bands.values()], axis=2)
    if not np.isfinite(means).any():
        return []
    columns = rr.Measurements.columns(values=means.ravel(), variances=variances.ravel())
    per_row = columns.partition(np.full(log.times.size, len(bands)))
    style = line_style(path, *bands, archetype=rr.Measurements)
    return [style, moving(path, log.times, per_row)]


def line_style(path: str, *lines: Line, archetype: Any = rr.SeriesLines) -> Chunk:
    """Static style of the lines of an entity."""
    names, tints, widths = zip(*lines, strict=True)
    look = archetype.from_fields(colors=tints, widths=widths, names=names)
    return static(path, look)
