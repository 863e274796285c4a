"""The journal of a served agent: each message with its replies is a line of JSON.

Each line is written at once, so that a killed process loses at most its last line. A
file may contain several runs.
"""

import json
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from gplfd_policies.serving.protocol import encode

BEGINNING: Final = b'{"journal":1'
"""Beginning of the first line of every run."""


class Journal:
    """Appends to a file; does nothing without a path."""

    def __init__(self, path: Path | None, about: Mapping[str, Any]) -> None:
        self._file: int | None = None
        if path is not None:
            flags = os.O_RDWR | os.O_CREAT | os.O_APPEND
            self._file = os.open(path, flags, 0o600)
            size = os.fstat(self._file).st_size
            if size and os.pread(self._file, 1, size - 1) != b"\n":
                os.write(self._file, b"\n")  # after a line that a kill truncated
            os.write(self._file, encode({"journal": 1, **about}))

    def write(
        self,
        at: float,
        came: bytes | str | None,
        replies: Sequence[Mapping[str, Any]],
        took: float,
    ) -> None:
        """Add a message with its replies, time and duration [s].

        `came` is a line of JSON, which is copied, other text, or None for no message.
        If the disk is full, the journal ends, but the robot continues.
        """
        if self._file is None:
            return
        text = came if isinstance(came, bytes) else json.dumps(came).encode()
        rest = encode({"at": at, "took": took, "out": list(replies)})
        try:
            os.write(self._file, b'{"in":%b,%b' % (text, rest[1:]))
        except OSError as error:
            print(f"gplfd: the journal ends here: {error}", file=sys.stderr, flush=True)
            self.close()

    def close(self) -> None:
        """Close the file; later messages are not written."""
        if self._file is not None:
            os.close(self._file)
            self._file = None


def read_journal(path: Path) -> list[dict[str, Any]]:
    """Return the lines of a journal, without truncated lines.

    Raises:
        ValueError: The file is not a journal, or a line within a run is damaged.
    """
    lines = path.read_bytes().split(b"\n")
    if not lines[0].startswith(BEGINNING):
        raise ValueError(f"{path} is not a journal of gplfd serve")
    found = []
    for number, line in enumerate(lines[:-1], start=1):
        try:
            found.append(json.loads(line))
        except (ValueError, RecursionError):
            if number < len(lines) - 1 and not lines[number].startswith(BEGINNING):
                raise ValueError(f"{path}: line {number} is damaged") from None
    return found
