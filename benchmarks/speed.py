"""Speed of the method and of the environment: python benchmarks/speed.py [PARTS ...].

Prints the times that docs/benchmark.md and docs/learners.md show, with what is wanted.
Actions run in turns within one process, with one BLAS thread, so that other load slows
all of them equally. Times are CPU times, medians over the rounds. The part ``warp``
needs the extra warp.
"""

import copy
import functools
import gc
import importlib
import itertools
import os
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Literal, get_args

import gymnasium as gym
import mujoco
import numpy as np
import tyro
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from gplfd_env import ENVIRONMENT_ID, IMPEDANCE_ENVIRONMENT_ID, RL_ENVIRONMENT_ID
from gplfd_env.scene.build import GRASP_KEY
from gplfd_env.spatial.se3 import handle_pose_on_arc
from gplfd_experiments.data.teacher import DEMONSTRATED_RADII, Teacher
from gplfd_experiments.episodes.rollout import rollout
from gplfd_experiments.files.provenance import code_state
from gplfd_experiments.files.table import Table, text_table
from gplfd_experiments.recording.episode import record_episode
from gplfd_policies import ViaPoint, align
from gplfd_policies.adaptation import ADAPTATIONS, AdaptationForm
from gplfd_policies.agents.agent import batch_agents
from gplfd_policies.demonstrations.alignment import AlignmentMethod
from gplfd_policies.movements.skill import fit_skill
from gplfd_policies.registry.catalogue import make_agent

Array = NDArray[np.float64]
Action = Callable[[], object]
Timed = tuple[Callable[[], Action], int]
"""Prepares an action, which is not timed, and the number of its operations."""
Row = tuple[str, str, str]
"""What is measured, its value with the unit, and the wanted value."""
Rows = Iterator[Row]


def row(what: str, values: Array, unit: str, wanted: str = "", scale: float = 1) -> Row:
    """Return a line with a scaled median; ``wanted`` is a limit such as ``"≤ 20"``."""
    value = f"{scale * np.median(values):.4g} {unit}"
    return what, value, f"{wanted} {unit}" if wanted else ""


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
            gc.disable()
            try:
                wall, cpu = time.perf_counter(), time.process_time()
                action()
                cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
            finally:
                gc.enable()
            rounds[name].append((cpu / operations, wall / operations))
    return {name: np.array(seconds[1:]).T for name, seconds in rounds.items()}


def method(repeats: int) -> Iterator[Row]:
    """Time learning, prediction, via-points and alignment."""
    fits, sizes = {}, ((6, 200), (100, 1000))
    for count, samples in sizes:
        radii, rng = tuple(np.linspace(0.35, 0.65, count)), np.random.default_rng(0)
        motions = Teacher().demonstrate_doors(radii, 1, rng=rng)
        fit = functools.partial(fit_skill, align(motions, n_samples=samples))
        fits[count, samples] = fit
    learning = {f"fit of {n} × {m}": repeated(fit) for (n, m), fit in fits.items()}
    times = measure(learning, repeats)
    for name, (cpu, _) in times.items():
        yield row(name, cpu, "ms", scale=1e3)
    small, large = (cpu for cpu, _ in times.values())
    yield row("fit of 100 × 1000 over 6 × 200", large / small, "×", "≤ 2")

    skill, phases = fits[sizes[0]](), np.linspace(0.0, 1.0, 200)
    skill.deviations  # noqa: B018  (computed on first use; belongs to learning)
    path = skill.aligned.poses[0]
    points = [ViaPoint(phase=phases[at], pose=path[at]) for at in range(0, 40, 4)]

    def updating(build: AdaptationForm) -> Action:
        adaptation = build(skill, phases)

        def update() -> None:
            for point in points:
                adaptation.observe(point)
                _ = adaptation.mean, adaptation.std

        return update

    actions: dict[str, Timed] = {
        form: (functools.partial(updating, build), len(points))
        for form, build in ADAPTATIONS.items()
    }
    actions["predict"] = repeated(functools.partial(skill.predict, phases), 50)
    adapting = {name: cpu for name, (cpu, _) in measure(actions, repeats).items()}
    predict = adapting.pop("predict")
    yield row("Skill.predict, 200 phases", predict, "ms", "≤ 0.5", 1e3)
    for form, cpu in adapting.items():
        limit = "≤ 0.2" * (form == "process")
        yield row(f"one via-point, {form}", cpu, "ms", limit, 1e3)
    ratio = adapting["product"] / adapting["process"]
    yield row("one via-point, product over process", ratio, "×", "≥ 15")

    two = Teacher().standard_demonstrations(seed=0)[:2]
    aligning = {
        name: repeated(functools.partial(align, two, method=name))
        for name in get_args(AlignmentMethod)
    }
    for name, (cpu, _) in measure(aligning, repeats).items():
        yield row(f"align two demonstrations, {name}", cpu, "ms", scale=1e3)


