"""Forces of the synthetic human on a handle; method.md has the equations.

Not modelled: damping and inertia of the handle (less than 0.06 N m), friction of the
bolt, contact with frame and stop, weight of the hand, and friction at rest.
"""

import dataclasses
import math
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_env.doors.hardware import GRAVITY
from gplfd_env.doors.motion import CloserLaw, carried, links_of, roller_way
from gplfd_env.validation.fields import Quantities, quantity
from gplfd_experiments.data.teacher.motion import smooth_functions
from gplfd_experiments.files.arrays import FloatArray, smoothed

_HANDLE_MASS: Final = 0.4  # Mass at the distance of the handle from the hinge [kg].
_ARMATURE: Final = 0.01  # Inertia of the hinge [kg m²].
_AT_REST: Final = 0.01  # Angular velocity φ̇₀ that smooths the friction [rad/s].
_AT_STOP: Final = math.radians(0.1)  # Angle φ₀ within which stops carry [rad].
_STEP: Final = 1e-4  # Step for the differentiation of paths [rad].
_SMOOTHED: Final = 0.1  # Time over which angles are differentiated [s].


@dataclass(frozen=True, kw_only=True, slots=True)
class ForceConfig(Quantities):
    """How a person's forces vary and are measured; raises as `TeacherConfig` does."""

    effort_std: float = quantity(0.03, low=0.0, high=0.5)
    """Variation of the required torque: standard deviation of a factor about 1."""
    across_std: float = quantity(1.0, unit="N", low=0.0, high=50.0)
    across_share: float = quantity(0.1, low=0.0, high=2.0)
    """Pull across the path, towards the hinge and up: standard deviation of each, and
    an additional one as a share of the pull along the path."""
    grip_moment_std: float = quantity(0.05, unit="N m", low=0.0, high=5.0)
    """Moment by which the hand twists the handle: standard deviation per axis."""
    variation_time: float = quantity(1.0, unit="s", low=0.05, high=60.0)
    """Correlation time of all of these."""
    bias_force_std: float = quantity(0.3, unit="N", low=0.0, high=20.0)
    bias_moment_std: float = quantity(0.01, unit="N m", low=0.0, high=2.0)
    """Sensor's bias, constant in a demonstration: standard deviation per axis."""
    noise_force_std: float = quantity(0.2, unit="N", low=0.0, high=20.0)
    noise_moment_std: float = quantity(0.01, unit="N m", low=0.0, high=2.0)
    """Sensor's white noise: standard deviation per axis."""


def hinge_torque(door: DoorConfig, angles: FloatArray, rate: float) -> FloatArray:
    """Return the torques [N m], (N,), for opening angles φ [rad] at a rate [Hz].

    I φ̈ + I' φ̇² / 2 + (c + c_d) φ̇ + F tanh(φ̇ / φ̇₀) + tanh(φ / φ₀) (S(φ) + G(φ)), with
    the inertia I, dampers c of the hinge and c_d of the closer, Coulomb friction F,
    springs S of closer, seal and stiction, and gravity G of a leaf that rises.
    """
    window = 2 * max(round(0.5 * _SMOOTHED * rate), 1) + 1
    ends: Literal["interp", "nearest"]
    ends = "interp" if window <= angles.size else "nearest"
    velocity, acceleration = (
        smoothed(angles, window, 2, deriv=order, step=1.0 / rate, mode=ends)
        for order in (1, 2)
    )
    inertia, weight = inertia_and_gravity(door, angles)
    further, _ = inertia_and_gravity(door, angles + _STEP)
    closer = dataclasses.replace(CloserLaw.of(door), friction=0.0)
    springs = closer.torque(angles, np.zeros_like(angles))
    torque: FloatArray = np.tanh(angles / _AT_STOP) * springs
    torque += closer.torque(angles, velocity) - springs + door.hinge_damping * velocity
    friction = door.friction + door.mechanism.roller_friction * roller_way(door, angles)
    torque += friction * np.tanh(velocity / _AT_REST)
    torque += inertia * acceleration + np.tanh(angles / _AT_STOP) * weight
    torque += 0.5 * (further - inertia) / _STEP * velocity**2
    return torque


