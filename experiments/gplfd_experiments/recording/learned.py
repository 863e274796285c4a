"""What a method learned, as a recording: demonstrations, mean and tube, and σ."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import Chunk

from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.recording import colours
from gplfd_experiments.recording.layout import (
    TEXT,
    Eye,
    as_chunks,
    only,
    series_view,
    view_3d,
)
from gplfd_experiments.recording.panels import Line, line_style
from gplfd_experiments.recording.stream import moving, recording_file, static
from gplfd_experiments.recording.tube import QUANTILE, tube_triangles, tube_vertices
from gplfd_policies.movements.movement import Movement

_SCENE: Final = "/learned"
_PLOTS: Final = "/outputs"
_OUTPUTS: Final = (
    *(("x", "x [m]", 1.0), ("y", "y [m]", 1.0), ("z", "z [m]", 1.0)),
    *((f"turn_{axis}", f"θu_{axis} [°]", 180.0 / math.pi) for axis in ("x", "y", "z")),
)
"""Entity, title and scale of each output."""
_PHASES: Final = np.linspace(0.0, 1.0, 200)
_LINE: Final = 0.002
"""Of the scene's size: half the width of a line."""
_OPACITY: Final = 90


def record_learned(path: str | Path, movement: Movement, name: str) -> None:
    """Write an .rrd of a movement and what it was learned from, complete or not at all.

    The movement plays at its own duration; the six outputs are beside it, with the
    demonstrations as they were aligned. ``name`` is the method's.
    """
    demonstrated = movement.aligned.poses
    text = f"""\
### What `{name}` learned from {len(demonstrated)} recordings

Grey: the recordings, aligned. Violet: the mean and its tube, ±1.96 σ per axis (normal \
quantile; with few recordings less than 95 %). Where recordings agree the tube is \
narrow, and a robot that follows it is stiff; where they differ it is wide and soft. \
Playing takes {movement.duration:.1f} s, the recordings' mean duration.
"""
    page = rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN)
    with recording_file(path, _layout(demonstrated)) as stream:
        stream.send_recording_name(f"what {name} learned")
        chunks = [*_scene(movement), *_outputs(movement), static(TEXT, page)]
        stream.send_chunks(chunks)


def _scene(movement: Movement) -> list[Chunk]:
    """Demonstrations, mean, tube, and a hand that moves along the mean."""
    aligned, learned = movement.aligned, movement.predict(_PHASES)
    line = _LINE * _size(aligned.poses)
    mean = learned.mean[:, :3]
    vertices, normals = tube_vertices(mean, np.nan_to_num(learned.std[:, :3]))
    # Quaternions (x, y, z, w) of the rotation vectors.
    turns = learned.mean[:, 3:]
    angle = np.sqrt(np.sum(turns**2, axis=1, keepdims=True))
    axis = 0.5 * np.sinc(0.5 * angle / np.pi) * turns
    hand = rr.Transform3D.columns(
        translation=mean, quaternion=np.hstack([axis, np.cos(angle / 2)])
    )
    demonstrated = [poses[:, :3] for poses in aligned.poses]
    looks: dict[str, Any] = {
        "demonstrations": rr.LineStrips3D(
            demonstrated, colors=colours.DEMONSTRATION, radii=line
        ),
        "mean": rr.LineStrips3D([mean], colors=colours.ADAPTED, radii=2.0 * line),
        "tube": rr.Mesh3D(
            vertex_positions=vertices,
            vertex_normals=normals,
            triangle_indices=tube_triangles(),
            albedo_factor=(*colours.ADAPTED, _OPACITY),
        ),
        "hand": rr.TransformAxes3D(0.12 * _size(aligned.poses)),
    }
    return [
        *(static(f"{_SCENE}/{name}", look) for name, look in looks.items()),
        moving(f"{_SCENE}/hand", movement.duration * _PHASES, hand),
    ]


def _outputs(movement: Movement) -> Iterator[Chunk]:
    """Every output over time: demonstrations, mean and band."""
    aligned, learned = movement.aligned, movement.predict(_PHASES)
    lines = [
        Line(f"demonstration {number}", colours.DEMONSTRATION, 1.0)
        for number in range(len(aligned.poses))
    ]
    for output, (name, _, scale) in enumerate(_OUTPUTS):
        demonstrated, believed = (
            f"{_PLOTS}/{name}/{each}" for each in ("demonstrations", "learned")
        )
        yield line_style(demonstrated, *lines)
        curves = rr.Scalars.columns(scalars=scale * aligned.poses[:, :, output].T)
        yield moving(demonstrated, movement.duration * aligned.times, curves)
        band = Line("mean, ±1.96 σ", colours.ADAPTED)
        yield line_style(believed, band, archetype=rr.Measurements)
        std = QUANTILE * scale * np.nan_to_num(learned.std[:, output])
        values = rr.Measurements.columns(
            values=scale * learned.mean[:, output], variances=std**2
        )
        yield moving(believed, movement.duration * _PHASES, values)


def _size(demonstrated: FloatArray) -> float:
    """Return how large the motion is [m]."""
    return max(float(np.ptp(demonstrated[..., :3], axis=(0, 1)).max()), 1e-3)


def _layout(demonstrated: FloatArray) -> tuple[Chunk, ...]:
    """Look at the middle of the motion from beside and above it."""
    positions = demonstrated[..., :3].reshape(-1, 3)
    middle = 0.5 * (positions.min(axis=0) + positions.max(axis=0))
    eye = Eye(
        position=middle + _size(demonstrated) * np.array([1.2, 1.0, 1.2]),
        target=middle,
        up=(0.0, 1.0, 0.0),
    )
    scene = view_3d("What was shown and learned", _SCENE, [f"{_SCENE}/**"], eye)
    page = rrb.TextDocumentView(origin=TEXT, name="About")
    plots = [series_view(f"{_PLOTS}/{name}", title) for name, title, _ in _OUTPUTS]
    views = rrb.Horizontal(
        rrb.Vertical(scene, page, row_shares=[4, 1]),
        rrb.Vertical(*plots[:3]),
        rrb.Vertical(*plots[3:]),
        column_shares=[5, 3, 3],
    )
    return as_chunks(only(views))
