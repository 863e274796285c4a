"""Linear algebra on one thread.

The number of BLAS threads determines the order of summation, and with it the last bits
of a product. Therefore every entry point of this package that learns, reads, predicts,
adapts or acts computes under `one_thread`. The numbers then do not depend on the
caller's settings (``test_linear_algebra_runs_on_one_thread``). One thread is also
faster: the policies' matrices have about a hundred rows, and distributing them among
threads costs ten times the work itself.

The limit needs threadpoolctl. If that is not installed, e.g. on a robot, BLAS uses the
number of threads with which the process was started: set ``OPENBLAS_NUM_THREADS=1``.
"""

import contextlib
import functools
import os
import threading
from typing import Any


class _OneThread(contextlib.ContextDecorator):
    """The limit of the process; entering it again takes about a microsecond.

    It ends when the last computing thread leaves. A forked child starts without a
    limit, because the threads that would leave it stay in the parent.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._entered = 0
        self._before: list[int] = []
        if hasattr(os, "register_at_fork"):  # Windows has no fork.
            os.register_at_fork(
                before=self._lock.acquire,
                after_in_parent=self._lock.release,
                after_in_child=self._start_in_child,
            )

    def __enter__(self) -> None:
        with self._lock:
            if not self._entered:
                self._before = [each.get_num_threads() for each in _libraries()]
                self._set([1] * len(self._before))
            self._entered += 1

    def __exit__(self, *_: object) -> None:
        with self._lock:
            # It is already 0 if a block that was entered before a fork ends in the
            # child.
            self._entered = max(0, self._entered - 1)
            if not self._entered:
                self._set(self._before)

    def _start_in_child(self) -> None:
        if self._entered:
            self._entered = 0
            self._set(self._before)
        self._lock.release()

    @staticmethod
    def _set(numbers: list[int]) -> None:
        for each, number in zip(_libraries(), numbers, strict=True):
            # From version 3.8 on, threadpoolctl lets only the first thread set the
            # number and ignores all others. Therefore threads are counted here.
            getattr(each, "_real_set_num_threads", each.set_num_threads)(number)


@functools.cache
def _libraries() -> list[Any]:
    """Return the BLAS libraries of NumPy and SciPy; finding them takes milliseconds.

    None without threadpoolctl.
    """
    # SciPy has its own BLAS, which must be loaded before libraries are listed.
    import scipy.linalg  # noqa: F401

    try:
        from threadpoolctl import ThreadpoolController
    except ModuleNotFoundError:
        return []

    found: list[Any] = ThreadpoolController().select(user_api="blas").lib_controllers
    return found


one_thread = _OneThread()
"""Keeps BLAS to one thread: ``with one_thread:``, or ``@one_thread`` for a function."""
