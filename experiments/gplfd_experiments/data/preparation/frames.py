"""Frames of motions and wrenches: the hand's offset, sensors, door hinges.

Wrenches are about a point, (f_x, f_y, f_z, m_x, m_y, m_z) [N, N m].
"""

import itertools
import math
from dataclasses import fields, replace
from typing import Final, NamedTuple

import numpy as np
import scipy
from scipy.spatial.transform import Rotation

from gplfd_experiments.data.preparation.samples import Notes, Samples
from gplfd_experiments.data.raw import RawRecording
from gplfd_experiments.data.settings import ImportSettings, PoseNumbers
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.arrays.records import interpolated

_STAYS_OPEN: Final = 0.75  # Least final angle of a door, as a share of its widest.
_SHORTEST: Final = math.radians(10.0)  # Smallest arc for estimating a hinge [rad].
_ROUND: Final = 0.05  # Largest distance (rms) from the circle per radius.
_DOORS: Final = (0.3, 1.05)  # Radii of doors [m].
_UNROUND: Final = 0.02  # A hinge with a larger distance (rms) per radius is doubtful.
_UNTURNED: Final = 8.0  # So is one if hand and door turn differently [deg].
_CUTS: Final = np.linspace(0.0, 0.4, 21)  # Shares of the path that may be reach.
_LEAST_PART: Final = 0.5  # Smallest share of the path on the circle.
_ALIKE, _NOISE = 1.5, 3e-4  # Parts of such residuals fit alike, per least and [m].
# A part is cut out if the whole is off by this ratio. Openings of a box and a cabinet
# by people and a robot have 1 to 7, doors with a reach of 5 to 20 cm 26 to 170.
_FAR_OFF: Final = 8.0
_LARGEST: Final = 1e9  # Larger forces and moments count as missing [N, N m].

# Another order of quaternions is proposed for an arc of this least size [rad], if the
# hand's and the door's rotation differ by more (rms) [rad], and with the other order by
# less than this share of it. The hand's rotation as a share of the opening angle is
# then in a range, and from proportionality to the angle it deviates by less (rms).
# Openings of a box by nine people have 0.70 to 0.98, and 0.02 to 0.10.
_LEAST_TURN: Final = math.radians(20.0)
_UNLIKE, _FAR_BETTER = 0.15, 0.3
_SHARE_TURNED, _IN_TIME = (0.65, 1.2), 0.12


class Hinge(NamedTuple):
    """A circle in space, fitted to the path of a hand."""

    centre: FloatArray  # Point of the axis in the plane of the motion [m], (3,).
    axis: FloatArray
    """Direction of the axis; the motion has positive angles about it, (3,)."""
    radius: float  # Distance of the hand from the axis [m].
    angles: FloatArray  # Opening angle of each sample, from 0 [rad], (N,).
    residual: float  # Distance of the motion from the circle, root mean square [m].


def find_hinge(positions: FloatArray) -> Hinge:
    """Fit a circle to positions of a hand [m], (N, 3); ValueError if there is none."""
    problem = "it has fewer than three samples"
    if len(positions) >= 3:
        hinge = _fitted(positions)
        arc, off = np.ptp(hinge.angles), hinge.residual
        if arc >= _SHORTEST and off <= _ROUND * hinge.radius:
            return hinge
        problem = (
            f"it is an arc of {math.degrees(arc):.1f}°, {1e3 * off:.0f} mm (rms) off a "
            f"circle of {hinge.radius:.2f} m"
        )
    raise ValueError(
        f"the motion has no hinge: {problem}; give --frame first-pose or a pose, or "
        "part it into repetitions (--segment)"
    )


