"""What a disturbance does to one simulation, control period by control period.

Forces hold for a control period, like commands; they are computed from the readings at
its beginning. So one simulation and many are treated by the same arithmetic.
"""

import math
from typing import Final

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.disturbance import Bump, Disturbance, Person, Push, Stop
from gplfd_env.doors.variation import Variation
from gplfd_env.robot.placement import task_rotation_w
from gplfd_env.simulation.loads import Loads, Vector
from gplfd_env.task.observation import DoorReading

_SUBSTEPS: Final = 50
"""Steps of the person's hand in a control period: 0.2 ms, a fortieth of the period in
which the stiffest hand swings."""

_TOUCH: Final = math.radians(0.5)
"""The door has come to a stop when it is this near [rad], and has broken away when it
has moved by this."""

_NOTHING: Final = (0.0, 0.0, 0.0)


class Intervention:
    """Carries out the disturbance of an episode.

    Args:
        variation: The episode's circumstances.
    """

    def __init__(self, variation: Variation) -> None:
        disturbance: Disturbance = variation.disturbance
        door = variation.door
        self._door, self._breakaway = door, disturbance.breakaway
        self._stuck = self._breakaway is not None
        self._push = disturbance.push and _PushInTime(disturbance.push)
        self._person = disturbance.person and PersonHand(
            disturbance.person, door.hand_radius
        )
        self._stop = disturbance.stop and _StopInTime(disturbance.stop)
        self._bump = disturbance.bump and _BumpInTime(disturbance.bump, door)
        self.push_force = 0.0
        """Of the last period's push [N]."""

    @property
    def person_force(self) -> float:
        """Greatest force between person and robot or door in the last period [N]."""
        return self._person.peak if self._person else 0.0

    @property
    def person_energy(self) -> float:
        """Work done on the person since the reset [J]."""
        return self._person.energy if self._person else 0.0

    @property
    def base_shift(self) -> Vector:
        """Displacement of the base so far, task frame [m]."""
        return self._bump.shift if self._bump else _NOTHING

    @property
    def base_distance(self) -> float:
        """Its magnitude [m]."""
        return math.hypot(*self.base_shift)

    @property
    def base_velocity(self) -> Vector:
        """Rate of that displacement [m/s]."""
        return self._bump.velocity if self._bump else _NOTHING

    def loads(self, time: float, reading: DoorReading, slip: float) -> Loads:
        """Return what acts in the control period that begins now.

        Args:
            time: Since the reset [s].
            reading: Of door and grasp.
            slip: How far the hand has slipped along the opening motion [m].
        """
        along, upward, outward = reading.axes
        hand, forearm, hinge = _NOTHING, _NOTHING, self._seal(reading.angle)
        if self._push:
            sizes = self._push.forces(time, reading.angle)
            self.push_force = math.hypot(*sizes)
            force = _combined(sizes, (along, upward, outward))
            if self._push.on == "hand":
                hand = force
            elif self._push.on == "forearm":
                forearm = force
            else:
                hinge += sizes[0] * self._door.hand_radius
        if self._person:
            resistance = self._person.resistance(time, reading.angle, slip)
            if self._person.on == "door":
                hinge -= resistance * self._door.hand_radius
            else:
                held = _combined((-resistance, 0.0, 0.0), (along, upward, outward))
                hand = (hand[0] + held[0], hand[1] + held[1], hand[2] + held[2])
        if self._bump:
            self._bump.move(time, reading.angle)
        stop = self._door.stop_angle
        if self._stop:
            stop = min(stop, self._stop.angle(time, reading.angle))
        about_up = self._door.side * self._door.way * hinge
        return Loads(hand, forearm, about_up, stop, self._friction(reading.angle))

    def _seal(self, angle: float) -> float:
        seal = self._breakaway
        if seal is None or angle >= seal.seal_angle:
            return 0.0
        torque: float = seal.seal * (1.0 - max(angle, 0.0) / seal.seal_angle)
        return -torque

    def _friction(self, angle: float) -> float:
        self._stuck = self._stuck and angle < _TOUCH
        if self._breakaway is None or not self._stuck:
            return self._door.friction
        stuck: float = self._door.friction + self._breakaway.stiction
        return stuck


