"""Motion of a person who reaches for a handle, presses it and opens the door.

Random and irregular motion, and its irregular recording, stand first.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gplfd_env.doors.config import DoorConfig
from gplfd_env.validation.fields import Quantities, quantity
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.agents.reaching import GRASPED, join_at_grasp
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.demonstrations.npz import LabelledDemonstrations

DEMONSTRATED_RADII: Final = (0.35, 0.50, 0.65)
"""Radii of the demonstrated doors with a bar [m]."""
ROOM_RADII: Final = (0.53, 0.65, 0.78)
"""Radii of doors with a lever or knob, for DIN leaves of 0.584, 0.709, 0.834 m [m]."""
_RADII: Final[Mapping[str, tuple[float, float, float]]] = {
    "sliding": (0.55, 0.70, 0.85),
    "parallel-sliding": (0.45, 0.60, 0.75),
    "folding": (0.44, 0.54, 0.64),
    "flap": (0.32, 0.38, 0.44),
    "rising-butt": ROOM_RADII,
}
"""The same for other motions."""
_SHAPE: Final = {
    "parallel-sliding": ("mechanism", "offset"),
    "folding": ("leaf", "backset"),
}
"""Fields that determine the path in addition to the radius."""

# Pressing the handle: means and standard deviations.
_PRESS_TIME: Final = (0.8, 0.15)  # Time in which the handle is pressed [s].
_PRESS_SHARE: Final = (0.96, 0.03)  # Share of its travel, at most to its stop.
_OVERLAP: Final = 0.85
"""Share of the pressing after which a person begins to pull; the bolt is then free."""
_RETURN: Final = (math.radians(8.0), math.radians(25.0))
"""Range of opening angles in which the handle returns [rad]."""
_KEPT: Final = 0.2
"""Share of its rotation that the handle keeps, because a hand rests on it."""

# Reaching for the handle.
_DISTANCE: Final = (0.10, 0.25)  # Smallest and largest distance at the start [m].
_DIRECTION: Final = 0.6
"""Largest angle between start and normal of the door, sideways or vertically [rad]."""
_TURN: Final = 0.1  # Standard deviation per axis of the hand's rotation there [rad].
_ARCH: Final = 0.01
"""Standard deviation per axis of the path's distance from the straight line [m]."""
_REACH_TIME: Final = (1.6, 0.2)  # Mean and standard deviation [s].
_GRIP_TIME: Final = (0.4, 0.1)  # The same of the time in which the hand closes [s].

# Random and irregular motion.
_LONGEST_BURST: Final = 6  # Largest number of consecutive lost samples.
_N_COSINES: Final = 64  # Terms of a smooth random function, which is nearly Gaussian.
_TIMING_GRID: Final = 400  # Number of points for the integration of the uneven timing.


def minimum_jerk(progress: FloatArray) -> FloatArray:
    """Minimum-jerk profile 10 s³ - 15 s⁴ + 6 s⁵, constant outside [0, 1]."""
    s = np.clip(progress, 0.0, 1.0)
    return s**3 * (10.0 + s * (6.0 * s - 15.0))


def smooth_functions(
    times: FloatArray,
    correlation_time: float,
    n_functions: int,
    rng: np.random.Generator,
) -> FloatArray:
    """Draw smooth random functions with mean 0 and standard deviation 1, (N, n).

    A sum of cosines whose covariance is exp(-Δt² / (2 ``correlation_time``²)). It does
    not depend on the samples: it is the same motion at every sampling rate.
    """
    frequency = rng.standard_normal((n_functions, _N_COSINES)) / correlation_time
    phase = rng.uniform(0.0, 2.0 * np.pi, (n_functions, _N_COSINES))
    cosines = np.cos(times[:, None, None] * frequency + phase)
    return np.asarray(np.sqrt(2.0 / _N_COSINES) * cosines.sum(axis=-1))


def coloured_noise(
    n_samples: int, bandwidth: float, n_signals: int, rng: np.random.Generator
) -> FloatArray:
    """Draw stationary noise with mean 0 and standard deviation 1, (N, n).

    Its second-order Butterworth filter has a cut-off in cycles per sample; at or above
    0.5 the noise stays white. Equal to `scipy.signal.sosfilt`, which imports slowly.
    """
    if bandwidth >= 0.5:
        return rng.standard_normal((n_samples, n_signals))
    warped = 4.0 * np.tan(0.5 * np.pi * (2.0 * bandwidth))
    poles = warped * -np.exp(0.25j * np.pi * np.array([1.0, -1.0]))
    gain = warped**2 * np.real(1.0 / np.prod(4.0 - poles))
    poles = (4.0 + poles) / (4.0 - poles)
    pole = 0.5 * (poles[1] + poles[0].conj())
    _, first, second = np.poly([pole, pole.conj()]).tolist()
    now, before, _ = (np.poly([-1.0, -1.0]) * gain).tolist()

    def filtered(signal: FloatArray) -> FloatArray:
        values, late, later = [], 0.0, 0.0
        for number in signal.tolist():
            value = now * number + late
            late = before * number - first * value + later
            later = now * number - second * value
            values.append(value)
        return np.array(values)

    settling = math.ceil(4.0 / bandwidth)
    impulse = np.zeros(settling)
    impulse[0] = 1.0
    norm = np.linalg.norm(filtered(impulse))
    white = rng.standard_normal((settling + n_samples, n_signals))
    noise = np.array([filtered(signal) for signal in white.T]).T
    return np.asarray(noise[settling:] / norm)


