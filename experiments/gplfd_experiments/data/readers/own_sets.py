"""Sets of ``gplfd demos import`` and ``gplfd demos record``: the hand's motions."""

from pathlib import Path

from gplfd_experiments.data.raw import RawRecording
from gplfd_experiments.data.readers.tables import ROTATION_VECTOR, quaternions_of
from gplfd_experiments.data.settings import ImportSettings
from gplfd_policies.demonstrations.npz import load_demonstrations


def read(path: Path, settings: ImportSettings) -> list[RawRecording]:
    """Read poses and wrenches of a set of demonstrations, or as they were observed."""
    del settings  # No choice is open.
    if (path / "data/metadata.json").is_file():
        from gplfd_experiments.data.minari import open_dataset

        dataset = open_dataset(path)
        episodes = (
            dataset.episode(number).observations for number in range(dataset.n_episodes)
        )
        motions = [
            (f": episode {number}", seen["time"][:, 0], seen["ee_pose"], seen["wrench"])
            for number, seen in enumerate(episodes)
        ]
    else:
        demonstrations = load_demonstrations(path).demonstrations
        motions = [
            (f"[{number}]", motion.times, motion.poses, motion.wrenches)
            for number, motion in enumerate(demonstrations)
        ]
    return [
        RawRecording(
            name=path.name + part,
            times=times,
            positions=poses[:, :3],
            unit="m",
            quaternions=quaternions_of(ROTATION_VECTOR, poses[:, 3:]),
            wrenches=wrenches,
            forces_on="hand" if "episode" in part else "object",
        )
        for part, times, poses, wrenches in motions
    ]
