"""Data sets of ``gplfd demos record``: the hand's motion in every episode."""

from pathlib import Path

from gplfd_experiments.data.minari import open_dataset
from gplfd_experiments.data.minari.dataset import DATA, MAIN_FILE
from gplfd_experiments.data.raw import OBSERVED, RawRecording, Selection
from gplfd_experiments.data.readers.tables import quaternions_of
from gplfd_policies.arrays.storage import DecodingBudget


def read(path: Path, selection: Selection) -> list[RawRecording]:
    """Read the observed poses of the hand, in the task frame, and the wrenches."""
    del selection  # No file is open.
    dataset = open_dataset(path)
    # Each episode is limited when it is read; this limits their sum.
    budget = DecodingBudget((dataset.path / DATA / MAIN_FILE).stat().st_size)
    recordings = []
    for number in range(dataset.n_episodes):
        seen = dataset.episode(number).observations
        poses = seen["ee_pose"]
        kept = sum(seen[name].nbytes for name in ("ee_pose", "time", "wrench"))
        budget.claim(kept, f"episode {number}")
        recordings.append(
            RawRecording(
                name=f"{path.name}: episode {number}",
                times=seen["time"][:, 0],
                positions=poses[:, :3],
                unit="m",
                quaternions=quaternions_of(poses[:, 3:]),
                wrenches=seen["wrench"],
                sensor=OBSERVED,
            )
        )
    return recordings
