"""Compliance control: movement, adaptation, stiffness and admittance, step by step.

Section IV-B of Arduengo et al., *Gaussian-Process-based Robot Learning from
Demonstration*, arXiv:2002.09979. Arrays of many hands have a leading axis of rows. A
row does not depend on the others, to the last bit: arithmetic is elementwise, and sums
have a fixed order. BLAS products such as ``vecdot`` are not used across rows, because
some add in an order that depends on the memory address.
"""

import math
from dataclasses import dataclass, field
from typing import Any, Final, Literal, NamedTuple

import numpy as np

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.spatial.se3 import into_axes
from gplfd_env.validation.fields import check_choice, check_quantities, quantity
from gplfd_policies.adaptation.gridded import LOOK_AHEAD, GriddedMovements
from gplfd_policies.arrays.rows import ALL_ROWS, PerRow, Rows
from gplfd_policies.arrays.shapes import Axes, Bool, Frames, Vectors
from gplfd_policies.control.load import (
    ContactState,
    ForceForecast,
    LearnedLoad,
    Load,
    LoadResponse,
)
from gplfd_policies.control.rendering import ArmRendering, VirtualRendering
from gplfd_policies.control.stability import GovernedStiffness, StiffnessGovernor
from gplfd_policies.control.steps import AgentStep
from gplfd_policies.control.stiffness import (
    DEFAULT_DYNAMICS,
    DEFAULT_PROFILE,
    PhaseStiffness,
    StiffnessProfile,
    VirtualDynamics,
    directional_std,
    path_frame,
    product,
)
from gplfd_policies.movements.movement import ViaPoint
from gplfd_policies.phase.phase_rule import POSE_ERROR, PhaseEstimate, PhaseRule

_PULL: Final = np.array([1.0, 0.0, 0.0])  # direction of the path before the first step
_UNITS: Final = np.eye(3)
_STD_TIMES: Final = 0.05, 0.2
"""Time constants of the σ that sets the stiffness, as it rises and as it falls [s]."""
_HELD: Final = 1e-3
"""Length of the last direction added to the chord of a path that stands still [m]."""


@dataclass(frozen=True, kw_only=True, slots=True)
class ComplianceConfig:
    """How an agent moves through the task, yields, and uses via-points."""

    load: Load = field(default_factory=LearnedLoad)
    """Rule that compensates the load of the door."""
    profile: StiffnessProfile = DEFAULT_PROFILE
    """Stiffness as a function of uncertainty, Eq. (24)."""
    phase_stiffness: PhaseStiffness | None = None
    """Stiffness from demonstrated forces at each phase, in addition to `profile`."""
    dynamics: VirtualDynamics = DEFAULT_DYNAMICS
    """Mass and damping ratio of the virtual dynamics, Eq. (22)."""
    rendering: type[VirtualRendering] | type[ArmRendering] = VirtualRendering
    """Where compliance is realised: by virtual dynamics, or by the arm itself."""
    stiffness_frame: Literal["path", "axes"] = "path"
    """Directions of the translational stiffness: of the path, or the task's axes."""
    control_period: float = quantity(CONTROL_PERIOD, above=0.0, unit="s")
    """Time between two commands [s]."""
    via_spacing: float = quantity(0.01, above=0.0)
    """Progress between two via-points, in phase."""
    via_std: tuple[float, float] = POSE_ERROR
    """Noise of an observed via-point: position [m], rotation [rad]."""
    force_std: tuple[float, float] = (1.0, 0.1)
    """σ of a measured force [N] and moment [N m] as observations of the door's."""
    settling_time: float = quantity(0.1, low=0.0, unit="s")
    """Time constant of the set-point after a via-point [s]; 0 for a jump. Tuned."""
    max_turn_lead: float = quantity(0.05, above=0.0)
    """Greatest lead of the set-point's rotation over the hand, in phase: if the hand
    turned earlier than the handle, it would only twist on the bar."""
    phase_drop: float = quantity(0.1, above=0.0)
    """If the observed phase falls by more than this below the last via-point, that
    phase counts as wrong. Tuned: ten times `via_spacing`, as doors swing back."""

    def __post_init__(self) -> None:
        check_quantities(self)
        if not isinstance(self.load, Load):
            raise ValueError(
                "ComplianceConfig.load must be a load rule "
                f"(gplfd_policies.control.load.Load), got {self.load!r}"
            )
        lowest, highest = np.repeat(self.rendering.stiffness_range, 3, axis=0).T
        profile, dynamics = self.profile, self.dynamics
        if np.any(profile.k_min < lowest) or np.any(profile.k_max > highest):
            raise ValueError(
                f"ComplianceConfig.profile asks for {profile.k_min} to {profile.k_max} "
                "[N/m, N m/rad], but its rendering can do from "
                f"{lowest} to {highest}; choose another one"
            )
        frame = self.stiffness_frame
        check_choice("ComplianceConfig.stiffness_frame", frame, ("path", "axes"))
        along_path, why = frame == "path", 'choose stiffness_frame="axes"'
        if along_path and self.rendering.control == "impedance":
            raise ValueError(f"an arm's stiffness is along the task's axes; {why}")
        if not along_path and self.phase_stiffness is not None:
            raise ValueError(
                "ComplianceConfig.phase_stiffness has the directions of the path; "
                'choose stiffness_frame="path", or None'
            )
        for name, values in {
            "dynamics.mass": dynamics.mass,
            "dynamics.least_damping": dynamics.least_damping,
            "profile.k_min": profile.k_min,
        }.items():
            if along_path and np.ptp(values[:3]) > 0.0:
                raise ValueError(
                    f"ComplianceConfig.{name} must be the same along x, y and z where "
                    f"the stiffness turns with the path, got {values[:3]}; or {why}"
                )
        if len(self.via_std) != 2 or not all(0.0 <= s < math.inf for s in self.via_std):
            raise ValueError(
                "ComplianceConfig.via_std must be two finite numbers >= 0, position "
                f"[m] and rotation [rad], got {self.via_std}"
            )


