"""Where a robot's hand is, from its joints' positions."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from scipy.spatial.transform import Rotation

from gplfd_policies.arrays.storage import regular_file


def hand_of(urdf: Path, link: str) -> Callable[[Any], tuple[float, ...]]:
    """Return what makes position and quaternion of a link from a joint state.

    Joints that a message does not name keep their last position, zero at first.

    Args:
        urdf: Description of the robot; its meshes are not loaded.
        link: The hand.

    Raises:
        ModuleNotFoundError: yourdfpy is not installed.
        ValueError: The robot has no such link.
    """
    try:
        import yourdfpy
    except ImportError as error:
        raise ModuleNotFoundError(
            f"joint states need yourdfpy ({error}); in a checkout of gplfd: pip "
            "install '.[ros]', elsewhere: pip install 'gplfd[ros]'"
        ) from error
    regular_file(urdf, "a URDF file (--urdf)")
    robot = yourdfpy.URDF.load(
        str(urdf),
        build_scene_graph=True,
        load_meshes=False,
        load_collision_meshes=False,
    )
    if link not in robot.link_map:
        links = ", ".join(list(robot.link_map)[:40])
        raise ValueError(f"{urdf.name} has no link {link!r}; it has {links}")
    positions = dict.fromkeys(robot.actuated_joint_names, 0.0)

    def pose(message: Any) -> tuple[float, ...]:
        known = dict(zip(message.name, message.position, strict=True))
        if not known.keys() & positions.keys():
            raise ValueError(
                f"a joint state names {', '.join(known)!s:.100}, and {urdf.name} has "
                f"{', '.join(positions)!s:.200}"
            )
        positions.update({name: known[name] for name in known if name in positions})
        robot.update_cfg(positions)
        matrix = robot.get_transform(link)
        quaternion = Rotation.from_matrix(matrix[:3, :3]).as_quat(scalar_first=True)
        return (*map(float, matrix[:3, 3]), *map(float, quaternion))

    return pose
