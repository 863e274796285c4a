"""Model of a closer: springs that fade with the angle and one-way dampers.

MuJoCo's joint springs and dampers depend on neither direction nor range. Three elements
provide this without a callback, and none of them adds energy:

* A torque T that falls linearly to zero at an angle φ₁ is the sum of the constant T,
  the stiffness -T/φ₁, and a tendon spring T/φ₁ that is slack below φ₁.
* A one-way damper D is a tendon limit without stiffness: its force is D times the
  velocity towards the limit, and never negative.
* Efficiency is Coulomb friction: opening and closing moment differ by twice the
  friction.
"""

from typing import Final

import mujoco

from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.motion import fading_torques, has_tendons

# Torques that fade; each is a tendon of that name.
_FADING: Final = ("stiction", "seal", "closer_boost")
_CLOSING: Final = "closing_damper"
_BACKCHECK: Final = "backcheck"
_ANYWHERE: Final = 10.0  # An angle greater than every opening angle [rad].
# Impedance of a limit that acts as a damper: the least that MuJoCo allows, so that its
# force does not depend on the other forces on the door.
_SOFT: Final = 1e-4


def add_closer(spec: mujoco.MjSpec, door: DoorConfig, *, tendons: bool) -> None:
    """Add the actuator ``door_closer`` to the joint ``hinge``, and its tendons.

    One-way dampers need the compiled leaf's inertia and are left to `set_closer`.
    """
    # A pure bias force, -(preload + stiffness * angle): a spring's reference angle
    # could not give a preload without a stiffness. Its control input has no gain.
    joint = {"target": "hinge", "trntype": mujoco.mjtTrn.mjTRN_JOINT}
    closer = spec.add_actuator(name="door_closer", **joint)
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
    for name, reach in (
        (_CLOSING, (_ANYWHERE, 2.0 * _ANYWHERE)),
        (_BACKCHECK, (-_ANYWHERE, _ANYWHERE)),
    ):
        limits = {"limited": True, "range": reach, "solref_limit": [0.0, 0.0]}
        softness = {"solimp_limit": [_SOFT, _SOFT, 0.001, 0.5, 2.0]}
        damper = spec.add_tendon(name=name, springlength=[0, 0], **limits, **softness)
        damper.wrap_joint("hinge", 1.0)


def set_closer(model: mujoco.MjModel, door: DoorConfig) -> None:
    """Write a closer's parameters into a compiled scene whose leaf has its mass."""
    if has_tendons(door):
        for name, (torque, faded) in zip(_FADING, fading_torques(door), strict=True):
            tendon = model.tendon(name).id
            model.tendon_stiffness[tendon] = torque / faded
            model.tendon_lengthspring[tendon] = -_ANYWHERE, faded
        for name, damping in (
            (_CLOSING, door.closer.closing_damping),
            (_BACKCHECK, door.closer.backcheck_damping),
        ):
            tendon = model.tendon(name).id
            # The force of a limit is its reference acceleration divided by this weight.
            weight = model.tendon_invweight0[tendon]
            model.tendon_solref_lim[tendon] = 0.0, -damping * weight
        model.tendon_range[model.tendon(_BACKCHECK).id, 1] = door.closer.backcheck_angle
    actuator = model.actuator("door_closer").id
    model.actuator_biasprm[actuator, :2] = _bias(door)


def _bias(door: DoorConfig) -> tuple[float, float]:
    """Return the actuator's bias: constant [N m] and stiffness [N m/rad]."""
    preload, stiffness = door.closing_spring
    for torque, faded in fading_torques(door):
        preload += torque
        stiffness -= torque / faded
    return -preload, -stiffness
