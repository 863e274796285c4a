"""The room around robot and door: physics options, light, floor, cameras."""

from typing import Any, Final

import mujoco
import numpy as np

from gplfd_env.task import Base

PHYSICS_STEP: Final = 0.002
"""Physics time step [s]."""

INTANGIBLE: Final[dict[str, Any]] = {"contype": 0, "conaffinity": 0}
"""Of a geom that touches nothing."""

UNDRAWN: Final[dict[str, Any]] = {"size": [0.005] * 3, "rgba": [0, 0, 0, 0]}
"""Of a site that only marks a frame."""


_VIEWS: Final[dict[Base, dict[str, tuple[tuple[float, ...], ...]]]] = {
    "fixed": {
        "overview": ((-0.35, -1.75, 2.0), (0.48, 0.50, 0.82)),
        "top": ((0.55, 0.35, 3.6), (0.56, 0.37, 0.0)),
    },
    "mobile": {
        "overview": ((-2.1, 1.0, 2.5), (0.75, -0.6, 0.75)),
        "top": ((0.75, -0.6, 5.4), (0.76, -0.58, 0.0)),
    },
}
"""From where and at what two cameras look [m]; where a base drives they see its way."""


def add_room(spec: mujoco.MjSpec, base: Base = "fixed") -> None:
    """Set the physics options and add light, floor and two fixed cameras.

    An elliptic cone with a large ``impratio`` is what keeps a friction grasp from
    creeping: with MuJoCo's defaults the bar is lost under a sustained pull.

    Args:
        spec: The scene; edited in place. World frame = the robot's base_footprint.
        base: Whether it drives.
    """
    spec.option.timestep = PHYSICS_STEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = 100.0
    spec.stat.center = [0.55, 0.45, 0.8]
    spec.stat.extent = 1.8
    spec.visual.global_.offwidth = 1280
    spec.visual.global_.offheight = 960
    spec.visual.headlight.ambient = [0.3] * 3
    spec.visual.headlight.diffuse = [0.3] * 3
    spec.visual.map.znear = 0.02
    _add_floor(spec)
    spec.worldbody.add_light(
        name="window",
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        pos=[0.0, -1.5, 3.0],
        dir=[0.25, 0.55, -1.0],
        diffuse=[0.6] * 3,
        specular=[0.15] * 3,
    )
    for name, (position, target) in _VIEWS[base].items():
        _add_camera(spec, name, position, target)


def _add_camera(
    spec: mujoco.MjSpec,
    name: str,
    position: tuple[float, ...],
    target: tuple[float, ...],
) -> None:
    """Add a fixed camera that looks from a position at a target, both (3,) [m]."""
    backward = np.subtract(position, target)
    right = np.cross((0.0, 0.0, 1.0), backward)
    up = np.cross(backward, right)
    spec.worldbody.add_camera(name=name, pos=position, xyaxes=[*right, *up])


def _add_floor(spec: mujoco.MjSpec) -> None:
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.92, 0.95, 0.98],
        rgb2=[0.70, 0.78, 0.86],
        width=64,
        height=384,
    )
    spec.add_texture(
        name="tiles",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=[0.80, 0.80, 0.79],
        rgb2=[0.74, 0.74, 0.73],
        width=128,
        height=128,
    )
    material = spec.add_material(name="tiles", texrepeat=[8, 8], reflectance=0.0)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "tiles"
    spec.worldbody.add_geom(
        name="floor",
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[4, 4, 0.1],
        material="tiles",
        **INTANGIBLE,
    )
