"""Speed of the environment: steps, their physics, resets, and many doors at once."""

import copy
import itertools
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Final

import gymnasium as gym
import mujoco
import numpy as np

from gplfd_env import ENVIRONMENT_ID, IMPEDANCE_ENVIRONMENT_ID
from gplfd_env.scene.build import GRASP_KEY
from gplfd_env.spatial.arc import handle_pose_on_arc
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.speed.machine import load
from gplfd_experiments.speed.report import Measurement, Target, Value, at_least, at_most
from gplfd_experiments.speed.timing import Timed, after, measure, repeated

# --- Steps -------------------------------------------------------------------

_STEPS, _ROUNDS = 600, 4
_STATE: Final = mujoco.mjtState.mjSTATE_INTEGRATION


def measure_steps(repeats: int) -> Measurement:
    """Open a medium door along its arc with jitter, and repeat its physics alone."""
    rows: dict[str, Mapping[str, Value]] = {}
    targets: list[Target] = []
    for environment_id in (ENVIRONMENT_ID, IMPEDANCE_ENVIRONMENT_ID):
        both, is_repeated = _opening(environment_id)
        times = measure(both, _ROUNDS * repeats)
        step, physics = times["step"], times["physics"]
        beyond, ratio = 1e6 * step.cpu_beyond(physics), step.cpu_over(physics)
        rows[environment_id] = {
            "step µs": 1e6 * step.cpu_median,
            "physics µs": 1e6 * physics.cpu_median,
            "beyond µs": beyond,
            "ratio": ratio,
            "physics repeated": "bit for bit" if is_repeated() else "DEPARTS",
        }
        targets += [
            at_most(f"{environment_id}: beyond the physics [µs]", beyond, 20.0),
            at_most(f"{environment_id}: times the physics", ratio, 1.3),
        ]
    return Measurement(
        title=f"environment: CPU time of a step, mean of {_STEPS}, and of its physics "
        "alone",
        rows=rows,
        targets=tuple(targets),
    )


def _opening(environment_id: str) -> tuple[dict[str, Timed], Callable[[], bool]]:
    """Return an opening in 6 s, ``step``, and its ``physics`` alone on another model.

    The physics starts from the state after the reset and is given the commands of all
    steps, and the servo's gains wherever a step has changed them. The function returns
    whether its last run ended in the same state, bit for bit.
    """
    env: Any = gym.make(environment_id, door="medium").unwrapped
    rng = np.random.default_rng(0)
    greatest: FloatArray = env.action_space.high
    # Stiffnesses vary from half to the whole of their range.
    actions: FloatArray = greatest * rng.uniform(0.5, 1.0, (_STEPS, greatest.size))
    actions[:, :6] = _arc_with_jitter(env, 0.9, _STEPS, rng)
    env.reset(seed=0)
    start, gains = _state(env.model, env.data), _gains(env.model)
    commands: list[tuple[FloatArray, FloatArray | None]] = []
    for action in actions:
        env.step(action)
        before, gains = gains, _gains(env.model)
        kept = np.array_equal(before, gains)
        commands.append((env.data.ctrl.copy(), None if kept else gains))
    end, model = _state(env.model, env.data), copy.copy(env.model)
    data, substeps = mujoco.MjData(model), round(env.dt / model.opt.timestep)

    def step() -> None:
        for action in actions:
            env.step(action)

    def physics() -> None:
        for command, gains in commands:
            if gains is not None:
                model.actuator_gainprm[:], model.actuator_biasprm[:] = gains
            data.ctrl[:] = command
            mujoco.mj_step(model, data, nstep=substeps)

    to_start = partial(mujoco.mj_setState, model, data, start, _STATE)
    both = {
        "step": after(partial(env.reset, seed=0), step, _STEPS),
        "physics": after(to_start, physics, _STEPS),
    }
    return both, lambda: np.array_equal(_state(model, data), end)


def _arc_with_jitter(
    env: Any, angle: float, steps: int, rng: np.random.Generator
) -> FloatArray:
    """Return commands along the handle's arc to an angle [rad], (steps, 6)."""
    arc = handle_pose_on_arc(env.door.radius, np.linspace(0.0, angle, steps))
    return arc + rng.normal(0.0, 0.002, arc.shape)


def _gains(model: mujoco.MjModel) -> FloatArray:
    """Return all values in the model that an action may write."""
    return np.stack([model.actuator_gainprm, model.actuator_biasprm])


def _state(model: mujoco.MjModel, data: mujoco.MjData) -> FloatArray:
    state = np.empty(mujoco.mj_stateSize(model, _STATE))
    mujoco.mj_getState(model, data, state, _STATE)
    return state


# --- Resets ------------------------------------------------------------------

_RADII: Final = (0.41, 0.42)
"""Radii with a reset before the timed resets to them [m]."""


