"""Time series beside the scene, all on the same time axis."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from experiments.episode_log import EpisodeLog
from experiments.recording import colours
from experiments.recording.colours import Colour
from experiments.recording.stream import seconds
from experiments.recording.tube import QUANTILE

FloatArray = NDArray[np.float64]

ROOT: Final = "/plots"
ANGLE_MARKS_DEG: Final = (15.0, 30.0, 60.0)
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


def log_panels(stream: rr.RecordingStream, log: EpisodeLog) -> None:
    """Log every time series of the layout, each as columns."""
    for name, output, scale in OUTPUTS:
        _log_output(stream, log, name, output, scale)
    for panel, values in (
        ("uncertainty", 1e3 * log.std),
        ("uncertainty_rate", 1e3 * log.std_rate),
        ("stiffness", log.stiffness),
        ("stability", 100.0 * share_of_bound(log)),
    ):
        x, z = values[:, SHOWN_AXES].T
        lines = (Line("x", x, colours.AXIS_X), Line("z", z, colours.AXIS_Z))
        _log_lines(stream, f"{ROOT}/{panel}/axes", log.times, *lines)
    _log_levels(stream, f"{ROOT}/stability/bound", log, (100.0,), colours.LIMIT)
    angle = Line("door", np.degrees(log.door_angle), colours.TRUTH, 2.5)
    _log_lines(stream, f"{ROOT}/angle/door", log.times, angle)
    _log_levels(stream, f"{ROOT}/angle/marks", log, ANGLE_MARKS_DEG, colours.MARK)
    forces = (
        Line("opens the door", log.force_tangential, colours.TRUTH, 1.5),
        Line("fights the hinge", log.force_radial, colours.FORCE, 1.5),
    )
    _log_lines(stream, f"{ROOT}/force/parts", log.times, *forces)


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


def _log_output(
    stream: rr.RecordingStream, log: EpisodeLog, name: str, output: int, scale: float
) -> None:
    """Log one output's belief before the door, belief now, and what happened."""
    root = f"{ROOT}/{name}"
    before = before_adaptation(log)
    if before is not None:
        mean, std = (scale * values[:, output] for values in before)
        line = Line("before", mean, colours.BEFORE, 1.0)
        _log_band(stream, f"{root}/before", log.times, line, std)
    mean = scale * log.predicted_mean[:, output]
    std = scale * log.predicted_std[:, output]
    line = Line("policy now", mean, colours.ADAPTED, 1.0)
    _log_band(stream, f"{root}/predicted", log.times, line, std)
    lines = (
        Line("true", scale * log.handle_pose[:, output], colours.TRUTH, 3.0),
        Line("hand", scale * log.ee_pose[:, output], colours.HAND, 1.0),
    )
    _log_lines(stream, f"{root}/motion", log.times, *lines)


def _log_levels(
    stream: rr.RecordingStream,
    path: str,
    log: EpisodeLog,
    levels: Sequence[float],
    colour: Colour,
) -> None:
    """Log horizontal lines through the whole episode."""
    lines = (Line(f"{level:g}", np.full(2, level), colour, 1.0) for level in levels)
    _log_lines(stream, path, log.times[[0, -1]], *lines)


def _log_lines(
    stream: rr.RecordingStream, path: str, times: FloatArray, *lines: Line
) -> None:
    """Log curves where all of them are finite; nothing when they never are."""
    values = np.stack([line.values for line in lines], axis=1)
    known = np.isfinite(values).all(axis=1)
    if not known.any():
        return
    style = rr.SeriesLines(
        colors=[line.colour for line in lines],
        widths=[line.width for line in lines],
        names=[line.name for line in lines],
    )
    stream.log(path, style, static=True)
    columns = rr.Scalars.columns(scalars=values[known])
    stream.send_columns(path, seconds(times[known]), columns)


def _log_band(
    stream: rr.RecordingStream,
    path: str,
    times: FloatArray,
    line: Line,
    std: FloatArray,
) -> None:
    """Log a line with its band of ±1.96 σ where it is finite.

    The viewer draws a band of one standard deviation, so the variance is scaled.
    """
    known = np.isfinite(line.values) & np.isfinite(std)
    if not known.any():
        return
    style = rr.Measurements.from_fields(
        colors=line.colour, widths=line.width, names=line.name
    )
    stream.log(path, style, static=True)
    columns = rr.Measurements.columns(
        values=line.values[known], variances=(QUANTILE * std[known]) ** 2
    )
    stream.send_columns(path, seconds(times[known]), columns)
