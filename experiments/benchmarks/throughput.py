"""How fast loops run, by the clock on the wall and by CPU time, in turns.

Threads help on the wall and not in CPU time; other processes hurt on the wall and
hardly in CPU time. So both are measured, with the machine's load beside them.
"""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

__all__ = ["Entrant", "Load", "Pace", "measure_paces"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Entrant:
    """A loop to be timed."""

    begin: Callable[[], object]
    """Brings it to its start; not timed."""
    run: Callable[[], object]
    """The loop from there."""
    steps: int
    """Environment steps of one run."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Pace:
    """Seconds per environment step, one number per round."""

    wall: tuple[float, ...]
    """On the wall [s]."""
    cpu: tuple[float, ...]
    """Of all the process's threads [s]."""

    @property
    def rate(self) -> float:
        """Environment steps per second, median."""
        return 1.0 / statistics.median(self.wall)

    @property
    def cost(self) -> float:
        """CPU seconds per environment step, median."""
        return statistics.median(self.cpu)

    def speed_up(self, other: Pace) -> float:
        """How many times faster than another on the wall: median over rounds."""
        return _median_ratio(other.wall, self.wall)

    def cost_ratio(self, other: Pace) -> float:
        """CPU time over another's: median over rounds."""
        return _median_ratio(self.cpu, other.cpu)


def _median_ratio(above: tuple[float, ...], below: tuple[float, ...]) -> float:
    return statistics.median(a / b for a, b in zip(above, below, strict=True))


@dataclass(frozen=True, kw_only=True, slots=True)
class Load:
    """Processes that wanted a core, a minute's average; None where unknown."""

    before: float | None
    """When the measurement began."""
    after: float | None
    """When it ended."""
    cores: int | None
    """Cores of the machine."""

    def __str__(self) -> str:
        """Such as ``load 0.4 to 1.9 on 2 cores``."""
        if self.before is None or self.after is None:
            return f"load unknown on {self.cores} cores"
        return f"load {self.before:.1f} to {self.after:.1f} on {self.cores} cores"


def measure_paces(
    entrants: Mapping[str, Entrant], repeats: int, *, least_steps: int = 1
) -> tuple[dict[str, Pace], Load]:
    """Time every entrant once per round.

    A first round warms caches up and is not counted, except for a single repeat.

    Args:
        entrants: Loops by name.
        repeats: Counted rounds, at least 1.
        least_steps: Shorter entrants run several times per round, until they have made
            this many environment steps.

    Returns:
        Paces by name, and the load meanwhile.
    """
    before = _load()
    rounds: dict[str, list[tuple[float, float]]] = {name: [] for name in entrants}
    warm_up = 1 if repeats > 1 else 0
    for _ in range(warm_up + repeats):
        for name, entrant in entrants.items():
            rounds[name].append(_timed(entrant, least_steps))
    counted = {name: zip(*all_[warm_up:], strict=True) for name, all_ in rounds.items()}
    paces = {name: Pace(wall=wall, cpu=cpu) for name, (wall, cpu) in counted.items()}
    return paces, Load(before=before, after=_load(), cores=os.cpu_count())


def _timed(entrant: Entrant, least_steps: int) -> tuple[float, float]:
    """Return seconds per environment step on the wall and of CPU time."""
    runs = -(-least_steps // entrant.steps)
    wall = cpu = 0.0
    for _ in range(runs):
        entrant.begin()
        started, started_cpu = time.perf_counter(), time.process_time()
        entrant.run()
        cpu += time.process_time() - started_cpu
        wall += time.perf_counter() - started
    return wall / (runs * entrant.steps), cpu / (runs * entrant.steps)


def _load() -> float | None:
    try:
        return os.getloadavg()[0]
    except (AttributeError, OSError):  # Windows has none.
        return None
