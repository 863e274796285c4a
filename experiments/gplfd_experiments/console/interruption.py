"""Ends of the process: when Ctrl-C may come, and `os._exit` in a policy."""

import contextlib
import os
import signal
import sys
from collections.abc import Iterator
from typing import NoReturn


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


@contextlib.contextmanager
def os_exit_raises() -> Iterator[None]:
    """Make `os._exit` in a user's policy an error, which is reported with its place.

    It would end the process at once, without a word and with the policy's status.
    """
    process, exit_at_once = os.getpid(), os._exit

    def refuse(status: int) -> NoReturn:
        if os.getpid() != process:  # A child of the policy, which may end so.
            exit_at_once(status)
        raise RuntimeError(f"os._exit({status}) was called")

    os._exit = refuse
    try:
        yield
    finally:
        os._exit = exit_at_once
