"""Meaning of an action: a pose, or a pose and its stiffness, base twist or width."""

import math
import reprlib
from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from gplfd_env.conventions.constants import GRIPPER_WIDTH, Array, Control
from gplfd_env.doors.variation import Variation
from gplfd_env.robot.config import RobotConfig
from gplfd_env.robot.model import COMMAND_LIMITS, SERVO_DAMPING, SERVO_STIFFNESS
from gplfd_env.robot.placement import standoff_pose
from gplfd_env.robot.whole_body import SPEED

STIFFNESS_RANGES: Final = ((20.0, SERVO_STIFFNESS[0]), (1.0, SERVO_STIFFNESS[1]))
"""Commanded stiffness: translation [N/m], rotation [N m/rad]."""

_POSE_LIMIT: Final = np.repeat(COMMAND_LIMITS, 3)
_SOFTEST: Final = np.repeat([low for low, _ in STIFFNESS_RANGES], 3)
_STIFFEST: Final = np.repeat([high for _, high in STIFFNESS_RANGES], 3)
_DAMPING_OF_ROOT: Final = -np.repeat(SERVO_DAMPING, 3) / np.sqrt(_STIFFEST)


@dataclass(frozen=True, kw_only=True, slots=True)
class Command:
    """The meaning of an action: its bounds, and `rest`, which holds the closed handle.

    If it `drives`, the last three entries are the base's twist; if it `grips`, the last
    one is the gripper's width. Error messages contain the `meaning` of the entries.
    """

    control: Control
    low: Array
    high: Array
    rest: Array
    meaning: str
    drives: bool = False
    grips: bool = False

    @property
    def space(self) -> spaces.Box:
        """The action space."""
        return spaces.Box(self.low, self.high, dtype=np.float64)

    def resting(self, variation: Variation, robot: RobotConfig) -> Array:
        """Return the action that keeps the hand at its initial pose."""
        if variation.standoff is None:
            return self.rest
        action = self.rest.copy()
        action[:6] = standoff_pose(variation.door, variation.standoff, robot)
        if self.grips:
            action[-1] = GRIPPER_WIDTH
        return action

    def check(
        self,
        action: object,
        shape: tuple[int, ...],
        ignored: NDArray[np.bool_] | None = None,
    ) -> Array:
        """Return an action as a new array with `ignored` rows set to `rest`.

        Raises a ValueError if it is not an array of finite numbers of this shape.
        """
        try:
            command = np.array(action, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            raise ValueError(
                f"the action must be numbers of shape {shape}, {self.meaning}; got "
                f"{reprlib.repr(action)}"
            ) from None
        if command.shape != shape:
            raise ValueError(
                f"the action must have shape {shape}, {self.meaning}; got shape "
                f"{command.shape}"
            )
        if ignored is not None:
            command[ignored] = self.rest
        # For a single action a loop over floats is faster than NumPy's reduction.
        flat = command.ravel().tolist()
        if not all(map(math.isfinite, flat)):
            raise ValueError(
                f"the action must be finite, got {command.tolist()}; check the policy "
                "for divisions by zero or an unstable integrator"
            )
        return command

    def clamped(self, commands: Array) -> Array:
        """Return commands within the bounds of the action space, (..., n)."""
        return np.minimum(np.maximum(commands, self.low), self.high)


def _command(control: Control, further: str, extra: ArrayLike, **more: Any) -> Command:
    """Return a command of a pose and further entries (least, greatest, rest)."""
    low, high, rest = np.reshape(extra, (-1, 3)).T
    hand = (
        "commanded position [m] and rotation vector [rad] of the hand in the task frame"
    )
    return Command(
        control=control,
        low=np.concatenate([-_POSE_LIMIT, low]),
        high=np.concatenate([_POSE_LIMIT, high]),
        rest=np.concatenate([np.zeros(6), rest]),
        meaning=hand + further,
        **more,
    )


COMMANDS: Final[dict[Control, Command]] = {
    "pose": _command("pose", "", []),
    "impedance": _command(
        "impedance",
        ", and its stiffness on these axes [N/m, N m/rad]",
        np.column_stack([_SOFTEST, _STIFFEST, _STIFFEST]),
    ),
}
"""Commands by kind of control."""

DRIVEN: Final = _command(
    "pose",
    ", and twist of the base in its own axes [m/s, rad/s]",
    [(-limit, limit, 0.0) for limit in (SPEED[0], SPEED[0], SPEED[1])],
    drives=True,
)
"""The pose of the hand and the twist of the base."""

GRIPPING: Final = _command(
    "pose",
    ", and width of the gripper between its fingers [m]",
    (0.0, GRIPPER_WIDTH, 0.0),
    grips=True,
)
"""The pose of the hand and the width of the gripper."""


class ServoGains:
    """Sets the gains of the six servos of a model.

    The force on axis i is k_i (command - pose)_i - d_i velocity_i, with the damping d =
    d₀ √(k/k₀) that keeps the damping ratio of the stiffest servo: 2√(m k) for the 4 kg
    and 0.15 kg m² of the arm's apparent inertia at the hand.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self._gain = model.actuator_gainprm[:6, 0]
        self._spring = model.actuator_biasprm[:6, 1]
        self._damper = model.actuator_biasprm[:6, 2]

    def set(self, gain: Array, spring: Array, damper: Array) -> None:
        """Set the gains from `servo_gains`, each (6,)."""
        self._gain[:] = gain
        self._spring[:] = spring
        self._damper[:] = damper


def servo_gains(stiffness: Array) -> tuple[Array, Array, Array]:
    """Return gain, position bias and velocity bias of servos with a stiffness."""
    clamped = np.minimum(np.maximum(stiffness, _SOFTEST), _STIFFEST)
    return clamped, -clamped, np.sqrt(clamped) * _DAMPING_OF_ROOT
