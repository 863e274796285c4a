"""The parts of ``gplfd speed`` by name."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from gplfd_experiments.speed.adapt import measure_adaptation
from gplfd_experiments.speed.align import measure_alignment
from gplfd_experiments.speed.environment import measure_resets, measure_steps
from gplfd_experiments.speed.fit import compare_fits
from gplfd_experiments.speed.peers import DISTRIBUTIONS, installed
from gplfd_experiments.speed.report import Measurement
from gplfd_experiments.speed.vectors import measure_vectors


@dataclass(frozen=True, kw_only=True, slots=True)
class Part:
    """One part: what is measured together."""

    measures: Mapping[str, Callable[[int], Measurement]]
    """What to run, by the name of its results; each takes the number of repeats."""
    seconds: float
    """Roughly how long a round takes where nothing else runs."""
    peers: tuple[str, ...] = ()
    """Import names of the libraries that it compares with."""


PARTS: Final[Mapping[str, Part]] = {
    "fit": Part(
        measures={"fit": compare_fits}, seconds=9.0, peers=("hetgpy", "sklearn")
    ),
    "adapt": Part(measures={"adapt": measure_adaptation}, seconds=1.0),
    "align": Part(measures={"align": measure_alignment}, seconds=3.0, peers=("dtw",)),
    "environment": Part(
        measures={
            "steps": measure_steps,
            "resets": measure_resets,
            "vectors": measure_vectors,
        },
        seconds=8.0,
    ),
}
"""In the order of the report."""


def announcement(names: Iterable[str], repeats: int) -> str:
    """Say what will be measured, roughly how long it takes, and what is missing.

    Args:
        names: Keys of `PARTS`.
        repeats: Measurements of every time.
    """
    parts = {name: PARTS[name] for name in names}
    # One more round warms caches up.
    minutes = (repeats + 1) * sum(part.seconds for part in parts.values()) / 60.0
    text = (
        f"measuring {', '.join(parts)}: about {max(1, round(minutes))} min where "
        "nothing else runs"
    )
    missing = [
        DISTRIBUTIONS[peer]
        for part in parts.values()
        for peer in part.peers
        if not installed(peer)
    ]
    if missing:
        text += (
            f"; without {' and '.join(missing)}, not installed (pip install "
            "'gplfd[bench]')"
        )
    return text
