"""Metrics of an episode, computed from its log.

The prediction error is that of Arduengo et al., *Gaussian-Process-based Robot Learning
from Demonstration*, arXiv:2002.09979, Section IV-B; smoothness that of Balasubramanian
et al., *On the analysis of movement smoothness*, Journal of NeuroEngineering and
Rehabilitation 12:112, 2015. Forces on people are compared with ISO/TS 15066, which
limits the force of more than half a second and, at twice that value, a shorter one.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_env.task.opening import DEMONSTRATED_ANGLE, HEAVY_FORCE, STAGES
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.files.arrays import FloatArray, smoothed

PROGRESS: Final = (0.05, 0.15, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85, 0.95)
"""Door angles at which forecasts are scored, as shares of the demonstrated angle."""

_LATEST: Final = 0.1
"""Largest delay of a valid forecast, as a share of the demonstrated angle."""

_ARC_POINTS: Final = 100


def forecast_errors(
    log: EpisodeLog, demonstrated_angle: float
) -> tuple[float | None, ...]:
    """Return the error of the forecast made at each progress of `PROGRESS`.

    The truth is the handle's arc from its present angle to the demonstrated angle, even
    if the episode ended before. The error is the rms distance of points on this arc
    from the path of the forecast's mean; timing is ignored.
    """
    times, opened = log.forecasts.times, log.opening.door_angle
    errors: list[float | None] = [None] * len(PROGRESS)
    scored: list[tuple[int, int, float]] = []
    for number, angle in enumerate(demonstrated_angle * np.array(PROGRESS)):
        since = _first(log, opened >= angle)
        # Half a microsecond of tolerance, because both times are sums of steps.
        if since is not None and (asked := times >= since - 5e-7).any():
            forecast = int(np.argmax(asked))
            start = float(np.interp(times[forecast], log.times, opened))
            if start < min(angle + _LATEST * demonstrated_angle, demonstrated_angle):
                scored.append((number, forecast, start))
    if not scored:
        return tuple(errors)
    starts = np.array([start for *_, start in scored])
    arcs = np.linspace(starts, demonstrated_angle, _ARC_POINTS, axis=1)
    paths = handle_path(log, arcs.ravel()).reshape(-1, _ARC_POINTS, 3)
    for (number, forecast, _), rest in zip(scored, paths, strict=True):
        squared = squared_distances(rest, log.forecasts.mean[forecast, :, :3])
        errors[number] = math.sqrt(float(squared.mean()))
    return tuple(errors)


def handle_path(log: EpisodeLog, angles: FloatArray) -> FloatArray:
    """Return the handle's positions (N, 3) [m] at opening angles (N,) [rad].

    The path is turned and shifted to the logged handle: the robot may be misplaced.
    """
    door, path = DoorGeometry.of(log.config), log.opening.handle_pose
    true = door.hand_poses(log.opening.door_angle, log.opening.handle_angle)
    logged, seen = _plane(true), _plane(path)
    turn = np.vdot(logged - logged[0], seen - seen[0])
    wanted = door.hand_poses(angles)
    placed = seen[0] + turn / abs(turn) * (_plane(wanted) - logged[0])
    height = path[0, 1] + (wanted[:, 1] - true[0, 1])
    return np.stack([placed.real, height, placed.imag], axis=1)


def _plane(positions: FloatArray) -> NDArray[np.complex128]:
    """Positions seen from above, as x + iz."""
    return positions[:, 0] + 1j * positions[:, 2]


def squared_distances(points: FloatArray, path: FloatArray) -> FloatArray:
    """Return squared distances of points (N, 3) from a path with corners (M, 3)."""
    start, step = path[:-1].T, np.diff(path, axis=0).T
    length = np.maximum((step**2).sum(axis=0), np.finfo(float).tiny)
    # By coordinate, because sums over a last axis of three are slow.
    offset = [x[:, None] - first for x, first in zip(points.T, start, strict=True)]
    along: Any = sum(x * s for x, s in zip(offset, step, strict=True))
    share = np.clip(along / length, 0.0, 1.0)
    gap: Any = sum((x - share * s) ** 2 for x, s in zip(offset, step, strict=True))
    return np.asarray(gap.min(axis=1))


_MOVED: Final = math.radians(1.0)  # Angle from which the door counts as moved [rad].
_SMOOTHING_TIME: Final = 0.2
"""Window of the local polynomials for jerk and acceleration [s]."""
_RECOVERED: Final = math.radians(5.0)
"""Further opening after a disturbance that counts as recovery [rad]."""
_AFTER: Final = 1.0
"""Time after a disturbance in which the release speed is measured [s]."""


def episode_metrics(
    log: EpisodeLog, *, demonstrated_angle: float = DEMONSTRATED_ANGLE
) -> dict[str, Any]:
    """Return all measures of one episode by name, as plain data for JSON.

    SI units unless the name says otherwise. "Opening motion" means the steps from the
    door's first degree to its largest angle less one degree; all steps when the door
    never moved by a degree. A measure that an episode or a policy lacks is None.

    Args:
        log: The episode.
        demonstrated_angle: Angle to which the demonstrated doors were opened [rad]; the
            standard teacher's mean by default.
    """
    opening, agent = log.opening, log.decisions
    angle, stage = opening.door_angle, int(opening.capability[-1])
    rows = opening_motion(log)
    errors = prediction_errors(log)[rows]
    stiffness = _known_rows(agent.stiffness)[:, :3]
    stiff = bool(np.isfinite(stiffness).all())
    margin = _known_rows(agent.stability_margin)
    acceleration, peak, smoothness = door_acceleration(angle, log.dt), None, None
    if acceleration is not None:
        peak = float(np.max(np.abs(acceleration)))
        if acceleration.any():
            smoothness = 1.0 / math.sqrt(float(np.sum(acceleration**2)))
    # Where the bound on dk/dt limits a direction, the rate is within 0.2 % of it.
    used = share_of_bound(log)
    used = used[np.isfinite(used).all(axis=1)]
    governed = float(np.mean((used >= 0.998).any(axis=1))) if used.size else None
    names = ("policy", "door", "radius", "seed", "success", "failure", "reason")
    return {
        **{name: getattr(log, name) for name in names},
        "capability": stage,  # Index into STAGES of the furthest stage.
        "stage": STAGES[stage],
        "duration": float(log.times[-1] - log.times[0]),
        "final_angle_deg": math.degrees(angle[-1]),
        **{
            f"time_to_{degrees}_deg": _first(log, angle >= math.radians(degrees))
            for degrees in (15, 30, 60)
        },
        **_handle_forces(log),
        "work": work_on_door(log),
        # Distance of the hand from where it grasped the handle.
        "slip_max_mm": 1e3 * float(np.max(np.abs(opening.slip))),
        # Mean of E[ε²] during the opening motion, over x, y, z [m²] and over the
        # rotation vector [rad²].
        "prediction_error_position": _mean_where_finite(errors[:, :3].sum(axis=1)),
        "prediction_error_rotation": _mean_where_finite(errors[:, 3:].sum(axis=1)),
        # Of the path of the hand in the opening motion.
        "log_dimensionless_jerk": log_dimensionless_jerk(
            log.motion.ee_pose[rows, :3], log.dt
        ),
        # Along the columns of the log's `frame` [N/m].
        "stiffness_min": stiffness.min(axis=0).tolist() if stiff else None,
        "stiffness_max": stiffness.max(axis=0).tolist() if stiff else None,
        # Smallest distance to the stability bound, over translations [N/(m s)] and
        # rotations [N m/(rad s)].
        "stability_margin_translation": _finite(margin[:, :3].min()),
        "stability_margin_rotation": _finite(margin[:, 3:].min()),
        "governed_share": governed,
        # Door angles at which forecasts are scored, as shares of the demonstrated
        # angle, and rms distance of the handle's remaining path from the forecast path.
        "forecast_progress": list(PROGRESS),
        "forecast_error_mm": [
            None if error is None else 1e3 * error
            for error in forecast_errors(log, demonstrated_angle)
        ],
        # Indicators of the EUROBENCH benchmark: largest |φ̈| [rad/s²], 1 / √Σ φ̈² over
        # the control steps [s²/rad], larger is smoother, and time to the first degree.
        "door_acceleration_peak": peak,
        "door_smoothness": smoothness,
        "time_to_move": _first(log, np.abs(angle - angle[0]) >= _MOVED),
        **_disturbed(log),
        "latency_median_ms": 1e3 * float(np.nanmedian(agent.latency_s)),
        "latency_p95_ms": 1e3 * float(np.nanpercentile(agent.latency_s, 95)),
        "latency_wall_median_ms": _finite(1e3 * np.median(agent.latency_wall_s)),
        "latency_wall_p95_ms": _finite(1e3 * np.percentile(agent.latency_wall_s, 95)),
    }


def _handle_forces(log: EpisodeLog) -> dict[str, float]:
    """Return the measures of the force on the handle."""
    radial = np.abs(log.forces.force_radial)
    along = {"tangential": log.forces.force_tangential, "radial": radial}
    return {
        # Force along the motion of the handle, and along the radius, where it does no
        # work [N]: largest magnitude, and 95th percentile over the episode.
        **{
            f"force_{name}_{kind}": float(np.percentile(np.abs(force), percent))
            for name, force in along.items()
            for kind, percent in (("peak", 100), ("p95", 95))
        },
        # Across the path of the handle: ∫ |F_r| dt [N s], and the largest force that
        # lasted for 20 ms [N], which no single sample decides.
        "force_radial_impulse": float(np.trapezoid(radial, dx=log.dt)),
        "force_radial_20ms": sustained(radial, log.dt, 0.02),
        # In any direction [N].
        "force_handle_peak": float(
            np.linalg.norm((*along.values(), log.forces.force_vertical), axis=0).max()
        ),
    }


def _disturbed(log: EpisodeLog) -> dict[str, Any]:
    """Return the measures of a person, a stop and a push."""
    forces, angle = log.forces, log.opening.door_angle
    pushed = np.flatnonzero(forces.push_force > 0)
    displacement = speed = recovered = None
    if pushed.size:
        # Of the hand from the policy's mean, or from its command if it has no mean.
        agent = log.decisions
        path = np.where(np.isfinite(agent.desired), agent.desired, agent.action)
        beside = log.motion.ee_pose - path
        beside = beside[max(pushed[0] - 1, 0) : pushed[-1] + 2, :3]
        displacement = 1e3 * float(np.linalg.norm(beside - beside[0], axis=1).max())
    disturbances = forces.push_force, forces.person_force, forces.stop_force
    disturbed = np.flatnonzero(np.any(np.stack(disturbances) > 0, axis=0))
    if disturbed.size and disturbed[-1] + 1 < angle.size:
        released = int(disturbed[-1]) + 1
        stop = released + round(_AFTER / log.dt)
        speed = float(np.abs(np.gradient(angle, log.dt)[released:stop]).max())
        further = angle[released:] >= angle[released] + _RECOVERED
        recovered = float(np.argmax(further) * log.dt) if further.any() else None
    return {
        # On a person, and of the door on what stops it [N]: largest, and sustained for
        # half a second. ISO/TS 15066 allows 280 N and 140 N at hands and fingers.
        "person_force_peak": float(forces.person_force.max()),
        "person_force_sustained": sustained(forces.person_force, log.dt),
        "person_energy": float(forces.person_energy[-1]),
        "stop_force_peak": float(forces.stop_force.max()),
        "stop_force_sustained": sustained(forces.stop_force, log.dt),
        # Greatest change of the hand's distance from the policy's path under a push.
        "push_displacement_mm": displacement,
        # Largest speed of the door in the second after the last disturbance [rad/s],
        # and time until it was 5 degrees further open.
        "release_speed": speed,
        "recovery_time": recovered,
    }


def late_decisions(metrics: Sequence[Mapping[str, Any]]) -> str:
    """State in how many episodes decisions exceeded the control period; "" if in none.

    Of one policy, by the median, because a busy machine delays single decisions.
    """
    period = 1e3 * CONTROL_PERIOD
    medians = [m.get("latency_wall_median_ms") or 0.0 for m in metrics]
    late = [median for median in medians if median > period]
    if not late:
        return ""
    return (
        f"decisions took longer than the control period of {period:g} ms in "
        f"{len(late)} of {len(metrics)} episodes (median {np.median(late):.1f} ms of "
        "wall time); the simulation waits for them, a robot would not"
    )


def opening_motion(log: EpisodeLog) -> slice:
    """Rows from the door's first degree to its largest angle less one degree."""
    angle = log.opening.door_angle
    if angle.max() < _MOVED:
        return slice(0, angle.size)
    start = int(np.argmax(angle >= _MOVED))
    stop = int(np.argmax(angle >= angle.max() - _MOVED))
    return slice(start, max(stop, start) + 1)


