"""Decision times in real time: python benchmarks/realtime.py.

The policy ``gp`` decides every 10 ms, the period of a robot's controller, in a process
that can import neither MuJoCo nor threadpoolctl. The process has one core, on which
another process multiplies matrices continuously; a third process does so on a second
core. The observations are those of a simulated opening, repeated; the agent is reset
before each opening. Times are of whole decisions, including those that begin an opening
and those that other processes interrupt.
"""

import contextlib
import gc
import multiprocessing
import os
import resource
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

# The process that decides imports this module: only `record` and `main` load MuJoCo.

PERIOD: Final = 10_000_000
"""Time between two decisions [ns]."""

Agent = Literal["skill", "forces"]
"""What is learned: a skill without or with demonstrated forces."""
Priority = Literal["ordinary", "nice", "fifo"]
"""Linux's ordinary scheduling, a niceness of -10, or its real-time scheduler."""

_SPAWN: Final = multiprocessing.get_context("spawn")


def record(folder: Path, agents: tuple[Agent, ...]) -> None:
    """Open a door with each agent; save its skill, observations and actions."""
    from harness import opened, tasks_of

    from gplfd_env.doors.config import DOORS
    from gplfd_experiments.data.teacher import ForceConfig, Teacher
    from gplfd_policies.movements.skill import Skill
    from gplfd_policies.registry.catalogue import POLICIES
    from gplfd_policies.registry.method import TrainingInput

    for name in agents:
        forces = name == "forces"
        teacher = Teacher(forces=ForceConfig() if forces else None)
        shown = teacher.standard_demonstrations(seed=0)
        method = POLICIES["gp"].method
        skill = method and method.learn(TrainingInput(demonstrations=shown))
        assert isinstance(skill, Skill)
        skill.save(folder / f"{name}.npz")
        doors = [DOORS["medium"]]
        (log,) = opened(tasks_of(doors, "gp", seed=0, demonstrated_forces=forces))
        arrays = {key: getattr(log, key) for key in ("ee_pose", "wrench", "action")}
        np.savez(folder / f"{name}-opening.npz", **arrays)


def compute(core: int) -> None:
    """Multiply matrices on a core until the process is terminated."""
    os.sched_setaffinity(0, {core})
    factor = np.full((256, 256), 1.0 / 256)
    while True:
        factor = factor @ factor


@contextlib.contextmanager
def loaded(cores: list[int]) -> Iterator[None]:
    """Run a computing process on each of the cores."""
    processes = [_SPAWN.Process(target=compute, args=(core,)) for core in cores]
    for process in processes:
        process.start()
    try:
        yield
    finally:
        for process in processes:
            process.kill()