def arc_with_jitter(radius: float, angle: float, steps: int) -> Array:
    """Return commands along the arc of a handle to an angle [rad], (steps, 6)."""
    arc = handle_pose_on_arc(radius, np.linspace(0.0, angle, steps))
    return arc + np.random.default_rng(0).normal(0.0, 0.002, arc.shape)


def step_and_physics(environment_id: str, steps: int = 600) -> dict[str, Timed]:
    """Return an opening in 6 s, and its physics alone: the same commands of joints."""
    env: Any = gym.make(environment_id, door="medium").unwrapped
    greatest = env.action_space.high
    # Stiffnesses vary from half to the whole of their range.
    shares = np.random.default_rng(0).uniform(0.5, 1.0, (steps, greatest.size))
    actions = greatest * shares
    actions[:, :6] = arc_with_jitter(env.door.radius, 0.9, steps)
    data, substeps = mujoco.MjData(env.model), round(env.dt / env.model.opt.timestep)
    env.reset(seed=0)
    start, commands = copy.copy(env.data), []
    for action in actions:
        env.step(action)
        commands.append(env.data.ctrl.copy())

    def after_reset() -> Action:
        env.reset(seed=0)
        return lambda: [env.step(action) for action in actions]

    def physics() -> None:
        for command in commands:
            data.ctrl[:] = command
            mujoco.mj_step(env.model, data, nstep=substeps)

    def from_start() -> Action:
        mujoco.mj_copyData(data, env.model, start)
        return physics

    return {"step": (after_reset, steps), "physics": (from_start, steps)}


def environment(repeats: int) -> Iterator[Row]:
    """Time steps beyond their physics, and resets."""
    for environment_id in (ENVIRONMENT_ID, IMPEDANCE_ENVIRONMENT_ID):
        timed = measure(step_and_physics(environment_id), 4 * repeats)
        (step, _), (physics, _) = timed.values()
        what = f"{environment_id}: step"
        yield row(f"{what} beyond physics", step - physics, "µs", "≤ 20", 1e6)
        yield row(f"{what} over physics", step / physics, "×", "≤ 1.3")

    env: Any = gym.make(ENVIRONMENT_ID, door="medium")
    rng = np.random.default_rng(0)

    def friction_and_mass() -> dict[str, float]:
        friction, mass = rng.uniform(0.0, 2.0), rng.uniform(5.0, 30.0)
        return {"hinge_friction": friction, "panel_mass": mass}

    def from_medium(door: Callable[[], Any]) -> Action:
        env.reset(options={"door": "medium"})
        return lambda: [env.reset(options={"door": door()}) for _ in range(5)]

    resets: dict[str, Timed] = {
        name: (functools.partial(from_medium, door), 5)
        for name, door in (
            ("the same door", lambda: "medium"),
            ("new friction and mass", friction_and_mass),
            ("a new radius", lambda: rng.uniform(0.30, 0.65)),
        )
    }
    for name, (cpu, _) in measure(resets, repeats).items():
        limit = "≤ 20" if name == "a new radius" else "≤ 1"
        yield row(f"reset: {name}", cpu, "ms", limit, 1e3)


def vectors(repeats: int, counts: tuple[int, ...] = (2, 64, 256)) -> Iterator[Row]:
    """Open a medium door for 0.3 s in many simulations on two threads."""
    env: Any = gym.make(ENVIRONMENT_ID, door="medium").unwrapped
    commands = arc_with_jitter(env.door.radius, 0.1, 30)
    data, substeps = mujoco.MjData(env.model), round(env.dt / env.model.opt.timestep)

    def physics() -> None:
        mujoco.mj_resetDataKeyframe(env.model, data, GRASP_KEY)
        for command in commands:
            data.ctrl[:6] = command
            mujoco.mj_step(env.model, data, nstep=substeps)

    def stepping(count: int, **settings: Any) -> Timed:
        envs: Any = gym.make_vec(ENVIRONMENT_ID, count, door="medium", **settings)
        actions = np.repeat(commands[:, None], count, axis=1)

        def prepare() -> Action:
            envs.reset()
            return lambda: [envs.step(action) for action in actions]

        return prepare, count * len(commands)

    actions: dict[str, Timed] = {
        "mj_step": (lambda: physics, len(commands)),
        "sync": stepping(2, vectorization_mode="sync"),
        **{str(count): stepping(count, num_threads=2) for count in counts},
    }
    times = measure(actions, repeats)
    (alone, _), (_, sync) = times.pop("mj_step"), times.pop("sync")
    for count, (cpu, wall) in times.items():
        name = f"{count} simulations on 2 threads"
        limit = "≤ 1.15" * (count == "64")
        yield row(f"{name}, CPU over mj_step", cpu / alone, "×", limit)
        limit = "≥ 2.5" * (count == "2")
        yield row(f"{name}, speed over SyncVectorEnv", sync / wall, "×", limit)


