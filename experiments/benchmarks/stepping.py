"""What a step of the environment costs beyond its physics."""

from __future__ import annotations

import statistics
import time
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
from numpy.typing import NDArray

from experiments.benchmarks.report import Table, Target
from gplfd_env import ENVIRONMENT_ID
from gplfd_env.task import handle_pose_on_arc

__all__ = ["Stepping", "measure_stepping"]

FloatArray = NDArray[np.float64]

_STEPS = 600
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION


@dataclass(frozen=True, kw_only=True, slots=True)
class Stepping:
    """Thread CPU time of `env.step` and of the physics alone, on the same states."""

    environment_id: str
    """What was stepped."""
    step: float
    """Median of `env.step` [s]."""
    physics: float
    """Median of `mj_step` from the same states with the same commands [s]."""
    ratio: float
    """Median over rounds of their ratio."""
    identical: bool
    """Whether the replayed states ended bit for bit where the environment did."""
    rounds: int
    """Rounds of 600 steps."""

    def tables(self) -> tuple[Table, ...]:
        """One line."""
        return (
            Table(
                title="environment: CPU time of a step, and of its physics alone",
                columns=("", "step µs", "physics µs", "ratio", "replay"),
                rows=(
                    (
                        self.environment_id,
                        f"{1e6 * self.step:.1f}",
                        f"{1e6 * self.physics:.1f}",
                        f"{self.ratio:.2f}",
                        "bit for bit" if self.identical else "DEPARTS",
                    ),
                ),
            ),
        )

    def targets(self) -> tuple[Target, ...]:
        """Little more than the physics."""
        return (
            Target(
                name="environment: beyond the physics [µs]",
                value=1e6 * (self.step - self.physics),
                high=20.0,
            ),
            Target(name="environment: times the physics", value=self.ratio, high=1.3),
        )


def measure_stepping(repeats: int) -> Stepping:
    """Open a medium door along its arc with jitter; replay the physics after it.

    Args:
        repeats: Rounds of 600 steps.
    """
    env = gym.make(ENVIRONMENT_ID, door="medium").unwrapped
    rounds = [_round(env, seed) for seed in range(repeats)]
    steps, physics, identical = zip(*rounds, strict=True)
    return Stepping(
        environment_id=ENVIRONMENT_ID,
        step=statistics.median(steps),
        physics=statistics.median(physics),
        ratio=statistics.median(
            step / bare for step, bare in zip(steps, physics, strict=True)
        ),
        identical=all(identical),
        rounds=repeats,
    )


def _round(env: Any, seed: int) -> tuple[float, float, bool]:
    """Return the median CPU seconds of both, and whether the replay is exact."""
    rng = np.random.default_rng(seed)
    env.reset(seed=seed)
    model, data = env.model, env.data
    states = np.empty((_STEPS, mujoco.mj_stateSize(model, _STATE)))
    commands = np.empty((_STEPS, data.ctrl.size))
    step = np.empty(_STEPS)
    for index in range(_STEPS):
        angle = 0.9 * index / _STEPS
        pose = handle_pose_on_arc(env.door.radius, angle) + rng.normal(0, 0.002, 6)
        mujoco.mj_getState(model, data, states[index], _STATE)
        started = time.thread_time_ns()
        env.step(pose)
        step[index] = time.thread_time_ns() - started
        commands[index] = data.ctrl
    bare, final = _replay(model, states, commands, round(env.dt / model.opt.timestep))
    exact = bool(np.array_equal(final, data.qpos))
    return 1e-9 * float(np.median(step)), 1e-9 * float(np.median(bare)), exact


def _replay(
    model: mujoco.MjModel, states: FloatArray, commands: FloatArray, substeps: int
) -> tuple[FloatArray, FloatArray]:
    """Step the physics from every state; return nanoseconds and the last positions."""
    data = mujoco.MjData(model)
    elapsed = np.empty(len(states))
    for index, (state, command) in enumerate(zip(states, commands, strict=True)):
        mujoco.mj_setState(model, data, state, _STATE)
        data.ctrl[:] = command
        started = time.thread_time_ns()
        mujoco.mj_step(model, data, nstep=substeps)
        elapsed[index] = time.thread_time_ns() - started
    return elapsed, data.qpos.copy()
