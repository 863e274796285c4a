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
from typing import Final

import mujoco

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


class CloserLaw:
    """The closing torque of a door's closer, seal and stiction.

    Friction counts while the door moves.

    Args:
        door: Its fields.
    """

    def __init__(self, door: DoorConfig) -> None:
        self._preload, self._stiffness = door.closer_preload, door.closer_stiffness
        self._fading = [each for each in fading_torques(door) if each[0] > 0.0]
        self._friction, self._damping = door.closer_friction, door.closer_damping
        self._closing = door.closing_damping
        self._backcheck = door.backcheck_damping, door.backcheck_angle
        # Fast path: most doors have none of these, and this runs in every period.
        self._springs_alone = not (
            self._fading or self._friction or self._damping or has_tendons(door)
        )

    def torque(self, angle: float, velocity: float) -> float:
        """Return the torque [N m].

        Args:
            angle: Opening angle φ [rad].
            velocity: Its rate [rad/s].
        """
        opened = angle if angle > 0.0 else 0.0
        torque = self._preload + self._stiffness * opened
        if self._springs_alone:
            return torque
        for closed, faded in self._fading:
            torque += closed * max(1.0 - opened / faded, 0.0)
        damping, (backcheck, beyond) = self._damping, self._backcheck
        if velocity < 0.0:
            damping += self._closing
        elif angle > beyond:
            damping += backcheck
        if abs(velocity) > _SPEED:
            torque += math.copysign(self._friction, velocity)
        return torque + damping * velocity


def add_closer(spec: mujoco.MjSpec, door: DoorConfig, *, tendons: bool) -> None:
    """Add the actuator ``door_closer`` to the joint ``hinge``, and its tendons.

    Args:
        spec: The scene; edited in place.
        door: Its numbers; those of one-way dampers need the compiled leaf's inertia and
            are left to `set_closer`.
        tendons: Whether there are any.
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
    """Write a closer's parameters into a compiled scene, after the leaf's mass.

    Args:
        model: The scene; edited in place.
        door: With `has_tendons` as the scene was compiled.
    """
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
