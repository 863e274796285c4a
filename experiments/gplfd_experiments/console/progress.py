"""Progress on stderr, and messages above its bars; only warnings when quiet."""

import logging
import sys
from collections.abc import Iterable
from typing import Any, Final

from tqdm import tqdm

LOG: Final = logging.getLogger("gplfd")
"""Progress has level INFO, so that it is hidden when gplfd is used as a library."""


class MessageHandler(logging.Handler):
    """Prints messages on stderr, each on a line of its own above progress bars."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print a message."""
        try:
            tqdm.write(self.format(record), file=sys.stderr)
        except Exception:
            self.handleError(record)


def progress_bar(items: Iterable[Any] | None = None, **options: Any) -> "tqdm[Any]":
    """Return tqdm's bar over some items, or one that is moved by hand.

    It is shown where progress is wanted and stderr is a terminal.
    """
    # To tqdm None means: where stderr is a terminal.
    disable = None if LOG.isEnabledFor(logging.INFO) else True
    return tqdm(items, leave=False, disable=disable, **options)


_ESTIMATED: Final = 0.1
"""Share of the work after which the remaining time is estimated. Before it, the start
of the workers and the size of the first jobs dominate."""


class _Counter(tqdm):  # type: ignore[type-arg]
    """A bar that estimates the time left once enough of the work is done."""

    @property
    def format_dict(self) -> Any:
        """What the bar is written from, see tqdm."""
        known = super().format_dict
        new, left = known["n"] - known["initial"], known["total"] - known["initial"]
        if new < _ESTIMATED * left:
            known["bar_format"] = "{l_bar}{bar}| {n_fmt}/{total_fmt} [{elapsed}]"
        return known


def counter(unit: str, total: int, done: int) -> "tqdm[Any]":
    """Say how much of a long work is done, and return a bar that counts the rest.

    Where stderr is no terminal, it writes a line every half a minute.
    """
    LOG.info("%d %ss, %d of them done already", total, unit, done)
    pause = 0.5 if sys.stderr.isatty() else 30.0
    return _Counter(
        total=total,
        initial=done,
        unit=unit,
        mininterval=pause,
        maxinterval=pause,
        # Policies differ by the time they take: the mean says most.
        smoothing=0.0,
        disable=not LOG.isEnabledFor(logging.INFO),
    )
