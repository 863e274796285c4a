"""The arena: physics options, light, floor and cameras."""

import math
from typing import Final

import mujoco
import numpy as np

from gplfd_env.conventions.constants import INTANGIBLE, Array
from gplfd_env.doors.config import MOTIONS, DoorConfig
from gplfd_env.doors.motion import carried, end_angle, links_of
from gplfd_env.doors.variation import Placement
from gplfd_env.robot.config import RobotConfig
from gplfd_env.robot.placement import handle_position_w, task_rotation_w

PHYSICS_STEP: Final = 0.002
"""Physics time step [s]."""
CASING: Final = 0.11
"""Width of frame and casing beyond the leaf [m]."""
DOOR_HEIGHT: Final = 2.00
"""Height of every leaf [m]."""
FLAP_WIDTH: Final = 0.60
"""Width of a leaf that turns about a level hinge [m]."""

_ASPECT: Final = 4.0 / 3.0
_FIELD_OF_VIEW: Final = math.radians(40.0)
# Margin around the points that a camera has to show, as a factor.
_MARGIN: Final = 1.03
# Opening angles at which leaf and robot have to be in the picture.
_SHOWN_ANGLES: Final = np.radians(np.linspace(0.0, 75.0, 6))
# Radius and height of upright cylinders around the robot's base and head [m].
_BASE_SIZE: Final = (0.29, 0.35)
_HEAD_SIZE: Final = (0.18, 1.55)


def add_arena(spec: mujoco.MjSpec, door: DoorConfig, robot: RobotConfig) -> None:
    """Set the physics options and add light, floor and two fixed cameras.

    An elliptic cone with a large ``impratio`` prevents creep of a friction grasp: with
    MuJoCo's defaults the bar is lost under a sustained pull.
    """
    spec.option.timestep = PHYSICS_STEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 100.0
    spec.stat.center = [0.55, 0.45, 0.8]
    spec.stat.extent = 1.8
    spec.visual.global_.offwidth = 1280
    spec.visual.global_.offheight = 960
    spec.visual.headlight.ambient = [0.4] * 3
    spec.visual.headlight.diffuse = [0.2] * 3
    spec.visual.headlight.specular = [0.1] * 3
    spec.visual.map.znear = 0.02
    # Surfaces near the border of the area with shadows would be speckled.
    spec.visual.map.shadowclip = 2.5
    kind, pattern = mujoco.mjtTexture, mujoco.mjtBuiltin
    sky = {"rgb1": [0.92, 0.95, 0.98], "rgb2": [0.70, 0.78, 0.86]}
    sky |= {"type": kind.mjTEXTURE_SKYBOX, "builtin": pattern.mjBUILTIN_GRADIENT}
    spec.add_texture(name="sky", width=64, height=384, **sky)
    tiles = {"rgb1": [0.80, 0.80, 0.79], "rgb2": [0.74, 0.74, 0.73]}
    tiles |= {"type": kind.mjTEXTURE_2D, "builtin": pattern.mjBUILTIN_CHECKER}
    spec.add_texture(name="tiles", width=128, height=128, **tiles)
    material = spec.add_material(name="tiles", texrepeat=[8, 8], reflectance=0.0)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "tiles"
    plane = {"type": mujoco.mjtGeom.mjGEOM_PLANE, "size": [4, 4, 0.1]}
    spec.worldbody.add_geom(name="floor", material="tiles", **plane, **INTANGIBLE)
    light = {"type": mujoco.mjtLightType.mjLIGHT_DIRECTIONAL}
    light |= {"pos": [0.0, -1.5, 3.0], "dir": [0.25, 0.55, -1.0]}
    light |= {"diffuse": [0.4] * 3, "specular": [0.1] * 3}
    spec.worldbody.add_light(name="window", **light)

    # Azimuth of "overview" relative to the door's normal, and elevation: chosen in
    # steps of 15° and 10° by the number of visible pixels of hand and handle with the
    # door closed, half open and fully open.
    turn, elevation = -door.hinge_sign * math.radians(45.0), math.radians(-27.0)
    if door.swing == "push":
        turn, elevation = math.radians(30.0), math.radians(-32.0)
    elif robot.base == "fixed" and (door.handle, door.hinge_side) != ("bar", "right"):
        turn = door.hinge_sign * math.radians(75.0)
    points = _shown_points(door, robot)
    into_door = -task_rotation_w(door, robot)[:, 0]
    heading = math.atan2(into_door[1], into_door[0]) + turn
    level = np.array([math.cos(heading), math.sin(heading), 0.0])
    upward = np.array([0.0, 0.0, 1.0])
    forward = math.cos(elevation) * level + math.sin(elevation) * upward
    for name, direction, up in (
        ("overview", forward, upward),
        ("top", -upward, into_door),
    ):
        right = np.cross(direction, up)
        right /= np.linalg.norm(right)
        axes = np.column_stack([right, np.cross(right, direction), -direction])
        place = axes @ _camera_position(points @ axes)
        view = {
            "xyaxes": [*axes[:, 0], *axes[:, 1]],
            "fovy": math.degrees(_FIELD_OF_VIEW),
        }
        spec.worldbody.add_camera(name=name, pos=place, **view)


