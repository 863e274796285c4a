"""Declaration of the keys of an info, for one simulation and for many."""

from collections.abc import Mapping
from operator import attrgetter
from typing import Any, Final, NamedTuple

import numpy as np

from gplfd_env.conventions.one_and_many import columns
from gplfd_env.task.episode import Episode
from gplfd_env.task.episodes import Episodes
from gplfd_env.task.opening import FAILURES
from gplfd_env.task.stages import REASONS, STAGES


class Entry(NamedTuple):
    """A key of an info."""

    kind: type  # Type of its value: array for vectors, ``str`` for text.
    source: str  # Attribute of an episode; for text the index into `texts`.
    meaning: str  # Short description.
    unit: str = ""  # Empty if it has none.
    texts: tuple[str, ...] = ()  # Possible values of a text.


_ARRAY: Final = np.ndarray

INFO: Final[Mapping[str, Entry]] = {
    "door_angle": Entry(float, "readings.door.angle", "opening angle", "rad"),
    "opening": Entry(float, "opening", "`door_angle` divided by the success angle"),
    "door_velocity": Entry(float, "readings.door.velocity", "its rate", "rad/s"),
    "door_radius": Entry(float, "constants.radius", "R of the present door", "m"),
    "slip": Entry(float, "slip", "of the hand from the grasped point", "m"),
    "force_tangential": Entry(
        float, "readings.door.forces.tangential", "hand on handle, opening it", "N"
    ),
    "force_radial": Entry(
        float, "readings.door.forces.radial", "hand on handle, away from the hinge", "N"
    ),
    "force_vertical": Entry(
        float, "readings.door.forces.vertical", "hand on handle, upwards", "N"
    ),
    "push_force": Entry(float, "effects.push_force", "force of a push", "N"),
    "person_force": Entry(
        float, "effects.person_force", "greatest force on a person, last period", "N"
    ),
    "person_energy": Entry(
        float, "effects.person_energy", "work done on a person since the reset", "J"
    ),
    "base_shift": Entry(
        float, "effects.base_distance", "how far a bump moved the base", "m"
    ),
    "stop_force": Entry(
        float, "stop_force", "door on its stop, at the handle's radius", "N"
    ),
    "handle_angle": Entry(
        float, "readings.door.handle_angle", "of a lever or knob; 0 of a bar", "rad"
    ),
    "bolt": Entry(
        float, "readings.door.bolt", "how far it is drawn in; 0 without a latch", "m"
    ),
    "closer_torque": Entry(
        float, "closer_torque", "of closer, seal and stiction", "N m"
    ),
    "capability": Entry(int, "progress.stage", "the furthest stage so far, 0 to 10"),
    "handle_pose": Entry(_ARRAY, "handle_pose", "pose of the grasped point", "m, rad"),
    "base_pose": Entry(
        _ARRAY, "readings.base.pose", "relative to its pose at the reset", "m, rad"
    ),
    "base_velocity": Entry(_ARRAY, "readings.base.velocity", "its rate", "m/s, rad/s"),
    "success": Entry(bool, "progress.opening.success", "opened, and held open"),
    "is_success": Entry(bool, "progress.opening.success", "the same as `success`"),
    "grasped": Entry(bool, "readings.door.grasped", "both fingers touch the handle"),
    "simulation_error": Entry(
        bool, "progress.simulation_error", "the simulation has diverged"
    ),
    "failure": Entry(str, "failure", "kind of failure", texts=FAILURES),
    "reason": Entry(str, "reason", "reason of the failure", texts=REASONS),
    "stage": Entry(str, "progress.stage", "name of `capability`", texts=STAGES),
    "reward_terms": Entry(dict, "progress.terms", "their sum is the reward"),
}
"""Every key, in the order of the info."""

TEXTS: Final = tuple(name for name, entry in INFO.items() if entry.kind is str)
"""Keys whose values are text."""

_ALL_OF: Final = attrgetter(*[entry.source for entry in INFO.values()])
_VECTORS: Final = tuple(name for name, entry in INFO.items() if entry.kind is _ARRAY)
_WORDS: Final = tuple((name, INFO[name].texts) for name in TEXTS)
_WORD_ARRAYS: Final = {name: np.array(words, dtype=object) for name, words in _WORDS}


def info_of(episode: Episode) -> dict[str, Any]:
    """Return the info of an episode of one simulation."""
    info = dict(zip(INFO, _ALL_OF(episode), strict=False))
    for name in _VECTORS:
        info[name] = np.array(info[name])
    for name, words in _WORDS:
        info[name] = words[info[name]]
    return info


def infos_of(episodes: Episodes) -> dict[str, Any]:
    """Return the infos of n episodes as new arrays (n, ...)."""
    n = episodes.n
    infos = dict(zip(INFO, _ALL_OF(episodes), strict=True))
    for name, value in infos.items():
        kind = INFO[name].kind
        if kind is dict:
            infos[name] = {term: columns((x,), n)[:, 0] for term, x in value.items()}
        elif kind is _ARRAY:
            infos[name] = columns(value, n)
        elif kind is str:
            infos[name] = _WORD_ARRAYS[name][value]
        else:
            infos[name] = np.empty(n, kind)
            infos[name][:] = value
    return infos
