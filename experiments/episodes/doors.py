"""Doors as people name them on a command line or in a file."""

from collections.abc import Sequence

from gplfd_env.config import DoorConfig, door_config


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
        configs[name] = config
    return configs