def _fitted(positions: FloatArray, *, precisely: bool = True) -> Hinge:
    """Return the circle of least squared distances, or roughly of their squares."""
    mean = positions.mean(axis=0)
    _, _, directions = np.linalg.svd(positions - mean, full_matrices=False)
    plane, normal = directions[:2], directions[2]
    flat = (positions - mean) @ plane.T
    # x² + y² = 2 a x + 2 b y + c, the start of the fit of distances.
    left = np.column_stack([2.0 * flat, np.ones(len(flat))])
    a, b, c = np.linalg.lstsq(left, np.sum(flat**2, axis=1), rcond=None)[0]
    fit = np.array([a, b, math.sqrt(max(c + a * a + b * b, 1e-12))])

    def distances(circle: FloatArray) -> FloatArray:
        return np.asarray(np.hypot(*(flat - circle[:2]).T) - circle[2])

    fit = scipy.optimize.least_squares(distances, fit).x if precisely else fit
    arms = flat - fit[:2]
    angles = np.unwrap(np.arctan2(arms[:, 1], arms[:, 0]))
    angles -= angles[0]
    # Positive where the door is widest open: one that is closed again ends at 0.
    if angles[np.argmax(np.abs(angles))] < 0.0:
        angles, normal = -angles, -normal
    # plane[0] × plane[1] may be either normal; angles are positive about this one.
    handed = np.sign(np.cross(plane[0], plane[1]) @ directions[2])
    off_plane = (positions - mean) @ directions[2]
    off_circle = np.linalg.norm(arms, axis=1) - fit[2]
    residual = float(np.sqrt(np.mean(off_plane**2 + off_circle**2)))
    centre = mean + fit[:2] @ plane
    return Hinge(centre, normal * handed, float(fit[2]), angles, residual)


def door_hinge(positions: FloatArray) -> Hinge | None:
    """Return the hinge of a motion that turns as far as a door, None of another."""
    try:
        hinge = find_hinge(positions)
    except ValueError:
        return None
    return hinge if np.ptp(hinge.angles) >= _LEAST_TURN else None


def radius_of_door(poses: FloatArray) -> float | None:
    """Return the radius of a motion as of a door [m], None if it is not so round."""
    hinge = door_hinge(poses[:, :3])
    if hinge is None or hinge.residual > _UNROUND * hinge.radius:
        return None
    return hinge.radius if _DOORS[0] <= hinge.radius <= _DOORS[1] else None


def on_circle(samples: Samples) -> Samples:
    """Return the longest part that is on the circle of a hinge, without reach.

    It fits many times better than the whole: by its distance from a circle and the
    rotation of the hand with the angle, or by the distance alone.
    """
    positions, rotations = samples.positions, samples.rotations
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    turned = (rotations * rotations[0].inv()).as_rotvec()
    fits = {}
    for first, last in itertools.product(_CUTS, 1.0 - _CUTS):
        if last - first >= _LEAST_PART:
            places = way[-1] * np.linspace(first, last, 60)
            sampled = interpolated(places, way, np.hstack([positions, turned]))
            fits[first, last] = sampled[:, 3:], _fitted(sampled[:, :3], precisely=False)
    for with_rotation in (True, False) if turned.any() else (False,):
        residuals = {}
        for part, (turns, hinge) in fits.items():
            off = hinge.residual
            if with_rotation:  # The hand is to turn by the angle on the circle.
                untimely = turns @ hinge.axis - hinge.angles
                off = math.hypot(off, hinge.radius * float(np.std(untimely)))
            residuals[part] = off
        bound = _ALIKE * min(residuals.values()) + _NOISE
        fitting = [part for part, off in residuals.items() if off <= bound]
        first, last = max(fitting, key=lambda part: part[1] - part[0])
        if residuals[0.0, 1.0] >= _FAR_OFF * residuals[first, last]:
            return samples[(way >= first * way[-1]) & (way <= last * way[-1])]
    return samples


def doubtful_rotation(poses: FloatArray, reading: str = "") -> str | None:
    """Return a warning if orientations, as read, do not turn with their hinge."""
    hinge = door_hinge(poses[:, :3])
    if hinge is None:
        return None
    door = Rotation.from_rotvec(hinge.angles[:, None] * hinge.axis)
    orders = []
    for shift in (0, 1, -1):
        quaternions = np.roll(poses[:, 3:], shift, axis=1)
        rotations = Rotation.from_quat(quaternions, scalar_first=True)
        since = rotations * rotations[0].inv()
        error = float(np.sqrt(np.mean((since.inv() * door).magnitude() ** 2)))
        # A free hand may rotate about such an axis by chance, but not by the same angle
        # at the same time.
        about_axis = since.as_rotvec() @ hinge.axis
        share = float(about_axis @ hinge.angles / (hinge.angles @ hinge.angles))
        untimely = np.linalg.norm(about_axis - share * hinge.angles)
        timely = untimely <= _IN_TIME * np.linalg.norm(since.as_rotvec())
        fits = _SHARE_TURNED[0] <= share <= _SHARE_TURNED[1] and bool(timely)
        orders.append((error, fits))
    (error, fits), *others = orders
    other, other_fits = min(others, key=lambda order: order[0])
    if error < _UNLIKE or (reading and fits):
        return None
    text = f"the hand moves about a hinge, but its rotation differs by {error:.2g} rad"
    if reading:
        return f"{text}: was it read rightly, as {reading}?"
    if other > _FAR_BETTER * error or not other_fits:
        return None
    return (
        f"{text}, and by {other:.2g} rad with the other order of quaternions: is the "
        "order correct?"
    )


