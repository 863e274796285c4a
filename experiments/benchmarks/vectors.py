"""Many doors at once: environment steps per second, and what each of them costs."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
from numpy.typing import NDArray

from experiments.benchmarks.report import Table, Target
from experiments.benchmarks.throughput import Entrant, Load, Pace, measure_paces
from gplfd_env import ENVIRONMENT_ID
from gplfd_env.config import DOORS
from gplfd_env.scene import GRASP_KEY
from gplfd_env.task import handle_pose_on_arc

__all__ = ["Vectors", "measure_vectors"]

FloatArray = NDArray[np.float64]

RAW, RAW_MANY = "mj_step alone", "mj_step alone, 64 in turns"
SINGLE, SYNC = "gym.make", "SyncVectorEnv, 2"

_SIMULATIONS = (1, 2, 4, 16, 64, 256)
_THREADS = (1, 2)
_PERIODS = 30
_LEAST_STEPS = 800


@dataclass(frozen=True, kw_only=True, slots=True)
class Vectors:
    """The same 0.3 s of the same door, alone and many times over."""

    paces: dict[str, Pace]
    """By name: `RAW`, `RAW_MANY`, `SINGLE`, `SYNC`, and the `vector_name` of each."""
    identical: bool
    """Whether all simulations of all of them ended bit for bit in the same state."""
    load: Load
    """Of the machine."""

    def tables(self) -> tuple[Table, ...]:
        """One line per kind of loop."""
        raw, sync = self.paces[RAW], self.paces[SYNC]
        agreed = "same states bit for bit" if self.identical else "states DEPART"
        return (
            Table(
                title=f"environment: many at once ({agreed}; {self.load})",
                columns=("", "steps/s", "of Sync", "CPU µs/step", "of mj_step"),
                rows=tuple(
                    (
                        name,
                        f"{pace.rate:.0f}",
                        f"{pace.speed_up(sync):.2f}",
                        f"{1e6 * pace.cost:.1f}",
                        f"{pace.cost_ratio(raw):.2f}",
                    )
                    for name, pace in self.paces.items()
                ),
            ),
        )

    def targets(self) -> tuple[Target, ...]:
        """Faster than Gymnasium's own vector, and hardly dearer than the physics."""
        few, many = self.paces[vector_name(2, 2)], self.paces[vector_name(64, 2)]
        return (
            Target(
                name="vector, 2 simulations on 2 threads, over SyncVectorEnv",
                value=few.speed_up(self.paces[SYNC]),
                low=2.5,
            ),
            Target(
                name="vector, 64 simulations on 2 threads: CPU over mj_step's",
                value=many.cost_ratio(self.paces[RAW]),
                high=1.15,
            ),
        )


def vector_name(simulations: int, threads: int) -> str:
    """Return the name of a line: simulations × threads of `gym.make_vec`."""
    return f"gym.make_vec, {simulations} on {threads} thread{'s' * (threads > 1)}"


def measure_vectors(repeats: int) -> Vectors:
    """Open a medium door for 0.3 s in every way to step it, in turns.

    Args:
        repeats: Rounds in which each of them makes at least 800 environment steps.
    """
    commands = _opening()
    entrants = {
        RAW: _raw(commands),
        RAW_MANY: _raw(commands, 64),
        SINGLE: _single(commands),
        SYNC: _vector(commands, 2, vectorization_mode="sync"),
    } | {
        vector_name(simulations, threads): _vector(
            commands, simulations, num_threads=threads
        )
        for threads in _THREADS
        for simulations in _SIMULATIONS
    }
    paces, load = measure_paces(entrants, repeats, least_steps=_LEAST_STEPS)
    return Vectors(paces=paces, identical=_agree(entrants), load=load)


def _opening() -> FloatArray:
    """Return commands along the handle's arc with jitter, (30, 6)."""
    radius = DOORS["medium"].radius
    angles = np.linspace(0.0, 0.1, _PERIODS)
    arc = handle_pose_on_arc(radius, angles)
    return arc + np.random.default_rng(0).normal(0.0, 0.002, arc.shape)


def _raw(commands: FloatArray, simulations: int = 1) -> Entrant:
    """Return the physics alone; many in turns lose the processor's caches."""
    env: Any = gym.make(ENVIRONMENT_ID, door="medium").unwrapped
    models = [copy.copy(env.model) for _ in range(simulations)]
    pairs = [(model, mujoco.MjData(model)) for model in models]
    substeps = round(env.dt / env.model.opt.timestep)

    def begin() -> None:
        for model, data in pairs:
            mujoco.mj_resetDataKeyframe(model, data, GRASP_KEY)
            mujoco.mj_forward(model, data)

    def run() -> FloatArray:
        for command in commands:
            for model, data in pairs:
                data.ctrl[:6] = command
                mujoco.mj_step(model, data, nstep=substeps)
        return np.array([data.qpos for _, data in pairs])

    return Entrant(begin=begin, run=run, steps=simulations * len(commands))


def _single(commands: FloatArray) -> Entrant:
    env: Any = gym.make(ENVIRONMENT_ID, door="medium")

    def run() -> FloatArray:
        for command in commands:
            env.step(command)
        return np.array([env.unwrapped.data.qpos])

    return Entrant(begin=env.reset, run=run, steps=len(commands))


def _vector(commands: FloatArray, simulations: int, **arguments: Any) -> Entrant:
    envs: Any = gym.make_vec(
        ENVIRONMENT_ID, num_envs=simulations, door="medium", **arguments
    )
    actions = np.repeat(commands[:, None], simulations, axis=1)

    def run() -> FloatArray:
        for action in actions:
            envs.step(action)
        alone = [env.unwrapped.data.qpos for env in getattr(envs, "envs", ())]
        return np.array(alone or envs.unwrapped.qpos)

    return Entrant(begin=envs.reset, run=run, steps=simulations * len(commands))


def _agree(entrants: dict[str, Entrant]) -> bool:
    """Whether all simulations end in the same joint positions."""
    ends = []
    for entrant in entrants.values():
        entrant.begin()
        ends.append(np.asarray(entrant.run()))
    return bool(np.all(np.concatenate(ends) == ends[0]))
