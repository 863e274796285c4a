"""Optional libraries: how to install those that are missing."""

import contextlib
from collections.abc import Iterator


@contextlib.contextmanager
def optional_libraries(need: str, extra: str) -> Iterator[None]:
    """Say how to install what imports in the block lack.

    Args:
        need: What needs which library, for the message.
        extra: The extra of gplfd that installs it.

    Raises:
        ModuleNotFoundError: An import in the block failed.
    """
    try:
        yield
    except ImportError as error:
        raise ModuleNotFoundError(
            f"{need} ({error}); in a checkout of gplfd: pip install '.[{extra}]', "
            f"elsewhere: pip install 'gplfd[{extra}]'"
        ) from error