def work_on_door(log: EpisodeLog) -> float:
    """Work of the hand on the door, ∫ F_t ds, by the trapezoidal rule [J].

    For a leaf on a hinge, ds = r dφ, where r is the distance of the hand from the
    hinge; on a lever it is smaller than that of the handle.
    """
    force, angle = log.forces.force_tangential, log.opening.door_angle
    if log.config.motion in ("hinged", "flap"):
        return log.config.hand_radius * float(np.trapezoid(force, angle))
    path = DoorGeometry.of(log.config).hand_poses(angle)[:, :3]
    steps = np.sign(np.diff(angle)) * np.linalg.norm(np.diff(path, axis=0), axis=1)
    return float(0.5 * (force[1:] + force[:-1]) @ steps)


def share_of_bound(log: EpisodeLog) -> FloatArray:
    """Rate of the stiffness over its stability bound, (T, 6); NaN without stiffness.

    It is 1 if the bound is not positive: the frame rotated, and stiffness must fall.
    """
    bound = log.decisions.stability_margin + log.decisions.stiffness_rate
    share: FloatArray = np.ones_like(bound)
    np.divide(log.decisions.stiffness_rate, bound, out=share, where=~(bound <= 0.0))
    return share


def prediction_errors(log: EpisodeLog) -> FloatArray:
    """Squared prediction error per step and output, bias and variance together.

    E[ε²] = (E[f*(t)] - f(t))² + var f*(t) of Section IV-B (unnumbered there), with the
    prediction at the observed phase, made before the agent used the observation, and
    the handle's true pose as f.

    Returns:
        (T, 6) [m², rad²]; NaN where the policy made no prediction.
    """
    bias = log.decisions.predicted_mean - log.opening.handle_pose
    return np.asarray(bias**2 + log.decisions.predicted_std**2)


