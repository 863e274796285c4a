"""Declaration of the keys of an info."""

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np

from gplfd_env.task.opening import FAILURES, REASONS, STAGES


class Entry(NamedTuple):
    """A key of an info."""

    kind: type  # Type of its value: array for vectors, ``str`` for text.
    meaning: str  # Short description.
    unit: str = ""  # Empty if it has none.
    texts: tuple[str, ...] = ()  # Possible values of a text.


_ARRAY: Final = np.ndarray

INFO: Final[Mapping[str, Entry]] = {
    "door_angle": Entry(float, "opening angle", "rad"),
    "opening": Entry(float, "`door_angle` divided by the success angle"),
    "door_velocity": Entry(float, "its rate", "rad/s"),
    "door_radius": Entry(float, "R of the present door", "m"),
    "slip": Entry(float, "of the hand from the grasped point", "m"),
    "force_tangential": Entry(float, "hand on handle, opening it", "N"),
    "force_radial": Entry(float, "hand on handle, away from the hinge", "N"),
    "force_vertical": Entry(float, "hand on handle, upwards", "N"),
    "push_force": Entry(float, "force of a push", "N"),
    "person_force": Entry(float, "greatest force on a person, last period", "N"),
    "person_energy": Entry(float, "work done on a person since the reset", "J"),
    "base_shift": Entry(float, "how far a bump moved the base", "m"),
    "stop_force": Entry(float, "door on its stop, at the handle's radius", "N"),
    "handle_angle": Entry(float, "of a lever or knob; 0 of a bar", "rad"),
    "bolt": Entry(float, "how far it is drawn in; 0 without a latch", "m"),
    "closer_torque": Entry(float, "of closer, seal and stiction", "N m"),
    "capability": Entry(int, "the furthest stage so far, 0 to 10"),
    "handle_pose": Entry(_ARRAY, "pose of the grasped point", "m, rad"),
    "base_pose": Entry(_ARRAY, "relative to its pose at the reset", "m, rad"),
    "base_velocity": Entry(_ARRAY, "its rate", "m/s, rad/s"),
    "success": Entry(bool, "opened, and held open"),
    "is_success": Entry(bool, "the same as `success`"),
    "grasped": Entry(bool, "both fingers touch the handle"),
    "simulation_error": Entry(bool, "the simulation has diverged"),
    "failure": Entry(str, "kind of failure", texts=FAILURES),
    "reason": Entry(str, "reason of the failure", texts=REASONS),
    "stage": Entry(str, "name of `capability`", texts=STAGES),
    "reward_terms": Entry(dict, "their sum is the reward"),
}
"""Every key, in the order of the info."""

TEXTS: Final = tuple(name for name, entry in INFO.items() if entry.kind is str)
"""Keys whose values are text."""
VECTORS: Final = tuple(name for name, entry in INFO.items() if entry.kind is _ARRAY)
"""Keys whose values are vectors."""
