"""What a step of the environments costs beyond its physics."""

from __future__ import annotations

import copy
import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
from numpy.typing import NDArray

from experiments.benchmarks.report import Table, Target
from gplfd_env import ENVIRONMENT_ID, IMPEDANCE_ENVIRONMENT_ID
from gplfd_env.task import handle_pose_on_arc

__all__ = ["Stepped", "Stepping", "measure_stepping"]

FloatArray = NDArray[np.float64]

_STEPS = 600
_CHUNKS = 6
_WRITTEN = ("actuator_gainprm", "actuator_biasprm")
"""Fields of the model that an action may write: the servo's gains."""
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION


@dataclass(frozen=True, kw_only=True, slots=True)
class Stepped:
    """Thread CPU time of one environment's `step` and of its physics alone."""

    environment_id: str
    """What was stepped."""
    step: float
    """Median of `env.step` [s]."""
    physics: float
    """Median of `mj_step` from the same states with the same commands and gains [s]."""
    ratio: float
    """Median over rounds of their ratio."""
    identical: bool
    """Whether every replayed step ended bit for bit where the environment did."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Stepping:
    """Both environments, stepped and replayed in turns."""

    environments: tuple[Stepped, ...]
    """One entry each."""
    rounds: int
    """Rounds of 600 steps."""

    def tables(self) -> tuple[Table, ...]:
        """One line per environment."""
        return (
            Table(
                title="environment: CPU time of a step, and of its physics alone",
                columns=("", "step µs", "physics µs", "beyond µs", "ratio", "replay"),
                rows=tuple(
                    (
                        one.environment_id,
                        f"{1e6 * one.step:.1f}",
                        f"{1e6 * one.physics:.1f}",
                        f"{1e6 * (one.step - one.physics):.1f}",
                        f"{one.ratio:.2f}",
                        "bit for bit" if one.identical else "DEPARTS",
                    )
                    for one in self.environments
                ),
            ),
        )

    def targets(self) -> tuple[Target, ...]:
        """Little more than the physics."""
        return tuple(
            target
            for one in self.environments
            for target in (
                Target(
                    name=f"{one.environment_id}: beyond the physics [µs]",
                    value=1e6 * (one.step - one.physics),
                    high=20.0,
                ),
                Target(
                    name=f"{one.environment_id}: times the physics",
                    value=one.ratio,
                    high=1.3,
                ),
            )
        )


def measure_stepping(repeats: int) -> Stepping:
    """Open a medium door along its arc with jitter; replay the physics after it.

    Args:
        repeats: Rounds of 600 steps of each environment.
    """
    ids = ENVIRONMENT_ID, IMPEDANCE_ENVIRONMENT_ID
    return Stepping(
        environments=tuple(_stepped(id_, repeats) for id_ in ids), rounds=repeats
    )


def _stepped(environment_id: str, repeats: int) -> Stepped:
    env = gym.make(environment_id, door="medium").unwrapped
    rounds = [_round(env, seed) for seed in range(repeats)]
    steps, physics, identical = zip(*rounds, strict=True)
    return Stepped(
        environment_id=environment_id,
        step=statistics.median(steps),
        physics=statistics.median(physics),
        ratio=statistics.median(
            step / bare for step, bare in zip(steps, physics, strict=True)
        ),
        identical=all(identical),
    )


def _round(env: Any, seed: int) -> tuple[float, float, bool]:
    """Return the median CPU seconds of both, and whether the replay is exact."""
    env.reset(seed=seed)
    replay = _Replay(env)
    step: list[int] = []
    bare: list[int] = []
    # In turns, so that both see the same clock frequency and the same neighbours.
    for actions in np.array_split(_opening(env, seed), _CHUNKS):
        trace = [_traced_step(env, action) for action in actions]
        step += [one.elapsed for one in trace]
        bare += replay.run(trace)
    return (
        1e-9 * statistics.median(step),
        1e-9 * statistics.median(bare),
        replay.identical,
    )


def _opening(env: Any, seed: int) -> FloatArray:
    """Return actions that open the door in 6 s; stiffnesses from half to all."""
    rng = np.random.default_rng(seed)
    poses = handle_pose_on_arc(env.door.radius, np.linspace(0.0, 0.9, _STEPS))
    greatest: FloatArray = env.action_space.high
    actions: FloatArray = greatest * rng.uniform(0.5, 1.0, (_STEPS, greatest.size))
    actions[:, :6] = poses + rng.normal(0.0, 0.002, (_STEPS, 6))
    return actions


@dataclass(frozen=True, kw_only=True, slots=True)
class _TracedStep:
    """Everything that `mj_step` started from, and where it led."""

    elapsed: int
    """CPU time of the environment's step [ns]."""
    start: FloatArray
    """State before."""
    ctrl: FloatArray
    """Command that the step gave."""
    gains: tuple[FloatArray, ...]
    """What it wrote into the model, `_WRITTEN`."""
    end: FloatArray
    """State after."""


def _traced_step(env: Any, action: FloatArray) -> _TracedStep:
    start = _state(env.model, env.data)
    started = time.thread_time_ns()
    env.step(action)
    elapsed = time.thread_time_ns() - started
    return _TracedStep(
        elapsed=elapsed,
        start=start,
        ctrl=env.data.ctrl.copy(),
        gains=tuple(getattr(env.model, name).copy() for name in _WRITTEN),
        end=_state(env.model, env.data),
    )


class _Replay:
    """Steps the physics alone, on a model and data of its own.

    Args:
        env: Whose steps are replayed, after its reset.

    Attributes:
        identical: Every step so far ended where the environment's did.
    """

    def __init__(self, env: Any) -> None:
        self._model = copy.copy(env.model)
        self._data = mujoco.MjData(self._model)
        self._substeps = round(env.dt / self._model.opt.timestep)
        self.identical = True

    def run(self, trace: Sequence[_TracedStep]) -> list[int]:
        """Repeat steps; return the CPU time of each [ns]."""
        model, data = self._model, self._data
        elapsed = []
        for step in trace:
            mujoco.mj_setState(model, data, step.start, _STATE)
            data.ctrl[:] = step.ctrl
            for name, values in zip(_WRITTEN, step.gains, strict=True):
                getattr(model, name)[:] = values
            started = time.thread_time_ns()
            mujoco.mj_step(model, data, nstep=self._substeps)
            elapsed.append(time.thread_time_ns() - started)
            same = np.array_equal(_state(model, data), step.end)
            self.identical = self.identical and same
        return elapsed


def _state(model: mujoco.MjModel, data: mujoco.MjData) -> FloatArray:
    state = np.empty(mujoco.mj_stateSize(model, _STATE))
    mujoco.mj_getState(model, data, state, _STATE)
    return state
