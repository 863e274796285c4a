"""What a step costs beyond its physics, and what it costs to begin an episode."""

import copy
import itertools
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np

from gplfd_env import ENVIRONMENT_ID, IMPEDANCE_ENVIRONMENT_ID
from gplfd_env.spatial.arc import handle_pose_on_arc
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.speed.report import Measurement, Target, Value, at_most
from gplfd_experiments.speed.timing import Timed, after, measure, repeated

_STEPS, _ROUNDS = 600, 4
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
_RADII = (0.41, 0.42)
"""Radii that are met before resets to them are timed [m]."""


def measure_steps(repeats: int) -> Measurement:
    """Open a medium door along its arc with jitter, and repeat its physics alone.

    Args:
        repeats: Times four rounds of 600 steps of each environment.
    """
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
    """Return an opening, and its physics alone, on a model of its own.

    The physics alone starts from the state after the reset and is given the commands of
    all steps, and the servo's gains wherever a step has changed them.

    Returns:
        ``step`` and ``physics``; and what answers whether the latter, when it last ran,
        ended bit for bit in the same state.
    """
    env: Any = gym.make(environment_id, door="medium").unwrapped
    actions = _arc_with_jitter(env)
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


def _arc_with_jitter(env: Any) -> FloatArray:
    """Return actions that open the door in 6 s; stiffnesses from half to all."""
    rng = np.random.default_rng(0)
    angles = np.linspace(0.0, 0.9, _STEPS)
    poses = handle_pose_on_arc(env.door.radius, angles)
    greatest: FloatArray = env.action_space.high
    actions: FloatArray = greatest * rng.uniform(0.5, 1.0, (_STEPS, greatest.size))
    actions[:, :6] = poses + rng.normal(0.0, 0.002, poses.shape)
    return actions


def _gains(model: mujoco.MjModel) -> FloatArray:
    """Everything in the model that an action may write."""
    return np.stack([model.actuator_gainprm, model.actuator_biasprm])


def _state(model: mujoco.MjModel, data: mujoco.MjData) -> FloatArray:
    state = np.empty(mujoco.mj_stateSize(model, _STATE))
    mujoco.mj_getState(model, data, state, _STATE)
    return state


def measure_resets(repeats: int) -> Measurement:
    """Time `env.reset`, observation included, to the same door and to others.

    Args:
        repeats: Measurements of every kind.
    """
    env = gym.make(ENVIRONMENT_ID, door="medium")
    times = measure(_resets(env), repeats)
    env.close()
    limits = {"the same door": 1.0, "new friction and mass": 1.0, "a new radius": 20.0}
    return Measurement(
        title="environment: reset",
        rows={name: {"CPU ms [quartiles]": time} for name, time in times.items()},
        targets=tuple(
            at_most(f"reset: {name} [ms]", 1e3 * times[name].cpu_median, limit)
            for name, limit in limits.items()
        ),
    )


def _resets(env: gym.Env[Any, Any]) -> dict[str, Timed]:
    """Resets of each kind; before, one that is not timed brings the door there."""
    rng, known = np.random.default_rng(0), itertools.cycle(_RADII)

    def new_physics() -> dict[str, float]:
        return {
            "hinge_friction": rng.uniform(0.0, 2.0),
            "panel_mass": rng.uniform(5.0, 30.0),
        }

    def to(door: Callable[[], Any], times: int = 1) -> None:
        for _ in range(times):
            env.reset(options={"door": door()})

    medium, next_known = partial(to, lambda: "medium"), partial(next, known)
    return {
        "the same door": repeated(env.reset, 20, medium),
        "new friction and mass": repeated(partial(to, new_physics), 20, medium),
        "a radius met before": repeated(
            partial(to, next_known), 20, partial(to, next_known, len(_RADII))
        ),
        "a new radius": repeated(
            partial(to, lambda: rng.uniform(0.30, 0.65)), 5, medium
        ),
    }
