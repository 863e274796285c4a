"""A picture of motions as they were recorded and as they are learned from."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gplfd_experiments.data.preparation import Motion
from gplfd_experiments.files.arrays import FloatArray

_COMPONENTS = ("x", "y", "z")


def draw(motions: Sequence[Motion], path: Path) -> None:
    """Write a picture: before on the left, after on the right.

    Positions are in the upper row, orientations below: the components of the recorded
    quaternions, and of the rotation vectors that were made of them.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 6.5), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(2, 2)
    for motion in motions:
        before, after = motion.recorded, motion.demonstration
        clock = before.times - before.times[0]
        _lines(axes[0, 0], clock, before.poses[:, :3])
        _lines(axes[1, 0], clock, before.poses[:, 3:])
        _lines(axes[0, 1], after.times - after.times[0], after.poses[:, :3])
        _lines(axes[1, 1], after.times - after.times[0], after.poses[:, 3:])
    titles = (
        ("recorded: position [m]", "prepared: position [m]"),
        ("recorded: quaternion", "prepared: rotation vector [rad]"),
    )
    names = ((_COMPONENTS, _COMPONENTS), (("w", *_COMPONENTS), _COMPONENTS))
    for row in range(2):
        for column in range(2):
            one = axes[row, column]
            one.set_title(titles[row][column], loc="left", fontsize=10)
            one.legend(one.lines[: len(names[row][column])], names[row][column])
            one.grid(alpha=0.3)
            if row:
                one.set_xlabel("time since the first sample [s]")
    figure.savefig(path, dpi=110)


def _lines(axes: Any, times: FloatArray, columns: FloatArray) -> None:
    for place, column in enumerate(np.asarray(columns).T):
        axes.plot(times, column, color=f"C{place}", linewidth=0.8, alpha=0.7)