def log_dimensionless_jerk(positions: FloatArray, dt: float) -> float | None:
    """Log dimensionless jerk of a path, -ln(T³ / v_peak² · ∫ ‖d³p/dt³‖² dt).

    T is the duration and v_peak the largest speed. A full minimum-jerk motion has
    -ln(720 · 64 / 225) = -5.32 whatever its length and duration. Derivatives come from
    quintics fitted to 0.2 s around each sample.

    Larger is smoother. None when the path (N, 3) [m], sampled every ``dt`` [s], is
    shorter than the window or does not move.
    """
    window = 2 * max(3, round(0.5 * _SMOOTHING_TIME / dt)) + 1
    if positions.shape[0] < window:
        return None
    velocity, jerk = (smoothed(positions, window, 5, deriv=n, step=dt) for n in (1, 3))
    peak_squared = float(np.max(np.sum(velocity**2, axis=1)))
    if peak_squared == 0.0:
        return None
    duration = (positions.shape[0] - 1) * dt
    cost = float(np.trapezoid(np.sum(jerk**2, axis=1), dx=dt))
    return -math.log(duration**3 / peak_squared * cost)


def door_acceleration(angle: FloatArray, dt: float) -> FloatArray | None:
    """Second derivative of the door's angle by local parabolas over 0.2 s [rad/s²].

    From angles (N,) [rad] at steps of ``dt`` [s]; None for fewer samples than a window.
    """
    window = 2 * round(0.5 * _SMOOTHING_TIME / dt) + 1
    if angle.size < window:
        return None
    return smoothed(angle, window, 2, deriv=2, step=dt)


