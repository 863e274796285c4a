"""Boxes and rods of a door in MuJoCo, by default without contact."""

from collections.abc import Sequence
from typing import Any, Final

import mujoco

from gplfd_env.conventions.constants import INTANGIBLE

STEEL: Final = (0.55, 0.57, 0.60, 1.0)

_SEEN: Final[dict[str, Any]] = {**INTANGIBLE, "mass": 0.0}


def add_box(
    body: mujoco.MjsBody,
    name: str,
    place: Sequence[float],
    size: Sequence[float],
    colour: Sequence[float],
    **attributes: Any,
) -> None:
    """Add a box of no mass at a place, with half of its lengths [m]."""
    box: dict[str, Any] = {"type": mujoco.mjtGeom.mjGEOM_BOX, "pos": place}
    box |= {"size": size, "rgba": colour} | _SEEN | attributes
    body.add_geom(name=name, **box)


def add_rod(
    body: mujoco.MjsBody,
    name: str,
    ends: Sequence[float],
    radius: float,
    colour: Sequence[float] = STEEL,
    **attributes: Any,
) -> None:
    """Add a cylinder of no mass between two ends, (6,) [m]."""
    rod: dict[str, Any] = {"type": mujoco.mjtGeom.mjGEOM_CYLINDER, "fromto": ends}
    rod |= {"size": [radius, 0, 0], "rgba": colour} | _SEEN | attributes
    body.add_geom(name=name, **rod)