class _SetPoint(NamedTuple):
    """Where some hands are commanded to go in this control step, and how stiffly."""

    phase: PerRow
    desired: Axes  # poses at these phases [m, rad]
    velocity: Vectors  # of the poses [m/s]
    std: Axes  # σ that sets the stiffness, along the frame, and its rate
    std_rate: Axes
    frame: Frames | None
    governed: GovernedStiffness


class ComplianceController:
    """Controls one hand, or many with one phase rule and one config."""

    def __init__(
        self,
        movements: GriddedMovements,
        phases: PhaseRule,
        load: Load,
        config: ComplianceConfig,
        forces: ForceForecast | None = None,
    ) -> None:
        self._movements, self._phases, self._forces = movements, phases, forces
        self._load, self._config = load, config
        shape = movements.durations.shape
        self._governor = StiffnessGovernor(config.profile, config.dynamics, shape)
        self._renderer = config.rendering(config.dynamics, config.control_period, shape)
        self._via_noise = np.repeat(config.via_std, 3)
        self._command_phase, self._observed_phase = np.zeros(shape), np.zeros(shape)
        self._last_via = np.zeros(shape)
        # σ, settled, and with the lag of the hand; NaN before the first step.
        self._settled, self._std = np.full((2, *shape, 6), np.nan)
        self._tangent = np.broadcast_to(_PULL, (*shape, 3)).copy()
        self._offset = np.zeros((*shape, 6))  # of the set-point from the mean

    def reset(self, rows: Rows = ALL_ROWS) -> None:
        """Begin an episode at the closed door in these rows."""
        parts = self._movements, self._phases, self._load, self._governor
        for part in (*parts, self._renderer, self._forces):
            if part is not None:
                part.reset(rows)
        for phase in (self._command_phase, self._observed_phase, self._last_via):
            phase[rows] = 0.0
        self._settled[rows] = np.nan
        self._std[rows] = np.nan
        self._tangent[rows] = _PULL
        self._offset[rows] = 0.0

    def decide(self, poses: Axes, wrenches: Axes, rows: Rows = ALL_ROWS) -> AgentStep:
        """Return the commands of these rows for the next control period.

        Axes [m, rad] and wrenches [N, N m] of the hands are in the task frame.
        """
        movements, forces = self._movements, self._forces
        # A copy, because a phase rule may return the command phase, which changes.
        command_phase: PerRow = self._command_phase[rows].copy()
        estimate = self._phases.update(
            movements.geared(poses, -1, rows),
            self._observed_phase[rows],
            command_phase,
            rows,
        )
        phase = self._observed_phase[rows] = estimate.phase
        mean, mean_std, chord = movements.ahead(phase, rows)
        force, force_ahead = None, None
        if forces is not None:
            axes = into_axes(poses[..., None, 3:], _UNITS)
            force, force_ahead = forces.expect(phase, axes, rows)
            forces.measure(wrenches, axes, rows)

        # Due for a via-point are rows that moved on, or whose last phase was wrong.
        config, last_via = self._config, self._last_via[rows]
        lost = phase < last_via - config.phase_drop
        due = (phase >= last_via + config.via_spacing) | lost
        self._last_via[rows] = np.where(due, phase, last_via)
        if due.any():
            command_phase = self._adapt(due, estimate, poses, command_phase, rows)
            _, _, chord = movements.ahead(phase, rows)
        length = np.sqrt(np.add.reduce(chord * chord, axis=-1)) + 1e-9
        direction: Vectors = chord / length[..., None]
        contact = ContactState(
            expected=force,
            expected_ahead=force_ahead,
            wrench=wrenches,
            direction=direction,
            pose=poses,
            displacement=self._renderer.displaced(poses[..., :3], rows),
        )
        response = self._load.update(contact, rows)
        target = self._advance(phase, command_phase, response, direction, rows)
        frame, governed = target.frame, target.governed
        action = self._renderer.command(
            target.desired,
            target.velocity,
            governed.stiffness,
            compliant_wrench=response.compliant_wrench,
            compensated_force=(response.compliant_wrench - wrenches)[..., :3],
            rows=rows,
            frame=frame,
        )

        directions = np.eye(3) if frame is None else frame
        names = ("path_size", "path_size_std", "heading", "heading_std")
        inferred: dict[str, Any] = dict(zip(names, estimate.inferred, strict=True))
        if force is not None:
            expected, expected_std = force.along(directions)
            inferred |= {"expected_force": expected, "expected_force_std": expected_std}
        return AgentStep(
            action=action,
            desired=target.desired,
            frame=directions,
            std=target.std,
            std_rate=target.std_rate,
            stiffness=governed.stiffness,
            stiffness_rate=governed.rate,
            stability_margin=governed.margin,
            compensated_load=response.compensated_load,
            path_lag=response.path_lag,
            phase=target.phase,
            observed_phase=phase,
            phase_misfit=estimate.misfit,
            predicted_mean=movements.geared(mean, 1, rows),
            predicted_std=mean_std,
            via_point=due,
            **inferred,
        )

    def _adapt(
        self,
        due: Bool[np.ndarray | np.bool_, "*N"],
        estimate: PhaseEstimate,
        poses: Axes,
        command_phase: PerRow,
        rows: Rows,
    ) -> PerRow:
        """Condition due movements on the observed poses; return the command phases.

        The set-point stays: along the path by its phase, else by a decaying offset.
        """
        movements, phase = self._movements, estimate.phase
        before = self._set_point(command_phase, phase, rows)
        # A phase error displaces all outputs together along the path.
        along = self._phases.rate(phase, rows) * np.asarray(estimate.std)[..., None]
        # Indexed by `due`, the arrays of one hand have a leading axis, too.
        sizes = map(estimate.sizes, np.flatnonzero(due).tolist())
        seen = np.asarray(phase)[due].tolist(), poses[due], along[due], sizes
        via_points = [
            ViaPoint(phase=s, pose=pose, std=self._via_noise, along=error, sizes=size)
            for s, pose, error, size in zip(*seen, strict=True)
        ]
        movements.observe(movements.numbers[rows][due].tolist(), via_points)
        if self._forces is not None:
            self._forces.learn(due, phase, rows)
        ends = np.minimum(command_phase + LOOK_AHEAD, 1.0)
        phases = np.array([command_phase, ends - LOOK_AHEAD, ends])
        after, begin, end = movements.at(phases, rows)[..., :6]
        chord = (end - begin)[..., :3] / LOOK_AHEAD
        shift = np.add.reduce((before - after)[..., :3] * chord, axis=-1)
        shift /= np.add.reduce(chord * chord, axis=-1) + 1e-9
        shift = np.minimum(np.maximum(shift, -LOOK_AHEAD), LOOK_AHEAD)
        shifted = np.minimum(np.maximum(command_phase + shift, 0.0), 1.0)
        command_phase = np.where(due, shifted, command_phase)
        jump = before - self._set_point(command_phase, phase, rows)
        self._offset[rows] += np.where(np.asarray(due)[..., None], jump, 0.0)
        return command_phase

    def _set_point(self, phase: PerRow, observed_phase: PerRow, rows: Rows) -> Axes:
        """Return the means of these rows' movements, with limited lead in rotation."""
        turn_phase = np.minimum(phase, observed_phase + self._config.max_turn_lead)
        moments = self._movements.at(np.array([phase, turn_phase]), rows)
        poses: Axes = moments[0, ..., :6]
        poses[..., 3:] = moments[1, ..., 3:6]
        return poses

    def _advance(
        self,
        observed_phase: PerRow,
        command_phase: PerRow,
        response: LoadResponse,
        direction: Vectors,
        rows: Rows,
    ) -> _SetPoint:
        """Move the set-point one period on, and follow σ and stiffness, Eq. (24)."""
        config, movements = self._config, self._movements
        period = config.control_period
        step = response.pace * period / movements.durations[rows]
        phase = np.minimum(np.maximum(command_phase + step, 0.0), 1.0)
        phase_rate = (phase - command_phase) / period
        self._command_phase[rows] = phase
        turn_phase = np.minimum(phase, observed_phase + config.max_turn_lead)
        end = np.minimum(phase + LOOK_AHEAD, 1.0)
        phases = np.array([phase, end - LOOK_AHEAD, end, turn_phase])
        moments = movements.at(phases, rows)
        chord = moments[2, ..., :3] - moments[1, ..., :3]
        desired, std = moments[0, ..., :6], moments[0, ..., 6:12]
        desired[..., 3:] = moments[3, ..., 3:6]
        remaining = config.settling_time / (period + config.settling_time)
        offset = self._offset[rows] = remaining * self._offset[rows]
        desired = movements.geared(desired + offset, 1, rows)
        velocity = chord / LOOK_AHEAD * np.asarray(phase_rate)[..., None]

        lag = np.asarray(response.path_lag)[..., None] * direction
        frame, learned = None, config.phase_stiffness
        if config.stiffness_frame == "path":
            tangent = chord + _HELD * self._tangent[rows]
            square = np.add.reduce(tangent * tangent, axis=-1, keepdims=True)
            tangent = self._tangent[rows] = tangent / np.sqrt(square)
            if learned is not None:
                tangent = learned.direction_at(phase, tangent)
            frame = path_frame(tangent)
            std = directional_std(frame, std, moments[0, ..., 12])
            lag = product(frame.swapaxes(-1, -2), lag[..., None])[..., 0]
        # Every via-point reduces σ at once, and then it grows again. A fall, which
        # stiffens, is followed more slowly than a rise, which softens.
        before = self._settled[rows]
        before = np.where(np.isnan(before), std, before)
        share = period / (period + np.where(std > before, *_STD_TIMES))
        self._settled[rows] = std = before + share * (std - before)
        std[..., :3] = np.sqrt(std[..., :3] * std[..., :3] + lag * lag)
        previous = self._std[rows]
        previous = np.where(np.isnan(previous), std, previous)
        self._std[rows] = std
        wished = config.profile.stiffness(std, frame, rows)
        if learned is not None:
            wished = learned.combined(wished, phase)
        governed = self._governor.step(wished, period, rows, frame)
        std_rate = (std - previous) / period
        return _SetPoint(phase, desired, velocity, std, std_rate, frame, governed)
