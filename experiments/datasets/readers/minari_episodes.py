"""Data sets of ``gplfd demos record``: the hand's motion in every episode."""

from pathlib import Path

from gplfd.experiments.datasets.minari import open_dataset
from gplfd.experiments.datasets.raw import RawRecording
from gplfd.experiments.datasets.readers.selection import Selection
from gplfd.experiments.datasets.readers.tables import quaternions_of


def read(path: Path, selection: Selection) -> list[RawRecording]:
    """Read the observed poses of the hand, in the task's frame, and the wrenches.

    Raises:
        ValueError: The data set is damaged, or another program's.
    """
    del selection  # Nothing is open.
    dataset = open_dataset(path)
    recordings = []
    for number in range(dataset.n_episodes):
        seen = dataset.episode(number).observations
        poses = seen["ee_pose"]
        recordings.append(
            RawRecording(
                name=f"{path.name}: episode {number}",
                times=seen["time"][:, 0],
                positions=poses[:, :3],
                unit="m",
                quaternions=quaternions_of(poses[:, 3:]),
                signals={"force": seen["wrench"]},
            )
        )
    return recordings
