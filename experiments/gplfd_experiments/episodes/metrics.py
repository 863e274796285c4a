"""Metrics of an episode, computed from its log.

The prediction error is that of Arduengo et al., *Gaussian-Process-based Robot Learning
from Demonstration*, arXiv:2002.09979, Section IV-B; smoothness is the log
dimensionless jerk of Balasubramanian et al., *On the analysis of movement smoothness*,
Journal of NeuroEngineering and Rehabilitation 12:112, 2015. Acceleration and smoothness
of the door are those of the EUROBENCH project's benchmark of robots at doors. Forces on
people are compared with ISO/TS 15066, which limits the quasi-static force of more than
half a second and, at twice that value, the transient force. Errors of forecasts are in
`gplfd_experiments.episodes.forecast_error`.
"""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d
from scipy.signal import savgol_filter

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_env.task.opening import DEMONSTRATED_ANGLE
from gplfd_env.task.stages import STAGES
from gplfd_experiments.episodes.forecast_error import PROGRESS, forecast_errors
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.files.arrays import FloatArray

_MOVED: Final = math.radians(1.0)
"""Angle from which the door counts as moved [rad]; the opening motion ends when the
door is first within this angle of its largest angle."""

_SMOOTHING_TIME: Final = 0.2
"""Window of the local polynomials for jerk and acceleration [s]."""

SUSTAINED: Final = 0.5
"""A force of this duration counts as sustained [s]."""

