"""Phase rules: which phase of the task an observed pose belongs to.

The policy of Arduengo et al., *Gaussian-Process-based Robot Learning from
Demonstration*, arXiv:2002.09979, is a function of time, but a compliant robot lags
behind the clock. Conditioning on "at clock time t the hand is here" makes the policy
learn its own lag. Progress is therefore estimated from the path: the phase of an
observation is the one at which the *demonstrations* come nearest to it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Protocol, runtime_checkable

import numpy as np

from gplfd_env.validation.fields import check_quantities, quantity
from gplfd_policies.arrays.rows import ALL_ROWS, Numbers, Rows
from gplfd_policies.arrays.shapes import Float
from gplfd_policies.demonstrations.path_similarity import LikelySizes

Poses = Float[np.ndarray, "*N 6"]
Phases = Float[Numbers, "*N"]


POSE_ERROR: Final = (2e-3, 0.15)
"""Errors of an observed pose that no demonstration shows: position [m], compliance and
slip of the grasp; rotation [rad], turning of the hand on the bar. A friction grasp
transmits a few tenths of a newton metre: under load the hand turns before the door
does, and its rotation alone would indicate a door angle that was not reached."""


@dataclass(frozen=True, kw_only=True, slots=True)
class PhaseNoise:
    """Phase observation noise: standard deviations."""

    position: float = quantity(POSE_ERROR[0], low=0.0, unit="m")
    """Of an observed position [m]."""

    rotation: float = quantity(POSE_ERROR[1], low=0.0, unit="rad")
    """Of an observed rotation [rad]."""

    heading: float = quantity(math.radians(3.0), low=0.0, unit="rad")
    """Turn of the whole motion about the vertical [rad]: how askew the robot stands to
    the door. 0 trusts the heading."""

    def __post_init__(self) -> None:
        check_quantities(self)


@dataclass(frozen=True, slots=True)
class PhaseEstimate:
    """Estimated phases of observed poses, one number of each kind per pose."""

    phase: Phases
    """Where along the task they are, 0..1."""
    std: Phases
    """Standard deviations of the phases."""
    misfit: Phases
    """How far they are from anything demonstrated near there: root mean square of the
    features' errors over their standard deviations. About 1 or less where all is as
    expected; NaN of a rule that does not compare."""
    sizes: Sequence[LikelySizes] = ()
    """What the paths so far say about size and heading, one per pose; none of a rule
    that does not infer them."""


@runtime_checkable
class PhaseObserver(Protocol):
    """Estimates the phases of the observed poses of N rows."""

    def reset(self, rows: Rows = ALL_ROWS) -> None:
        """Let these rows forget their paths and begin at the start of the task."""

    def update(
        self, poses: Poses, previous: Phases, command: Phases, rows: Rows = ALL_ROWS
    ) -> PhaseEstimate:
        """Return the phases of observed poses, and how sure they are.

        Args:
            poses: Hand poses of these rows, task frame [m, rad].
            previous: Phases of their last observations, 0 at the start of the task.
            command: Phases of their set-points.
            rows: The rows that are meant.
        """

    def rate(self, phases: Phases, rows: Rows = ALL_ROWS) -> Poses:
        """Return dμ/ds of these rows' demonstrations at phases, (A, 6)."""


@runtime_checkable
class PhaseRule(PhaseObserver, Protocol):
    """A phase observer of which those of several rows can be made one."""

    @property
    def settings(self) -> object:
        """What rules of different rows must share to be stacked."""

    @classmethod
    def stacked(cls, rules: Sequence[Any]) -> PhaseRule:
        """Return the rule of all rows of rules with equal settings."""


class ClockPhase:
    """The phase of an observation is that of the command: the paper's time.

    Note:
        A hand that lags behind its command teaches the policy its lag; see
        `gplfd_policies.phase.path_phase.PathPhase`.
    """

    @property
    def settings(self) -> object:
        """Nothing: all clocks are alike."""
        return ()

    @classmethod
    def stacked(cls, rules: Sequence[ClockPhase]) -> ClockPhase:
        """Return a clock."""
        return cls()

    def reset(self, rows: Rows = ALL_ROWS) -> None:
        """Do nothing: a clock has no memory."""

    def update(
        self, poses: Poses, previous: Phases, command: Phases, rows: Rows = ALL_ROWS
    ) -> PhaseEstimate:
        """Return the command phases, as if they were certain."""
        certain = np.zeros_like(command)
        return PhaseEstimate(command, certain, np.full_like(command, np.nan))

    def rate(self, phases: Phases, rows: Rows = ALL_ROWS) -> Poses:
        """Return zero: a certain phase makes no via-point weaker."""
        return np.zeros((*phases.shape, 6))
