"""Time series beside the scene, all on the same time axis."""

import functools
import itertools
from typing import Final, NamedTuple

import numpy as np
import rerun as rr
from numpy.typing import NDArray
from rerun.chunk import Chunk

from experiments.episodes.log import EpisodeLog
from experiments.recording import colours
from experiments.recording.colours import Colour
from experiments.recording.part import Part
from experiments.recording.stream import moving, seconds, static
from experiments.recording.tube import QUANTILE

FloatArray = NDArray[np.float64]

ROOT: Final = "/plots"
ANGLE_MARKS_DEG: Final = (15.0, 30.0, 60.0)
ZERO: Final = f"{ROOT}/zero"
"""Entity of a line at zero, which keeps zero in sight where a panel shows it too."""

OUTPUTS: Final = (("x", 0, 1.0), ("z", 2, 1.0), ("turn", 4, 180.0 / np.pi))
"""Entity, output number and scale to the panel's unit of the policy panels: the three
outputs in which opening a door varies."""

SHOWN_AXES: Final = [0, 2]
"""Outputs in the panels of uncertainty and stiffness: x and z."""


class Line(NamedTuple):
    """One curve of a panel or the centre line of a band."""

    name: str
    values: FloatArray
    colour: Colour
    width: float = 2.0


def panels(part: Part) -> list[Chunk]:
    """Every time series of the layout; where a value is not finite, nothing is drawn.

    A series that is not finite in the whole episode, as the stiffness of a policy
    without any, is left out.
    """
    log, index = part.log, seconds(part.log.times[part.first_row :])
    angle = Line("door", np.degrees(log.door_angle), colours.TRUTH, 2.5)
    forces = (
        Line("opens the door", log.force_tangential, colours.TRUTH, 1.5),
        Line("fights the hinge", log.force_radial, colours.FORCE, 1.5),
    )
    curves = {f"{ROOT}/angle/door": (angle,), f"{ROOT}/force/parts": forces}
    for panel, values in (
        ("uncertainty", 1e3 * log.std),
        ("uncertainty_rate", 1e3 * log.std_rate),
        ("stiffness", log.stiffness),
        ("stability", 100.0 * share_of_bound(log)),
    ):
        x, z = values[:, SHOWN_AXES].T
        lines = (Line("x", x, colours.AXIS_X), Line("z", z, colours.AXIS_Z))
        curves[f"{ROOT}/{panel}/axes"] = lines
    for name, output, scale in OUTPUTS:
        true, hand = scale * log.handle_pose[:, output], scale * log.ee_pose[:, output]
        curves[f"{ROOT}/{name}/motion"] = (
            Line("true", true, colours.TRUTH, 3.0),
            Line("hand", hand, colours.HAND, 1.0),
        )
    drawn = [_lines(part, index, path, *lines) for path, lines in curves.items()]
    return [
        *itertools.chain.from_iterable(drawn),
        *_beliefs(part, index),
        *_levels(part, f"{ROOT}/angle/marks", ANGLE_MARKS_DEG, colours.MARK),
        *_levels(part, f"{ROOT}/stability/bound", (100.0,), colours.LIMIT),
        *_levels(part, ZERO, (0.0,), colours.MARK),
    ]


def share_of_bound(log: EpisodeLog) -> FloatArray:
    """Stiffness rate over its stability bound, (T, 6); stable below 1.

    The bound itself is positive: it is that of a stiffness above zero.
    """
    share: FloatArray = log.stiffness_rate / (log.stiffness_rate + log.stability_margin)
    return share


def before_adaptation(log: EpisodeLog) -> tuple[FloatArray, FloatArray] | None:
    """First forecast at the observed phases: mean and std (T, 6), None without one."""
    if log.forecast_times.size == 0:
        return None

    def at_observed(values: FloatArray) -> FloatArray:
        columns = [
            np.interp(log.observed_phase, log.forecast_phase, column)
            for column in values.T
        ]
        return np.stack(columns, axis=1)

    return at_observed(log.forecast_mean[0]), at_observed(log.forecast_std[0])


def _lines(
    part: Part, index: list[rr.TimeColumn], path: str, *lines: Line
) -> list[Chunk]:
    """Curves of one panel."""
    values = np.stack([line.values for line in lines], axis=1)
    if not part.shows(values):
        return []
    columns = rr.Scalars.columns(scalars=values[part.first_row :])
    data = moving(path, index, columns)
    look = tuple((line.name, line.colour, line.width) for line in lines)
    return [_lines_style(path, look), data] if part.begins(values) else [data]


def _levels(
    part: Part, path: str, levels: tuple[float, ...], colour: Colour
) -> list[Chunk]:
    """Horizontal lines through the whole part."""
    ends = part.log.times[[part.first_row, -1]]
    columns = rr.Scalars.columns(scalars=np.tile(levels, (2, 1)))
    data = moving(path, seconds(ends), columns)
    look = tuple((f"{level:g}", colour, 1.0) for level in levels)
    return [data] if part.first_row else [_lines_style(path, look), data]


def _beliefs(part: Part, index: list[rr.TimeColumn]) -> list[Chunk]:
    """Mean and ±1.96 σ of each output, before the door was felt and now.

    The viewer draws a band of one standard deviation, so variances are scaled.
    """
    log, chunks = part.log, []
    now = Line("policy now", log.predicted_mean, colours.ADAPTED, 1.0)
    beliefs = [(now, log.predicted_std)]
    before = before_adaptation(log)
    if before is not None:
        first = Line("before", before[0], colours.BEFORE, 1.0)
        beliefs.insert(0, (first, before[1]))
    means = np.stack([line.values for line, _ in beliefs], axis=1)
    variances = np.stack([(QUANTILE * std) ** 2 for _, std in beliefs], axis=1)
    for name, output, scale in OUTPUTS:
        path, mean = f"{ROOT}/{name}/belief", scale * means[..., output]
        if not part.shows(mean):
            continue
        columns = rr.Measurements.columns(
            values=mean[part.first_row :].ravel(),
            variances=scale**2 * variances[part.first_row :, :, output].ravel(),
        )
        each = np.full(len(mean) - part.first_row, len(beliefs))
        if part.begins(mean):
            look = tuple((line.name, line.colour, line.width) for line, _ in beliefs)
            chunks.append(_bands_style(path, look))
        chunks.append(moving(path, index, columns.partition(each)))
    return chunks


@functools.cache
def _lines_style(path: str, look: tuple[tuple[str, Colour, float], ...]) -> Chunk:
    names, tints, widths = zip(*look, strict=True)
    return static(path, rr.SeriesLines(colors=tints, widths=widths, names=names))


@functools.cache
def _bands_style(path: str, look: tuple[tuple[str, Colour, float], ...]) -> Chunk:
    names, tints, widths = zip(*look, strict=True)
    style = rr.Measurements.from_fields(colors=tints, widths=widths, names=names)
    return static(path, style)
