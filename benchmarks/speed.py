"""Speed of the method and of the environment: python benchmarks/speed.py [PARTS ...].

Prints the times that docs/notes/speed.md shows: medians over rounds. Actions run in
turns within one process, with one BLAS thread, so that other load slows all equally.
"""

import copy
import functools
import gc
import itertools
import os
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
import tyro
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from gplfd_env import ENVIRONMENT_ID, IMPEDANCE_ENVIRONMENT_ID
from gplfd_env.spatial.se3 import handle_pose_on_arc
from gplfd_experiments.data.teacher import DEMONSTRATED_RADII, Teacher
from gplfd_experiments.files.provenance import code_state
from gplfd_experiments.files.table import Table, text_table
from gplfd_policies import ViaPoint, align
from gplfd_policies.adaptation import ADAPTATIONS
from gplfd_policies.agents.agent import batch_agents
from gplfd_policies.movements.skill import fit_skill
from gplfd_policies.registry.catalogue import make_agent

Array = NDArray[np.float64]
Action = Callable[[], object]
Timed = tuple[Callable[[], Action], int]
"""Prepares an action, which is not timed, and the number of its operations."""
Rows = Iterator[tuple[str, str]]
"""What is measured, and its value with the unit."""


def row(what: str, values: Array, unit: str, scale: float = 1.0) -> tuple[str, str]:
    """Return a line with a scaled median."""
    return what, f"{scale * np.median(values):.4g} {unit}"


def repeated(action: Action, times: int = 1) -> Timed:
    """Return an action that runs several times in a measurement."""
    return lambda: lambda: [action() for _ in range(times)], times


def measure(actions: Mapping[str, Timed], repeats: int) -> dict[str, Array]:
    """Time actions in turns, after a first round that warms up caches.

    Returns CPU and wall seconds per operation, (2, ``repeats``).
    """
    rounds: dict[str, list[tuple[float, float]]] = {name: [] for name in actions}
    for _ in range(repeats + 1):
        for name, (prepare, operations) in actions.items():
            action = prepare()
            gc.collect()
            wall, cpu = time.perf_counter(), time.process_time()
            action()
            cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
            rounds[name].append((cpu / operations, wall / operations))
    return {name: np.array(seconds[1:]).T for name, seconds in rounds.items()}


def method(repeats: int) -> Rows:
    """Time learning, prediction and via-points."""
    fits = {}
    for count, samples in ((6, 200), (100, 1000)):
        radii, rng = tuple(np.linspace(0.35, 0.65, count)), np.random.default_rng(0)
        motions = Teacher().demonstrate_doors(radii, 1, rng=rng)
        fit = functools.partial(fit_skill, align(motions, n_samples=samples))
        fits[f"fit of {count} × {samples}"] = fit
    skill, phases = next(iter(fits.values()))(), np.linspace(0.0, 1.0, 200)
    skill.deviations  # noqa: B018  (computed on first use; belongs to learning)
    path = skill.aligned.poses[0]
    points = [ViaPoint(phase=phases[at], pose=path[at]) for at in range(0, 40, 4)]

    def updating(form: str) -> Action:
        adaptation = ADAPTATIONS[form](skill, phases)

        def update() -> None:
            for point in points:
                adaptation.observe(point)
                _ = adaptation.mean, adaptation.std

        return update

    predict = functools.partial(skill.predict, phases)
    actions = {name: repeated(fit) for name, fit in fits.items()}
    actions["Skill.predict, 200 phases"] = repeated(predict, 50)
    for form in ADAPTATIONS:
        update = functools.partial(updating, form)
        actions[f"one via-point, {form}"] = update, len(points)
    for name, (cpu, _) in measure(actions, repeats).items():
        yield row(name, cpu, "ms", 1e3)


def stepping(envs: Any, actions: Sequence[Any], count: int = 1) -> Timed:
    """Return steps of one environment or of many, after a reset."""

    def prepare() -> Action:
        envs.reset(seed=0)
        return lambda: [envs.step(action) for action in actions]

    return prepare, count * len(actions)


def step_and_physics(
    environment_id: str, steps: int = 600
) -> tuple[Array, dict[str, Timed]]:
    """Return actions that open a door at 9° per second, their steps, and the physics.

    The physics alone has the same commands of joints.
    """
    env: Any = gym.make(environment_id, door="medium").unwrapped
    greatest, rng = env.action_space.high, np.random.default_rng(0)
    # Stiffnesses vary from half to the whole of their range.
    actions = greatest * rng.uniform(0.5, 1.0, (steps, greatest.size))
    angles = np.linspace(0.0, 0.15 * env.dt * steps, steps)
    actions[:, :6] = handle_pose_on_arc(env.door.radius, angles)
    actions[:, :6] += rng.normal(0.0, 0.002, (steps, 6))
    data, substeps = mujoco.MjData(env.model), round(env.dt / env.model.opt.timestep)
    env.reset(seed=0)
    start, commands = copy.copy(env.data), []
    for action in actions:
        env.step(action)
        commands.append(env.data.ctrl.copy())

    def physics() -> None:
        for command in commands:
            data.ctrl[:] = command
            mujoco.mj_step(env.model, data, nstep=substeps)

    def from_start() -> Action:
        mujoco.mj_copyData(data, env.model, start)
        return physics

    timed = {"step": stepping(env, actions), "physics": (from_start, steps)}
    return actions, timed


