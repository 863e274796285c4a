"""Xsens MVN in XML (.mvnx): position and orientation of one segment."""

from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from gplfd_experiments.data.raw import RawRecording, chosen
from gplfd_experiments.data.settings import ImportSettings
from gplfd_experiments.files.arrays import FloatArray


def read(path: Path, settings: ImportSettings) -> list[RawRecording]:
    """Read the motion of a segment, in metres and Xsens' global frame.

    Times are the frame's index divided by the frame rate, because the times in the file
    are rounded to milliseconds.
    """
    segment, rate = settings.body or "RightHand", 0.0
    labels: dict[str, int] = {}
    of_body = False  # Gloves have lists of segments of their own.
    indices: list[int] = []
    positions: list[FloatArray] = []
    orientations: list[FloatArray] = []
    for event, element in ElementTree.iterparse(path, ("start", "end")):
        match event, element.tag.rpartition("}")[2]:
            case "start", "subject":
                rate = float(element.get("frameRate", 0.0))
            case _, "segments":
                of_body = event == "start"
            case "start", "segment" if of_body:
                label = element.get("label", "")
                if label in labels:
                    raise ValueError(f"two segments have the label {label!r:.40}")
                labels[label] = len(labels)
            case "end", "frame":
                # Frames other than normal ones are poses of the calibration.
                if element.get("type") == "normal":
                    _, place = chosen(segment, labels, "segment", file=path.name)
                    indices.append(int(element.get("index", "")))
                    for what, width, rows in (
                        ("position", 3, positions),
                        ("orientation", 4, orientations),
                    ):
                        rows.append(_row(element, what, (len(labels), width))[place])
                element.clear()
    if not indices or not rate > 0.0:
        raise ValueError("it has no frameRate, or no frame of type normal")
    return [
        RawRecording(
            name=f"{path.name}: {segment}",
            times=np.array(indices) / rate,
            positions=np.array(positions),
            unit="m",
            quaternions=np.array(orientations),
        )
    ]


def _row(frame: ElementTree.Element, what: str, shape: tuple[int, int]) -> FloatArray:
    """Return the numbers of every segment in a frame, in this shape."""
    index = frame.get("index")
    texts = [child.text or "" for child in frame if child.tag.endswith(what)]
    if len(texts) != 1:
        raise ValueError(
            f"frame {index} lacks its position or orientation, or has two; export both "
            "from MVN"
        )
    numbers = np.array(texts[0].split(), dtype=np.float64)
    if numbers.size != shape[0] * shape[1]:
        raise ValueError(
            f"frame {index}: {what} has {numbers.size} numbers, and {shape[0]} "
            f"segments need {shape[0] * shape[1]}"
        )
    return numbers.reshape(shape)
