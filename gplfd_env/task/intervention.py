"""Effect of a disturbance on one simulation in each control period.

Forces are constant during a control period, like commands; they are computed from the
readings at its beginning.
"""

import math
from collections.abc import Sequence
from typing import Final

from gplfd_env.conventions.constants import CONTROL_PERIOD, Vector
from gplfd_env.doors.disturbance import Person
from gplfd_env.doors.motion import end_angle
from gplfd_env.doors.variation import Variation
from gplfd_env.robot.config import RobotConfig
from gplfd_env.robot.placement import task_rotation_w
from gplfd_env.simulation.command import Loads

# Integration steps of the person's hand per control period: 0.2 ms, a fortieth of the
# oscillation period of the stiffest hand.
_SUBSTEPS: Final = 50
# The door touches a stop if it is nearer than this [rad], and has broken away after
# moving by this angle.
_TOUCH: Final = math.radians(0.5)
_NOTHING: Final = (0.0, 0.0, 0.0)


class Intervention:
    """Executes the disturbance of an episode.

    After `loads`, it has the force of the push and the greatest one between person and
    robot or door in this period [N], the work done on the person since the reset [J],
    the displacement of the base in the task frame [m], its magnitude and rate [m/s].
    """

    def __init__(self, variation: Variation, robot: RobotConfig) -> None:
        self._cause = cause = variation.disturbance
        self._door = door = variation.door
        self._stuck = cause.breakaway is not None
        self._person = cause.person and PersonHand(cause.person, door.hand_radius)
        if cause.push:
            self._push_start = _Start(cause.push.start_angle, cause.push.start_time)
        if cause.stop:
            self._stop_start = _Start(max(cause.stop.angle - _TOUCH, 0.0), 0.0)
        if cause.bump:
            self._bump_start = _Start(cause.bump.start_angle, cause.bump.start_time)
            # The world frame is the frame of the base.
            shift = (cause.bump.forward, cause.bump.left, 0.0)
            to_task = task_rotation_w(door, robot).T
            self._whole_shift = tuple((to_task @ shift).tolist())
        self.push_force = self.person_force = self.person_energy = 0.0
        self.base_distance = 0.0
        self.base_shift: Vector = _NOTHING
        self.base_velocity: Vector = _NOTHING

    def loads(
        self, time: float, angle: float, axes: Sequence[float], slip: float
    ) -> Loads:
        """Return the loads in the next period, from the angle of the door [rad].

        The nine numbers are `DoorReading.axes`; the hand has slipped by `slip` [m].
        """
        cause, door = self._cause, self._door
        hand, forearm, hinge = _NOTHING, _NOTHING, 0.0
        if cause.breakaway and angle < cause.breakaway.seal_angle:
            closed = 1.0 - max(angle, 0.0) / cause.breakaway.seal_angle
            hinge = -cause.breakaway.seal * closed
        if cause.push:
            push, since = cause.push, self._push_start.since(time, angle)
            sizes, share = _NOTHING, 1.0
            if since is not None and since < push.duration:
                if push.profile == "half_sine":
                    middle = min(since + 0.5 * CONTROL_PERIOD, push.duration)
                    share = math.sin(math.pi * middle / push.duration)
                sizes = share * push.along, share * push.upward, share * push.outward
            self.push_force = math.hypot(*sizes)
            if cause.push.on == "hand":
                hand = self._in_world(sizes, axes)
            elif cause.push.on == "forearm":
                forearm = self._in_world(sizes, axes)
            else:
                hinge += sizes[0] * door.hand_radius
        if self._person:
            resistance = self._person.resistance(time, angle, slip)
            self.person_force = self._person.peak
            self.person_energy = self._person.energy
            if self._person.on == "door":
                hinge -= resistance * door.hand_radius
            else:
                held = self._in_world((-resistance, 0.0, 0.0), axes)
                hand = (hand[0] + held[0], hand[1] + held[1], hand[2] + held[2])
        since = self._bump_start.since(time, angle) if cause.bump else None
        if cause.bump and since is not None:
            # To the end of the period that begins now.
            duration = cause.bump.duration
            s = min((since + CONTROL_PERIOD) / duration, 1.0)
            share = s**3 * (10.0 - 15.0 * s + 6.0 * s * s)
            rate = 30.0 * s * s * (1.0 - s) ** 2 / duration
            x, y, z = self._whole_shift
            self.base_shift = share * x, share * y, share * z
            self.base_distance = math.hypot(*self.base_shift)
            self.base_velocity = rate * x, rate * y, rate * z
        stop, friction = end_angle(door), door.friction
        if cause.stop:
            since = self._stop_start.since(time, angle)
            if since is None or since < cause.stop.duration - 1e-9:
                stop = min(stop, cause.stop.angle)
        self._stuck = self._stuck and angle < _TOUCH
        if cause.breakaway and self._stuck:
            friction += cause.breakaway.stiction
        hinge *= door.hinge_sign * door.swing_sign
        return Loads(hand, forearm, hinge, stop, friction)

    def _in_world(self, sizes: Vector, axes: Sequence[float]) -> Vector:
        """Return a force [N] along the motion, upwards and outwards in world axes."""
        a, b, c = sizes
        a, c = self._door.swing_sign * a, self._door.hinge_sign * c
        x, y, z = (a * axes[i] + b * axes[i + 3] + c * axes[i + 6] for i in range(3))
        return x, y, z


