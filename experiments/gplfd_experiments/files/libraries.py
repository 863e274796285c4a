"""Optional libraries: how to install those that are missing."""

import contextlib
from collections.abc import Iterator


@contextlib.contextmanager
def optional_libraries(need: str, extra: str) -> Iterator[None]:
    """If imports in the block fail, state what needs the library, and its extra."""
    try:
        yield
    except ImportError as error:
        raise ModuleNotFoundError(
            f"{need} ({error}); in a checkout of gplfd: pip install '.[{extra}]', "
            f"elsewhere: pip install 'gplfd[{extra}]'"
        ) from error
