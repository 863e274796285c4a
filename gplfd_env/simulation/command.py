"""Inputs of a simulation: the meaning of an action, external loads, further rates."""

import math
import reprlib
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import mujoco
import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike

from gplfd_env.conventions.constants import GRIPPER_WIDTH, Array, Control, Mask, Vector
from gplfd_env.doors.variation import Variation
from gplfd_env.robot.config import RobotConfig
from gplfd_env.robot.model import COMMAND_LIMITS, SERVO_DAMPING, SERVO_STIFFNESS
from gplfd_env.robot.placement import standoff_pose
from gplfd_env.robot.whole_body import SPEED, Planar
from gplfd_env.validation.fields import real_array

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
        self, action: object, shape: tuple[int, ...], ignored: Mask | None = None
    ) -> Array:
        """Return a finite action anew, `ignored` rows at rest; or ValueError."""
        try:
            command = real_array(action)
        except (TypeError, ValueError, OverflowError):
            raise ValueError(
                f"the action must be numbers of shape {shape}, {self.meaning}; got "
                f"{reprlib.repr(action)}"
            ) from None
        if command.shape != shape:
            wanted = f"the action must have shape {shape}, {self.meaning}"
            raise ValueError(f"{wanted}; got shape {command.shape}")
        if ignored is not None:
            command[ignored] = self.rest
        # For a single action a loop over floats is faster than NumPy's reduction.
        flat = command.ravel().tolist()
        if not all(map(math.isfinite, flat)):
            raise ValueError(
                f"the action must be finite, got {command.tolist()}; look for "
                "divisions by zero or an unstable integrator in the policy"
            )
        return command

    def clamped(self, commands: Array) -> Array:
        """Return commands within the bounds of the action space, (..., n)."""
        return np.minimum(np.maximum(commands, self.low), self.high)


def _command(control: Control, further: str, extra: ArrayLike, **more: Any) -> Command:
    """Return a command of a pose and further entries (least, greatest, rest)."""
    pose = np.column_stack([-_POSE_LIMIT, _POSE_LIMIT, np.zeros(6)])
    low, high, rest = np.vstack([pose, np.reshape(extra, (-1, 3))]).T.copy()
    meaning = f"commanded position [m] and rotation vector [rad] of the hand{further}"
    bounds = {"low": low, "high": high, "rest": rest}
    return Command(control=control, meaning=meaning, **bounds, **more)


COMMANDS: Final[dict[Control, Command]] = {
    "pose": _command("pose", " in the task frame", []),
    "impedance": _command(
        "impedance",
        " in the task frame, and its stiffness on these axes [N/m, N m/rad]",
        np.column_stack([_SOFTEST, _STIFFEST, _STIFFEST]),
    ),
}
"""Commands by kind of control."""

DRIVEN: Final = _command(
    "pose",
    " in the task frame, and twist of the base in its own axes [m/s, rad/s]",
    [(-limit, limit, 0.0) for limit in (SPEED[0], SPEED[0], SPEED[1])],
    drives=True,
)
"""The pose of the hand and the twist of the base."""

GRIPPING: Final = _command(
    "pose",
    " in the task frame, and width of the gripper between its fingers [m]",
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
        self._biases = model.actuator_biasprm[:6, 1:3]

    def set(self, stiffness: Array) -> None:
        """Set the gains by a stiffness (6,) [N/m, N m/rad], clamped to its range."""
        clamped = np.minimum(np.maximum(stiffness, _SOFTEST), _STIFFEST)
        self._gain[:], self._biases[:, 0] = clamped, -clamped
        self._biases[:, 1] = np.sqrt(clamped) * _DAMPING_OF_ROOT


class Loads(NamedTuple):
    """External loads on the bodies of a simulation."""

    hand: Vector  # Force on the gripper, world frame [N].
    forearm: Vector  # Force on the forearm, world frame [N].
    hinge: float  # Torque on the leaf about the upward axis [N m].
    stop: float  # Angle at which the leaf meets a stop [rad].
    friction: float  # Coulomb friction of the hinge [N m].

    @property
    def wrenches(self) -> tuple[tuple[float, ...], ...]:
        """Force and torque on gripper, forearm and leaf, world frame [N, N m]."""
        still = (0.0, 0.0, 0.0)
        leaf = (*still, 0.0, 0.0, self.hinge)
        return (*self.hand, *still), (*self.forearm, *still), leaf


class ExtraInputs(NamedTuple):
    """Inputs of simulations besides the hands' commands, by row of the simulation."""

    loads: dict[int, Loads]  # External loads, of episodes with a disturbance.
    base_rates: dict[int, Planar]  # Commanded rates of mobile bases.
    gripper_widths: dict[int, float]  # Commanded widths of movable fingers [m].

    def of(self, rows: Collection[int]) -> "ExtraInputs":
        """Return the inputs of some simulations."""
        parts: Any = [{row: x[row] for row in rows if row in x} for x in self]
        return ExtraInputs(*parts)


NO_EXTRA_INPUTS: Final = ExtraInputs({}, {}, {})
