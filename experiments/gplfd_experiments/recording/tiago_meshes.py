"""PAL's own meshes of TIAGo for recordings, from the user's installation.

The package ``example-robot-data`` has them; its robot description is licensed
CC BY-NC-ND 3.0. It is not part of this package: it is read from the user's
installation. A recording with the meshes contains them.
"""

import contextlib
import importlib.metadata
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from gplfd_experiments.recording.scene import BodyMeshes, LinkMesh

DISTRIBUTION: Final = "example-robot-data"
# The arm without a hand; the package has no parallel gripper, so ours is drawn.
_DESCRIPTION: Final = "tiago_description/robots/tiago_no_hand.urdf"
_BASE: Final = "base_link"


def tiago_looks(bodies: Sequence[str]) -> BodyMeshes:
    """Read PAL's visual meshes from the user's installation.

    A mesh goes to the nearest link above it that has the name of one of our bodies;
    head and wheels are in their zero position. Raises ModuleNotFoundError or ValueError
    if the description is missing or of another robot.
    """
    import yourdfpy

    files: list[importlib.metadata.PackagePath] = []
    with contextlib.suppress(importlib.metadata.PackageNotFoundError):
        files = importlib.metadata.files(DISTRIBUTION) or []
    paths = [file.locate() for file in files if str(file).endswith(_DESCRIPTION)]
    if not paths or not Path(str(path := paths[0])).is_file():
        raise ModuleNotFoundError(
            f"PAL's meshes of TIAGo come from the package {DISTRIBUTION}, which is not "
            "installed: pip install 'gplfd[tiago]' (131 MB; its licence is CC BY-NC-ND "
            "3.0)"
        )
    robot: Any = yourdfpy.URDF.load(str(path))
    if _BASE not in robot.link_map:
        raise ValueError(f"{path} is not TIAGo's description: it has no link {_BASE}")
    drawn = sum(len(link.visuals) for link in robot.robot.links)
    if len(robot.scene.geometry) < drawn:
        raise ValueError(
            f"only {len(robot.scene.geometry)} of {drawn} meshes that {path} names "
            f"could be read; install {DISTRIBUTION} again"
        )
    above = {joint.child: joint.parent for joint in robot.robot.joints}
    graph = robot.scene.graph
    meshes: dict[str, list[LinkMesh]] = {}
    for node in graph.nodes_geometry:
        link = graph.transforms.parents[node]
        body: str | None = link
        while body is not None and body not in bodies:
            body = above.get(body)
        if body is None:
            continue
        placement, geometry = graph.get(node, body)
        solid = robot.scene.geometry[geometry].copy().apply_transform(placement)
        carried = meshes.setdefault(body, [])
        mesh = LinkMesh(
            name=f"{link}_{len(carried)}",
            vertices=solid.vertices[solid.faces].reshape(-1, 3),
            normals=np.repeat(solid.face_normals, 3, axis=0),
            colour=tuple(int(channel) for channel in solid.visual.main_color),
        )
        carried.append(mesh)
    return meshes