class _Start:
    """Notes when angle and time have both been reached."""

    def __init__(self, start_angle: float, start_time: float) -> None:
        self._angle, self._time = start_angle, start_time
        self.at: float | None = None

    def since(self, time: float, angle: float) -> float | None:
        """Return the time since the start [s]; None before it."""
        if self.at is None and time >= self._time and max(angle, 0.0) >= self._angle:
            self.at = time
        return None if self.at is None else time - self.at


class _PushInTime:
    def __init__(self, push: Push) -> None:
        self._push, self.on = push, push.on
        self._start = _Start(push.start_angle, push.start_time)

    def forces(self, time: float, angle: float) -> Vector:
        """Return the force along, upwards and outwards in the period from now [N]."""
        push = self._push
        since = self._start.since(time, angle)
        if since is None or since >= push.duration:
            return _NOTHING
        share = 1.0
        if push.profile == "half_sine":
            middle = min(since + 0.5 * CONTROL_PERIOD, push.duration)
            share = math.sin(math.pi * middle / push.duration)
        return share * push.along, share * push.upward, share * push.outward


class PersonHand:
    """A person's hand on the handle's circle: a mass between two spring-dampers.

    With the position x of the hand from where it took hold, the arc s of what it
    touches, m ẍ = f - k_a x - d_a ẋ, where f = k_c (s - x) + d_c (ṡ - ẋ) is the
    contact force, never negative if the person only stands in the way. Integrated in
    `_SUBSTEPS` semi-implicit Euler steps per control period, in which s goes on at its
    last rate.

    Args:
        person: Who it is; every number drawn.
        radius: Of the handle's circle [m].

    Attributes:
        on: What is touched.
        peak: Greatest magnitude of f in the last period [N].
        energy: ∫ f ds since the reset [J].
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
        """Return the mean contact force in the period from now, against opening [N].

        Args:
            time: Since the reset [s].
            angle: Of the door [rad].
            slip: Of the hand on the handle, along the motion [m].
        """
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
                # The hand begins with the speed of what it takes hold of.
                self._anchor, self._velocity = arc, rate
        elif time - self._held >= self._person.duration - 1e-9:
            return 0.0
        return self._swing(arc - self._anchor, rate)

    def _swing(self, arc: float, rate: float) -> float:
        """Go on by one control period; return the mean contact force [N]."""
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


class _StopInTime:
    def __init__(self, stop: Stop) -> None:
        self._stop = stop
        self._start = _Start(max(stop.angle - _TOUCH, 0.0), 0.0)

    def angle(self, time: float, angle: float) -> float:
        """Return where the leaf meets a stop in the period from now [rad]."""
        since = self._start.since(time, angle)
        free = since is not None and since >= self._stop.duration - 1e-9
        return math.inf if free else self._stop.angle


class _BumpInTime:
    def __init__(self, bump: Bump, door: DoorConfig) -> None:
        self._bump = bump
        self._start = _Start(bump.start_angle, bump.start_time)
        base = (bump.forward, bump.left, 0.0)
        # The world frame is the base's.
        self._whole = tuple((task_rotation_w(door).T @ base).tolist())
        self.shift = self.velocity = _NOTHING

    def move(self, time: float, angle: float) -> None:
        """Bring the displacement to the end of the period that begins now."""
        since = self._start.since(time, angle)
        if since is None:
            return
        s = min((since + CONTROL_PERIOD) / self._bump.duration, 1.0)
        share = s**3 * (10.0 - 15.0 * s + 6.0 * s * s)
        rate = 30.0 * s * s * (1.0 - s) ** 2 / self._bump.duration
        x, y, z = self._whole
        self.shift = share * x, share * y, share * z
        self.velocity = rate * x, rate * y, rate * z


def _combined(sizes: Vector, axes: tuple[Vector, Vector, Vector]) -> Vector:
    """Return a vector from its components along three axes."""
    (a, b, c), (first, second, third) = sizes, axes
    return (
        a * first[0] + b * second[0] + c * third[0],
        a * first[1] + b * second[1] + c * third[1],
        a * first[2] + b * second[2] + c * third[2],
    )
