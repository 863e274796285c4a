"""Linear algebra on one thread.

The policies' matrices have about a hundred rows. Sharing them out among threads costs
ten times the work itself, and more where the cores are busy.
"""

import functools
from contextlib import AbstractContextManager
from typing import Any

from threadpoolctl import ThreadpoolController


def one_thread() -> AbstractContextManager[Any]:
    """Keep BLAS to one thread while the context lasts; costs some microseconds."""
    limit: AbstractContextManager[Any] = _libraries().limit(limits=1, user_api="blas")
    return limit


@functools.cache
def _libraries() -> ThreadpoolController:
    """Return the loaded libraries: finding them takes a millisecond."""
    return ThreadpoolController()
