"""Sets of ``gplfd demos import`` and ``gplfd demos record``: the hand's motions."""

from pathlib import Path

from gplfd_experiments.data.raw import RawRecording
from gplfd_experiments.data.readers.tables import ROTATION_VECTOR, quaternions_of
from gplfd_experiments.data.settings import ImportSettings
from gplfd_policies.demonstrations.npz import load_demonstrations


def read(path: Path, settings: ImportSettings) -> list[RawRecording]:
    """Read poses and wrenches of a set of demonstrations, or as they were observed."""
    del settings  # No choice is open.
    if observed := (path / "data/metadata.json").is_file():
        from gplfd_experiments.data.minari import open_dataset

        dataset = open_dataset(path)
        episodes = map(dataset.episode, range(dataset.n_episodes))
        seen = (episode.observations for episode in episodes)
        motions = [(s["time"][:, 0], s["ee_pose"], s["wrench"]) for s in seen]
    else:
        recorded = load_demonstrations(path).demonstrations
        motions = [(motion.times, motion.poses, motion.wrenches) for motion in recorded]
    return [
        RawRecording(
            f"{path.name}: episode {number}" if observed else f"{path.name}[{number}]",
            poses[:, :3],
            "m",
            times,
            quaternions_of(ROTATION_VECTOR, poses[:, 3:]),
            wrenches=wrenches,
            forces_on="hand" if observed else "object",
        )
        for number, (times, poses, wrenches) in enumerate(motions)
    ]
