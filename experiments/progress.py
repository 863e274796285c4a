"""What a command reports on stderr while it works; nothing but warnings when quiet."""

import logging
from collections.abc import Iterable
from typing import Any, Final

from tqdm import tqdm

LOG: Final = logging.getLogger("gplfd")
"""Progress is information, and hidden where nobody asked for it: in a library."""


def progress_bar(
    items: Iterable[Any] | None = None, *, anywhere: bool = False, **options: Any
) -> "tqdm[Any]":
    """Return tqdm's bar over some items, where progress is wanted.

    Args:
        items: What to go through; None for a bar that is moved by hand.
        anywhere: Show it also where stderr is no terminal.
        options: Of tqdm.
    """
    wanted = LOG.isEnabledFor(logging.INFO)
    # To tqdm None means: where stderr is a terminal.
    disable = not wanted if anywhere or not wanted else None
    return tqdm(items, **{"leave": False, "disable": disable} | options)
