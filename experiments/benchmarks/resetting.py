"""What it costs to begin an episode, before the same door and before another."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np

from experiments.benchmarks.report import Table, Target
from experiments.benchmarks.timing import (
    Action,
    Candidate,
    CpuTime,
    interleaved,
    repeated,
)
from gplfd_env import ENVIRONMENT_ID

__all__ = ["Resetting", "measure_resets"]

_MANY, _FEW = 20, 5
_KNOWN = (0.41, 0.42)


@dataclass(frozen=True, kw_only=True, slots=True)
class Resetting:
    """CPU time of `env.reset`, observation included."""

    same_door: CpuTime
    """Nothing changes."""
    new_physics: CpuTime
    """Another hinge friction and leaf mass."""
    known_radius: CpuTime
    """One of two radii that this process has met before."""
    new_radius: CpuTime
    """A radius that it has not: another geometry, compiled and settled."""

    def tables(self) -> tuple[Table, ...]:
        """One line per kind of reset."""
        lines = {
            "the same door": self.same_door,
            "new friction and mass": self.new_physics,
            "a radius met before": self.known_radius,
            "a new radius": self.new_radius,
        }
        return (
            Table(
                title="environment: reset",
                columns=("", "CPU ms [quartiles]"),
                rows=tuple((name, str(cpu)) for name, cpu in lines.items()),
            ),
        )

    def targets(self) -> tuple[Target, ...]:
        """A new door every episode costs no more than a few steps."""
        measured = (
            ("the same door", self.same_door, 1.0),
            ("new friction and mass", self.new_physics, 1.0),
            ("a new radius", self.new_radius, 20.0),
        )
        return tuple(
            Target(name=f"reset: {name} [ms]", value=1e3 * cpu.median, high=limit)
            for name, cpu, limit in measured
        )


def measure_resets(repeats: int) -> Resetting:
    """Reset to doors drawn anew, in turns.

    Args:
        repeats: Measurements of every kind.
    """
    env = gym.make(ENVIRONMENT_ID, door="medium")
    rng = np.random.default_rng(0)

    def to(door: Any) -> None:
        env.reset(options={"door": door})

    def physics() -> None:
        friction, mass = rng.uniform(0.0, 2.0), rng.uniform(5.0, 30.0)
        to({"hinge_friction": friction, "panel_mass": mass})

    known = itertools.cycle(_KNOWN)

    def both_known() -> None:
        for radius in _KNOWN:
            to(radius)

    medium = partial(to, "medium")
    times = interleaved(
        {
            "same_door": _after(medium, env.reset, _MANY),
            "new_physics": _after(medium, physics, _MANY),
            "known_radius": _after(both_known, lambda: to(next(known)), _MANY),
            "new_radius": _after(medium, lambda: to(rng.uniform(0.30, 0.65)), _FEW),
        },
        repeats,
    )
    env.close()
    return Resetting(**times)


def _after(settle: Action, reset: Action, operations: int) -> Candidate:
    """Return resets of one kind; before, one that is not timed brings them there."""
    action = repeated(reset, operations)

    def prepare() -> Action:
        settle()
        return action.prepare()

    return Candidate(prepare=prepare, operations=operations)
