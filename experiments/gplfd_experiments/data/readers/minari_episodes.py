"""Data sets of ``gplfd demos record``: the hand's motion in every episode."""

from pathlib import Path

from gplfd_experiments.data.minari import open_dataset
from gplfd_experiments.data.raw import RawRecording
from gplfd_experiments.data.readers.tables import ROTATION_VECTOR, quaternions_of
from gplfd_experiments.data.settings import ImportSettings


def read(path: Path, settings: ImportSettings) -> list[RawRecording]:
    """Read the observed poses of the hand, in the task frame, and the wrenches."""
    del settings  # No choice is open.
    dataset = open_dataset(path)
    seen = (
        dataset.episode(number).observations for number in range(dataset.n_episodes)
    )
    return [
        RawRecording(
            name=f"{path.name}: episode {number}",
            times=observations["time"][:, 0],
            positions=observations["ee_pose"][:, :3],
            unit="m",
            quaternions=quaternions_of(ROTATION_VECTOR, observations["ee_pose"][:, 3:]),
            wrenches=observations["wrench"],
            forces_on="hand",
        )
        for number, observations in enumerate(seen)
    ]