def inertia_and_gravity(
    door: DoorConfig, angles: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return inertia [kg m²] and gravity's closing torque [N m] at angles, each (N,).

    Of parts whose centres c turn by ψ: Σ m (∂c/∂φ)² + J (∂ψ/∂φ)² and Σ m g ∂c_y/∂φ.
    """
    if door.motion == "hinged":
        width = door.radius + door.leaf.backset + door.overhang
        middle = 0.5 * width - door.overhang
        leaf = (width**2 + door.leaf.thickness**2) / 12.0
        leaf += middle**2 + door.leaf.handle_standoff**2
        hinge = door.panel_mass * leaf + _HANDLE_MASS * door.radius**2 + _ARMATURE
        return np.full_like(angles, hinge), np.zeros_like(angles)
    links, depth = links_of(door), -door.leaf.handle_standoff
    # Edges of the leaves, from the handle away from the hinge [m].
    far, near = -door.radius - door.overhang, door.leaf.backset
    leaves = [(links, far, near)]
    if door.motion == "folding":
        fold = -door.fold_distance
        leaves = [(links[:1], far, fold), (links, fold, near)]
    inertia, weight = np.full_like(angles, _ARMATURE), np.zeros_like(angles)
    parts = [
        (moving, low, high, depth, door.panel_mass * (high - low) / (near - far))
        for moving, low, high in leaves
    ]
    for moving, low, high, x, mass in [*parts, (links, 0.0, 0.0, 0.0, _HANDLE_MASS)]:
        centre, middle = np.zeros((angles.size, 6)), 0.5 * (low + high)
        if door.level:
            centre[:, :2] = x, -math.copysign(1.0, links[0].anchor[1]) * middle
        else:
            centre[:, 0], centre[:, 2] = x, door.hinge_sign * middle
        before, after = (carried(moving, angles + h, centre) for h in (-_STEP, _STEP))
        rates = (after - before) / (2.0 * _STEP)
        thick = door.leaf.thickness if high > low else 0.0
        about = mass * ((high - low) ** 2 + thick**2) / 12.0
        inertia += mass * (rates[:, :3] ** 2).sum(axis=1)
        inertia += about * (rates[:, 3:] ** 2).sum(axis=1)
        weight += mass * GRAVITY * rates[:, 1]
    return inertia, weight


def handle_torque(door: DoorConfig, turns: FloatArray) -> FloatArray:
    """Return the torque [N m] that holds a lever or knob at angles [rad], (N,).

    Beyond its dead travel, the handle also draws the bolt against its spring.
    """
    preload, stiffness = door.handle_spring
    torque = np.tanh(turns / _AT_STOP) * (preload + stiffness * turns)
    if door.latch == "spring":
        lock = door.lockset
        ratio = lock.bolt_throw / (door.handle_travel - lock.dead_travel)
        beyond = np.maximum(turns - lock.dead_travel, 0.0)
        bolt = lock.bolt_preload + lock.bolt_stiffness * ratio * beyond
        torque += np.tanh(beyond / _AT_STOP) * ratio * bolt
    return torque


def hand_wrenches(
    config: ForceConfig,
    door: DoorConfig,
    times: FloatArray,
    angles: FloatArray,
    turns: FloatArray,
    hand: FloatArray,
    rng: np.random.Generator,
) -> FloatArray:
    """Return what a sensor in the hand of a person who opens a door measures, (N, 6).

    These are forces and moments of the hand on the handle [N, N m], axes of the task
    frame, about the position of the recorded hand [m], (N, 3). Times [s] are evenly
    spaced, (N,), as are angles of door and handle [rad].
    """
    human_rng, sensor_rng = rng.spawn(2)
    varied = smooth_functions(times, config.variation_time, 6, human_rng)
    effort = 1.0 + config.effort_std * varied[:, :1]
    rate = (times.size - 1) / float(times[-1] - times[0])
    geometry = DoorGeometry.of(door)
    held = geometry.hand_poses(angles, turns)[:, :3]
    # Where the handle goes as the door turns, ∂p/∂φ, and what is across that.
    along = np.cross(geometry.axis, held - geometry.hinge)
    if geometry.links:
        before, after = (
            geometry.hand_poses(angles + step, turns)[:, :3] for step in (-_STEP, _STEP)
        )
        along = (after - before) / (2.0 * _STEP)
    radius = np.linalg.norm(along, axis=1, keepdims=True)
    pull = effort * hinge_torque(door, angles, rate)[:, None] / radius
    across = (config.across_std + config.across_share * np.abs(pull)) * varied[:, 1:3]
    inwards = np.cross(geometry.axis, along) / radius
    force = pull * along / radius + across[:, :1] * inwards
    force += across[:, 1:] * geometry.axis
    moment = config.grip_moment_std * varied[:, 3:]
    if geometry.spindle is not None and geometry.turn is not None:
        leaf = Rotation.from_rotvec(angles[:, None] * geometry.axis).as_matrix()
        spindle = geometry.hinge + leaf @ (geometry.spindle - geometry.hinge)
        if geometry.links:
            closed = np.zeros((angles.size, 6))
            closed[:, :3] = geometry.spindle
            spindle = carried(geometry.links, angles, closed)[:, :3]
        turn = leaf @ geometry.turn
        arm = np.cross(turn, held - spindle)  # ∂p/∂θ
        torque = effort * handle_torque(door, turns)[:, None]
        if door.hand_offset > 0.0:
            force += torque * arm / door.hand_offset**2
        # A moment turns a knob, and keeps a pull up or down from turning a lever.
        moment += (torque - (force * arm).sum(axis=1, keepdims=True)) * turn
    moment += np.cross(held - hand, force)
    errors = sensor_rng.standard_normal((times.size + 1, 6))
    errors[0] *= np.repeat([config.bias_force_std, config.bias_moment_std], 3)
    errors[1:] *= np.repeat([config.noise_force_std, config.noise_moment_std], 3)
    return np.asarray(np.hstack([force, moment]) + errors[0] + errors[1:])
