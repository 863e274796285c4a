"""A learned movement as a recording: demonstrations, mean, tube and σ."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import Chunk
from scipy.spatial.transform import Rotation

from gplfd_experiments.recording import colours
from gplfd_experiments.recording.layout import Plot, series_view, view_3d
from gplfd_experiments.recording.motion import QUANTILE, tube_triangles, tube_vertices
from gplfd_experiments.recording.panels import Line, bands, series
from gplfd_experiments.recording.stream import (
    TEXT,
    moving,
    page,
    static,
    write_recording,
)
from gplfd_policies.movements.movement import Movement

_SCENE: Final = "/learned"
_PLOTS: Final = "/outputs"
# Entity, title and scale of each output.
_OUTPUTS: Final = (
    *(("x", "x [m]", 1.0), ("y", "y [m]", 1.0), ("z", "z [m]", 1.0)),
    *((f"turn_{axis}", f"θu_{axis} [°]", 180.0 / math.pi) for axis in ("x", "y", "z")),
)
_PHASES: Final = np.linspace(0.0, 1.0, 200)
_LINE: Final = 0.002  # Half the width of a line, as a share of the scene's size.
_OPACITY: Final = 90


def record_learned(path: str | Path, movement: Movement, name: str) -> None:
    """Write an .rrd of a movement and its demonstrations, complete or not at all.

    The movement plays in its own duration, beside the six outputs with the aligned
    demonstrations. ``name`` is the method's.
    """
    demonstrated = movement.aligned.poses[:, :, :3]
    low, high = demonstrated.min(axis=(0, 1)), demonstrated.max(axis=(0, 1))
    size = max(float((high - low).max()), 1e-3)
    # The view is from the side and above, towards the middle of the motion.
    middle = 0.5 * (low + high)
    eye = (middle + size * np.array([1.2, 1.0, 1.2]), middle, (0.0, 1.0, 0.0))
    scene = view_3d(
        "Demonstrations and learned movement", _SCENE, [f"{_SCENE}/**"], eye
    )
    about = rrb.TextDocumentView(origin=TEXT, name="About")
    plots = [series_view(Plot(*output[:2]), _PLOTS) for output in _OUTPUTS]
    views = rrb.Horizontal(
        rrb.Vertical(scene, about, row_shares=[4, 1]),
        rrb.Vertical(*plots[:3]),
        rrb.Vertical(*plots[3:]),
        column_shares=[5, 3, 3],
    )
    chunks = _chunks(movement, size, name)
    write_recording(path, f"what {name} learned", views, chunks)


def _chunks(movement: Movement, size: float, name: str) -> Iterator[Chunk]:
    """Return scene, curves and page of a movement; ``size`` is the scene's [m]."""
    aligned, learned = movement.aligned, movement.predict(_PHASES)
    times, mean = movement.duration * _PHASES, learned.mean[:, :3]
    # Demonstrations, mean, tube, and a hand that moves along the mean.
    vertices, normals = tube_vertices(mean, np.nan_to_num(learned.std[:, :3]))
    strips, width = list(aligned.poses[:, :, :3]), _LINE * size
    looks: dict[str, Any] = {
        "demonstrations": rr.LineStrips3D(
            strips, colors=colours.DEMONSTRATION, radii=width
        ),
        "mean": rr.LineStrips3D([mean], colors=colours.ADAPTED, radii=2.0 * width),
        "tube": rr.Mesh3D(
            vertex_positions=vertices,
            vertex_normals=normals,
            triangle_indices=tube_triangles(),
            albedo_factor=(*colours.ADAPTED, _OPACITY),
        ),
        "hand": rr.TransformAxes3D(0.12 * size),
    }
    for entity, look in looks.items():
        yield static(f"{_SCENE}/{entity}", look)
    turns = Rotation.from_rotvec(learned.mean[:, 3:]).as_quat()
    hand = rr.Transform3D.columns(translation=mean, quaternion=turns)
    yield moving(f"{_SCENE}/hand", times, hand)

    # Every output over time: demonstrations, mean and band.
    band = Line("mean, ±1.96 σ", colours.ADAPTED)
    for output, (entity, _, scale) in enumerate(_OUTPUTS):
        curves = {
            Line(f"demonstration {number}", colours.DEMONSTRATION, 1.0): scale * curve
            for number, curve in enumerate(aligned.poses[:, :, output])
        }
        aligned_times = movement.duration * aligned.times
        yield from series(f"{_PLOTS}/{entity}/demonstrations", aligned_times, curves)
        std = QUANTILE * scale * np.nan_to_num(learned.std[:, output])
        belief = {band: (scale * learned.mean[:, output], std**2)}
        yield from bands(f"{_PLOTS}/{entity}/learned", times, belief)
    yield page(f"""\
### What `{name}` learned from {len(aligned.poses)} recordings

Grey: the recordings, aligned. Violet: the mean and its tube, ±1.96 σ per axis (normal \
quantile; with few recordings less than 95 %). Where recordings agree the tube is \
narrow, and a robot that follows it is stiff; where they differ it is wide and soft. \
Playing takes {movement.duration:.1f} s, the recordings' mean duration.
""")
