"""Door opening with a TIAGo-like arm in MuJoCo, as a Gymnasium environment.

Importing this package registers the ids; MuJoCo is loaded only by ``gym.make``::

    import gymnasium as gym, gplfd_env
    env = gym.make("gplfd/DoorOpening-v0", door="medium")
    env = gym.make("gplfd_env:gplfd/DoorOpening-v0")  # needs no import
"""

import gymnasium

from gplfd_env.config import DOORS, DoorConfig

ENVIRONMENT_ID = "gplfd/DoorOpening-v0"
"""Pose commands to the Cartesian servo; see `gplfd_env.door_opening`."""

gymnasium.register(
    id=ENVIRONMENT_ID,
    entry_point="gplfd_env.door_opening:DoorOpeningEnv",
    max_episode_steps=1500,
)

__all__ = ["DOORS", "ENVIRONMENT_ID", "DoorConfig"]
