"""Calls a function that runs a user's policy in a process of its own.

What the policy changes, ends, forks or never returns from is then its own: the state of
NumPy, working folder, random numbers, modules, signals and files of the caller stay.
"""

import contextlib
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from gplfd_policies.arrays.storage import complete_or_absent

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


class ProcessEndedError(Exception):
    """The process of a policy ended without a result: the reason, and its status."""


def call_apart(function: Callable[..., Any], *arguments: Any) -> Any:
    """Return ``function(*arguments, allow)`` of another process.

    It calls ``allow(seconds)`` to set the time until its next call, or its end. Raises
    a `ProcessEndedError` if there is no result.
    """
    paths = os.pathsep.join(folder or os.getcwd() for folder in sys.path)
    with tempfile.TemporaryDirectory(prefix="gplfd-") as scratch:
        answer = Path(scratch, "answer")
        process = subprocess.Popen(
            [sys.executable, "-P", "-c", _CHILD],
            stdin=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": paths},
            start_new_session=True,
        )
        try:
            process.communicate(pickle.dumps((answer, function, arguments)))
        finally:
            process.kill()
            with contextlib.suppress(ProcessLookupError, AttributeError):
                os.killpg(process.pid, signal.SIGKILL)  # what it has forked
            status = process.wait()
        if answer.exists():
            result, texts = pickle.loads(answer.read_bytes())
            for text in texts:
                warnings.warn(text, stacklevel=2)
            return result
    ended = f"signal {-status}" if status < 0 else f"exit status {status}"
    reason = f"its process ended: {ended}, in the policy's code"
    raise ProcessEndedError(_ENDLESS if status == _HANGS else reason, status)


def child() -> None:
    """Call the function on standard input, and write its result to a file."""
    answer, function, arguments = pickle.load(sys.stdin.buffer)
    with contextlib.suppress(OSError):
        os.dup2(2, 1)
    with warnings.catch_warnings(record=True) as caught:
        result = function(*arguments, _TimeLimit().allow)
    with complete_or_absent(answer) as temporary:
        texts = {str(warning.message) for warning in caught}
        temporary.write_bytes(pickle.dumps((result, texts)))
    with contextlib.suppress(OSError, ValueError):
        sys.stdout.flush()
    os._exit(0)  # not after the policy's threads


class _TimeLimit:
    """Raises a TimeoutError in the main thread, and ends the process soon after."""

    def __init__(self) -> None:
        self._process, self._parent = os.getpid(), os.getppid()
        self.allow(LEARNING_LIMIT)
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
