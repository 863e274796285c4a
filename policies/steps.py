"""What agents decide in one control step: the records between policy and robot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, SupportsIndex

import numpy as np
from jaxtyping import Bool, Float

from policies.members import Members

__all__ = ["AgentStep", "AgentSteps", "Observation"]

Observation = Mapping[str, Float[np.ndarray, "..."]]
"""What the robot measures, by name; of a batch, one row per member."""

Pose = Float[np.ndarray, " 6"]
Poses = Float[np.ndarray, "N 6"]


@dataclass(frozen=True, kw_only=True, slots=True)
class AgentStep:
    """What an agent decided in one control step, and why.

    An agent without uncertainty or without compliance fills what it has no notion of
    with NaN.

    Attributes:
        action: Commanded hand pose, task frame [m, rad].
        desired: The policy's mean at the command phase [m, rad].
        std: The policy's standard deviation there, which sets the stiffness [m, rad].
        std_rate: Rate of the σ the controller really used, jumps included [1/s].
        stiffness: Rendered stiffness, after the governor [N/m, N m/rad].
        stiffness_rate: Its rate over this step [N/m/s, N m/rad/s].
        stability_margin: Pointwise stability bound minus `stiffness_rate`.
        phase: Command phase: where along the task the set-point is, 0..1.
        observed_phase: Where along the task the hand is, 0..1.
        predicted_mean: Mean at `observed_phase`, before this observation adapted the
            policy; the phase itself was told by it.
        predicted_std: Standard deviation there [m, rad].
        via_point: This observation was taken as a via-point.
    """

    action: Pose
    desired: Pose
    std: Pose
    std_rate: Pose
    stiffness: Pose
    stiffness_rate: Pose
    stability_margin: Pose
    phase: float
    observed_phase: float
    predicted_mean: Pose
    predicted_std: Pose
    via_point: bool

    @classmethod
    def of(cls, fields: Mapping[str, Any]) -> AgentStep:
        """Make the record from fields without leading axis: numbers of NumPy."""
        return cls(
            **{name: fields[name] for name in _POSES},
            phase=float(fields["phase"]),
            observed_phase=float(fields["observed_phase"]),
            via_point=bool(fields["via_point"]),
        )

    def __post_init__(self) -> None:
        poses = np.array([getattr(self, name) for name in _POSES], dtype=np.float64)
        poses.flags.writeable = False
        for name, pose in zip(_POSES, poses, strict=True):
            object.__setattr__(self, name, pose)


@dataclass(frozen=True, kw_only=True, slots=True)
class AgentSteps:
    """What N agents decided in one control step: the fields of `AgentStep`, stacked.

    The fields mean what they mean there; poses are (N, 6), phases (N,), ``via_point``
    is boolean (N,). A member that did not act has its last action, ``via_point`` false
    and NaN elsewhere. The record takes its arrays over: they become read-only.
    """

    action: Poses
    desired: Poses
    std: Poses
    std_rate: Poses
    stiffness: Poses
    stiffness_rate: Poses
    stability_margin: Poses
    phase: Float[np.ndarray, " N"]
    observed_phase: Float[np.ndarray, " N"]
    predicted_mean: Poses
    predicted_std: Poses
    via_point: Bool[np.ndarray, " N"]

    def __post_init__(self) -> None:
        for name in _FIELDS:
            getattr(self, name).setflags(write=False)

    def row(self, member: SupportsIndex) -> AgentStep:
        """Return what one member decided."""
        return AgentStep.of({name: getattr(self, name)[member] for name in _FIELDS})

    @classmethod
    def of(cls, steps: Sequence[AgentStep]) -> AgentSteps:
        """Stack the decisions of single agents."""
        poses = {
            name: np.reshape([getattr(step, name) for step in steps], (len(steps), 6))
            for name in _POSES
        }
        return cls(
            **poses,
            phase=np.array([step.phase for step in steps], dtype=np.float64),
            observed_phase=np.array(
                [step.observed_phase for step in steps], dtype=np.float64
            ),
            via_point=np.array([step.via_point for step in steps], dtype=np.bool_),
        )

    def among(self, members: Members, last_actions: Poses) -> AgentSteps:
        """Return the steps of a whole batch of which only these members acted.

        Args:
            members: Numbers of the rows of this record within the batch.
            last_actions: What every member of the batch last did, (N, 6).
        """
        if isinstance(members, tuple):
            return self
        count = len(last_actions)
        fields: dict[str, np.ndarray] = {
            name: np.full((count, 6), np.nan) for name in _POSES
        }
        fields |= {name: np.full(count, np.nan) for name in _PHASES}
        fields |= {
            "action": last_actions.copy(),
            "via_point": np.zeros(count, np.bool_),
        }
        for name, array in fields.items():
            array[members] = getattr(self, name)
        return AgentSteps(**fields)


_POSES: Final = (
    *("action", "desired", "std", "std_rate", "stiffness", "stiffness_rate"),
    *("stability_margin", "predicted_mean", "predicted_std"),
)
_PHASES: Final = ("phase", "observed_phase")
_FIELDS: Final = (*_POSES, *_PHASES, "via_point")