def offset_by(samples: Samples, offset: PoseNumbers | None) -> Samples:
    """Return the motion of an object with a pose in the hand, and moments about it."""
    if offset is None:
        return samples
    rotations = samples.rotations
    turn = Rotation.from_quat(offset[3:], scalar_first=True)
    arms = rotations.apply(offset[:3])
    if samples.wrenches is not None:
        samples = replace(samples, wrenches=about(samples.wrenches, arms))
    return _posed(samples, samples.positions + arms, rotations * turn)


def in_frame(
    samples: Samples, frame: str | PoseNumbers, notes: Notes
) -> tuple[Samples, float | None]:
    """Return a motion and its wrenches in a frame, and the radius of its hinge [m]."""
    if frame == "recorded":
        return samples, None
    positions, rotations = samples.positions, samples.rotations
    if frame != "hinge":
        base = samples.poses[0] if frame == "first-pose" else np.array(frame)
        axes = Rotation.from_quat(base[3:], scalar_first=True)
        moved = axes.inv().apply(positions - base[:3])
        return _posed(samples, moved, axes.inv() * rotations, axes), None
    hinge = find_hinge(positions)
    # The door's task frame: x pull, y up, z outwards from the hinge.
    outwards = positions[0] - hinge.centre
    outwards -= hinge.axis * (hinge.axis @ outwards)
    outwards /= np.linalg.norm(outwards)
    pull = np.cross(hinge.axis, outwards)
    axes = Rotation.from_matrix(np.column_stack([pull, hinge.axis, outwards]))
    # The orientation is the rotation since the start, in the axes of the door.
    turned = axes.inv() * rotations * rotations[0].inv() * axes
    if not np.ptp(samples.poses[:, 3:], axis=0).any():
        turned = Rotation.from_rotvec(hinge.angles[:, None] * [0.0, 1.0, 0.0])
        notes.add("no orientations: the hand is assumed to rotate with the door")
    widest = int(np.argmax(hinge.angles))
    opened, closed = np.degrees([hinge.angles[widest], abs(hinge.angles[-1])])
    if hinge.angles[-1] <= _STAYS_OPEN * hinge.angles[widest]:
        start, end = max(samples.times[0], 0.0), samples.times[widest]
        notes.warn(
            f"opened to {opened:.0f}° after {end:.2f} s, then closed to {closed:.0f}°: "
            f"to learn to open, cut there (--segment {start:.2f}-{end:.2f})"
        )
    text = f"at {hinge.radius:.3f} m, opened to {opened:.0f}°"
    notes.add(f"hinge {text}, {1e3 * hinge.residual:.1f} mm off the circle (rms)")
    about_axis = math.degrees(np.unwrap(turned.as_rotvec()[:, 1])[widest])
    doubts = []
    if not _DOORS[0] <= hinge.radius <= _DOORS[1]:
        doubts.append(f"doors have a radius of {_DOORS[0]:g} to {_DOORS[1]:g} m")
    if hinge.residual > _UNROUND * hinge.radius:
        doubts.append("the motion is not round")
    if abs(about_axis - opened) > max(_UNTURNED, 0.1 * opened):
        doubts.append(f"the hand turned by {about_axis:.0f}° about the hinge")
    if doubts:
        notes.warn(
            f"is this hinge {text}, right? {', and '.join(doubts)}; if it is not, cut "
            "the opening out (--segment)"
        )
    moved = axes.inv().apply(positions - positions[0])
    return _posed(samples, moved, turned, axes), hinge.radius