def _camera_position(points: Array) -> Array:
    """Return the nearest camera position that shows all points, in its axes [m].

    A point (x, y, z), with axes right, up and backward, is in the picture of a camera
    at c if |x - c_x| <= (c_z - z) t with the tangent t of half the field of view, and
    likewise in y: linear in c.
    """
    vertical = math.tan(_FIELD_OF_VIEW / 2.0) / _MARGIN
    tangents = np.array([_ASPECT * vertical, vertical])
    depth = points[:, 2:] * tangents
    greatest = (points[:, :2] + depth).max(axis=0)
    least = (points[:, :2] - depth).min(axis=0)
    distance = ((greatest - least) / (2.0 * tangents)).max()
    return np.array([*((greatest + least) / 2.0), distance])


def _shown_points(door: DoorConfig, robot: RobotConfig) -> Array:
    """Return corners of the leaf and the robot while the door opens, world (N, 3) [m].

    A mobile base turns with the leaf about the hinge while it pulls, and moves straight
    with the handle while it pushes: a decimetre from `gplfd_env.robot.whole_body`.
    """
    axes = task_rotation_w(door, robot)
    floor = handle_position_w(door, Placement(), robot) * [1.0, 1.0, 0.0]
    hinge = floor - door.hinge_sign * door.hand_radius * axes[:, 2]
    to_lock = door.hinge_sign * axes[:, 2]
    frame_end = door.radius + door.leaf.backset + CASING
    around = np.arange(8) * (math.pi / 4.0)
    circle = np.stack([np.cos(around), np.sin(around), np.zeros(8)], axis=1)
    sizes = (_BASE_SIZE[0], 0.0), _BASE_SIZE, _HEAD_SIZE
    outline = np.vstack([size * circle + high * axes[:, 1] for size, high in sizes])
    leaf, around_robot = [], [outline]
    for depth in (-0.08, 0.08):
        wall = hinge + (depth - door.leaf.handle_standoff) * axes[:, 0]
        leaf += [wall - CASING * to_lock, wall + frame_end * to_lock]
    links, ends = links_of(door), np.zeros((3, 6))
    ends[1:, 2] = door.hinge_sign * np.array([-door.radius, door.leaf.backset])
    if door.motion == "folding":
        ends[1, 2] = -door.hinge_sign * door.fold_distance
    elif door.level:
        ends[1:, 2] = -FLAP_WIDTH / 2.0, FLAP_WIDTH / 2.0
    for angle in _SHOWN_ANGLES.clip(max=end_angle(door)):
        moved, *opened = carried(links, angle, ends)[:, :3]
        leaf += list(floor + opened @ axes.T)
        if robot.base == "fixed":
            continue
        if MOTIONS[door.motion].upright_hinge and door.swing == "pull":
            sine, cosine = door.hinge_sign * math.sin(angle), math.cos(angle)
            turned = sine * np.cross([0.0, 0.0, 1.0], -hinge)
            around_robot.append(hinge - cosine * hinge + turned + outline)
        else:
            around_robot.append(axes @ (moved * [1.0, 0.0, 1.0]) + outline)
    high = (DOOR_HEIGHT + CASING) * axes[:, 1]
    points: Array = np.concatenate([leaf, leaf + high, *around_robot])
    return points
