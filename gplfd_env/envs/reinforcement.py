"""``gplfd/DoorOpeningRL-v1``: the pose environment for reinforcement learning."""

from typing import Any

import gymnasium as gym

from gplfd_env import wrappers
from gplfd_env.envs.door_opening import DoorOpeningEnv
from gplfd_env.envs.vector import DoorOpeningVectorEnv


def door_opening_rl(**arguments: Any) -> gym.Env[Any, Any]:
    """Return one door in `RelativeAction`, `GentleReward` and `FlatObservation`."""
    refuse_reward(arguments)
    relative = wrappers.RelativeAction(DoorOpeningEnv(**arguments))
    return wrappers.FlatObservation(wrappers.GentleReward(relative))


# Gymnasium reads the render modes of an entry point, to collect pictures itself.
door_opening_rl.metadata = DoorOpeningEnv.metadata  # type: ignore[attr-defined]


def door_opening_rl_vector(
    num_envs: int = 1, **arguments: Any
) -> gym.vector.VectorEnv[Any, Any, Any]:
    """Return n simulations: `DoorOpeningVectorEnv` in the same wrappers."""
    refuse_reward(arguments)
    return for_learners(DoorOpeningVectorEnv(num_envs, **arguments))


def for_learners(envs: DoorOpeningVectorEnv) -> gym.vector.VectorEnv[Any, Any, Any]:
    """Return a vector environment in the wrappers of ``gplfd/DoorOpeningRL-v1``."""
    relative = wrappers.VectorRelativeAction(envs)
    return wrappers.VectorFlatObservation(wrappers.VectorGentleReward(relative))


def refuse_reward(arguments: dict[str, Any]) -> None:
    """Raise a ValueError if a reward is given: the wrappers have their own."""
    if "reward" in arguments:
        raise ValueError(
            "gplfd/DoorOpeningRL-v1 has its own reward; for others wrap "
            f"gplfd/DoorOpening-v1; got reward={arguments['reward']!r}"
        )
