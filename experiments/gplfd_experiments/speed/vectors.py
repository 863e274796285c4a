"""Many doors at once: environment steps per second, and what each of them costs."""

import copy
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np

from gplfd_env import ENVIRONMENT_ID
from gplfd_env.doors.config import DOORS
from gplfd_env.scene.build import GRASP_KEY
from gplfd_env.spatial.arc import handle_pose_on_arc
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.speed.machine import load
from gplfd_experiments.speed.report import Measurement, at_least, at_most
from gplfd_experiments.speed.timing import Timed, after, measure

PHYSICS, PHYSICS_IN_TURNS = "mj_step alone", "mj_step alone, 64 in turns"
SINGLE, SYNC = "gym.make", "SyncVectorEnv, 2"

_SIMULATIONS = (1, 2, 4, 16, 64, 256)
_THREADS = (1, 2)
_PERIODS = 30
_LEAST_STEPS = 800


def vector_name(simulations: int, threads: int) -> str:
    """Return the name of a line: simulations × threads of `gym.make_vec`."""
    return f"gym.make_vec, {simulations} on {threads} thread{'s' * (threads > 1)}"


def measure_vectors(repeats: int) -> Measurement:
    """Open a medium door for 0.3 s in every way to step it, in turns.

    Args:
        repeats: Rounds in which each of them makes at least 800 environment steps.
    """
    ways = _ways_to_step(_commands())
    identical = _end_alike(ways)
    times = measure(ways, repeats, least_operations=_LEAST_STEPS)
    physics, sync = times[PHYSICS], times[SYNC]
    agreed = "same states bit for bit" if identical else "states DEPART"
    return Measurement(
        title=f"environment: many at once ({agreed}; {load()})",
        rows={
            name: {
                "steps/s": time.rate,
                "of Sync": time.speed_over(sync),
                "CPU µs/step": 1e6 * time.cpu_median,
                "of mj_step": time.cpu_over(physics),
            }
            for name, time in times.items()
        },
        targets=(
            at_least(
                "vector, 2 simulations on 2 threads, over SyncVectorEnv",
                times[vector_name(2, 2)].speed_over(sync),
                2.5,
            ),
            at_most(
                "vector, 64 simulations on 2 threads: CPU over mj_step's",
                times[vector_name(64, 2)].cpu_over(physics),
                1.15,
            ),
        ),
    )


def _ways_to_step(commands: FloatArray) -> dict[str, Timed]:
    """Everything that is compared; actions return the joint positions at the end."""
    return {
        PHYSICS: _physics(commands),
        PHYSICS_IN_TURNS: _physics(commands, 64),
        SINGLE: _single(commands),
        SYNC: _vector(commands, 2, vectorization_mode="sync"),
    } | {
        vector_name(simulations, threads): _vector(
            commands, simulations, num_threads=threads
        )
        for threads in _THREADS
        for simulations in _SIMULATIONS
    }


def _commands() -> FloatArray:
    """Return commands along the handle's arc with jitter, (30, 6)."""
    radius = DOORS["medium"].radius
    angles = np.linspace(0.0, 0.1, _PERIODS)
    arc = handle_pose_on_arc(radius, angles)
    return arc + np.random.default_rng(0).normal(0.0, 0.002, arc.shape)


def _physics(commands: FloatArray, simulations: int = 1) -> Timed:
    """The physics alone; many in turns lose the processor's caches."""
    env: Any = gym.make(ENVIRONMENT_ID, door="medium").unwrapped
    models = [copy.copy(env.model) for _ in range(simulations)]
    pairs = [(model, mujoco.MjData(model)) for model in models]
    substeps = round(env.dt / env.model.opt.timestep)

    def run() -> FloatArray:
        for command in commands:
            for model, data in pairs:
                data.ctrl[:6] = command
                mujoco.mj_step(model, data, nstep=substeps)
        return np.array([data.qpos for _, data in pairs])

    def close() -> None:
        for model, data in pairs:
            mujoco.mj_resetDataKeyframe(model, data, GRASP_KEY)
            mujoco.mj_forward(model, data)

    return after(close, run, simulations * len(commands))


def _single(commands: FloatArray) -> Timed:
    env: Any = gym.make(ENVIRONMENT_ID, door="medium")

    def run() -> FloatArray:
        for command in commands:
            env.step(command)
        return np.array([env.unwrapped.data.qpos])

    return after(env.reset, run, len(commands))


def _vector(commands: FloatArray, simulations: int, **arguments: Any) -> Timed:
    envs: Any = gym.make_vec(
        ENVIRONMENT_ID, num_envs=simulations, door="medium", **arguments
    )
    actions = np.repeat(commands[:, None], simulations, axis=1)

    def run() -> FloatArray:
        for action in actions:
            envs.step(action)
        alone = [env.unwrapped.data.qpos for env in getattr(envs, "envs", ())]
        return np.array(alone or envs.unwrapped.qpos)

    return after(envs.reset, run, simulations * len(commands))


def _end_alike(ways: dict[str, Timed]) -> bool:
    """Whether all simulations end in the same joint positions."""
    ends = np.concatenate([np.asarray(timed.prepare()()) for timed in ways.values()])
    return bool(np.all(ends == ends[0]))
