"""Closing torque of a door closer as a function of opening angle and its rate.

`gplfd_env.scene.closer` models the same torque with MuJoCo's elements.
"""

import math
from dataclasses import dataclass
from typing import Final

from gplfd_env.conventions.one_and_many import (
    Flag,
    Number,
    anywhere,
    larger,
    negated,
    where,
)
from gplfd_env.doors.config import DoorConfig

STICTION_ANGLE: Final = math.radians(0.5)
"""Angle at which the stiction has faded [rad]."""

_SPEED: Final = 1e-3
"""Speed below which a door counts as at rest [rad/s]."""


def fading_torques(door: DoorConfig) -> tuple[tuple[float, float], ...]:
    """Return torques at the closed door [N m] and the angles [rad] of their zeros."""
    return (
        (door.stiction, STICTION_ANGLE),
        (door.seal, door.seal_angle),
        (door.closer.boost, door.closer.boost_angle),
    )


def has_tendons(door: DoorConfig) -> bool:
    """Return whether the closer has more than preload, stiffness and friction."""
    one_way = door.closer.closing_damping + door.closer.backcheck_damping
    return one_way > 0.0 or any(torque > 0.0 for torque, _ in fading_torques(door))


@dataclass(frozen=True, kw_only=True, slots=True)
class CloserLaw:
    """The closing torque of a door's closer, seal and stiction.

    Friction acts while the door moves. Fields are those of a `DoorConfig`, or arrays
    (n,) for n doors; `fading` is the result of `fading_torques`.
    """

    preload: Number
    stiffness: Number
    fading: tuple[tuple[Number, Number], ...]
    friction: Number
    damping: Number
    closing_damping: Number
    backcheck_damping: Number
    backcheck_angle: Number
    springs_alone: Flag
    """Whether only preload and stiffness are not zero, as for most doors."""

    @classmethod
    def of(cls, door: DoorConfig) -> "CloserLaw":
        """Return the closer law of a door."""
        further = door.closer.friction or door.closer.damping or has_tendons(door)
        preload, stiffness = door.closing_spring
        return cls(
            preload=preload,
            stiffness=stiffness,
            fading=fading_torques(door),
            friction=door.closer.friction,
            damping=door.closer.damping,
            closing_damping=door.closer.closing_damping,
            backcheck_damping=door.closer.backcheck_damping,
            backcheck_angle=door.closer.backcheck_angle,
            springs_alone=not further,
        )

    def torque(self, angle: Number, velocity: Number) -> Number:
        """Return the closing torque [N m] at an angle [rad] and its rate [rad/s]."""
        opened = where(angle > 0.0, angle, 0.0)
        torque = self.preload + self.stiffness * opened
        if not anywhere(negated(self.springs_alone)):
            return torque
        for closed, faded in self.fading:
            torque = torque + closed * larger(1.0 - opened / faded, 0.0)
        backcheck = where(angle > self.backcheck_angle, self.backcheck_damping, 0.0)
        damping = self.damping + where(velocity < 0.0, self.closing_damping, backcheck)
        friction = where(velocity < 0.0, -self.friction, self.friction)
        torque = torque + where(abs(velocity) > _SPEED, friction, 0.0)
        return torque + damping * velocity
