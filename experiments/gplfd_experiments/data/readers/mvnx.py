"""Xsens MVN in XML (.mvnx): position and orientation of one segment."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

import numpy as np

from gplfd_experiments.data.raw import RawRecording, Selection, chosen
from gplfd_experiments.files.arrays import FloatArray

_DEFAULT_SEGMENT: Final = "RightHand"
_WIDTHS: Final = {"position": 3, "orientation": 4}


def read(path: Path, selection: Selection) -> list[RawRecording]:
    """Read the motion of a segment, in metres and Xsens' global frame.

    Times are the frame's index divided by the frame rate, because the times in the file
    are rounded to milliseconds.
    """
    segment, rate, place = selection.body or _DEFAULT_SEGMENT, 0.0, -1
    labels: dict[str, int] = {}
    indices: list[int] = []
    values: dict[str, list[FloatArray]] = {name: [] for name in _WIDTHS}
    for event, name, element in _elements(path):
        if event == "start" and name == "subject":
            rate = float(element.get("frameRate", 0.0))
            if not 0.0 < rate < 1e6:
                raise ValueError(f"subject has the frameRate {rate}")
        elif event == "start" and name == "segment":
            label = element.get("label", "")
            if not label or label in labels:
                raise ValueError(
                    f"a segment's label is missing or repeated: {label!r:.40}"
                )
            labels[label] = len(labels)
        elif event == "end" and name == "frame":
            # Frames other than normal ones are poses of the calibration.
            if element.get("type") == "normal":
                if place < 0:
                    _, place = chosen(segment, labels, "segment", file=path.name)
                indices.append(int(element.get("index", "")))
                for what in _WIDTHS:
                    row = _row(element, what, indices[-1], len(labels))
                    values[what].append(row[place])
            element.clear()
    if not indices or not rate:
        raise ValueError("it has no frame of type normal: is it a recording?")
    return [
        RawRecording(
            name=f"{path.name}: {segment}",
            times=np.array(indices) / rate,
            positions=np.array(values["position"]),
            unit="m",
            quaternions=np.array(values["orientation"]),
        )
    ]


def _elements(path: Path) -> Iterator[tuple[str, str, ElementTree.Element]]:
    """Yield the event, the name without its namespace, and the element."""
    try:
        for event, element in ElementTree.iterparse(path, ("start", "end")):
            yield event, element.tag.rpartition("}")[2], element
    except ElementTree.ParseError as error:
        raise ValueError(f"it is no XML: {error}") from error


def _row(
    frame: ElementTree.Element, what: str, index: int, segments: int
) -> FloatArray:
    """Return the numbers of every segment in a frame, (segments, width)."""
    texts = [child.text or "" for child in frame if child.tag.endswith(what)]
    if len(texts) != 1:
        raise ValueError(
            f"frame {index} lacks its position or orientation, or has two; export both "
            "from MVN"
        )
    numbers = np.array(texts[0].split(), dtype=np.float64)
    if numbers.size != _WIDTHS[what] * segments:
        raise ValueError(
            f"frame {index}: {what} has {numbers.size} numbers, and {segments} "
            f"segments need {_WIDTHS[what] * segments}"
        )
    return numbers.reshape(segments, _WIDTHS[what])
