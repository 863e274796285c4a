"""Wrappers for learning: other forms of actions, observations and rewards.

Each wrapper exists for single environments and, with the prefix ``Vector``, for vector
environments; both give the same numbers, bit for bit. ``gplfd/DoorOpeningRL-v1`` is
``gplfd/DoorOpening-v1`` in three of them: `RelativeAction`, `GentleReward`,
`FlatObservation`.
"""

from gplfd_env.task.opening import FAILURES, REASONS
from gplfd_env.wrappers.forms import (
    LIMITS,
    FlatObservation,
    NumericInfo,
    RelativeAction,
    VectorFlatObservation,
    VectorNumericInfo,
    VectorRelativeAction,
    action_of,
    command_of,
    flat_of,
)
from gplfd_env.wrappers.gentle_reward import GentleReward, VectorGentleReward

__all__ = [
    "FAILURES",
    "LIMITS",
    "REASONS",
    "FlatObservation",
    "GentleReward",
    "NumericInfo",
    "RelativeAction",
    "VectorFlatObservation",
    "VectorGentleReward",
    "VectorNumericInfo",
    "VectorRelativeAction",
    "action_of",
    "command_of",
    "flat_of",
]