def decide(
    folder: Path, name: Agent, priority: Priority, core: int, count: int
) -> dict[str, float]:
    """Decide repeatedly on a core, and return the times.

    Raises a PermissionError if the process may not use the priority.
    """
    assert "mujoco" not in sys.modules
    for missing in ("mujoco", "threadpoolctl"):  # Importing these raises.
        sys.modules[missing] = None  # type: ignore[assignment]
    from gplfd_policies import POLICIES, load_skill

    os.sched_setaffinity(0, {core})
    if priority == "nice":
        os.setpriority(os.PRIO_PROCESS, 0, -10)
    elif priority == "fifo":
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(50))
    with np.load(folder / f"{name}-opening.npz") as opening:
        poses, wrenches, actions = (opening[key] for key in opening)
    method = POLICIES["gp"].method
    assert method is not None
    agent = method.follow(load_skill(folder / f"{name}.npz"))

    wall, cpu, late = times = np.full((3, count), -1, dtype=np.int64)
    begun, deciding, differing = 0, False, 0
    collections = []

    def collected(phase: str, _: object) -> None:
        nonlocal begun
        if phase == "start":
            begun = time.perf_counter_ns()
        elif deciding:
            collections.append(time.perf_counter_ns() - begun)

    gc.callbacks.append(collected)
    gc.collect()
    gc.freeze()
    before, due = np.array(_memory()), time.perf_counter_ns()
    for number in range(count):
        at, due = number % len(poses), max(due + PERIOD, time.perf_counter_ns())
        time.sleep(max(due - time.perf_counter_ns(), 0) * 1e-9)
        observation = {"ee_pose": poses[at], "wrench": wrenches[at]}
        deciding = True
        started, cpu_started = time.perf_counter_ns(), time.thread_time_ns()
        if at == 0:
            agent.reset(observation)
        step = agent.act(observation)
        cpu[number] = time.thread_time_ns() - cpu_started
        wall[number], late[number] = time.perf_counter_ns() - started, started - due
        deciding = False
        differing += not np.array_equal(step.action, actions[at])
    faults, growth = (np.array(_memory()) - before).tolist()

    late += wall
    names = "wall time", "CPU time", "from due to decided"
    return {
        "decisions": count,
        **{
            f"{what}, p{share:g} [ms]": 1e-6 * float(np.percentile(each, share))
            for what, each in zip(names, times, strict=True)
            for share in (50.0, 99.0, 99.9, 100.0)
        },
        "wall time over 2 ms": int((wall > 2e6).sum()),
        "wall time over 10 ms": int((wall > 1e7).sum()),
        "actions that differ from the simulation's": differing,
        "garbage collections in decisions": len(collections),
        "longest of them [ms]": 1e-6 * max(collections, default=0),
        "page faults per decision": faults / count,
        "growth of memory [MB]": 1e-6 * growth,
    }


def _memory() -> tuple[int, int]:
    """Return the page faults of this process so far, and its memory [bytes]."""
    pages = Path("/proc/self/statm").read_text(encoding="ascii").split()[1]
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_minflt, int(pages) * resource.getpagesize()


def main(
    minutes: float = 10.0,
    agents: tuple[Agent, ...] = ("skill",),
    priorities: tuple[Priority, ...] = ("ordinary",),
) -> None:
    """Measure the decision times of ``gp`` in a process without MuJoCo.

    Args:
        minutes: Duration of the measurement per agent and priority.
        agents: What the agents have learned: motions alone, or motions and forces.
        priorities: Ordinary scheduling; as root also a niceness of -10 or real time.
    """
    from harness import report

    from gplfd_experiments.speed.machine import load
    from gplfd_experiments.speed.report import Measurement, at_most

    # Inherited by the processes, which have no threadpoolctl to set it.
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    count = max(round(minutes * 60e9 / PERIOD), 1)
    cores = sorted(os.sched_getaffinity(0))[:2]

    def measure(folder: Path, name: Agent, priority: Priority) -> Measurement:
        before = load()
        with loaded(cores), ProcessPoolExecutor(1, mp_context=_SPAWN) as pool:
            job = pool.submit(decide, folder, name, priority, cores[0], count)
            found = job.result()
        case = f"{name}, {priority}"
        share = 100.0 * found["wall time over 2 ms"] / count
        differing = found["actions that differ from the simulation's"]
        return Measurement(
            title=f"{case}: before, {before}; after, {load()}",
            rows={row: {case: number} for row, number in found.items()},
            targets=(
                at_most(f"{case}: decisions over 2 ms [%]", share, 0.1),
                at_most(f"{case}: over 10 ms", found["wall time over 10 ms"], 0.0),
                at_most(f"{case}: actions that differ", differing, 0.0),
            ),
        )

    with tempfile.TemporaryDirectory() as temporary:
        record(Path(temporary), agents)
        measures: dict[str, Any] = {
            f"{name}, {priority}": partial(measure, Path(temporary), name, priority)
            for name in agents
            for priority in priorities
        }
        report(measures)


if __name__ == "__main__":
    import tyro

    tyro.cli(main)
