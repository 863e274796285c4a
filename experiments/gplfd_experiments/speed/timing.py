"""CPU and wall time of several actions, measured so that their ratios are reliable.

Compared actions run in turns within one process, so that other load slows all of them
equally.
"""

import gc
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Action = Callable[[], object]
"""An action to be timed; its result is not used."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Timed:
    """An action of some operations; times are per operation.

    It is prepared before every measurement; the preparation is not timed.
    """

    prepare: Callable[[], Action]
    operations: int = 1


def after(begin: Action, action: Action, operations: int = 1) -> Timed:
    """Return an action with an untimed call of ``begin`` before it."""

    def prepare() -> Action:
        begin()
        return action

    return Timed(prepare=prepare, operations=operations)


def repeated(
    action: Action,
    times: int = 1,
    begin: Action = lambda: None,
    operations: int = 1,
) -> Timed:
    """Return an action of some operations that runs several times in a measurement."""

    def many() -> None:
        for _ in range(times):
            action()

    return after(begin, many, times * operations)


@dataclass(frozen=True, kw_only=True, slots=True)
class Timing:
    """Seconds per operation, one number per round."""

    cpu: tuple[float, ...]
    """CPU time of all threads of the process [s]."""
    wall: tuple[float, ...]
    """Wall time [s]: threads shorten it, other processes lengthen it."""

    @property
    def cpu_median(self) -> float:
        """Median CPU time of an operation [s]."""
        return _median(self.cpu)

    @property
    def rate(self) -> float:
        """Operations per second of the clock, by the median time."""
        return 1.0 / _median(self.wall)

    def cpu_over(self, other: "Timing") -> float:
        """CPU time as a multiple of another's, median over rounds."""
        return _median(np.divide(self.cpu, other.cpu))

    def cpu_beyond(self, other: "Timing") -> float:
        """Difference to another's CPU time [s], median over rounds."""
        return _median(np.subtract(self.cpu, other.cpu))

    def speed_over(self, other: "Timing") -> float:
        """How many times faster than another by the clock, median over rounds."""
        return _median(np.divide(other.wall, self.wall))

    def __str__(self) -> str:
        """CPU milliseconds with their quartiles, such as ``1.20 [1.18, 1.31]``."""
        quartiles = 1e3 * np.quantile(self.cpu, [0.25, 0.5, 0.75])
        low, median, high = (f"{each:#.3g}".rstrip(".") for each in quartiles)
        return f"{median} [{low}, {high}]"


def _median(values: NDArray[np.float64] | tuple[float, ...]) -> float:
    return float(np.median(values))


KeyT = TypeVar("KeyT")


def measure(
    actions: Mapping[KeyT, Timed], repeats: int, *, least_operations: int = 1
) -> dict[KeyT, Timing]:
    """Time every action once per round, in turns.

    A first round warms up caches and is not counted, except for a single repeat.
    Actions of less than ``least_operations`` run several times per round, each time
    with a new preparation.
    """
    if repeats < 1:
        raise ValueError(f"repeats must be 1 or more, got {repeats}")
    rounds: dict[KeyT, list[tuple[float, float]]] = {name: [] for name in actions}
    for _ in range(repeats + (repeats > 1)):
        for name, timed in actions.items():
            rounds[name].append(_seconds_per_operation(timed, least_operations))
    counted = {
        name: zip(*seconds[-repeats:], strict=True) for name, seconds in rounds.items()
    }
    return {name: Timing(cpu=cpu, wall=wall) for name, (cpu, wall) in counted.items()}


def _seconds_per_operation(timed: Timed, least_operations: int) -> tuple[float, float]:
    """Return CPU and wall time of an operation [s]."""
    runs = -(-least_operations // timed.operations)
    cpu = wall = 0.0
    collecting = gc.isenabled()
    try:
        for _ in range(runs):
            action = timed.prepare()
            gc.collect()
            gc.disable()
            started, cpu_started = time.perf_counter(), time.process_time()
            action()
            cpu += time.process_time() - cpu_started
            wall += time.perf_counter() - started
    finally:
        if collecting:
            gc.enable()
    return cpu / (runs * timed.operations), wall / (runs * timed.operations)
