"""Decision of an agent in one control step: the record between policy and robot."""

from __future__ import annotations

import dataclasses
import math
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from gplfd_env.conventions.constants import Control
from gplfd_env.validation.fields import real_array
from gplfd_policies.arrays.records import read_only
from gplfd_policies.arrays.rows import PerRow, Rows
from gplfd_policies.arrays.shapes import Axes, Bool, Float, Pose, Vectors

Observation = Mapping[str, Float[np.ndarray, "..."]]
"""Measurements of the robot by name; with a leading axis for a batch."""


_NAN: Final[Any] = math.nan
_ABSENT: Final[Any] = {x: read_only(np.full(x, np.nan))[()] for x in ((), (3,), (6,))}


def measured(observation: Observation) -> tuple[Pose, Pose]:
    """Return ``ee_pose`` [m, rad] and ``wrench`` [N, N m] of a single hand."""
    read = []
    for name, units in (("ee_pose", "[m, rad]"), ("wrench", "[N, N m]")):
        value: object = observation
        wanted = f"an observation must be a mapping with {name!r},"
        try:
            value = observation[name]
            wanted = f"observation[{name!r}] must be"
            numbers = np.asarray(value, dtype=np.float64)
            usable = numbers.shape == (6,) and all(map(math.isfinite, numbers.tolist()))
        except (KeyError, IndexError, TypeError, ValueError):
            usable = False
        if not usable:
            raise ValueError(
                f"{wanted} six finite numbers {units}, got "
                f"{textwrap.shorten(repr(value), 100, placeholder=' ...')}"
            )
        read.append(numbers)
    return read[0], read[1]


