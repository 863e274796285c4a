"""Transfer of lines over a pair of file descriptors, without blocking."""

import os
import select

from gplfd_policies.serving.protocol import MAX_LINE

_MOST_UNSENT = 2**20
_PIECE = 4096  # what a writable pipe accepts at once


class Link:
    """One end of a connection: a socket (given twice), or the ends of two pipes.

    Args:
        reader: Descriptor to read from.
        writer: Descriptor to write to.
    """

    def __init__(self, reader: int, writer: int) -> None:
        self._reader, self._writer = reader, writer
        self._partial, self._unsent = b"", b""
        self.closed = False

    def lines(self, timeout: float = 0.0) -> list[bytes]:
        """Return the complete lines that arrive within a time [s].

        A line that is too long, or the end of the stream, sets `closed`.
        """
        try:
            if not select.select([self._reader], [], [], timeout)[0]:
                return []
            data = os.read(self._reader, MAX_LINE)
        except OSError:
            data = b""
        *whole, self._partial = (self._partial + data).split(b"\n")
        self.closed |= not data or len(self._partial) > MAX_LINE
        return whole

    def send(self, data: bytes = b"") -> None:
        """Send as much as possible without blocking, and keep the rest.

        If the peer is gone, or a megabyte is waiting, `closed` is set.
        """
        self._unsent += data
        try:
            while self._unsent and select.select([], [self._writer], [], 0.0)[1]:
                sent = os.write(self._writer, self._unsent[:_PIECE])
                self._unsent = self._unsent[sent:]
        except OSError:
            self.closed = True
        self.closed |= len(self._unsent) > _MOST_UNSENT
