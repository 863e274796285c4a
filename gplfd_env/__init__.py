"""Door opening with a TIAGo-like arm in MuJoCo, as a Gymnasium environment.

Importing this package registers the ids, where Gymnasium is installed; MuJoCo is loaded
only by ``gym.make``, and the doors when one of their names is first used::

    import gymnasium as gym, gplfd_env
    env = gym.make("gplfd/DoorOpening-v1", door="medium")
    env = gym.make("gplfd_env:gplfd/DoorOpening-v1")  # needs no import
    envs = gym.make_vec("gplfd/DoorOpening-v1", num_envs=64, randomization="mild")
"""

from __future__ import annotations

from importlib import import_module
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from gplfd_env.conventions.constants import Control
    from gplfd_env.doors.config import DOORS, DoorConfig
    from gplfd_env.doors.disturbance import DISTURBANCES, Disturbance
    from gplfd_env.doors.geometry import DoorGeometry
    from gplfd_env.doors.randomization import RANDOMIZATIONS, DoorRandomization

ENVIRONMENT_ID = "gplfd/DoorOpening-v1"
"""Commands are poses; see `gplfd_env.envs.door_opening`, also for the next three."""
IMPEDANCE_ENVIRONMENT_ID = "gplfd/DoorOpeningImpedance-v1"
"""Commands are poses and stiffnesses."""
MOBILE_ENVIRONMENT_ID = "gplfd/DoorOpeningMobile-v1"
"""Commands are poses and twists of the base."""
GRIPPER_ENVIRONMENT_ID = "gplfd/DoorOpeningGripper-v1"
"""Commands are poses and widths of the gripper."""
RL_ENVIRONMENT_ID = "gplfd/DoorOpeningRL-v1"
"""Flat observations, actions within ±1 relative to the hand, a reward that prefers a
gentle opening; see `gplfd_env.wrappers`."""

ENVIRONMENT_IDS: Final[MappingProxyType[Control, str]] = MappingProxyType(
    {"pose": ENVIRONMENT_ID, "impedance": IMPEDANCE_ENVIRONMENT_ID}
)
"""Ids of the environments in which agents act, by the kind of command."""

TIME_LIMIT = 1500
"""Control periods after which an episode is truncated."""


try:
    import gymnasium
except ModuleNotFoundError as _error:
    # Without Gymnasium nothing is registered; policies still use this package.
    if _error.name != "gymnasium":
        raise
else:
    _names = [f"DoorOpening{_kind}" for _kind in ("", "Impedance", "Mobile", "Gripper")]
    _rl = "reinforcement:door_opening_rl"
    for _id, _single, _vector in (
        *(
            (f"gplfd/{x}-v1", f"door_opening:{x}Env", f"vector:{x}VectorEnv")
            for x in _names
        ),
        (RL_ENVIRONMENT_ID, _rl, f"{_rl}_vector"),
    ):
        gymnasium.register(
            id=_id,
            entry_point=f"gplfd_env.envs.{_single}",
            vector_entry_point=f"gplfd_env.envs.{_vector}",
            max_episode_steps=TIME_LIMIT,
        )

__all__ = [
    "DISTURBANCES",
    "DOORS",
    "ENVIRONMENT_ID",
    "ENVIRONMENT_IDS",
    "GRIPPER_ENVIRONMENT_ID",
    "IMPEDANCE_ENVIRONMENT_ID",
    "MOBILE_ENVIRONMENT_ID",
    "RANDOMIZATIONS",
    "RL_ENVIRONMENT_ID",
    "TIME_LIMIT",
    "Control",
    "Disturbance",
    "DoorConfig",
    "DoorGeometry",
    "DoorRandomization",
]


def __getattr__(name: str) -> Any:
    if name in __all__:
        modules = "conventions.constants", "doors.geometry", "doors.randomization"
        for module in (*modules, "doors.config", "doors.disturbance"):
            values = vars(import_module(f"{__name__}.{module}"))
            globals().update({key: values[key] for key in __all__ if key in values})
        return globals()[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