def on_warp(repeats: int, counts: tuple[int, ...], device: str | None) -> Iterator[Row]:
    """Time resting hands at many doors, on MuJoCo Warp and on MuJoCo's threads."""
    warp = importlib.import_module("warp")
    make_warp = importlib.import_module("gplfd_env.envs.warp").make_warp
    warp.config.log_level = warp.LOG_WARNING
    if device is not None:
        warp.set_device(device)

    def resting(envs: Any, count: int) -> Timed:
        still = np.zeros((count, 6), np.float32)

        def prepare() -> Action:
            envs.reset(seed=0)
            return lambda: [envs.step(still) for _ in range(60)]

        return prepare, 60 * count

    for count in counts:
        actions = {
            "MuJoCo": resting(gym.make_vec(RL_ENVIRONMENT_ID, count), count),
            f"Warp on {warp.get_device()}": resting(make_warp(count), count),
        }
        for name, (_, wall) in measure(actions, repeats).items():
            yield row(f"{count} doors, {name}", 1.0 / wall, "control steps/s")


def agents(
    repeats: int, counts: tuple[int, ...] = (2, 64), periods: int = 250
) -> Iterator[Row]:
    """Time `gp` in closed loop, alone and in lockstep, and the recording of it."""
    demonstrations = Teacher().standard_demonstrations(seed=0)
    agent = make_agent("gp", demonstrations)

    def loop(envs: Any, acting: Any, count: int) -> Timed:
        def run(observation: Any) -> None:
            for _ in range(periods):
                observation, *_ = envs.step(acting.act(observation).action)

        def prepare() -> Action:
            first, _ = envs.reset(seed=0)
            acting.reset(first)
            return functools.partial(run, first)

        return prepare, count * periods

    env: Any = gym.make(ENVIRONMENT_ID, door="medium")
    loops = {"one `gp` agent": loop(env, agent, 1)}
    settings: dict[str, Any] = {"num_threads": 2, "autoreset_mode": "Disabled"}
    for count in counts:
        doors = list(itertools.islice(itertools.cycle(DEMONSTRATED_RADII), count))
        envs = gym.make_vec(ENVIRONMENT_ID, count, door=doors, **settings)
        together = batch_agents([copy.deepcopy(agent) for _ in range(count)])
        loops[f"{count} `gp` agents in lockstep"] = loop(envs, together, count)
    for name, (cpu, wall) in measure(loops, repeats).items():
        limit = "≥ 5000" * name.startswith("64")
        yield row(name, 1.0 / wall, "control steps/s", limit)
        yield row(f"{name}, a control step", cpu, "ms", scale=1e3)

    opened = functools.partial(rollout, env, agent, policy="gp", door="medium", seed=0)
    log = opened()
    with tempfile.TemporaryDirectory() as folder:
        path, model = Path(folder) / "medium.rrd", env.unwrapped.model
        record = functools.partial(record_episode, path, log, model, demonstrations)
        actions = {"rollout": repeated(opened), "recording": repeated(record)}
        (opening, _), (recording, _) = measure(actions, repeats).values()
    share = recording / opening
    yield row("recording of an episode over the rollout", share, "×", "≤ 0.1")


Part = Literal["method", "environment", "vectors", "agents", "warp"]


def main(
    parts: tyro.conf.Positional[tuple[Part, ...]] = (
        *("method", "environment"),
        *("vectors", "agents"),
    ),
    repeats: int = 5,
    counts: tuple[int, ...] = (1, 8, 64),
    device: str | None = None,
) -> None:
    """Measure the parts and print a table.

    Args:
        parts: What to measure; about a minute each.
        repeats: Rounds of every measurement, 1 or more.
        counts: Numbers of doors of the part warp; thousands are for a GPU.
        device: Warp's device, for example cpu or cuda:0; by default Warp chooses.
    """
    measures: dict[Part, Callable[[int], Iterator[Row]]] = {
        "method": method,
        "environment": environment,
        "vectors": vectors,
        "agents": agents,
        "warp": functools.partial(on_warp, counts=counts, device=device),
    }
    state = code_state()
    print(f"commit {state['git']}, {state['versions']}, load {os.getloadavg()[0]:.1f}")
    with threadpool_limits(1), warnings.catch_warnings():
        # Teachers with sensor noise, about which `align` warns.
        warnings.simplefilter("ignore", UserWarning)
        rows = tuple(line for part in parts for line in measures[part](repeats))
    print(text_table(Table(columns=("what", "measured", "wanted"), rows=rows)))


if __name__ == "__main__":
    tyro.cli(main)
