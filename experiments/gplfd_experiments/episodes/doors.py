"""Doors as people name them on a command line or in a file."""

import hashlib
from collections.abc import Sequence
from pathlib import Path

from gplfd_env.conventions.constants import Start
from gplfd_env.doors.config import DOORS, DoorConfig, door_config
from gplfd_env.robot.stance import base_for, check_reach
from gplfd_experiments.files.plain_data import read_json


def reset_seed(seed: int, door: str, *, drawn: bool) -> int:
    """Return the seed of an environment's reset.

    Args:
        seed: Of teacher, policy and environment.
        door: Name of the door.
        drawn: Whether the reset draws anything: then every door of a seed draws for
            itself, the same for all policies.
    """
    if not drawn:
        return seed
    digest = hashlib.sha256(f"{seed} {door}".encode()).digest()
    return int.from_bytes(digest[:4]) % 1_000_000_000


def named_doors(
    doors: Sequence[str], *, start: Start = "grasped"
) -> dict[str, DoorConfig]:
    """Configurations by name, for names of doors, radii as text, and files.

    A file FILE.json holds door parameters, as `gym.make` takes them, and its door is
    called FILE.

    Args:
        doors: What a person gave.
        start: What the episodes at these doors begin with.

    Raises:
        ValueError: No door, an unknown one, a file that holds none, one out of reach,
            or one given twice.
        OSError: A file cannot be read.
    """
    if not doors:
        raise ValueError(
            "--doors needs at least one door: a name, a radius [m] or a .json file"
        )
    configs: dict[str, DoorConfig] = {}
    for given in doors:
        name, config = _named(given)
        if name in configs:
            raise ValueError(f"door {name} is given twice in --doors")
        check_reach(config, base_for(config), start)
        configs[name] = config
    return configs


def _named(given: str) -> tuple[str, DoorConfig]:
    if given.endswith(".json"):
        return _from_file(Path(given))
    try:
        radius = float(given)
    except ValueError:
        return given, door_config(given)
    return f"{radius:g}", door_config(radius)


def _from_file(path: Path) -> tuple[str, DoorConfig]:
    if path.stem in DOORS:
        raise ValueError(
            f"{path}: {path.stem} is the name of a door already; give the file another"
        )
    try:
        return path.stem, door_config(read_json(path))
    except (ValueError, TypeError) as error:
        raise ValueError(f"{path} holds no door: {error}") from error
