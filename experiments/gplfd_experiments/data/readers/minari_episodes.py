"""Data sets of ``gplfd demos record``: the hand's motion in every episode."""

from pathlib import Path

from gplfd_experiments.data.minari import open_dataset
from gplfd_experiments.data.raw import OBSERVED, RawRecording, Selection
from gplfd_experiments.data.readers.tables import quaternions_of


def read(path: Path, selection: Selection) -> list[RawRecording]:
    """Read the observed poses of the hand, in the task frame, and the wrenches."""
    del selection  # No choice is open.
    dataset = open_dataset(path)
    recordings = []
    for number in range(dataset.n_episodes):
        observations = dataset.episode(number).observations
        poses = observations["ee_pose"]
        recordings.append(
            RawRecording(
                name=f"{path.name}: episode {number}",
                times=observations["time"][:, 0],
                positions=poses[:, :3],
                unit="m",
                quaternions=quaternions_of(poses[:, 3:]),
                wrenches=observations["wrench"],
                sensor=OBSERVED,
            )
        )
    return recordings
