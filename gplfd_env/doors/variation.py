"""Circumstances of an episode: placement, initial pose, sensor noise, delay."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from statistics import NormalDist
from typing import Final

import numpy as np

from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.disturbance import Disturbance
from gplfd_env.validation.fields import Quantities, allowed_range, quantity


@dataclass(frozen=True, kw_only=True, slots=True)
class Placement(Quantities):
    """Placement error of the robot and of its grasp, which the robot does not know.

    The task frame's origin is the pose of the hand at the grasp, and its x axis is the
    direction that the robot believes the door to face. A heading error therefore turns
    the door's true arc in the task frame.
    """

    base_x: float = quantity(0.0, unit="m", low=-0.05, high=0.05)
    """The base is this far ahead of where it should be."""
    base_y: float = quantity(0.0, unit="m", low=-0.05, high=0.05)
    """The base is this far to the left of where it should be."""
    base_yaw: float = quantity(0.0, unit="rad", low=-0.1, high=0.1)
    """The base is turned this far to the left."""
    grasp_height: float = quantity(0.0, unit="m", low=-0.05, high=0.05)
    """The hand grasps the bar this far above its middle."""
    grasp_depth: float = quantity(0.0, unit="m", low=-0.008, high=0.008)
    """The bar lies this far towards the finger tips."""
    belief_x: float = quantity(0.0, unit="m", low=-0.09, high=0.09)
    belief_y: float = quantity(0.0, unit="m", low=-0.09, high=0.09)
    belief_z: float = quantity(0.0, unit="m", low=-0.09, high=0.09)
    """Error of the believed grasp, at which the task frame is: along the pulling
    direction, upwards, to the left of someone facing the door."""
    belief_rx: float = quantity(0.0, unit="rad", low=-0.3, high=0.3)
    belief_ry: float = quantity(0.0, unit="rad", low=-0.3, high=0.3)
    belief_rz: float = quantity(0.0, unit="rad", low=-0.3, high=0.3)
    """Rotation vector from the true to the believed grasp, along the same axes."""

    @property
    def belief(self) -> tuple[float, ...]:
        """Pose of the believed grasp relative to the true one, (6,) [m, rad]."""
        return dataclasses.astuple(self)[-6:]

    @property
    def true(self) -> Placement:
        """The same placement without an error of the believed grasp."""
        return dataclasses.replace(self, **dict.fromkeys(_BELIEFS, 0.0))


BELIEF_LIMIT: Final = 3.0
"""Largest error of the believed grasp in standard deviations."""

_BELIEFS: Final = tuple(field_.name for field_ in dataclasses.fields(Placement))[-6:]


@dataclass(frozen=True, kw_only=True, slots=True)
class Standoff(Quantities):
    """Initial position of the open hand before the handle, turned as to grasp it."""

    distance: float = quantity(0.15, unit="m", low=0.10, high=0.20)
    """Distance from the grasp."""
    aside: float = quantity(0.0, unit="rad", low=-0.25, high=0.25)
    """Direction from the grasp: angle to the left of straight back."""
    above: float = quantity(0.0, unit="rad", low=-0.25, high=0.25)
    """Direction from the grasp: angle above straight back."""

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Standoff:
        """Return a standoff with every field drawn uniformly from its range."""
        names = [declared.name for declared in dataclasses.fields(cls)]
        ranges = [allowed_range(cls, name) for name in names]
        drawn = [rng.uniform(allowed.low, allowed.high) for allowed in ranges]
        return cls(**dict(zip(names, drawn, strict=True)))


@dataclass(frozen=True, kw_only=True, slots=True)
class Perception(Quantities):
    """Standard deviations of the error of the believed grasp, per axis."""

    position: float = quantity(0.0, unit="m", low=0.0, high=0.03)
    """Standard deviation of its position."""
    rotation: float = quantity(0.0, unit="rad", low=0.0, high=0.1)
    """Standard deviation of its rotation vector."""

    def drawn(self, rng: np.random.Generator) -> dict[str, float]:
        """Draw fields of `Placement`: Gaussian, truncated at `BELIEF_LIMIT`.

        The number of draws is always the same. With equal generators, the errors of two
        records have the ratio of their standard deviations.
        """
        normal = NormalDist()
        low = normal.cdf(-BELIEF_LIMIT)
        shares = low + (1.0 - 2.0 * low) * rng.random(6)
        stds = 3 * [self.position] + 3 * [self.rotation]
        pairs = zip(_BELIEFS, stds, shares.tolist(), strict=True)
        return {name: std * normal.inv_cdf(share) for name, std, share in pairs}


@dataclass(frozen=True, kw_only=True, slots=True)
class SensorNoise(Quantities):
    """Standard deviations of white Gaussian noise on what the robot observes."""

    position: float = quantity(0.0, unit="m", low=0.0, high=0.01)
    """Noise on the hand's position."""
    rotation: float = quantity(0.0, unit="rad", low=0.0, high=0.1)
    """Noise on the hand's rotation vector."""
    force: float = quantity(0.0, unit="N", low=0.0, high=10.0)
    """Noise on the wrist's force."""
    torque: float = quantity(0.0, unit="N m", low=0.0, high=1.0)
    """Noise on the wrist's torque."""

    @property
    def silent(self) -> bool:
        """Whether there is no noise."""
        return not any(dataclasses.astuple(self))


@dataclass(frozen=True, kw_only=True, slots=True)
class Variation(Quantities):
    """One episode's door and circumstances."""

    door: DoorConfig = field(default_factory=DoorConfig)
    """The door."""
    placement: Placement = field(default_factory=Placement)
    """How the robot stands and grasps."""
    noise: SensorNoise = field(default_factory=SensorNoise)
    """Sensor noise."""
    delay: int = quantity(0, unit="control periods", low=0, high=10)
    """Delay from a command to its effect."""
    disturbance: Disturbance = field(default_factory=Disturbance)
    """External events."""
    standoff: Standoff | None = None
    """Initial position of the hand; None if it holds the handle."""

    @property
    def scene(self) -> tuple[DoorConfig, Placement, Standoff | None]:
        """The part of an episode that determines the scene."""
        return self.door, self.placement, self.standoff
