"""Decisions in real time: python benchmarks/realtime.py.

The policy ``gp`` decides every 10 ms, as the controller of a robot asks for, in a
process that cannot import MuJoCo. The process has one core, on which another process
multiplies matrices all the time; so does one on a second core. The observations are
those of a simulated opening, again and again, and with each opening the agent begins
anew. Times are wall times of whole decisions, those that begin an opening and those
that other processes interrupt included.
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
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from gplfd_experiments.speed.report import Measurement

# This module is imported by the process that decides: nothing of it loads MuJoCo before
# `main` runs.

PERIOD: Final = 10_000_000
"""Time between two decisions [ns]."""

Agent = Literal["skill", "forces"]
Priority = Literal["ordinary", "nice", "fifo"]
Collector = Literal["frozen", "ordinary"]


class Case(NamedTuple):
    """How a process decides."""

    agent: Agent
    """``"forces"`` has a skill of which demonstrated forces are a part."""
    priority: Priority
    """``"nice"`` is a niceness of -10, ``"fifo"`` Linux's real-time scheduler."""
    collector: Collector
    """``"frozen"`` leaves what exists before the first decision out of collections."""


class Decisions(NamedTuple):
    """What a process measured."""

    wall: np.ndarray
    """Wall time of every decision [ns]."""
    cpu: np.ndarray
    """CPU time of every decision [ns]."""
    late: np.ndarray
    """From when every decision was due until it began [ns]."""
    differing: int
    """Number of actions that are not, bit for bit, those that opened the door."""
    collections: list[int]
    """Wall times of garbage collections within decisions [ns]."""
    faults: int
    """Pages that the process asked for within the decisions after the first opening."""
    growth: int
    """Growth of the process's memory after the first opening [bytes]."""


def record(folder: Path, agents: tuple[Agent, ...]) -> None:
    """Open a door with each agent; keep its skill, and what it saw and did."""
    from harness import opened, tasks_of

    from gplfd_env.doors.config import DOORS
    from gplfd_experiments.data.teacher import ForceConfig, Teacher
    from gplfd_policies.registry.catalogue import policy_named
    from gplfd_policies.registry.method import TrainingInput

    method = policy_named("gp").method
    assert method is not None
    for name in agents:
        forces = name == "forces"
        teacher = Teacher(forces=ForceConfig() if forces else None)
        shown = teacher.standard_demonstrations(seed=0)
        skill: Any = method.learn(TrainingInput(demonstrations=shown))
        skill.save(folder / f"{name}.npz")
        tasks = tasks_of([DOORS["medium"]], "gp", seed=0, demonstrated_forces=forces)
        (log,) = opened(tasks)
        assert log.success
        arrays = {key: getattr(log, key) for key in ("ee_pose", "wrench", "action")}
        np.savez(folder / f"{name}-opening.npz", **arrays)


def compute(core: int) -> None:
    """Multiply matrices on a core until the process is ended."""
    os.sched_setaffinity(0, {core})
    factor = np.full((256, 256), 1.0 / 256)
    while True:
        factor = factor @ factor


@contextlib.contextmanager
def loaded(cores: list[int]) -> Iterator[None]:
    """Let a process compute on each of some cores."""
    spawn = multiprocessing.get_context("spawn")
    processes = [spawn.Process(target=compute, args=(core,)) for core in cores]
    try:
        for process in processes:
            process.start()
        yield
    finally:
        for process in processes:
            process.kill()
            process.join()


def schedule(priority: Priority) -> None:
    """Give this process a priority; raises a PermissionError where it may not."""
    if priority == "nice":
        os.setpriority(os.PRIO_PROCESS, 0, -10)
    elif priority == "fifo":
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(50))


def decide(folder: Path, case: Case, core: int, count: int) -> Decisions:
    """Decide again and again on a core, from a skill, without MuJoCo."""
    assert "mujoco" not in sys.modules
    for name in ("mujoco", "threadpoolctl"):  # A robot has neither: imports raise.
        sys.modules[name] = None  # type: ignore[assignment]
    from gplfd_policies import POLICIES, load_skill

    os.sched_setaffinity(0, {core})
    schedule(case.priority)
    with np.load(folder / f"{case.agent}-opening.npz") as opening:
        poses, wrenches, actions = (
            opening[name] for name in ("ee_pose", "wrench", "action")
        )
    method = POLICIES["gp"].method
    assert method is not None
    agent = method.follow(load_skill(folder / f"{case.agent}.npz"))
    wall, cpu, late = np.full((3, count), -1, dtype=np.int64)
    began, differing, faults, first_rss = 0, 0, 0, 0
    collections: list[int] = []

    def collected(phase: str, _: object) -> None:
        """Note how long a collection takes, unless it is between decisions."""
        nonlocal began
        now = time.perf_counter_ns()
        if phase == "start":
            began = now
        elif deciding:
            collections.append(now - began)

    deciding = False
    gc.callbacks.append(collected)
    if case.collector == "frozen":
        gc.collect()
        gc.freeze()
    due = time.perf_counter_ns() + PERIOD
    for number in range(count):
        at = number % len(poses)
        if number == len(poses) or (number == 0 and count <= len(poses)):
            first_rss, faults = _rss(), -resource.getrusage(0).ru_minflt
        time.sleep(max(due - time.perf_counter_ns(), 0) * 1e-9)
        observation = {"ee_pose": poses[at], "wrench": wrenches[at]}
        deciding = True
        started, cpu_started = time.perf_counter_ns(), time.thread_time_ns()
        if at == 0:
            agent.reset(observation)
        step = agent.act(observation)
        cpu[number] = time.thread_time_ns() - cpu_started
        ended = time.perf_counter_ns()
        deciding = False
        wall[number], late[number] = ended - started, started - due
        differing += not np.array_equal(step.action, actions[at])
        due = max(due + PERIOD, ended)
    faults += resource.getrusage(0).ru_minflt
    growth = _rss() - first_rss
    return Decisions(wall, cpu, late, differing, collections, faults, growth)


