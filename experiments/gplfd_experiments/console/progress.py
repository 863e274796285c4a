"""Progress on stderr, and the logger of messages; only warnings if quiet."""

import logging
import sys
from collections.abc import Iterable
from typing import Any, Final

from tqdm import tqdm

LOG: Final = logging.getLogger("gplfd")
"""Progress has the level INFO, so that it is hidden if gplfd is used as a library."""


def progress_bar(items: Iterable[Any] | None = None, **options: Any) -> "tqdm[Any]":
    """Return a bar over items, or updated manually, shown if stderr is a terminal."""
    # For tqdm, None means: only if stderr is a terminal.
    disable = None if LOG.isEnabledFor(logging.INFO) else True
    return tqdm(items, leave=False, disable=disable, **options)


def counter(unit: str, total: int, done: int) -> "tqdm[Any]":
    """Log how much of a long work is done, and return a bar for the rest."""
    LOG.info("%d %ss, %d of them done already", total, unit, done)
    return tqdm(
        total=total,
        initial=done,
        unit=unit,
        mininterval=1.0 if sys.stderr.isatty() else 10.0,
        # Times differ by policy, so the mean is used.
        smoothing=0.0,
        disable=not LOG.isEnabledFor(logging.INFO),
    )