class _Start:
    """Records when an angle [rad] and a time [s] have both been reached."""

    def __init__(self, angle: float, time: float) -> None:
        self._angle, self._time = angle, time
        self._at: float | None = None

    def since(self, time: float, angle: float) -> float | None:
        """Return the time since the start [s]; None before the start."""
        if self._at is None and time >= self._time and max(angle, 0.0) >= self._angle:
            self._at = time
        return None if self._at is None else time - self._at


class PersonHand:
    """A person's hand on the handle's circle: a mass between two spring-dampers.

    x is the displacement of the person's hand since it took hold, s the arc of the body
    that it touches. m ẍ = f - k_a x - d_a ẋ, with the contact force f = k_c (s - x) +
    d_c (ṡ - ẋ), never negative if the person only stands in the way. Integrated in
    `_SUBSTEPS` semi-implicit Euler steps per control period, during which s continues
    at its last rate. The circle has a `radius` [m]; `peak` is the greatest |f| in the
    last period [N], `energy` is ∫ f ds since the reset [J].
    """

    def __init__(self, person: Person, radius: float) -> None:
        self._person, self._radius, self.on = person, radius, person.on
        angle = 0.0 if person.one_sided else person.start_angle
        self._start = _Start(angle, person.start_time)
        self._anchor = radius * person.start_angle
        self._held: float | None = None
        self._last: float | None = None
        self._position = self._velocity = 0.0
        self.peak = self.energy = 0.0

    def resistance(self, time: float, angle: float, slip: float) -> float:
        """Return the mean contact force against opening [N], for a slip [m]."""
        arc = self._radius * angle + (slip if self.on == "hand" else 0.0)
        rate = 0.0 if self._last is None else (arc - self._last) / CONTROL_PERIOD
        self._last = arc
        self.peak = 0.0
        if self._start.since(time, angle) is None:
            return 0.0
        if self._held is None:
            touches = arc + rate * CONTROL_PERIOD > self._anchor
            if self._person.one_sided and not touches:
                return 0.0
            self._held = time
            if not self._person.one_sided:
                # The hand starts with the speed of the body that it takes hold of.
                self._anchor, self._velocity = arc, rate
        elif time - self._held >= self._person.duration - 1e-9:
            return 0.0
        return self._swing(arc - self._anchor, rate)

    def _swing(self, arc: float, rate: float) -> float:
        """Integrate one control period; return the mean contact force [N]."""
        person, step = self._person, CONTROL_PERIOD / _SUBSTEPS
        stiff, damp = person.contact_stiffness, person.contact_damping
        arm, arm_damp = person.arm_stiffness, person.arm_damping
        x, v, total, peak = self._position, self._velocity, 0.0, 0.0
        for _ in range(_SUBSTEPS):
            arc += rate * step
            force = stiff * (arc - x) + damp * (rate - v)
            if person.one_sided and (arc < x or force < 0.0):
                force = 0.0
            v += (force - arm * x - arm_damp * v) / person.hand_mass * step
            x += v * step
            total += force
            peak = max(peak, abs(force))
        self._position, self._velocity, self.peak = x, v, peak
        mean = total / _SUBSTEPS
        self.energy += mean * rate * CONTROL_PERIOD
        return mean