_RECOVERED: Final = math.radians(5.0)
"""Further opening after a disturbance that counts as recovery [rad]."""
_AFTER: Final = 1.0
"""Time after a disturbance in which the release speed is measured [s]."""


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodeMetrics:
    """Measures of one episode. SI units unless the name says otherwise.

    "Opening motion" means the steps from the door's first degree to its largest angle
    less one degree; all steps when the door never moved by a degree.
    """

    policy: str
    """Name of the policy."""
    door: str
    """Name of the door."""
    radius: float
    """Distance from hinge to handle [m]."""
    seed: int
    """Seed of the environment's reset."""
    success: bool
    """Whether the task was solved."""
    failure: str
    """Failure; empty on success."""
    reason: str
    """Cause of the failure, see `gplfd_env.task.stages`; empty on success."""
    capability: int
    """Furthest stage that was reached: index into `gplfd_env.task.stages.STAGES`."""
    stage: str
    """Its name."""
    duration: float
    """Simulated duration of the episode [s]."""
    final_angle_deg: float
    """Door angle at the end [deg]."""
    time_to_15_deg: float | None
    """Time until the door first reached 15 degrees [s]; None if never."""
    time_to_30_deg: float | None
    """Time until the door first reached 30 degrees [s]; None if never."""
    time_to_60_deg: float | None
    """Time until the door first reached 60 degrees [s]; None if never."""
    force_tangential_peak: float
    """Largest magnitude of the force along the handle's motion [N]."""
    force_tangential_p95: float
    """Its 95th percentile over the episode [N]."""
    force_radial_peak: float
    """Largest magnitude of the force along the radius, which does no work [N]."""
    force_radial_p95: float
    """Its 95th percentile over the episode [N]."""
    work: float
    """Work of the hand on the door, ∫ F_t r dφ [J]."""
    slip_max_mm: float
    """Largest distance of the hand from where it grasped the handle [mm]."""
    prediction_error_position: float | None
    """Mean of E[ε²] summed over x, y, z during the opening motion [m²]; None for
    policies without predictions."""
    prediction_error_rotation: float | None
    """The same over the rotation vector [rad²]."""
    log_dimensionless_jerk: float | None
    """Smoothness of the hand's path; less negative is smoother. None if the opening
    motion is too short to differentiate."""
    stiffness_min: tuple[float, float, float] | None
    """Smallest stiffness along the columns of the log's `frame` [N/m]; None in policies
    without stiffness."""
    stiffness_max: tuple[float, float, float] | None
    """Largest stiffness along them [N/m]; None in policies without stiffness."""
    stability_margin_translation: float | None
    """Smallest distance to the stability bound over translations [N/(m s)]; None in
    policies without stiffness."""
    stability_margin_rotation: float | None
    """The same over the rotations [N m/(rad s)]."""
    governed_share: float | None
    """Share of the decisions in which the stability bound limited the stiffness; None
    in policies without stiffness."""
    forecast_progress: tuple[float, ...]
    """Door angles at which forecasts are scored, as shares of the angle to which the
    demonstrated doors were opened."""
    forecast_error_mm: tuple[float | None, ...]
    """Root mean square distance of the handle's remaining path from the forecast path
    at each progress [mm]; None without a forecast."""
    force_handle_peak: float
    """Largest force of the hand on the handle in any direction [N]."""
    door_acceleration_peak: float | None
    """Largest angular acceleration of the door [rad/s²]; like the next two an indicator
    of the EUROBENCH benchmark of robots at doors. None in episodes below 0.2 s."""
    door_smoothness: float | None
    """1 / √Σ φ̈² over the control steps [s²/rad]; larger is smoother."""
    time_to_move: float | None
    """Time until the door has moved by a degree [s]; None if it never did."""
    person_force_peak: float
    """Largest force on the person [N]; 0 without one. ISO/TS 15066 allows a transient
    force of 280 N at hands and fingers."""
    person_force_sustained: float
    """Largest force on the person sustained for half a second [N]; ISO/TS 15066 allows
    140 N."""
    person_energy: float
    """Work done on the person [J]."""
    stop_force_peak: float
    """Largest force of the door on what stops it [N]."""
    stop_force_sustained: float
    """Largest force on it sustained for half a second [N]."""
    push_displacement_mm: float | None
    """Largest change of the hand's distance from the policy's path since a push began
    [mm]; None without a push."""
    release_speed: float | None
    """Largest speed of the door in the second after a disturbance ended [rad/s]; None
    if none did."""
    recovery_time: float | None
    """Time from the end of the last disturbance until the door was 5 degrees further
    open [s]; None if none ended or it never was."""
    latency_median_ms: float
    """Median CPU time of a decision [ms]."""
    latency_p95_ms: float
    """95th percentile of the CPU time of a decision [ms]."""
    latency_wall_median_ms: float | None
    """Median wall time of a decision [ms]; like the next one, None in older logs
    without it."""
    latency_wall_p95_ms: float | None
    """95th percentile of the wall time of a decision [ms]."""

    def as_json(self) -> dict[str, Any]:
        """Plain numbers, strings, lists and None by name."""
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in dataclasses.asdict(self).items()
        }