def environment(repeats: int) -> Rows:
    """Time steps beyond their physics, and resets."""
    for environment_id in (ENVIRONMENT_ID, IMPEDANCE_ENVIRONMENT_ID):
        _, actions = step_and_physics(environment_id)
        (step, _), (physics, _) = measure(actions, 4 * repeats).values()
        yield row(f"{environment_id}: step beyond physics", step - physics, "µs", 1e6)
        yield row(f"{environment_id}: step over physics", step / physics, "×")

    env: Any = gym.make(ENVIRONMENT_ID, door="medium")
    rng = np.random.default_rng(0)
    doors: Mapping[str, Callable[[], Any]] = {
        "the same door": lambda: "medium",
        "new friction": lambda: {"hinge_friction": rng.uniform(0.0, 2.0)},
        "a new radius": lambda: rng.uniform(0.30, 0.65),
    }

    def from_medium(door: Callable[[], Any]) -> Action:
        env.reset(options={"door": "medium"})
        return lambda: [env.reset(options={"door": door()}) for _ in range(5)]

    resets: dict[str, Timed] = {
        name: (functools.partial(from_medium, door), 5) for name, door in doors.items()
    }
    for name, (cpu, _) in measure(resets, repeats).items():
        yield row(f"reset: {name}", cpu, "ms", 1e3)


def vectors(repeats: int, counts: tuple[int, ...] = (2, 64)) -> Rows:
    """Open a medium door for 0.3 s in many simulations on two threads."""
    commands, alone = step_and_physics(ENVIRONMENT_ID, steps=30)

    def together(count: int, **settings: Any) -> Timed:
        envs = gym.make_vec(ENVIRONMENT_ID, count, door="medium", **settings)
        return stepping(envs, np.repeat(commands[:, None], count, axis=1), count)

    actions = {"mj_step": alone["physics"]}
    actions["sync"] = together(2, vectorization_mode="sync")
    actions |= {str(count): together(count, num_threads=2) for count in counts}
    times = measure(actions, repeats)
    (physics, _), (_, sync) = times.pop("mj_step"), times.pop("sync")
    for count, (cpu, wall) in times.items():
        name = f"{count} simulations on 2 threads"
        yield row(f"{name}, CPU over mj_step", cpu / physics, "×")
        yield row(f"{name}, speed over SyncVectorEnv", sync / wall, "×")


def agents(repeats: int, count: int = 64, periods: int = 250) -> Rows:
    """Time `gp` in closed loop with many simulations, in lockstep."""
    demonstrations = Teacher().standard_demonstrations(seed=0)
    agent = make_agent("gp", demonstrations)
    together = batch_agents([copy.deepcopy(agent) for _ in range(count)])
    doors = list(itertools.islice(itertools.cycle(DEMONSTRATED_RADII), count))
    settings: dict[str, Any] = {"num_threads": 2, "autoreset_mode": "Disabled"}
    envs = gym.make_vec(ENVIRONMENT_ID, count, door=doors, **settings)

    def run(observation: Any) -> None:
        for _ in range(periods):
            observation, *_ = envs.step(together.act(observation).action)

    def prepare() -> Action:
        first, _ = envs.reset(seed=0)
        together.reset(first)
        return functools.partial(run, first)

    ((_, wall),) = measure({"loop": (prepare, count * periods)}, repeats).values()
    yield row(f"{count} `gp` agents in lockstep", 1.0 / wall, "control steps/s")


PARTS: dict[str, Callable[[int], Rows]] = {
    part.__name__: part for part in (method, environment, vectors, agents)
}


def main(
    parts: tyro.conf.Positional[tuple[str, ...]] = tuple(PARTS), repeats: int = 5
) -> None:
    """Measure the parts and print a table.

    Args:
        parts: What to measure: method, environment, vectors, agents; a minute each.
        repeats: Rounds of every measurement, 1 or more.
    """
    state = code_state()
    print(f"commit {state['git']}, {state['versions']}, load {os.getloadavg()[0]:.1f}")
    gc.disable()
    with threadpool_limits(1), warnings.catch_warnings():
        # Teachers with sensor noise, about which `align` warns.
        warnings.simplefilter("ignore", UserWarning)
        rows = tuple(line for part in parts for line in PARTS[part](repeats))
    print(text_table(Table(columns=("what", "measured"), rows=rows)))


if __name__ == "__main__":
    tyro.cli(main)
