"""What a data set holds, as text."""

import math
from collections.abc import Mapping

from gplfd_experiments.data.minari.episode import RecordedEpisode
from gplfd_experiments.data.minari.physics import model_hash
from gplfd_experiments.data.minari.reading import Dataset
from gplfd_experiments.files.table import Table, text_table


def title(dataset: Dataset) -> str:
    """Return the data set in one line."""
    arguments = ", ".join(
        f"door of {value['radius']:g} m"
        if name == "door" and isinstance(value, Mapping) and "radius" in value
        else f"{name}={value!r}"
        for name, value in dataset.arguments.items()
    )
    return (
        f"{dataset.name}: policy {dataset.policy} in {dataset.environment}"
        f"{f' ({arguments})' if arguments else ''}, {dataset.n_episodes} episodes"
    )


def outcome(episode: RecordedEpisode) -> str:
    """Return how an episode ended: "opened", "stalled", "time limit", ..."""
    if episode.infos["success"][-1]:
        return "opened"
    failure = str(episode.infos["failure"][-1])
    return failure.replace("_", " ") or "time limit"


def contents(dataset: Dataset) -> str:
    """Return where the data set comes from, and a line per episode.

    Raises:
        ValueError: An episode is incomplete.
    """
    origin, git = dataset.origin, dataset.origin["git"]
    edited = " with edits" if git and git.get("dirty") else ""
    rows = []
    for number in range(dataset.n_episodes):
        episode = dataset.episode(number)
        infos = episode.infos
        row = {
            "episode": str(number),
            "radius [m]": f"{infos['door_radius'][-1]:.3f}",
            "seed": str(episode.seed),
            "steps": str(len(episode)),
            "time [s]": f"{episode.observations['time'][-1, 0]:.2f}",
            "angle [deg]": f"{math.degrees(infos['door_angle'][-1]):.1f}",
            "outcome": outcome(episode),
            "return": f"{episode.rewards.sum():.3f}",
            "model": model_hash(episode.model_digests)[:8],
        }
        rows.append(row)
    table = Table(columns=tuple(rows[0]), rows=tuple(tuple(r.values()) for r in rows))
    return "\n".join(
        [
            title(dataset),
            dataset.description,
            f"recorded {origin['created']} by `{' '.join(origin['command'])}`"
            + (f" at git {str(git.get('commit'))[:10]}{edited}" if git else ""),
            _listed({"minari": origin["minari"], **origin["versions"]}),
            _listed(origin["arithmetic"]),
            "",
            text_table(table),
        ]
    )


def _listed(values: Mapping[str, str]) -> str:
    return ", ".join(f"{name} {value}" for name, value in values.items())
