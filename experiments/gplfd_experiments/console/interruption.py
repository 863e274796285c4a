"""Ends of the process: delayed Ctrl-C, and `os._exit` in a policy."""

import contextlib
import os
import signal
import sys
from collections.abc import Iterator
from typing import NoReturn


@contextlib.contextmanager
def postponed_interruption() -> Iterator[None]:
    """Delay Ctrl-C until the block ends, and block it in processes that it starts.

    Interrupted imports fail in different ways, and some imports run another Python. The
    terminal sends Ctrl-C to all processes, but only this one should handle it:
    processes and threads that start in the block inherit the blocked signal.
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
    """Turn `os._exit` in a user's policy into an error with a traceback.

    Otherwise it would end the process without a message, with the policy's status.
    """
    process, exit_at_once = os.getpid(), os._exit

    def refuse(status: int) -> NoReturn:
        if os.getpid() != process:  # A child process of the policy may call it.
            exit_at_once(status)
        raise RuntimeError(f"os._exit({status}) was called")

    os._exit = refuse
    try:
        yield
    finally:
        os._exit = exit_at_once
