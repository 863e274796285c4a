"""Environments with ids of version 0: version 1, but only with a fixed base.

Under version 0 a driving base exceeded the limits of its drive. With a fixed base both
versions give the same numbers, bit for bit.
"""

from collections.abc import Callable
from typing import Any

from gplfd_env import (
    ENVIRONMENT_ID,
    GRIPPER_ENVIRONMENT_ID,
    IMPEDANCE_ENVIRONMENT_ID,
    RL_ENVIRONMENT_ID,
)
from gplfd_env.envs.door_opening import DoorOpeningEnv, DoorOpeningImpedanceEnv
from gplfd_env.envs.gripper import DoorOpeningGripperEnv, DoorOpeningGripperVectorEnv
from gplfd_env.envs.reinforcement import door_opening_rl, door_opening_rl_vector
from gplfd_env.envs.vector import DoorOpeningImpedanceVectorEnv, DoorOpeningVectorEnv


def _standing(make: Callable[..., Any], successor: str) -> Callable[..., Any]:
    """Return the entry point of version 1, changed to refuse a driving base."""

    def refusing_mobile_base(**arguments: Any) -> Any:
        own = getattr(arguments.get("robot"), "base", "fixed")
        if (arguments.get("base") or own) == "mobile":
            raise ValueError(
                f'base="mobile" needs {successor}: under version 0 a driving base '
                "exceeded the limits of its drive"
            )
        return make(**arguments)

    # Gymnasium reads the render modes of an entry point, to collect pictures itself.
    refusing_mobile_base.metadata = DoorOpeningEnv.metadata  # type: ignore[attr-defined]
    return refusing_mobile_base


door_opening = _standing(DoorOpeningEnv, ENVIRONMENT_ID)
door_opening_vector = _standing(DoorOpeningVectorEnv, ENVIRONMENT_ID)
impedance = _standing(DoorOpeningImpedanceEnv, IMPEDANCE_ENVIRONMENT_ID)
impedance_vector = _standing(DoorOpeningImpedanceVectorEnv, IMPEDANCE_ENVIRONMENT_ID)
gripper = _standing(DoorOpeningGripperEnv, GRIPPER_ENVIRONMENT_ID)
gripper_vector = _standing(DoorOpeningGripperVectorEnv, GRIPPER_ENVIRONMENT_ID)
rl = _standing(door_opening_rl, RL_ENVIRONMENT_ID)
rl_vector = _standing(door_opening_rl_vector, RL_ENVIRONMENT_ID)