def uneven_timing(
    clock: FloatArray, timing_std: float, rng: np.random.Generator
) -> FloatArray:
    """Draw a monotone map of [0, 1] onto itself with a deviation of its log-speed."""
    grid = np.linspace(0.0, 1.0, _TIMING_GRID)
    speed = np.exp(timing_std * smooth_functions(grid, 0.2, 1, rng)[:, 0])
    elapsed = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]))])
    return np.asarray(np.interp(clock, grid, elapsed / elapsed[-1]))


@dataclass(frozen=True, kw_only=True, slots=True)
class Habits(Quantities):
    """Irregularities of the motion and its recording; by default none."""

    haste: float = quantity(1.0, unit="", low=1.0, high=4.0)
    """Each motion is up to this factor faster or slower than the teacher's (uniform in
    the logarithm)."""
    pauses: int = quantity(0, unit="pauses", low=0, high=20)
    longest_pause: float = quantity(1.0, unit="s", low=0.1, high=10.0)
    """Number of pauses in the motion, at uniformly drawn places, and the longest; the
    shortest is a fifth of it."""
    backward: float = quantity(0.0, unit="rad", low=0.0, high=0.3)
    """Largest angle by which the door goes back and forward again in a pause."""
    longest_rest: float = quantity(0.0, unit="s", low=0.0, high=10.0)
    """Longest rest before the motion."""
    cut: float = quantity(0.0, unit="", low=0.0, high=0.5)
    """Largest share of the motion's duration that is missing at the end."""
    dropped: float = quantity(0.0, unit="", low=0.0, high=0.5)
    """Share of the samples that are lost, in bursts of up to six."""
    outliers: int = quantity(0, unit="outliers", low=0, high=20)
    outlier_distance: float = quantity(0.1, unit="m", low=0.0, high=1.0)
    """Number of outliers, samples in which the hand is elsewhere, and how far away."""


TIDY: Final = Habits()
"""The teacher without irregularities."""

MESSY: Final = Habits(
    haste=2.0,
    pauses=2,
    longest_pause=1.0,
    backward=math.radians(3.0),
    longest_rest=1.0,
    cut=0.05,
    dropped=0.05,
    outliers=1,
)
"""An ordinary recording without corrections."""


