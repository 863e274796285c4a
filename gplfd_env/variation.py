"""What may differ from one episode to the next besides the door itself."""

from __future__ import annotations

import dataclasses
import math
import numbers
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final

from gplfd_env.config import DoorConfig


@dataclass(frozen=True, kw_only=True, slots=True)
class Placement:
    """Where the robot really stands, and how its hand holds the bar.

    The robot does not know its placement error: it takes hold of the handle where it
    finds it, calls the hand's pose there the origin, and the direction in which it
    believes the door to face the x axis. So the task frame begins at the hand, and a
    wrong heading turns the door's true arc in it.

    Raises:
        ValueError: A field is not finite or outside its range.
        TypeError: A field is not a number.
    """

    base_x: float = 0.0
    """The base is this far ahead of where it should be [m], -0.05 to 0.05."""

    base_y: float = 0.0
    """The base is this far to the left of where it should be [m], -0.05 to 0.05."""

    base_yaw: float = 0.0
    """The base is turned this far to the left [rad], -0.1 to 0.1."""

    grasp_height: float = 0.0
    """The hand holds the bar this far above its middle [m], -0.05 to 0.05."""

    grasp_depth: float = 0.0
    """The bar lies this far towards the finger tips [m], -0.008 to 0.008."""

    def __post_init__(self) -> None:
        _check(self, _PLACEMENT_RANGES)


@dataclass(frozen=True, kw_only=True, slots=True)
class SensorNoise:
    """Standard deviations of white Gaussian noise on what the robot observes.

    Raises:
        ValueError: A field is negative, too large or not finite.
        TypeError: A field is not a number.
    """

    position: float = 0.0
    """On the hand's position [m], 0 to 0.01."""

    rotation: float = 0.0
    """On the hand's rotation vector [rad], 0 to 0.1."""

    force: float = 0.0
    """On the wrist's force [N], 0 to 10."""

    torque: float = 0.0
    """On the wrist's torque [N m], 0 to 1."""

    def __post_init__(self) -> None:
        _check(self, _NOISE_RANGES)

    @property
    def silent(self) -> bool:
        """Whether there is none."""
        return not any(dataclasses.astuple(self))


@dataclass(frozen=True, kw_only=True, slots=True)
class Variation:
    """One episode's door and circumstances.

    Raises:
        ValueError: The delay is not a whole number of control periods from 0 to 10.
    """

    door: DoorConfig = field(default_factory=DoorConfig)
    """The door."""

    placement: Placement = field(default_factory=Placement)
    """How the robot stands and grasps."""

    noise: SensorNoise = field(default_factory=SensorNoise)
    """What blurs its observations."""

    delay: int = 0
    """Control periods from a command to its effect, 0 to 10."""

    def __post_init__(self) -> None:
        whole = isinstance(self.delay, numbers.Integral)
        if not whole or not 0 <= self.delay <= LONGEST_DELAY:
            raise ValueError(
                f"Variation.delay = {self.delay!r} must be a whole number of control "
                f"periods from 0 to {LONGEST_DELAY}"
            )

    def as_dict(self) -> dict[str, float]:
        """Every number by name, e.g. for logs."""
        return {
            **dataclasses.asdict(self.door),
            **dataclasses.asdict(self.placement),
            **{f"{k}_noise": v for k, v in dataclasses.asdict(self.noise).items()},
            "delay": self.delay,
        }


LONGEST_DELAY: Final = 10
"""Most control periods from a command to its effect."""

_PLACEMENT_RANGES: Final[Mapping[str, tuple[float, float, str]]] = MappingProxyType(
    {
        "base_x": (-0.05, 0.05, "m"),
        "base_y": (-0.05, 0.05, "m"),
        "base_yaw": (-0.1, 0.1, "rad"),
        "grasp_height": (-0.05, 0.05, "m"),
        "grasp_depth": (-0.008, 0.008, "m"),
    }
)
_NOISE_RANGES: Final[Mapping[str, tuple[float, float, str]]] = MappingProxyType(
    {
        "position": (0.0, 0.01, "m"),
        "rotation": (0.0, 0.1, "rad"),
        "force": (0.0, 10.0, "N"),
        "torque": (0.0, 1.0, "N m"),
    }
)


def _check(record: object, ranges: Mapping[str, tuple[float, float, str]]) -> None:
    """Turn every field into a float within its range."""
    for name, (low, high, unit) in ranges.items():
        value = getattr(record, name)
        kind = type(record).__name__
        if isinstance(value, bool) or not isinstance(value, numbers.Real):
            raise TypeError(
                f"{kind}.{name} must be a number, got {value!r} "
                f"({type(value).__name__})"
            )
        value = float(value)
        if not (math.isfinite(value) and low <= value <= high):
            raise ValueError(
                f"{kind}.{name} = {value!r} is outside [{low:g}, {high:g}] {unit}"
            )
        object.__setattr__(record, name, value)
