"""The journal of a served agent: each message with its replies is a line of JSON.

Each line is written at once, so that a killed process loses at most its last line. A
file may contain several runs.
"""

import io
import json
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from gplfd_policies.serving.protocol import encode

BEGINNING: Final = b'{"journal":1'
"""Beginning of the first line of every run."""

LARGEST: Final = 2**30
"""Greatest size of a file [bytes]: at least an hour with all quantities explained."""


class Journal:
    """Appends to a file that only the user can read; does nothing without a path."""

    def __init__(self, path: Path | None, about: Mapping[str, Any]) -> None:
        self._file: io.FileIO | None = None
        if path is not None:
            file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o600)
            self._file = os.fdopen(file, "ab", buffering=0)
            # A kill may have truncated the last line of the last run.
            begun = b"\n" if self._file.tell() else b""
            self._file.write(begun + encode({"journal": 1, **about}))

    def write(
        self,
        at: float,
        received: bytes | str | None,
        replies: Sequence[Mapping[str, Any]],
        took: float,
    ) -> None:
        """Add a message with its replies, time and duration [s].

        `received` is a line of JSON, which is copied, other text, or None for no
        message. If the file has its greatest size, or the disk is full, the journal
        ends, but the robot continues.
        """
        if self._file is None:
            return
        if not isinstance(received, bytes):
            received = json.dumps(received).encode()
        rest = encode({"at": at, "took": took, "out": list(replies)})
        try:
            if self._file.tell() > LARGEST:
                raise OSError(f"it has {LARGEST} bytes")
            self._file.write(b'{"in":%b,%b' % (received, rest[1:]))
        except OSError as error:
            print(f"gplfd: the journal ends here: {error}", file=sys.stderr, flush=True)
            self.close()

    def close(self) -> None:
        """Close the file; later messages are not written."""
        if self._file is not None:
            self._file.close()
            self._file = None


def read_journal(path: Path) -> list[dict[str, Any]]:
    """Return the lines of a journal, without truncated last lines of runs.

    Raises:
        ValueError: The file is not a journal, or a line within a run is damaged.
    """
    lines = [line for line in path.read_bytes().split(b"\n") if line]
    if not lines or not lines[0].startswith(BEGINNING):
        raise ValueError(f"{path} is not a journal of gplfd serve")
    entries = []
    for number, line in enumerate(lines, start=1):
        try:
            entries.append(json.loads(line))
        except ValueError:
            if number < len(lines) and not lines[number].startswith(BEGINNING):
                raise ValueError(f"{path}: entry {number} is damaged") from None
    return entries
