"""What a data set holds, as text."""

from __future__ import annotations

import math
from typing import Final

from experiments.datasets.minari.episode import RecordedEpisode
from experiments.datasets.minari.physics import model_hash
from experiments.datasets.minari.reading import Dataset

_COLUMNS: Final = (
    ("episode", ""),
    ("radius", "m"),
    ("seed", ""),
    ("steps", ""),
    ("time", "s"),
    ("angle", "deg"),
    ("outcome", ""),
    ("return", ""),
    ("model", "hash"),
)
"""Heads of the columns and their units."""


def title(dataset: Dataset) -> str:
    """Return the data set in one line."""
    arguments = ", ".join(
        f"{name}={value!r}" for name, value in dataset.arguments.items()
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
    origin = dataset.origin
    versions = {"minari": origin["minari"], **origin["versions"]}
    git = origin["git"]
    edited = " with edits" if git and git.get("dirty") else ""
    rows: list[tuple[str, ...]] = list(zip(*_COLUMNS, strict=True))
    rows += [_row(n, dataset.episode(n)) for n in range(dataset.n_episodes)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(
        [
            title(dataset),
            dataset.description,
            f"recorded {origin['created']} by `{' '.join(origin['command'])}`"
            + (f" at git {str(git.get('commit'))[:10]}{edited}" if git else ""),
            ", ".join(f"{name} {version}" for name, version in versions.items()),
            ", ".join(
                f"{name} {value}" for name, value in origin["arithmetic"].items()
            ),
            "",
            *(
                "  ".join(cell.rjust(w) for cell, w in zip(row, widths, strict=True))
                for row in rows
            ),
        ]
    )


def _row(number: int, episode: RecordedEpisode) -> tuple[str, ...]:
    infos = episode.infos
    return (
        str(number),
        f"{infos['door_radius'][-1]:.3f}",
        str(episode.seed),
        str(len(episode)),
        f"{episode.observations['time'][-1, 0]:.2f}",
        f"{math.degrees(infos['door_angle'][-1]):.1f}",
        outcome(episode),
        f"{episode.rewards.sum():.3f}",
        model_hash(episode.model_digests)[:8],
    )
