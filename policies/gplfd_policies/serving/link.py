"""A line at a time over a pair of file descriptors, which never blocks."""

import contextlib
import os
import select

from gplfd_policies.serving.protocol import MAX_LINE

_MOST_UNSENT = 2**20


class Link:
    """One end of a connection: a socket twice, or the two ends of pipes.

    Args:
        reader: Descriptor to read from.
        writer: Descriptor to write to.
    """

    def __init__(self, reader: int, writer: int) -> None:
        self.reader, self._writer = reader, writer
        self._before = os.get_blocking(reader), os.get_blocking(writer)
        os.set_blocking(reader, False)
        os.set_blocking(writer, False)
        self._partial, self._unsent = b"", b""
        self.closed = False

    def lines(self, timeout: float | None = 0.0) -> list[bytes]:
        """Return the complete lines that came within a time [s]; None waits.

        A line that is too long, and the end of the stream, set `closed`.
        """
        try:
            if not select.select([self.reader], [], [], timeout)[0]:
                return []
            data = os.read(self.reader, MAX_LINE)
        except BlockingIOError:
            return []
        except OSError:
            data = b""
        *whole, self._partial = (self._partial + data).split(b"\n")
        self.closed |= not data or len(self._partial) > MAX_LINE
        return whole

    def send(self, data: bytes = b"") -> None:
        """Send what can be sent at once, and keep the rest for the next time.

        A peer that has gone, or does not read for a megabyte, sets `closed`.
        """
        self._unsent += data
        try:
            while self._unsent and not self.closed:
                self._unsent = self._unsent[os.write(self._writer, self._unsent) :]
        except BlockingIOError:
            self.closed = len(self._unsent) > _MOST_UNSENT
        except OSError:
            self.closed = True

    def restore(self) -> None:
        """Let the descriptors block again, if they did."""
        for descriptor, blocking in zip(
            (self.reader, self._writer), self._before, strict=True
        ):
            with contextlib.suppress(OSError):
                os.set_blocking(descriptor, blocking)
