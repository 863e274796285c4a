"""When an interruption by Ctrl-C may come."""

import contextlib
import signal
import sys
from collections.abc import Iterator


@contextlib.contextmanager
def postponed_interruption() -> Iterator[None]:
    """Let Ctrl-C wait until the block ends, and never reach what the block starts.

    An import that is interrupted fails in ways of its own, and some imports run another
    Python. The terminal sends Ctrl-C to all processes, but it is for this one: those
    that start in the block, and threads, inherit that it is blocked.
    """
    if sys.platform == "win32":
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
