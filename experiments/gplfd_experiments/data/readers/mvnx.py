"""Xsens MVN in XML (.mvnx): position and orientation of one segment.

Expat reads the file as a stream, so that memory contains this segment only.
Declarations of entities raise an error, because they expand a small XML file to a large
one.
"""

from array import array
from pathlib import Path
from typing import Any, Final
from xml.parsers import expat

import numpy as np

from gplfd_experiments.data.raw import RawRecording, Selection, chosen

_DEFAULT_SEGMENT: Final = "RightHand"
_LONGEST_TEXT: Final = 2**20
"""Largest length of an element [characters]; a frame of 24 segments has two
thousand."""
_WIDTHS: Final = {"position": 3, "orientation": 4}


def read(path: Path, selection: Selection) -> list[RawRecording]:
    """Read the motion of a segment, in metres and Xsens' global frame.

    Times are the frame's index divided by the frame rate, because the times in the file
    are rounded to milliseconds. Errors contain the line number.
    """
    segment = selection.body or _DEFAULT_SEGMENT
    frames = _Frames(segment, path.name)
    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.EntityDeclHandler = frames.entity
    parser.StartElementHandler = frames.start
    parser.EndElementHandler = frames.end
    parser.CharacterDataHandler = frames.text
    try:
        with path.open("rb") as stream:
            parser.ParseFile(stream)
    except expat.ExpatError as error:
        raise ValueError(f"it is no XML: {error}") from error
    except ValueError as error:
        raise ValueError(f"line {parser.CurrentLineNumber}: {error}") from error
    if not frames.indices:
        raise ValueError("it has no frame of type normal: is it a recording?")
    return [
        RawRecording(
            name=f"{path.name}: {segment}",
            times=np.frombuffer(frames.indices) / frames.rate,
            positions=np.frombuffer(frames.values["position"]).reshape(-1, 3),
            unit="m",
            quaternions=np.frombuffer(frames.values["orientation"]).reshape(-1, 4),
        )
    ]


class _Frames:
    """Handles the elements of a file in order, and stores the frames of one segment."""

    def __init__(self, segment: str, file: str) -> None:
        self.rate = 0.0
        self.indices = array("d")
        self.values = {name: array("d") for name in _WIDTHS}
        self._segment, self._file = segment, file
        self._labels: dict[str, int] = {}
        self._in_frame = False
        self._place = -1
        self._text: str | None = None

    def entity(self, *declaration: Any) -> None:
        """Raise an error for the declaration of an entity."""
        raise ValueError(f"it declares an entity, {declaration[0]!r:.40}: not read")

    def start(self, name: str, attributes: dict[str, str]) -> None:
        """Handle the beginning of an element."""
        if name == "subject":
            self.rate = float(attributes.get("frameRate", 0.0))
            if not 0.0 < self.rate < 1e6:
                raise ValueError(f"subject has the frameRate {self.rate}")
        elif name == "segment":
            label = attributes.get("label", "")
            if not label or label in self._labels:
                raise ValueError(
                    f"a segment's label is missing or repeated: {label!r:.40}"
                )
            self._labels[label] = len(self._labels)
        elif name == "frame":
            # Frames other than normal ones are poses of the calibration.
            self._in_frame = attributes.get("type") == "normal"
            if not self._in_frame:
                return
            if not self.rate:
                raise ValueError("frames come before the subject and its frameRate")
            if self._place < 0:
                _, self._place = chosen(
                    self._segment, self._labels, "segment", file=self._file
                )
            index = attributes.get("index", "")
            if not index.isdecimal() or len(index) > 15:
                raise ValueError(f"a frame has the index {index!r:.40}")
            self.indices.append(float(index))
        elif self._in_frame and name in _WIDTHS:
            self._text = ""

    def text(self, text: str) -> None:
        """Handle a part of an element's text."""
        if self._text is not None:
            self._text += text
            if len(self._text) > _LONGEST_TEXT:
                raise ValueError(f"an element is longer than {_LONGEST_TEXT}")

    def end(self, name: str) -> None:
        """Handle the end of an element."""
        if self._text is not None and name in _WIDTHS:
            numbers, width = self._text.split(), _WIDTHS[name]
            self._text = None
            if len(numbers) != width * len(self._labels):
                raise ValueError(
                    f"frame {self.indices[-1]:.0f}: {name} has {len(numbers)} "
                    f"numbers, and {len(self._labels)} segments need "
                    f"{width * len(self._labels)}"
                )
            first = width * self._place
            self.values[name].extend(map(float, numbers[first : first + width]))
        elif name == "frame" and self._in_frame:
            self._in_frame = False
            for what, width in _WIDTHS.items():
                if len(self.values[what]) != width * len(self.indices):
                    raise ValueError(
                        f"frame {self.indices[-1]:.0f} lacks its position or "
                        "orientation, or has two; export both from MVN"
                    )
