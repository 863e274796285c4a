"""Doors as people name them on a command line or in a file."""

import hashlib
from collections.abc import Sequence

from gplfd_env.config import DoorConfig, door_config
from gplfd_env.stance import base_for, check_reach


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


def named_doors(doors: Sequence[str]) -> dict[str, DoorConfig]:
    """Configurations by name, for names of doors and for radii as text.

    Raises:
        ValueError: No door, an unknown one, one out of reach, or one given twice.
    """
    if not doors:
        raise ValueError("--doors needs at least one door: a name or a radius [m]")
    configs: dict[str, DoorConfig] = {}
    for given in doors:
        try:
            radius = float(given)
        except ValueError:
            name, config = given, door_config(given)
        else:
            name, config = f"{radius:g}", door_config(radius)
        if name in configs:
            raise ValueError(f"door {name} is given twice in --doors")
        check_reach(config, base_for(config))
        configs[name] = config
    return configs
