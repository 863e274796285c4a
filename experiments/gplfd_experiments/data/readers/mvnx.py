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
    rows: dict[str, list[FloatArray]] = {"position": [], "orientation": []}
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
                    for what, width in (("position", 3), ("orientation", 4)):
                        texts = [c.text or "" for c in element if c.tag.endswith(what)]
                        numbers = np.array(" ".join(texts).split(), dtype=np.float64)
                        if numbers.size != len(labels) * width:
                            raise ValueError(
                                f"frame {indices[-1]}: {what} has {numbers.size} "
                                f"numbers, and {len(labels)} segments need "
                                f"{len(labels) * width}; export both from MVN"
                            )
                        rows[what].append(numbers.reshape(-1, width)[place])
                element.clear()
    if not indices or not rate > 0.0:
        raise ValueError("it has no frameRate, or no frame of type normal")
    positions, quaternions = map(np.array, rows.values())
    times, name = np.array(indices) / rate, f"{path.name}: {segment}"
    return [RawRecording(name, positions, "m", times, quaternions)]
