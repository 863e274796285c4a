"""The closer: springs that fade with the angle and one-way dampers.

MuJoCo's joint springs and dampers depend on neither direction nor range. Three elements
do, without a callback:

* a torque T that fades linearly to nothing at an angle φ₁ is the constant T, the
  stiffness -T/φ₁, and a tendon's spring T/φ₁ that is slack below φ₁;
* a damper D that works one way is a tendon's limit without stiffness: its force is
  D times the velocity towards the limit, and never negative;
* efficiency is Coulomb friction: opening and closing moment differ by twice of it.

None of them adds energy.
"""

import math
from dataclasses import dataclass
from typing import Final

import mujoco

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

_FADING: Final = ("stiction", "seal", "closer_boost")
"""Torques that fade; each is a tendon of that name."""

_CLOSING: Final = "closing_damper"
_BACKCHECK: Final = "backcheck"
_ANYWHERE: Final = 10.0
"""Greater than every opening angle [rad]."""

_SOFT: Final = 1e-4
"""Impedance of a limit that acts as a damper, the least that MuJoCo allows: its force
then does not depend on the other forces on the door."""

_SPEED: Final = 1e-3
"""Speed below which a door counts as at rest [rad/s]."""


def fading_torques(door: DoorConfig) -> tuple[tuple[float, float], ...]:
    """Return torques at the closed door [N m] and where they have faded [rad]."""
    return (
        (door.stiction, STICTION_ANGLE),
        (door.seal, door.seal_angle),
        (door.closer_boost, door.closer_boost_angle),
    )


def has_tendons(door: DoorConfig) -> bool:
    """Return whether a door's closer is more than preload, stiffness and friction."""
    one_way = door.closing_damping + door.backcheck_damping
    return one_way > 0.0 or any(torque > 0.0 for torque, _ in fading_torques(door))


@dataclass(frozen=True, kw_only=True, slots=True)
class CloserLaw:
    """The closing torque of a door's closer, seal and stiction.

    Friction counts while the door moves. Fields are those of a `DoorConfig`, or arrays
    (n,) of those of n doors; `fading` is what `fading_torques` gives.
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
    """Preload and stiffness are all that is not zero, as of most doors."""

    @classmethod
    def of(cls, door: DoorConfig) -> "CloserLaw":
        """Return that of a door."""
        further = door.closer_friction or door.closer_damping or has_tendons(door)
        return cls(
            preload=door.closer_preload,
            stiffness=door.closer_stiffness,
            fading=fading_torques(door),
            friction=door.closer_friction,
            damping=door.closer_damping,
            closing_damping=door.closing_damping,
            backcheck_damping=door.backcheck_damping,
            backcheck_angle=door.backcheck_angle,
            springs_alone=not further,
        )

    def torque(self, angle: Number, velocity: Number) -> Number:
        """Return it [N m] at an opening angle [rad] and its rate [rad/s]."""
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


def add_closer(spec: mujoco.MjSpec, door: DoorConfig, *, tendons: bool) -> None:
    """Add the actuator ``door_closer`` to the joint ``hinge``, and its tendons.

    One-way dampers need the compiled leaf's inertia and are left to `set_closer`.
    """
    # A pure bias force, -(preload + stiffness * angle): a spring's reference angle
    # could not give a preload without a stiffness. Its control input has no gain.
    closer = spec.add_actuator(
        name="door_closer", target="hinge", trntype=mujoco.mjtTrn.mjTRN_JOINT
    )
    closer.gaintype = mujoco.mjtGain.mjGAIN_FIXED
    closer.gainprm[0] = 0.0
    closer.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    closer.biasprm[:2] = _bias(door)
    if not tendons:
        return
    for name, (torque, faded) in zip(_FADING, fading_torques(door), strict=True):
        tendon = spec.add_tendon(name=name, springlength=[-_ANYWHERE, faded])
        tendon.stiffness[0] = torque / faded
        tendon.wrap_joint("hinge", 1.0)
    for name, limits in (
        (_CLOSING, (_ANYWHERE, 2.0 * _ANYWHERE)),
        (_BACKCHECK, (-_ANYWHERE, _ANYWHERE)),
    ):
        damper = spec.add_tendon(
            name=name,
            limited=True,
            range=limits,
            springlength=[0.0, 0.0],
            solref_limit=[0.0, 0.0],
            solimp_limit=[_SOFT, _SOFT, 0.001, 0.5, 2.0],
        )
        damper.wrap_joint("hinge", 1.0)


def set_closer(model: mujoco.MjModel, door: DoorConfig) -> None:
    """Write a closer's parameters into a compiled scene, after the leaf's mass."""
    if has_tendons(door):
        for name, (torque, faded) in zip(_FADING, fading_torques(door), strict=True):
            tendon = model.tendon(name).id
            model.tendon_stiffness[tendon] = torque / faded
            model.tendon_lengthspring[tendon] = -_ANYWHERE, faded
        for name, damping in (
            (_CLOSING, door.closing_damping),
            (_BACKCHECK, door.backcheck_damping),
        ):
            tendon = model.tendon(name).id
            # A limit's force is its reference acceleration over this weight.
            weight = model.tendon_invweight0[tendon]
            model.tendon_solref_lim[tendon] = 0.0, -damping * weight
        model.tendon_range[model.tendon(_BACKCHECK).id, 1] = door.backcheck_angle
    actuator = model.actuator("door_closer").id
    model.actuator_biasprm[actuator, :2] = _bias(door)


def _bias(door: DoorConfig) -> tuple[float, float]:
    """Return the actuator's bias: constant [N m] and per angle [N m/rad]."""
    preload, stiffness = door.closer_preload, door.closer_stiffness
    for torque, faded in fading_torques(door):
        preload += torque
        stiffness -= torque / faded
    return -preload, -stiffness
