"""The engine for debugging: one item after the other, in this process."""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import TypeVar

from gplfd_experiments.console.interruption import os_exit_raises

ItemT = TypeVar("ItemT")
ResultT = TypeVar("ResultT")


@dataclass(frozen=True, slots=True)
class Serial:
    """Runs items here, in order."""

    def run(
        self, work: Callable[[ItemT], ResultT], items: Sequence[ItemT]
    ) -> Generator[tuple[ItemT, ResultT], None, None]:
        """See `gplfd_experiments.studies.engines.Engine.run`."""
        for item in items:
            with os_exit_raises():
                result = work(item)
            yield item, result
