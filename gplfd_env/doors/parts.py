"""Parts of a door with their dimensions: leaf, lockset, closer, mechanism."""

import math
from dataclasses import dataclass

from gplfd_env.validation.fields import Quantities, quantity


@dataclass(frozen=True, kw_only=True, slots=True)
class Leaf(Quantities):
    """Dimensions of the leaf, and where its handle is."""

    width: float | None = quantity(None, unit="m", low=0.35, high=1.25)
    """Width of the leaf; None: 1 cm more than the door's `radius` and `backset`."""
    backset: float = quantity(0.08, unit="m", low=0.04, high=0.25)
    """Distance from the leaf's free edge to the handle's axis."""
    thickness: float = quantity(0.04, unit="m", low=0.015, high=0.08)
    """Thickness of the leaf."""
    handle_standoff: float = quantity(0.07, unit="m", low=0.06, high=0.12)
    """Distance between the handle's axis and the leaf's mid-plane."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Lockset(Quantities):
    """A handle that turns, and the bolt that it retracts."""

    handle_length: float = quantity(0.12, unit="m", low=0.10, high=0.15)
    """Lever: distance from the axis about which it turns to its end."""
    handle_preload: float | None = quantity(None, unit="N m", low=0.0, high=5.0)
    """Torque of the return spring at rest; None, here and below: as in
    `gplfd_env.doors.config.TURNING`."""
    handle_stiffness: float | None = quantity(None, unit="N m/rad", low=0.1, high=15.0)
    """Stiffness of the return spring."""
    handle_travel: float | None = quantity(None, unit="rad", low=0.25, high=1.2)
    """Angle at which the handle meets its stop."""
    handle_arm: float | None = quantity(None, unit="m", low=0.04, high=0.15)
    """Paddle, touch bar, handleset: distance from its axis to where it is held."""
    dead_travel: float = quantity(0.06, unit="rad", low=0.0, high=0.2)
    """Angle at which the handle begins to retract the bolt."""
    bolt_throw: float = quantity(0.0127, unit="m", low=0.010, high=0.020)
    """How far the bolt protrudes; the handle's whole travel retracts it."""
    bolt_preload: float = quantity(4.0, unit="N", low=1.0, high=20.0)
    """Force of the bolt's spring when the bolt protrudes."""
    bolt_stiffness: float = quantity(300.0, unit="N/m", low=50.0, high=2000.0)
    """Stiffness of the bolt's spring."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Closer(Quantities):
    """A device that closes the door."""

    stiffness: float = quantity(0.0, unit="N m/rad", low=0.0, high=50.0)
    """Closing torque that grows with the angle."""
    preload: float = quantity(0.0, unit="N m", low=0.0, high=50.0)
    """Closing torque at every angle, also when closed."""
    boost: float = quantity(0.0, unit="N m", low=0.0, high=50.0)
    """Additional closing torque at the closed door (latch boost)."""
    boost_angle: float = quantity(
        math.radians(30.0), unit="rad", low=math.radians(5.0), high=math.radians(90.0)
    )
    """Angle at which the latch boost, which falls linearly, reaches zero."""
    friction: float = quantity(0.0, unit="N m", low=0.0, high=30.0)
    """Half of opening minus closing moment."""
    damping: float = quantity(0.0, unit="N m s/rad", low=0.0, high=50.0)
    """Damping while the door moves."""
    closing_damping: float = quantity(0.0, unit="N m s/rad", low=0.0, high=200.0)
    """Additional damping while the door closes."""
    backcheck_damping: float = quantity(0.0, unit="N m s/rad", low=0.0, high=200.0)
    """Additional damping while the door opens beyond `backcheck_angle`."""
    backcheck_angle: float = quantity(
        math.radians(70.0), unit="rad", low=math.radians(30.0), high=math.pi
    )
    """Angle at which the back-check damping begins."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Mechanism(Quantities):
    """Dimensions of what guides a leaf that does not only turn about its hinge."""

    clear_width: float | None = quantity(None, unit="m", low=0.30, high=1.05)
    """Sliding: clear width; None: the door's `radius`."""
    offset: float = quantity(0.05, unit="m", low=0.02, high=0.10)
    """Parallel-sliding: distance by which the leaf moves out before it slides."""
    rise: float = quantity(0.012, unit="m", low=0.005, high=0.02)
    """Rising butt: height gained per 90°."""
    strut_stiffness: float = quantity(0.0, unit="N m/rad", low=0.0, high=60.0)
    """Flap: torque of the gas strut per angle from its dead point; it opens the flap
    beyond the dead point and closes it before."""
    strut_dead_angle: float = quantity(
        math.radians(10.0), unit="rad", low=0.0, high=math.radians(60.0)
    )
    """Flap: dead point of the gas strut."""
    roller_friction: float = quantity(0.0, unit="N", low=0.0, high=200.0)
    """Folding: Coulomb friction of the guided edge's rollers, along their rail."""