@dataclass(frozen=True, kw_only=True, slots=True)
class AgentStep:
    """Command of an agent in one control step, with the quantities that explain it.

    Read-only. The steps of N agents are one record whose arrays have a leading axis N.
    All fields except `action` are optional; a quantity that an agent lacks is NaN.
    """

    action: Axes
    """Commanded hand pose, task frame [m, rad]."""
    desired: Axes = _NAN
    """Mean of the movement at the command phase [m, rad]."""
    frame: Float[np.ndarray, "... 3 3"] = field(default_factory=lambda: np.eye(3))
    """T: directions along the path, up, and across it, as columns in the task frame, or
    the axes of the task frame. The first three numbers of `std`, `stiffness`, their
    rates and margins are along these columns, and the translational stiffness is
    T diag(k) Tᵀ; the last three are about the axes of the task frame."""
    std: Axes = _NAN
    """Standard deviation that sets the stiffness: that of the movement at the command
    phase, plus `path_lag` along the path [m, rad]."""
    std_rate: Axes = _NAN
    """Rate of the σ that the controller used, including jumps [m/s, rad/s]."""
    stiffness: Axes = _NAN
    """Rendered stiffness [N/m, N m/rad]; with ``"impedance"`` a command to the arm."""
    stiffness_rate: Axes = _NAN
    """Rate of the stiffness over this step [N/(m s), N m/(rad s)]."""
    stability_margin: Axes = _NAN
    """Pointwise stability bound minus `stiffness_rate` [N/(m s), N m/(rad s)]."""
    compensated_load: PerRow | float = _NAN
    """Resistance along the path that the hand bears without yielding [N]."""
    path_lag: PerRow | float = _NAN
    """Lag of the hand behind `desired` along the path; part of `std` [m]."""
    phase: PerRow | float = _NAN
    """Command phase: phase of the set-point, 0..1."""
    observed_phase: PerRow | float = _NAN
    """Phase of the hand, 0..1."""
    phase_misfit: PerRow | float = _NAN
    """Root mean square deviation of the hand from the demonstrations near
    `observed_phase`, over the standard deviations: about 1 or less is as expected; from
    3 on, the phase is searched along the whole task."""
    path_size: PerRow | float = _NAN
    """Median size of the path so far relative to the demonstrations' geometric mean."""
    path_size_std: PerRow | float = _NAN
    """Standard deviation of the logarithm of `path_size`."""
    heading: PerRow | float = _NAN
    """Rotation of the path about the vertical relative to the demonstrations [rad]."""
    heading_std: PerRow | float = _NAN
    """Standard deviation of `heading` [rad]."""
    predicted_mean: Axes = _NAN
    """Mean at `observed_phase`, before this observation adapted the movement; the phase
    itself was estimated with this observation [m, rad]."""
    predicted_std: Axes = _NAN
    """Standard deviation of `predicted_mean` [m, rad]."""
    expected_force: Vectors = _NAN
    """Mean force of the hand on what it holds, along the columns of `frame`, expected
    before this observation from demonstrated forces and from this door so far [N]."""
    expected_force_std: Vectors = _NAN
    """Standard deviation of `expected_force` [N]."""
    mode: PerRow | float = _NAN
    """Number of the active mode, from 0, for an agent with several modes."""
    mode_probability: PerRow | float = _NAN
    """Probability of the active mode, from demonstrations and observations so far."""
    via_point: Bool[np.ndarray | np.bool_, "*N"] | bool = False
    """Whether this observation was used as a via-point."""

    def __post_init__(self) -> None:
        leading = np.shape(self.action)[:-1]
        for name, shape in STEP_SHAPES.items():
            value: Any = getattr(self, name)
            if not leading and value is _NAN and name != "action":
                object.__setattr__(self, name, _ABSENT[shape])
                continue
            if not (leading or shape) and type(value) is np.float64:
                continue
            dtype = np.bool_ if name == "via_point" else np.float64
            exact = type(value) is np.ndarray and value.dtype == np.float64
            if name == "action" and not exact:
                value = real_array(value)
            array: np.ndarray = np.array(value, dtype)
            if array.shape != leading + shape:
                single = shape if name == "frame" else ()
                if array.shape != single or name == "action":
                    raise ValueError(
                        f"AgentStep.{name} must have shape {leading + shape}, got "
                        f"{array.shape}"
                    )
                array = np.full(leading + shape, array)
            # The empty index turns arrays without axes into NumPy scalars.
            object.__setattr__(self, name, array[()])

    def command(self, control: Control) -> Float[np.ndarray, "*N A"]:
        """Return the action (6,), for "impedance" followed by the stiffness (12,)."""
        if control == "pose":
            return self.action
        if not np.array_equal(self.frame, np.broadcast_to(np.eye(3), self.frame.shape)):
            raise ValueError(
                "an arm is commanded its stiffness along the task's axes; leave "
                "AgentStep.frame out"
            )
        return np.concatenate([self.action, self.stiffness], axis=-1)

    @classmethod
    def stacked(cls, steps: Sequence[AgentStep]) -> AgentStep:
        """Return the steps of single agents as one record."""
        if not steps:
            return cls(action=np.empty((0, 6)))
        fields = {name: [getattr(step, name) for step in steps] for name in STEP_SHAPES}
        for name, shape in STEP_SHAPES.items():  # A default costs less than a stack.
            if all(value is _ABSENT.get(shape) for value in fields[name]):
                del fields[name]
        return cls(**{name: np.array(values) for name, values in fields.items()})

    def of(self, row: int) -> AgentStep:
        """Return the step of an agent of a batch."""
        return AgentStep(**{name: getattr(self, name)[row] for name in STEP_SHAPES})

    def among(self, rows: Rows, last_actions: Axes) -> AgentStep:
        """Return the steps of a batch in which only these rows act and others stay."""
        if isinstance(rows, tuple):
            return self
        everyone = AgentStep(action=last_actions)
        for name in STEP_SHAPES:
            getattr(everyone, name)[rows] = getattr(self, name)
        return everyone


STEP_SHAPES: Final[Mapping[str, tuple[int, ...]]] = MappingProxyType(
    {
        entry.name: {"Axes": (6,), "Vectors": (3,)}.get(str(entry.type), ())
        for entry in dataclasses.fields(AgentStep)
    }
    | {"frame": (3, 3)}
)
"""The fields of `AgentStep` with their shapes for one agent."""
