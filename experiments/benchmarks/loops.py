"""Agents in the loop: control steps per second, of one door and of many at once."""

from __future__ import annotations

import copy
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from experiments.benchmarks.report import Table, Target
from experiments.benchmarks.throughput import Entrant, Load, Pace, measure_paces
from experiments.teacher import DEMONSTRATED_RADII, Teacher
from gplfd_env import ENVIRONMENT_ID
from policies.agent import Agent
from policies.lockstep import batch_agents
from policies.registry import make_agent

__all__ = ["Loops", "measure_loops"]

ALONE = "one agent, gym.make"
TOGETHER = "{} agents in lockstep, gym.make_vec on {} threads"

_AGENTS = (2, 16, 64)
_THREADS = 2
_PERIODS = 250
"""Half an opening: no episode ends in it."""

Observation = Mapping[str, NDArray[np.float64]]


@dataclass(frozen=True, kw_only=True, slots=True)
class Loops:
    """`act` and `step` in turns for 2.5 s of an opening, policy ``gp``."""

    paces: dict[str, Pace]
    """Of control steps, by name."""
    deciding: dict[str, float]
    """CPU time of the agent in each of them, median [s]."""
    load: Load
    """Of the machine."""

    def tables(self) -> tuple[Table, ...]:
        """One line per loop."""
        return (
            Table(
                title=f"agent in the loop ({self.load})",
                columns=("", "control steps/s", "CPU µs/step", "of which agent"),
                rows=tuple(
                    (
                        name,
                        f"{pace.rate:.0f}",
                        f"{1e6 * pace.cost:.0f}",
                        f"{1e6 * self.deciding[name]:.0f}",
                    )
                    for name, pace in self.paces.items()
                ),
            ),
        )

    def targets(self) -> tuple[Target, ...]:
        """Fifty times real time."""
        name = TOGETHER.format(max(_AGENTS), _THREADS)
        return (
            Target(
                name=f"loop: {name} [control steps/s]",
                value=self.paces[name].rate,
                low=5000.0,
            ),
        )


def measure_loops(repeats: int) -> Loops:
    """Let agents open doors, one after the other and together, in turns.

    Args:
        repeats: Rounds of 250 control steps of every agent.
    """
    agent = _learned_agent()
    loops = {ALONE: _alone(agent)} | {
        TOGETHER.format(count, _THREADS): _together(agent, count) for count in _AGENTS
    }
    entrants = {
        name: Entrant(begin=loop.begin, run=loop.run, steps=loop.steps)
        for name, loop in loops.items()
    }
    paces, load = measure_paces(entrants, repeats)
    deciding = {
        name: statistics.median(loop.deciding[-repeats:]) / loop.steps
        for name, loop in loops.items()
    }
    return Loops(paces=paces, deciding=deciding, load=load)


def _learned_agent() -> Agent:
    """Return a ``gp`` agent that learned from six demonstrations of three doors."""
    demonstrations = Teacher().demonstrate_doors(
        DEMONSTRATED_RADII, per_radius=2, rng=np.random.default_rng(0)
    )
    return make_agent("gp", demonstrations)


class _Loop:
    """A closed loop of agents and simulations.

    Args:
        envs: One door or many.
        reset: Lets the agents begin.
        act: Gives their actions.
        count: How many doors.

    Attributes:
        steps: Control steps of one run.
        deciding: CPU seconds of the agents in every run.
    """

    def __init__(
        self,
        envs: Any,
        reset: Callable[[Observation], None],
        act: Callable[[Observation], Any],
        count: int = 1,
    ) -> None:
        self._envs, self._reset, self._act = envs, reset, act
        self.steps = count * _PERIODS
        self.deciding: list[float] = []

    def begin(self) -> None:
        """Close the doors and forget them."""
        self._observation, _ = self._envs.reset(seed=0)
        self._reset(self._observation)

    def run(self) -> None:
        """Open the doors."""
        observation, spent = self._observation, 0
        for _ in range(_PERIODS):
            started = time.thread_time_ns()
            action = self._act(observation).action
            spent += time.thread_time_ns() - started
            observation, *_ = self._envs.step(action)
        self.deciding.append(1e-9 * spent)


def _alone(agent: Agent) -> _Loop:
    env = gym.make(ENVIRONMENT_ID, door="medium")
    return _Loop(env, agent.reset, agent.act)


def _together(agent: Agent, count: int) -> _Loop:
    doors = [DEMONSTRATED_RADII[row % len(DEMONSTRATED_RADII)] for row in range(count)]
    envs = gym.make_vec(
        ENVIRONMENT_ID,
        num_envs=count,
        door=doors,
        num_threads=_THREADS,
        autoreset_mode="Disabled",
    )
    # One learning serves all: a copy is an agent of its own.
    agents = batch_agents([copy.deepcopy(agent) for _ in range(count)])
    return _Loop(envs, agents.reset, agents.act, count)