def episode_metrics(
    log: EpisodeLog, *, demonstrated_angle: float = DEMONSTRATED_ANGLE
) -> EpisodeMetrics:
    """Compute all measures of one episode.

    Args:
        log: The episode.
        demonstrated_angle: Angle to which the demonstrated doors were opened [rad]; the
            standard teacher's mean by default.
    """
    opening, forces, agent = log.opening, log.forces, log.decisions
    angle = opening.door_angle
    rows = opening_motion(log)
    errors = prediction_errors(log)[rows]
    stiffness = _known_rows(agent.stiffness)
    margin = _known_rows(agent.stability_margin)
    tangential, radial = forces.force_tangential, forces.force_radial
    acceleration, smoothness = door_acceleration(angle, log.dt), None
    if acceleration is not None and acceleration.any():
        smoothness = 1.0 / math.sqrt(float(np.sum(acceleration**2)))
    moved = np.abs(angle - angle[0]) >= _MOVED
    speed, recovered = recovery(log)
    return EpisodeMetrics(
        policy=log.policy,
        door=log.door,
        radius=log.radius,
        seed=log.seed,
        success=log.success,
        failure=log.failure,
        reason=log.reason,
        capability=int(opening.capability[-1]),
        stage=STAGES[int(opening.capability[-1])],
        duration=float(log.times[-1] - log.times[0]),
        final_angle_deg=math.degrees(angle[-1]),
        time_to_15_deg=_first(log, angle >= math.radians(15.0)),
        time_to_30_deg=_first(log, angle >= math.radians(30.0)),
        time_to_60_deg=_first(log, angle >= math.radians(60.0)),
        force_tangential_peak=_peak(tangential),
        force_tangential_p95=_p95(tangential),
        force_radial_peak=_peak(radial),
        force_radial_p95=_p95(radial),
        work=work_on_door(log),
        slip_max_mm=1e3 * _peak(opening.slip),
        prediction_error_position=_mean_where_finite(errors[:, :3].sum(axis=1)),
        prediction_error_rotation=_mean_where_finite(errors[:, 3:].sum(axis=1)),
        log_dimensionless_jerk=log_dimensionless_jerk(
            log.motion.ee_pose[rows, :3], log.dt
        ),
        stiffness_min=_xyz(stiffness.min(axis=0)),
        stiffness_max=_xyz(stiffness.max(axis=0)),
        stability_margin_translation=_finite(margin[:, :3].min()),
        stability_margin_rotation=_finite(margin[:, 3:].min()),
        governed_share=governed_share(log),
        forecast_progress=PROGRESS,
        forecast_error_mm=tuple(
            None if error is None else 1e3 * error
            for error in forecast_errors(log, demonstrated_angle)
        ),
        force_handle_peak=_peak(
            np.linalg.norm((tangential, radial, forces.force_vertical), axis=0)
        ),
        door_acceleration_peak=None if acceleration is None else _peak(acceleration),
        door_smoothness=smoothness,
        time_to_move=_first(log, moved),
        person_force_peak=float(forces.person_force.max()),
        person_force_sustained=sustained(forces.person_force, log.dt),
        person_energy=float(forces.person_energy[-1]),
        stop_force_peak=float(forces.stop_force.max()),
        stop_force_sustained=sustained(forces.stop_force, log.dt),
        push_displacement_mm=push_displacement_mm(log),
        release_speed=speed,
        recovery_time=recovered,
        latency_median_ms=1e3 * float(np.median(agent.latency_s)),
        latency_p95_ms=1e3 * float(np.percentile(agent.latency_s, 95)),
        latency_wall_median_ms=_finite(1e3 * np.median(agent.latency_wall_s)),
        latency_wall_p95_ms=_finite(1e3 * np.percentile(agent.latency_wall_s, 95)),
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class FailedEpisode:
    """An episode in which the policy raised an error: the door was not opened."""

    policy: str
    door: str
    radius: float
    """Distance from hinge to handle [m]."""
    seed: int
    error: str
    """Error of the policy, and its location."""
    success: bool = field(default=False, init=False)
    failure: str = field(default="policy_error", init=False)

    def as_json(self) -> dict[str, Any]:
        """Plain numbers and strings by name."""
        return dataclasses.asdict(self)


def late_decisions(metrics: Sequence[Mapping[str, Any]]) -> str:
    """State in how many episodes decisions exceeded the control period; "" if in none.

    The median counts, because other processes on a busy machine delay single decisions.

    Args:
        metrics: Metrics of episodes of one policy, from `EpisodeMetrics.as_json`.
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
    if log.config.motion not in ("hinged", "flap"):
        path = DoorGeometry.of(log.config).hand_poses(log.opening.door_angle)[:, :3]
        steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
        signed = np.sign(np.diff(log.opening.door_angle)) * steps
        middle = 0.5 * (
            log.forces.force_tangential[1:] + log.forces.force_tangential[:-1]
        )
        return float(middle @ signed)
    return log.config.hand_radius * float(
        np.trapezoid(log.forces.force_tangential, log.opening.door_angle)
    )


def share_of_bound(log: EpisodeLog) -> FloatArray:
    """Rate of the stiffness over its stability bound, (T, 6); NaN without stiffness.

    It is 1 if the bound is not positive: the frame rotated, and the stiffness must
    decrease.
    """
    bound = log.decisions.stability_margin + log.decisions.stiffness_rate
    share: FloatArray = np.ones_like(bound)
    np.divide(log.decisions.stiffness_rate, bound, out=share, where=~(bound <= 0.0))
    return share


def governed_share(log: EpisodeLog) -> float | None:
    """Share of the decisions in which the bound on dk/dt limited some direction.

    There the rate is within two thousandths of the bound.
    """
    used = share_of_bound(log)
    used = used[np.isfinite(used).all(axis=1)]
    return float(np.mean((used >= 0.998).any(axis=1))) if used.size else None


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

    Args:
        positions: Path (N, 3) [m].
        dt: Sampling period [s].

    Returns:
        The (dimensionless) smoothness, larger is smoother; None when the path is
        shorter than the window or does not move.
    """
    window = 2 * max(3, round(0.5 * _SMOOTHING_TIME / dt)) + 1
    if positions.shape[0] < window:
        return None
    velocity, jerk = (
        savgol_filter(positions, window, 5, deriv=order, delta=dt, axis=0)
        for order in (1, 3)
    )
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
    acceleration: FloatArray = savgol_filter(angle, window, 2, deriv=2, delta=dt)
    return acceleration


def sustained(force: FloatArray, dt: float) -> float:
    """Greatest of the magnitudes (N,) [N] that lasted for `SUSTAINED` unbroken [N]."""
    window = round(SUSTAINED / dt)
    return float(minimum_filter1d(force, window, mode="constant").max())


def push_displacement_mm(log: EpisodeLog) -> float | None:
    """Greatest change of the hand's distance from the policy's path under a push [mm].

    The path is the policy's mean, or its command if it has no mean.
    """
    pushed = np.flatnonzero(log.forces.push_force > 0)
    if pushed.size == 0:
        return None
    path = np.where(
        np.isfinite(log.decisions.desired), log.decisions.desired, log.decisions.action
    )
    beside = (log.motion.ee_pose - path)[max(pushed[0] - 1, 0) : pushed[-1] + 2, :3]
    return 1e3 * float(np.linalg.norm(beside - beside[0], axis=1).max())


def release(log: EpisodeLog) -> int | None:
    """Row after the last force of a push, person or stop; None if none ended."""
    disturbed = (
        (log.forces.push_force > 0)
        | (log.forces.person_force > 0)
        | (log.forces.stop_force > 0)
    )
    rows = np.flatnonzero(disturbed)
    if rows.size == 0 or rows[-1] + 1 == disturbed.size:
        return None
    return int(rows[-1]) + 1


def recovery(log: EpisodeLog) -> tuple[float | None, float | None]:
    """Release speed [rad/s] and recovery time [s] after the last disturbance."""
    if (released := release(log)) is None:
        return None, None
    stop = released + round(_AFTER / log.dt)
    speeds = np.gradient(log.opening.door_angle, log.dt)[released:stop]
    further = (
        log.opening.door_angle[released:]
        >= log.opening.door_angle[released] + _RECOVERED
    )
    time = float(np.argmax(further) * log.dt) if further.any() else None
    return float(np.abs(speeds).max()), time


def _first(log: EpisodeLog, holds: NDArray[np.bool_]) -> float | None:
    """Time since reset of the first row in which a condition is true [s]."""
    return float(log.times[np.argmax(holds)]) if holds.any() else None


def _known_rows(values: FloatArray) -> FloatArray:
    """Return the steps, (N, 6), in which the policy has values; all steps without any.

    An agent that reaches first has no stiffness until it holds the handle.
    """
    finite = np.isfinite(values).all(axis=1)
    return values[finite] if finite.any() else values


def _peak(values: FloatArray) -> float:
    return float(np.max(np.abs(values)))


def _p95(values: FloatArray) -> float:
    return float(np.percentile(np.abs(values), 95))


def _mean_where_finite(values: FloatArray) -> float | None:
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if finite.size else None


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _xyz(values: FloatArray) -> tuple[float, float, float] | None:
    if not np.isfinite(values[:3]).all():
        return None
    return (float(values[0]), float(values[1]), float(values[2]))
