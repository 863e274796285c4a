"""Phase rules: estimation of the phase of an observed pose.

The policy of Arduengo et al., arXiv:2002.09979, is a function of time, but a compliant
robot lags behind the clock. Conditioning on "at clock time t the hand is here" makes
the policy learn its own lag. Progress is therefore estimated from the path.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Protocol, runtime_checkable

import numpy as np

from gplfd_env.validation.fields import Quantities, quantity
from gplfd_policies.arrays.rows import ALL_ROWS, PerRow, Rows
from gplfd_policies.arrays.shapes import Axes
from gplfd_policies.demonstrations.path_similarity import SizePosterior

POSE_ERROR: Final = (2e-3, 0.15)
"""Errors of an observed pose that no demonstration shows: position [m], compliance and
slip of the grasp; rotation [rad], turning of the hand on the bar. A friction grasp
transmits a few tenths of a newton metre: under load the hand turns before the door
does, and its rotation alone would indicate a door angle that was not reached."""


@dataclass(frozen=True, kw_only=True, slots=True)
class PhaseNoise(Quantities):
    """Phase observation noise: standard deviations of position and rotation."""

    position: float = quantity(POSE_ERROR[0], low=0.0, unit="m")

    rotation: float = quantity(POSE_ERROR[1], low=0.0, unit="rad")


@dataclass(frozen=True, slots=True)
class PhaseEstimate:
    """Estimated phases of observed poses, one number of each kind per pose."""

    phase: PerRow
    """Phases of the poses, 0..1, and their standard deviations."""
    std: PerRow
    misfit: PerRow
    """Root mean square of the features' errors over their standard deviations near
    these phases: about 1 or less is as expected; NaN for a rule without comparison."""
    sizes: Sequence[SizePosterior] = ()
    """Estimates of size and heading from the paths so far, one per pose; empty for a
    rule that does not estimate them."""


@runtime_checkable
class PhaseRule(Protocol):
    """Estimates the phases of the observed poses of N rows."""

    settings: Any
    """Settings that must be equal for rules to be stacked."""

    @classmethod
    def stacked(cls, rules: Sequence[Any]) -> PhaseRule:
        """Return one rule for the rows of several rules with equal settings."""

    def reset(self, rows: Rows = ALL_ROWS) -> None:
        """Forget the paths of these rows and begin at the start of the task."""

    def update(
        self, poses: Axes, previous: PerRow, command: PerRow, rows: Rows = ALL_ROWS
    ) -> PhaseEstimate:
        """Return the phases of observed poses, and their uncertainty.

        Args:
            poses: Hand poses of these rows, task frame [m, rad].
            previous: Phases of their last observations, 0 at the start of the task.
            command: Phases of their set-points.
            rows: The rows of these poses.
        """

    def rate(self, phases: PerRow, rows: Rows = ALL_ROWS) -> Axes:
        """Return dμ/ds of these rows' demonstrations at phases, (A, 6)."""


class ClockPhase:
    """The phase of an observation is that of the command, i.e. time, as in the paper.

    A hand that lags behind its command teaches the policy its lag.
    """

    settings: object = ()

    @classmethod
    def stacked(cls, rules: Sequence[ClockPhase]) -> ClockPhase:
        """Return a clock."""
        return cls()

    def reset(self, rows: Rows = ALL_ROWS) -> None:
        """Do nothing: a clock has no memory."""

    def update(
        self, poses: Axes, previous: PerRow, command: PerRow, rows: Rows = ALL_ROWS
    ) -> PhaseEstimate:
        """Return the command phases, treated as certain."""
        certain = np.zeros_like(command)
        return PhaseEstimate(command, certain, np.full_like(command, np.nan))

    def rate(self, phases: PerRow, rows: Rows = ALL_ROWS) -> Axes:
        """Return zero: the phase is treated as certain."""
        return np.zeros((*phases.shape, 6))