def sustained(force: FloatArray, dt: float, duration: float = 0.5) -> float:
    """Greatest of the magnitudes (N,) [N] that lasted for a duration [s] in [N]."""
    window = round(duration / dt)
    return float(minimum_filter1d(force, window, mode="constant").max())


def _first(log: EpisodeLog, holds: NDArray[np.bool_]) -> float | None:
    """Time since reset of the first row in which a condition is true [s]."""
    return float(log.times[np.argmax(holds)]) if holds.any() else None


def _known_rows(values: FloatArray) -> FloatArray:
    """Return the steps, (N, 6), in which the policy has values; all without any."""
    # An agent that reaches first has no stiffness until it holds the handle.
    finite = np.isfinite(values).all(axis=1)
    return values[finite] if finite.any() else values


def _mean_where_finite(values: FloatArray) -> float | None:
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if finite.size else None


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


SHORT: Final[Mapping[str, str]] = {
    "stalled": "stuck",
    "latched": "latched",
    "not_grasped": "not grasped",
    "grasp_lost": "let go",
}
"""Short labels; other failures are named as they are."""

_WORDS: Final[Mapping[str, str]] = {
    "grasp_lost": "hand lost the handle",
    "base_blocked": "base was blocked",
    "stalled": "door did not move further",
    "latched": "latch was not released",
    "not_grasped": "handle was not grasped",
    "simulation_error": "simulation diverged",
    "policy_error": "policy raised an error",
    "time_limit": "time ran out",
    "blocked": "something blocked the door",
    "out_of_reach": "an arm joint was at its limit",
    "too_heavy": f"it took more than {HEAVY_FORCE:g} N",
}
"""Plain words for ``failure`` and ``reason`` of an episode."""


def why_closed(failure: str, reason: str) -> str:
    """Return in plain words why a door was not opened; "" if it was."""
    words = _WORDS.get(failure, failure.replace("_", " "))
    # Without a separate cause, the reason repeats the failure.
    cause = "" if reason in (failure, "handle_lost") else _WORDS.get(reason, reason)
    return f"{words}: {cause}" if cause else words
