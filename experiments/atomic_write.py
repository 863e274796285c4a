"""Files that are either complete or absent.

The content is written beside the target under a temporary name and then renamed over
it, so a run that is interrupted never leaves half a file under a name someone reads.
"""

from __future__ import annotations

import contextlib
import json
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any


@contextlib.contextmanager
def complete_or_absent(path: str | Path) -> Iterator[Path]:
    """Give a temporary path to write to; it becomes ``path`` when the block succeeds.

    Folders above ``path`` are created. When the block raises, the temporary file is
    removed and whatever stood at ``path`` before stays as it was.

    Raises:
        OSError: The folder or the file cannot be written.
    """
    target = Path(path)
    target.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(
        prefix=f".{target.name}.", suffix=target.suffix, dir=target.parent
    )
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        # mkstemp makes the file private to its owner; a result is for everyone the
        # user's umask allows.
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        temporary.replace(target)
    except OSError as error:
        # A full disk does not say for which file, and nobody knows the temporary one.
        if error.filename in (None, name):
            error.filename = str(target)
        raise
    finally:
        temporary.unlink(missing_ok=True)


def write_json(path: str | Path, value: Any) -> None:
    """Write ``value`` as indented JSON, complete or not at all.

    Raises:
        ValueError: The value holds NaN or infinity, which JSON cannot express.
        TypeError: The value holds something that JSON cannot express.
    """
    text = json.dumps(value, indent=2, allow_nan=False) + "\n"
    with complete_or_absent(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
