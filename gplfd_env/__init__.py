"""Door opening with a TIAGo-like arm in MuJoCo, as a Gymnasium environment.

Importing this package registers the ids, where Gymnasium is installed; MuJoCo is loaded
only by ``gym.make``::

    import gymnasium as gym, gplfd_env
    env = gym.make("gplfd/DoorOpening-v1", door="medium")
    env = gym.make("gplfd_env:gplfd/DoorOpening-v1")  # needs no import
    envs = gym.make_vec("gplfd/DoorOpening-v1", num_envs=64, randomization="mild")
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from gplfd_env.conventions.constants import Control
from gplfd_env.doors.config import DOORS, DoorConfig
from gplfd_env.doors.disturbance import DISTURBANCES, Disturbance
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_env.doors.randomization import RANDOMIZATIONS, DoorRandomization

ENVIRONMENT_ID = "gplfd/DoorOpening-v1"
"""Commands are poses; see `gplfd_env.envs.door_opening.DoorOpeningEnv`."""

IMPEDANCE_ENVIRONMENT_ID = "gplfd/DoorOpeningImpedance-v1"
"""Commands are poses and stiffnesses; see
`gplfd_env.envs.door_opening.DoorOpeningImpedanceEnv`."""

MOBILE_ENVIRONMENT_ID = "gplfd/DoorOpeningMobile-v1"
"""Commands are poses and twists of the base; see
`gplfd_env.envs.door_opening.DoorOpeningMobileEnv`."""

GRIPPER_ENVIRONMENT_ID = "gplfd/DoorOpeningGripper-v1"
"""Commands are poses and widths of the gripper; see
`gplfd_env.envs.door_opening.DoorOpeningGripperEnv`."""

RL_ENVIRONMENT_ID = "gplfd/DoorOpeningRL-v1"
"""Flat observations, actions within ±1 relative to the hand, a reward that prefers a
gentle opening; see `gplfd_env.wrappers`."""

ENVIRONMENT_IDS: Final[Mapping[Control, str]] = MappingProxyType(
    {"pose": ENVIRONMENT_ID, "impedance": IMPEDANCE_ENVIRONMENT_ID}
)
"""Ids of the environments in which agents act, by the kind of command."""

TIME_LIMIT = 1500
"""Control periods after which an episode is truncated."""


def _register(id: str, one: str, many: str) -> None:
    try:
        import gymnasium
    except ModuleNotFoundError as error:
        if error.name != "gymnasium":
            raise
        # Without Gymnasium nothing is registered; policies still use this package.
        return
    gymnasium.register(
        id=id,
        entry_point=f"gplfd_env.envs.{one}",
        vector_entry_point=f"gplfd_env.envs.{many}",
        max_episode_steps=TIME_LIMIT,
    )


_register(ENVIRONMENT_ID, "door_opening:DoorOpeningEnv", "vector:DoorOpeningVectorEnv")
_register(
    IMPEDANCE_ENVIRONMENT_ID,
    "door_opening:DoorOpeningImpedanceEnv",
    "vector:DoorOpeningImpedanceVectorEnv",
)
_register(
    MOBILE_ENVIRONMENT_ID,
    "door_opening:DoorOpeningMobileEnv",
    "vector:DoorOpeningMobileVectorEnv",
)
_register(
    GRIPPER_ENVIRONMENT_ID,
    "door_opening:DoorOpeningGripperEnv",
    "vector:DoorOpeningGripperVectorEnv",
)
_register(
    RL_ENVIRONMENT_ID,
    "reinforcement:door_opening_rl",
    "reinforcement:door_opening_rl_vector",
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