def _posed(
    samples: Samples,
    positions: FloatArray,
    rotations: Rotation,
    axes: Rotation | None = None,
) -> Samples:
    """Return samples with other poses, and wrenches in other axes."""
    poses = np.hstack([positions, rotations.as_quat(scalar_first=True)])
    wrenches = samples.wrenches
    if wrenches is not None and axes is not None:
        wrenches = in_axes(wrenches, axes)
    return replace(samples, poses=poses, wrenches=wrenches)


def in_axes(wrenches: FloatArray, axes: Rotation) -> FloatArray:
    """Return wrenches, (N, 6), in other axes, given in the present axes."""
    parts = wrenches[:, :3], wrenches[:, 3:]
    return np.hstack([axes.inv().apply(part) for part in parts])


def about(wrenches: FloatArray, shift: FloatArray) -> FloatArray:
    """Return wrenches, (N, 6), about a point that is shifted [m], m - shift × f."""
    forces, moments = wrenches[:, :3], wrenches[:, 3:]
    return np.hstack([forces, moments - np.cross(shift, forces)])


def wrenches_of_the_hand(
    samples: Samples, raw: RawRecording, settings: ImportSettings, notes: Notes
) -> Samples:
    """Return samples with the wrenches of the hand on the object.

    They are in the axes of the recorded poses, and about the position of the recorded
    hand. With the measured wrench of the environment on the hand (f_s, m_s), its bias
    b, the sensor's rotation R and position p relative to the hand, the axes A of the
    measurement (R, or those of the poses), and the tool's weight W and centre c,

        f = -(A (f_s - b_f) - W),    m = -(A (m_s - b_m) - R c × W) + p × f.

    Wrenches that cannot be converted are left out, and a note says why.
    """
    ignored = [
        f"--{field.name.replace('_', '-')}"
        for field in fields(settings)
        if field.name.startswith(("force_", "tool_", "gravity"))
        and getattr(settings, field.name) != field.default
    ]
    missing = samples.wrenches is None
    if ignored and (missing or raw.forces_on is not None):
        why = "it has no forces" if missing else "it states how they are"
        notes.warn(f"{', '.join(ignored)} without effect: {why}")
    if samples.wrenches is None:
        return samples
    if raw.forces_on is not None:
        settings = ImportSettings(force_on=raw.forces_on, force_axes="recorded")
    without = replace(samples, wrenches=None)
    pose, weight = np.array(settings.force_sensor), settings.tool_weight
    shift, in_hand = pose[:3], settings.force_axes == "hand"
    turning = in_hand or shift.any() or any(settings.tool_centre)
    if raw.quaternions is None and turning:
        notes.warn(
            "forces left out: they are in the axes of the hand, and it has no "
            "orientations; say --force-axes recorded if they are in those of positions"
        )
        return without
    hand = samples.rotations
    rotation = hand * Rotation.from_quat(pose[3:], scalar_first=True)
    axes = rotation if in_hand else Rotation.identity()
    wrenches = np.where(np.abs(samples.wrenches) < _LARGEST, samples.wrenches, np.nan)
    measured = wrenches if settings.force_on == "hand" else -wrenches
    if weight > 0.0:
        pull = weight * np.array(settings.gravity) / np.linalg.norm(settings.gravity)
        moments = np.cross(rotation.apply(settings.tool_centre), pull)
        tool = np.hstack([np.broadcast_to(pull, moments.shape), moments])
        measured = measured - in_axes(tool, axes)
        notes.add(f"weight of {weight:g} N subtracted from the forces")
    if (rest := settings.force_rest) > 0.0:
        resting = np.isfinite(measured).all(axis=1) & (samples.times <= rest)
        if not resting.any():
            notes.warn(f"forces left out: no sample in the first {rest:g} s")
            return without
        bias = measured[resting].mean(axis=0)
        measured = measured - bias
        force, moment = np.linalg.norm(bias[:3]), np.linalg.norm(bias[3:])
        notes.add(f"bias of {force:.3g} N and {moment:.3g} N m subtracted from forces")
    if raw.forces_on is None:
        whose = "sensor" if in_hand else "poses"
        notes.add(f"forces are on the {settings.force_on}, in the axes of the {whose}")
    recorded = in_axes(measured, axes.inv())
    return replace(samples, wrenches=-about(recorded, -hand.apply(shift)))