def irregular_timing(
    habits: Habits, duration: float, rate: float, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Draw the timing of a motion of a duration [s], with pauses and motions back.

    Returns times [s], the motion's clock in [0, 1], which stops in pauses, and the
    angle by which the door has gone back [rad], each (N,).
    """
    duration *= habits.haste ** rng.uniform(-1.0, 1.0)
    rest = habits.longest_rest * rng.uniform()
    places = np.sort(rng.uniform(0.1, 0.9, habits.pauses))
    lengths = habits.longest_pause * rng.uniform(0.2, 1.0, habits.pauses)
    depths = habits.backward * rng.uniform(0.0, 1.0, habits.pauses)
    end = rest + (1.0 - habits.cut * rng.uniform()) * duration + lengths.sum()
    times = np.arange(math.ceil(end * rate) + 1) / rate
    starts = rest + places * duration + np.cumsum(lengths) - lengths
    inside = np.clip((times[:, None] - starts) / lengths, 0.0, 1.0)
    clock = (times - rest - (lengths * inside).sum(axis=1)) / duration
    back = (depths * np.sin(np.pi * inside) ** 2).sum(axis=1)
    return times, np.clip(clock, 0.0, 1.0), back


def lose_samples(
    habits: Habits, poses: FloatArray, rng: np.random.Generator
) -> tuple[NDArray[np.bool_], FloatArray]:
    """Return the mask of the remaining samples, (N,), and poses with outliers, (N, 6).

    The first and the last sample are kept. The first ten samples have no outlier,
    because a recording is relative to its first sample.
    """
    n = len(poses)
    kept = np.ones(n, dtype=bool)
    lost = min(round(habits.dropped * n), n - 2)
    while np.count_nonzero(~kept) < lost:
        start, length = rng.integers(1, n - 1), rng.integers(1, _LONGEST_BURST + 1)
        kept[start : min(start + length, n - 1)] = False
    poses = poses.copy()
    candidates = np.flatnonzero(kept)[10:-1]
    for index in rng.choice(candidates, min(habits.outliers, candidates.size), False):
        direction = rng.standard_normal(3)
        distance = np.linalg.norm(direction)
        poses[index, :3] += habits.outlier_distance * direction / distance
    return kept, poses


class Press(NamedTuple):
    """Duration [s] and angle [rad] of turning the handle; zero for a bar."""

    time: float = 0.0
    angle: float = 0.0


def draw_press(door: DoorConfig, rng: np.random.Generator) -> Press:
    """Draw the motion of a door's handle."""
    if door.handle == "bar":
        return Press()
    longer, further = rng.standard_normal(2).tolist()
    time = max(_PRESS_TIME[0] + _PRESS_TIME[1] * longer, 0.5 * _PRESS_TIME[0])
    share = min(_PRESS_SHARE[0] + _PRESS_SHARE[1] * further, 1.0)
    return Press(time=time, angle=share * door.handle_travel)


def duration(press: Press, opening_time: float) -> float:
    """Return the duration of pressing and opening together [s]."""
    return _OVERLAP * press.time + opening_time


def press_and_opening(
    progress: FloatArray, press: Press, opening_time: float
) -> tuple[FloatArray, FloatArray]:
    """Return the progress of pressing and of opening, at that of the whole, (N,)."""
    if press.time == 0.0:
        return np.zeros_like(progress), progress
    elapsed = duration(press, opening_time) * progress
    opening = np.clip((elapsed - _OVERLAP * press.time) / opening_time, 0.0, 1.0)
    return minimum_jerk(elapsed / press.time), opening


def handle_angles(press: Press, share: FloatArray, angles: FloatArray) -> FloatArray:
    """Return handle angles [rad] for progress of pressing and door angles."""
    begins, ends = _RETURN
    back = (1.0 - _KEPT) * minimum_jerk((angles - begins) / (ends - begins))
    return press.angle * share * (1.0 - back)


def doors_like(door: DoorConfig) -> tuple[DoorConfig, ...]:
    """Return the three demonstrated doors of a door's kind: three sizes, one shape."""
    radii = DEMONSTRATED_RADII if door.handle == "bar" else ROOM_RADII
    radii = _RADII.get(door.motion, radii)
    kind: dict[str, Any] = door.kind
    if door.motion in _SHAPE:
        part, name = _SHAPE[door.motion]
        kind[part] = {name: getattr(getattr(door, part), name)}
    return tuple(DoorConfig(radius=radius, **kind) for radius in radii)


def reach_motion(
    rate: float, timing_std: float, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, Rotation]:
    """Return the motion of a hand that reaches the handle and closes, ending at time 0.

    Times (N,) [s], positions (N, 3) [m] from the handle, in door axes, and N rotations
    relative to the grasp. The motion along a gentle arch is unevenly timed.
    """
    distance = rng.uniform(*_DISTANCE)
    aside, above = rng.uniform(-_DIRECTION, _DIRECTION, 2)
    level = np.cos(above)
    direction = np.array([level * np.cos(aside), np.sin(above), level * np.sin(aside)])
    turned, arch = rng.standard_normal((2, 3))
    longer, slower = rng.standard_normal(2)
    reaching = max(_REACH_TIME[0] + _REACH_TIME[1] * longer, 0.5 * _REACH_TIME[0])
    gripping = max(_GRIP_TIME[0] + _GRIP_TIME[1] * slower, 0.5 * _GRIP_TIME[0])
    samples = round((reaching + gripping) * rate)
    times = np.arange(-samples, 1) / rate
    clock = np.clip((times - times[0]) / reaching, 0.0, 1.0)
    done = minimum_jerk(uneven_timing(clock, timing_std, rng))[:, None]
    from_line = np.sin(np.pi * done) ** 2 * (_ARCH * arch)
    positions = (1.0 - done) * (distance * direction) + from_line
    return times, positions, Rotation.from_rotvec((1.0 - done) * (_TURN * turned))


def with_reaches(
    reaches: Sequence[Demonstration],
    openings: Sequence[Demonstration],
    radii: Sequence[float | None],
) -> LabelledDemonstrations:
    """Join reaches and openings of doors with radii [m], or None.

    A signal says whether the hand holds the handle.
    """
    whole = tuple(map(join_at_grasp, reaches, openings))
    grasped = [{GRASPED: (x.times[:, None] >= 0.0).astype(float)} for x in whole]
    return LabelledDemonstrations(
        demonstrations=whole, radii=tuple(radii), signals=tuple(grasped)
    )
