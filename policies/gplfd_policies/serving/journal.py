"""The journal of a served agent: every message and its replies, a line of JSON each.

A line is one write, so that a killed process loses no more than the line that it was
writing. Several runs may follow each other in one file.
"""

import json
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from gplfd_policies.serving.protocol import encode

BEGINNING: Final = b'{"journal":1'
"""How the first line of every run begins."""


class Journal:
    """Appends to a file; to none without a path."""

    def __init__(self, path: Path | None, about: Mapping[str, Any]) -> None:
        self._file: int | None = None
        if path is not None:
            flags = os.O_RDWR | os.O_CREAT | os.O_APPEND
            self._file = os.open(path, flags, 0o600)
            size = os.fstat(self._file).st_size
            if size and os.pread(self._file, 1, size - 1) != b"\n":
                os.write(self._file, b"\n")  # after the line that a kill cut short
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
        A disk that is full ends the journal, but not the robot's motion.
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
        """Close the file; what follows is not written."""
        if self._file is not None:
            os.close(self._file)
            self._file = None


def read_journal(path: Path) -> list[dict[str, Any]]:
    """Return the lines of a journal; one that was cut short is left out.

    Raises:
        ValueError: It is no journal, or a line in the middle of a run is damaged.
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
