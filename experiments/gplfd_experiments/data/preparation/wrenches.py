"""Recorded forces made those of the hand on what it holds.

A wrench is a force and a moment about a point, (f_x, f_y, f_z, m_x, m_y, m_z) [N, N m].
"""

from dataclasses import replace
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from gplfd_experiments.data.preparation.samples import Notes, Samples
from gplfd_experiments.data.raw import RawRecording, WrenchSensor
from gplfd_experiments.files.arrays import FloatArray

_LARGEST: Final = 1e9  # Larger forces and moments count as missing [N, N m].


def in_axes(wrenches: FloatArray, axes: Rotation) -> FloatArray:
    """Return wrenches, (N, 6), in other axes, which are given in the present ones."""
    parts = wrenches[:, :3], wrenches[:, 3:]
    return np.hstack([axes.inv().apply(part) for part in parts])


def about(wrenches: FloatArray, shift: FloatArray) -> FloatArray:
    """Return wrenches, (N, 6), about a point that is shifted [m], m - shift × f."""
    forces, moments = wrenches[:, :3], wrenches[:, 3:]
    return np.hstack([forces, moments - np.cross(shift, forces)])


def of_the_hand(
    samples: Samples, raw: RawRecording, usual: WrenchSensor, notes: Notes
) -> Samples:
    """Return samples with the wrenches of the hand on what it holds.

    They are in the axes of the recorded poses, and about the position of the recorded
    hand. With the wrench of the environment on the hand (f_s, m_s) as it was measured,
    its bias b, the sensor's rotation R and position p relative to the hand, the axes A
    of the measurement (R, or those of the poses), and the tool's weight W and centre c,

        f = -(A (f_s - b_f) - W),    m = -(A (m_s - b_m) - R c × W) + p × f.

    Wrenches that cannot be converted are left out, and a note says why. The usual
    sensor is that of recordings whose file does not say how it was recorded.
    """
    if samples.wrenches is None:
        return samples
    wrenches = np.where(np.abs(samples.wrenches) < _LARGEST, samples.wrenches, np.nan)
    sensor = raw.sensor or usual
    without = replace(samples, wrenches=None)
    shift, weight = np.array(sensor.pose[:3]), sensor.tool_weight
    turning = sensor.axes == "hand" or shift.any() or any(sensor.tool_centre)
    if raw.quaternions is None and turning:
        notes.warn(
            "forces left out: they are in the axes of the hand, and it has no "
            "orientations; say --force-axes recorded if they are in those of positions"
        )
        return without
    hand = Rotation.from_quat(samples.poses[:, 3:], scalar_first=True)
    rotation = hand * Rotation.from_quat(sensor.pose[3:], scalar_first=True)
    axes = rotation if sensor.axes == "hand" else Rotation.identity()
    measured = wrenches if sensor.acts_on == "hand" else -wrenches
    if weight > 0.0:
        pull = weight * np.array(sensor.gravity) / np.linalg.norm(sensor.gravity)
        moments = np.cross(rotation.apply(sensor.tool_centre), pull)
        tool = np.hstack([np.broadcast_to(pull, moments.shape), moments])
        measured = measured - in_axes(tool, axes)
        notes.add(f"weight of {weight:g} N taken from the forces")
    if sensor.rest > 0.0:
        known = np.isfinite(measured).all(axis=1) & (samples.times <= sensor.rest)
        if not known.any():
            notes.warn(f"forces left out: none in the first {sensor.rest:g} s")
            return without
        bias = measured[known].mean(axis=0)
        measured = measured - bias
        notes.add(
            f"bias of {np.linalg.norm(bias[:3]):.3g} N and "
            f"{np.linalg.norm(bias[3:]):.3g} N m taken from the forces"
        )
    if raw.sensor is None:
        whose = "sensor" if sensor.axes == "hand" else "poses"
        notes.add(f"forces are on the {sensor.acts_on}, in the axes of the {whose}")
    recorded = in_axes(measured, axes.inv())
    return replace(samples, wrenches=-about(recorded, -hand.apply(shift)))


def bridged(samples: Samples, largest: float, notes: Notes) -> Samples:
    """Return samples with missing wrenches interpolated between known ones.

    Where none is known for longer than the largest gap [s], all are left out.
    """
    wrenches, times = samples.wrenches, samples.times
    if wrenches is None:
        return samples
    known = np.isfinite(wrenches).all(axis=1)
    if known.all():
        return samples
    ends = np.concatenate([times[:1], times[known], times[-1:]])
    longest = int(np.argmax(np.diff(ends)))
    gap = float(ends[longest + 1] - ends[longest])
    if not known.any() or gap > max(largest, 1.5 * samples.step):
        notes.warn(
            f"forces left out: there are none for {gap:.2f} s from "
            f"{ends[longest]:.2f} s on; cut there (--segment), or bridge it with "
            f"--largest-gap {gap + 0.01:.2f}"
        )
        return replace(samples, wrenches=None)
    notes.add(f"forces of {np.count_nonzero(~known)} samples interpolated")
    columns = wrenches[known].T
    filled = [np.interp(times, times[known], column) for column in columns]
    return replace(samples, wrenches=np.column_stack(filled))