def measure_resets(repeats: int) -> Measurement:
    """Time `env.reset`, observation included, to the same door and to others."""
    env = gym.make(ENVIRONMENT_ID, door="medium")
    rng, known = np.random.default_rng(0), itertools.cycle(_RADII)

    def new_physics() -> dict[str, float]:
        return {
            "hinge_friction": rng.uniform(0.0, 2.0),
            "panel_mass": rng.uniform(5.0, 30.0),
        }

    def to(door: Callable[[], Any], times: int = 1) -> None:
        for _ in range(times):
            env.reset(options={"door": door()})

    # An untimed reset before each measurement sets the door.
    medium, next_known = partial(to, lambda: "medium"), partial(next, known)
    resets = {
        "the same door": repeated(env.reset, 20, medium),
        "new friction and mass": repeated(partial(to, new_physics), 20, medium),
        "a radius met before": repeated(
            partial(to, next_known), 20, partial(to, next_known, len(_RADII))
        ),
        "a new radius": repeated(
            partial(to, lambda: rng.uniform(0.30, 0.65)), 5, medium
        ),
    }
    times = measure(resets, repeats)
    env.close()
    limits = {"the same door": 1.0, "new friction and mass": 1.0, "a new radius": 20.0}
    targets = [
        at_most(f"reset: {name} [ms]", 1e3 * times[name].cpu_median, limit)
        for name, limit in limits.items()
    ]
    return Measurement(
        title="environment: reset",
        rows={name: {"CPU ms [quartiles]": time} for name, time in times.items()},
        targets=tuple(targets),
    )


# --- Many at once ------------------------------------------------------------

PHYSICS, PHYSICS_IN_TURNS = "mj_step alone", "mj_step alone, 64 in turns"
SINGLE, SYNC = "gym.make", "SyncVectorEnv, 2"

_SIMULATIONS: Final = (1, 2, 4, 16, 64, 256)
_THREADS: Final = (1, 2)
_PERIODS: Final = 30
_LEAST_STEPS: Final = 800


def vector_name(simulations: int, threads: int) -> str:
    """Return the name of a line: simulations × threads of `gym.make_vec`."""
    return f"gym.make_vec, {simulations} on {threads} thread{'s' * (threads > 1)}"


def measure_vectors(repeats: int) -> Measurement:
    """Open a medium door for 0.3 s by every method of stepping, in turns."""
    ways = _ways_to_step()
    agreed = "same states bit for bit" if _end_alike(ways) else "states DEPART"
    times = measure(ways, repeats, least_operations=_LEAST_STEPS)
    physics, sync = times[PHYSICS], times[SYNC]
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


def _ways_to_step() -> dict[str, Timed]:
    """Return the compared actions by name; actions return the joint positions."""
    env: Any = gym.make(ENVIRONMENT_ID, door="medium")
    inner = env.unwrapped
    commands = _arc_with_jitter(inner, 0.1, _PERIODS, np.random.default_rng(0))

    def physics(simulations: int) -> Timed:
        models = [copy.copy(inner.model) for _ in range(simulations)]
        pairs = [(model, mujoco.MjData(model)) for model in models]
        substeps = round(inner.dt / inner.model.opt.timestep)

        def close() -> None:
            for model, data in pairs:
                mujoco.mj_resetDataKeyframe(model, data, GRASP_KEY)
                mujoco.mj_forward(model, data)

        def run() -> FloatArray:
            # Many simulations in turns do not fit the processor's caches.
            for command in commands:
                for model, data in pairs:
                    data.ctrl[:6] = command
                    mujoco.mj_step(model, data, nstep=substeps)
            return np.array([data.qpos for _, data in pairs])

        return after(close, run, simulations * len(commands))

    def single() -> FloatArray:
        for command in commands:
            env.step(command)
        return np.array([inner.data.qpos])

    def vector(simulations: int, **arguments: Any) -> Timed:
        envs: Any = gym.make_vec(
            ENVIRONMENT_ID, num_envs=simulations, door="medium", **arguments
        )
        actions = np.repeat(commands[:, None], simulations, axis=1)

        def run() -> FloatArray:
            for action in actions:
                envs.step(action)
            alone = [one.unwrapped.data.qpos for one in getattr(envs, "envs", ())]
            return np.array(alone or envs.unwrapped.qpos)

        return after(envs.reset, run, simulations * len(commands))

    ways = {
        PHYSICS: physics(1),
        PHYSICS_IN_TURNS: physics(64),
        SINGLE: after(env.reset, single, len(commands)),
        SYNC: vector(2, vectorization_mode="sync"),
    }
    for threads, count in itertools.product(_THREADS, _SIMULATIONS):
        ways[vector_name(count, threads)] = vector(count, num_threads=threads)
    return ways


def _end_alike(ways: Mapping[str, Timed]) -> bool:
    """Return whether all simulations end in the same joint positions."""
    ends = np.concatenate([np.asarray(timed.prepare()()) for timed in ways.values()])
    return bool(np.all(ends == ends[0]))
