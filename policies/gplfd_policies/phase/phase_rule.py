"""Which phase does an observed pose belong to?

The policy of Arduengo et al., *Gaussian-Process-based Robot Learning from
Demonstration*, arXiv:2002.09979, is a function of time, but a compliant robot lags
behind the clock. Conditioning on "at clock time t the hand is here" makes the policy
believe in its own lag. Progress is therefore told from the path: the phase of an
observation is the one at which the *demonstrations* come nearest to it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from gplfd_policies.arrays.members import EVERY_MEMBER, Members, Numbers

Poses = Float[np.ndarray, "*N 6"]
Phases = Float[Numbers, "*N"]


POSE_ERROR: Final = (2e-3, 0.15)
"""Errors of an observed pose that no demonstration shows: position [m], compliance and
slip of the grasp; rotation [rad], turning of the hand on the bar. A friction grasp
transmits a few tenths of a newton metre: under load the hand turns before the door
does, and who trusted its rotation would believe in a door that has not moved."""


@dataclass(frozen=True, kw_only=True, slots=True)
class PhaseNoise:
    """Errors with which a phase is told."""

    position: float = POSE_ERROR[0]
    """Of an observed position [m]."""

    rotation: float = POSE_ERROR[1]
    """Of an observed rotation [rad]."""

    heading: float = math.radians(3.0)
    """Turn of the whole motion about the vertical [rad]: how askew the robot stands to
    the door. 0 trusts the heading."""


@dataclass(frozen=True, slots=True)
class PhaseEstimate:
    """What a rule says of observed poses, one number of each kind per pose."""

    phase: Phases
    """Where along the task they are, 0..1."""
    std: Phases
    """Standard deviations of the phases."""
    misfit: Phases
    """How far they are from anything demonstrated near there: root mean square of the
    features' errors over their standard deviations. About 1 or less where all is as
    expected; NaN of a rule that does not look."""


@runtime_checkable
class PhaseObserver(Protocol):
    """Tells the phases of the observed poses of N members."""

    def reset(self, members: Members = EVERY_MEMBER) -> None:
        """Let these members forget their paths and begin at the start of the task."""

    def update(
        self,
        poses: Poses,
        previous: Phases,
        command: Phases,
        members: Members = EVERY_MEMBER,
    ) -> PhaseEstimate:
        """Return the phases of observed poses, and how sure they are.

        Args:
            poses: Hand poses of these members, task frame [m, rad].
            previous: Phases of their last observations, 0 at the start of the task.
            command: Phases of their set-points.
            members: Whose they are.
        """

    def rate(self, phases: Phases, members: Members = EVERY_MEMBER) -> Poses:
        """Return dμ/ds of these members' demonstrations at phases, (A, 6)."""


@runtime_checkable
class PhaseRule(PhaseObserver, Protocol):
    """A phase observer of which those of several members can be made one."""

    @property
    def settings(self) -> object:
        """What rules of different members must share to be stacked."""

    @classmethod
    def stacked(cls, rules: Sequence[Any]) -> PhaseRule:
        """Return the rule of all members of rules with equal settings."""


class ClockPhase:
    """The phase of an observation is that of the command: the paper's time.

    Note:
        A hand that lags behind its command teaches the policy its lag; see
        `PathPhase`.
    """

    @property
    def settings(self) -> object:
        """One clock is like the other."""
        return ()

    @classmethod
    def stacked(cls, rules: Sequence[ClockPhase]) -> ClockPhase:
        """Return a clock."""
        return cls()

    def reset(self, members: Members = EVERY_MEMBER) -> None:
        """A clock has nothing to forget."""

    def update(
        self,
        poses: Poses,
        previous: Phases,
        command: Phases,
        members: Members = EVERY_MEMBER,
    ) -> PhaseEstimate:
        """Return the command phases, as if they were certain."""
        certain = np.zeros_like(command)
        return PhaseEstimate(command, certain, np.full_like(command, np.nan))

    def rate(self, phases: Phases, members: Members = EVERY_MEMBER) -> Poses:
        """Return zero: a certain phase makes no via-point weaker."""
        return np.zeros((*phases.shape, 6))
