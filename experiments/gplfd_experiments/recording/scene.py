"""Robot and door: their bodies drawn once, and moved by transforms."""

import mujoco
import rerun as rr
from rerun.chunk import Chunk

from gplfd_experiments.recording.geoms import drawn_geoms, visual_geoms, xyzw
from gplfd_experiments.recording.kinematics import ROOT, body_poses, entity_of_body
from gplfd_experiments.recording.part import Part
from gplfd_experiments.recording.stream import moving, seconds, static, stretch
from gplfd_experiments.recording.tiago_meshes import TiagoLooks


def drawn_scene(model: mujoco.MjModel, looks: TiagoLooks | None = None) -> list[Chunk]:
    """Every visible geom, on the entity of the body that carries it.

    Args:
        model: The model that the episode ran in.
        looks: Meshes to draw in place of the robot's own shapes.
    """
    up = static(ROOT, rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    shown = model if looks is None else looks.undressed(model)
    entities = {body: entity_of_body(shown, body) for body in visual_geoms(shown)}
    chunks = [up, *drawn_geoms(shown, entities)]
    return chunks if looks is None else [*chunks, *looks.drawn(model)]


def moved_scene(model: mujoco.MjModel, part: Part) -> list[Chunk]:
    """The poses of all bodies that can move, by forward kinematics of ``qpos``.

    Args:
        model: The model that the episode ran in.
        part: Part of the episode to show.
    """
    bodies = [body for body in visual_geoms(model) if body != 0]
    frames = part.frames()
    positions, quaternions = body_poses(model, part.log.qpos[frames], bodies)
    # One conversion for all bodies, of which each gets its stretch.
    columns = rr.Transform3D.columns(
        translation=positions.reshape(-1, 3),
        quaternion=xyzw(quaternions).reshape(-1, 4),
    )
    index, size = seconds(part.log.times[frames]), frames.size
    return [
        moving(
            entity_of_body(model, body), index, stretch(columns, number * size, size)
        )
        for number, body in enumerate(bodies)
    ]
