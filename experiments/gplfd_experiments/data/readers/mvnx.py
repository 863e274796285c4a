"""Xsens MVN in XML (.mvnx): position and orientation of one segment.

Expat reads the file as a stream, so memory holds that segment only. Declarations of
entities are refused: they are how a small XML file becomes a large one.
"""

from array import array
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final
from xml.parsers import expat

import numpy as np

from gplfd_experiments.data.raw import RawRecording
from gplfd_experiments.data.readers.selection import Selection, chosen

DEFAULT_SEGMENT: Final = "RightHand"
"""What moves where nothing is said."""

_LONGEST_TEXT: Final = 2**20
"""Characters of one element at most; a frame of 24 segments has two thousand."""


def read(path: Path, selection: Selection) -> list[RawRecording]:
    """Read the motion of a segment, in metres and Xsens' global frame.

    Times are the frame's index by the frame rate: the file's own are rounded to
    milliseconds.

    Raises:
        ValueError: The file is no MVNX, or lacks the segment; the message has the line.
    """
    film = _Film(selection.body or DEFAULT_SEGMENT, path.name)
    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.EntityDeclHandler = _refuse_entity
    parser.StartElementHandler = film.start
    parser.EndElementHandler = film.end
    parser.CharacterDataHandler = film.text
    try:
        with path.open("rb") as stream:
            parser.ParseFile(stream)
    except expat.ExpatError as error:
        raise ValueError(f"it is no XML: {error}") from error
    except ValueError as error:
        raise ValueError(f"line {parser.CurrentLineNumber}: {error}") from error
    return [film.recording(path.name)]


def _refuse_entity(*declaration: Any) -> None:
    raise ValueError(f"it declares an entity, {declaration[0]!r:.40}: not read")


class _Film:
    """Takes elements as they come, and keeps one segment's frames."""

    def __init__(self, segment: str, file: str) -> None:
        self._segment, self._file = segment, file
        self._labels: dict[str, int] = {}
        self._place = -1
        self._rate = 0.0
        self._normal = False
        self._parts: list[str] | None = None
        self._length = 0
        self._indices = array("d")
        self._positions, self._quaternions = array("d"), array("d")
        self._starts: dict[str, Callable[[dict[str, str]], None]] = {
            "subject": self._subject,
            "segment": self._add_segment,
            "frame": self._frame,
        }

    def start(self, name: str, attributes: dict[str, str]) -> None:
        """Take the beginning of an element."""
        if name in self._starts:
            self._starts[name](attributes)
        elif self._normal and name in ("position", "orientation"):
            self._parts, self._length = [], 0

    def text(self, text: str) -> None:
        """Take a part of an element's text."""
        if self._parts is not None:
            self._length += len(text)
            if self._length > _LONGEST_TEXT:
                raise ValueError(f"an element is longer than {_LONGEST_TEXT}")
            self._parts.append(text)

    def end(self, name: str) -> None:
        """Take the end of an element."""
        if self._parts is not None and name in ("position", "orientation"):
            numbers = "".join(self._parts).split()
            self._parts = None
            width = 3 if name == "position" else 4
            if len(numbers) != width * len(self._labels):
                raise ValueError(
                    f"frame {self._indices[-1]:.0f}: {name} has {len(numbers)} "
                    f"numbers, and {len(self._labels)} segments need "
                    f"{width * len(self._labels)}"
                )
            kept = self._positions if width == 3 else self._quaternions
            first = width * self._place
            kept.extend(map(float, numbers[first : first + width]))
        elif name == "frame" and self._normal:
            self._normal = False
            frames = len(self._indices)
            if (len(self._positions), len(self._quaternions)) != (
                3 * frames,
                4 * frames,
            ):
                raise ValueError(
                    f"frame {self._indices[-1]:.0f} lacks its position or orientation, "
                    "or has two; export both from MVN"
                )

    def recording(self, name: str) -> RawRecording:
        """Return what was kept."""
        if not self._indices:
            raise ValueError("it has no frame of type normal: is it a recording?")
        return RawRecording(
            name=f"{name}: {self._segment}",
            times=np.frombuffer(self._indices) / self._rate,
            positions=np.frombuffer(self._positions).reshape(-1, 3),
            unit="m",
            quaternions=np.frombuffer(self._quaternions).reshape(-1, 4),
        )

    def _subject(self, attributes: dict[str, str]) -> None:
        self._rate = float(attributes.get("frameRate", 0.0))
        if not 0.0 < self._rate < 1e6:
            raise ValueError(f"subject has the frameRate {self._rate}")

    def _add_segment(self, attributes: dict[str, str]) -> None:
        label = attributes.get("label", "")
        if not label or label in self._labels:
            raise ValueError(f"a segment's label is missing or repeated: {label!r:.40}")
        self._labels[label] = len(self._labels)

    def _frame(self, attributes: dict[str, str]) -> None:
        self._normal = attributes.get("type") == "normal"
        if not self._normal:
            return
        if not self._rate:
            raise ValueError("frames come before the subject and its frameRate")
        if self._place < 0:
            _, self._place = chosen(
                self._segment, self._labels, "segment", file=self._file
            )
        index = attributes.get("index", "")
        if not index.isdecimal() or len(index) > 15:
            raise ValueError(f"a frame has the index {index!r:.40}")
        self._indices.append(float(index))
