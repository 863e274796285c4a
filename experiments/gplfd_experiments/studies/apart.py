"""Calls functions that run a user's policy in a process of that policy.

What the policy changes, ends, forks or never returns from is then its own: the state of
NumPy, working folder, random numbers, modules, signals and files of the caller stay.
"""

import contextlib
import math
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable, Hashable
from typing import Any, Final

LEARNING_LIMIT, STEP_LIMIT = 900.0, 60.0
"""Longest time of an import or a learning, and of a control step [s]."""
_GRACE: Final = 10.0
"""Time for a policy to end after a TimeoutError was raised in it [s]."""
_HANGS: Final = 124
"""Exit status of a process whose policy does not end."""
_ENDLESS: Final = (
    f"the policy did not return (limits: {LEARNING_LIMIT:g} s to learn, "
    f"{STEP_LIMIT:g} s for a control step)"
)
_ALARM: Final = getattr(signal, "SIGALRM", None)  # not on Windows
_CHILD: Final = "from gplfd_experiments.studies.apart import child; child()"

_processes: dict[Hashable, "subprocess.Popen[bytes]"] = {}
# They wait for a call, and end with this process.


class ProcessEndedError(Exception):
    """The process of a policy ended without a result: the reason, and its status."""


def call_apart(policy: Hashable, function: Callable[..., Any], *arguments: Any) -> Any:
    """Return ``function(*arguments, allow)`` of the process of a policy.

    It calls ``allow(seconds)`` to set the time until its next call, or its end. Raises
    a `ProcessEndedError` if there is no result.
    """
    process = _processes.pop(policy, None)
    if process is None:
        paths = os.pathsep.join(folder or os.getcwd() for folder in sys.path)
        process = subprocess.Popen(
            [sys.executable, "-u", "-P", "-c", _CHILD],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": paths},
            start_new_session=True,
        )
    calls: Any = process.stdin
    replies: Any = process.stdout
    try:
        calls.write(pickle.dumps((function, arguments)))
        calls.flush()
        result, texts = pickle.load(replies)
    except (OSError, EOFError) as error:
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(_GRACE)
        process.kill()
        with contextlib.suppress(ProcessLookupError, AttributeError):
            os.killpg(process.pid, signal.SIGKILL)  # what it has forked
        process.communicate()
        status = process.returncode
        ended = f"signal {-status}" if status < 0 else f"exit status {status}"
        reason = f"its process ended: {ended}, in the policy's code"
        reason = _ENDLESS if status == _HANGS else reason
        raise ProcessEndedError(reason, status) from error
    _processes[policy] = process
    for text in texts:
        warnings.warn(text, stacklevel=2)
    return result


def child() -> None:
    """Answer the calls on standard input, until it is closed."""
    calls, replies = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    with contextlib.suppress(OSError):
        os.dup2(2, 1)
    if hasattr(os, "register_at_fork"):
        # The caller waits for the end of this process, not of what it has forked.
        os.register_at_fork(after_in_child=replies.close)
    limit = _TimeLimit()
    while True:
        try:
            function, arguments = pickle.load(calls)
        except EOFError:
            os._exit(0)  # not after the policy's threads
        limit.allow(LEARNING_LIMIT)
        with warnings.catch_warnings(record=True) as caught:
            result = function(*arguments, limit.allow)
        limit.allow(math.inf)
        pickle.dump((result, {str(warning.message) for warning in caught}), replies)
        replies.flush()


class _TimeLimit:
    """Raises a TimeoutError in the main thread, and ends the process soon after."""

    def __init__(self) -> None:
        self._process, self._parent = os.getpid(), os.getppid()
        self.allow(math.inf)
        if _ALARM is not None:
            signal.signal(_ALARM, _stop)
        threading.Thread(target=self._watch, daemon=True).start()

    def allow(self, seconds: float) -> None:
        """Set the time until the next call."""
        if os.getpid() != self._process:
            os._exit(0)  # a copy of this process that the policy forked
        self._late, self._until = False, time.monotonic() + seconds

    def _watch(self) -> None:
        while os.getppid() == self._parent:
            if time.monotonic() > self._until:
                if self._late:
                    os._exit(_HANGS)
                self._late, self._until = True, self._until + _GRACE
                if _ALARM is not None:
                    signal.pthread_kill(threading.main_thread().ident or 0, _ALARM)
            time.sleep(0.5)
        os._exit(1)


def _stop(*_: object) -> None:
    raise TimeoutError(_ENDLESS)