def _rss() -> int:
    pages = Path("/proc/self/statm").read_text(encoding="ascii").split()[1]
    return int(pages) * resource.getpagesize()


def described(found: Decisions) -> dict[str, float]:
    """Return the numbers of a case."""
    response = found.late + found.wall
    numbers: dict[str, float] = {"decisions": len(found.wall)}
    for name, times in (
        ("wall time", found.wall),
        ("CPU time", found.cpu),
        ("from due to decided", response),
    ):
        for share in (50.0, 99.0, 99.9):
            at = np.percentile(times, share)
            numbers[f"{name}, p{share:g} [ms]"] = 1e-6 * float(at)
        numbers[f"{name}, max [ms]"] = 1e-6 * float(times.max())
    numbers["wall time over 2 ms"] = int((found.wall > 2e6).sum())
    numbers["wall time over 10 ms"] = int((found.wall > 1e7).sum())
    numbers["actions that differ"] = found.differing
    numbers["collections in decisions"] = len(found.collections)
    numbers["longest of them [ms]"] = 1e-6 * max(found.collections, default=0)
    numbers["page faults per decision"] = found.faults / len(found.wall)
    numbers["growth of memory [MB]"] = 1e-6 * found.growth
    return numbers


def measure(folder: Path, cases: list[Case], count: int) -> "Measurement":
    """Let one process after the other decide on the first of two loaded cores."""
    from gplfd_experiments.speed.machine import load
    from gplfd_experiments.speed.report import Measurement, at_most

    cores = sorted(os.sched_getaffinity(0))[:2]
    before, rows, targets = load(), {}, []
    for case in cases:
        name = ", ".join(case)
        spawn = multiprocessing.get_context("spawn")
        with loaded(cores), ProcessPoolExecutor(1, mp_context=spawn) as pool:
            try:
                found = pool.submit(decide, folder, case, cores[0], count).result()
            except PermissionError as error:
                print(f"{name}: not permitted here ({error})")
                continue
        numbers = described(found)
        for row, number in numbers.items():
            rows.setdefault(row, {})[name] = number
        share = 100.0 * numbers["wall time over 2 ms"] / numbers["decisions"]
        over = numbers["wall time over 10 ms"]
        targets += [
            at_most(f"{name}: decisions over 2 ms [%]", share, 0.1),
            at_most(f"{name}: decisions over 10 ms", over, 0.0),
            at_most(f"{name}: actions that differ", found.differing, 0.0),
        ]
    return Measurement(
        title=f"decisions on one of {len(cores)} loaded cores (before: {before}; "
        f"after: {load()})",
        rows=rows,
        targets=tuple(targets),
    )


def main(
    minutes: float = 10.0,
    agents: tuple[Agent, ...] = ("skill",),
    priorities: tuple[Priority, ...] = ("ordinary", "fifo"),
    collectors: tuple[Collector, ...] = ("frozen",),
) -> None:
    """Measure how long the decisions of ``gp`` take a process without MuJoCo.

    Args:
        minutes: How long each combination of the following decides.
        agents: What it has learned from: motions alone, or forces, too.
        priorities: Linux's ordinary scheduling, a niceness of -10, or real time (FIFO).
        collectors: Python's garbage collector with ``gc.freeze()``, or as it is.
    """
    from harness import report

    # Inherited by the processes, which have no threadpoolctl to set it.
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    cases = [
        Case(agent, priority, collector)
        for agent in agents
        for priority in priorities
        for collector in collectors
    ]
    count = max(round(minutes * 60e9 / PERIOD), 1)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        record(folder, agents)
        report({"decisions": partial(measure, folder, cases, count)})


if __name__ == "__main__":
    import tyro

    tyro.cli(main)
