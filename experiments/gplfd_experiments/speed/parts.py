"""The parts of ``gplfd speed`` by name."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Final

from gplfd_experiments.speed.environment import (
    measure_resets,
    measure_steps,
    measure_vectors,
)
from gplfd_experiments.speed.peers import DISTRIBUTIONS, installed
from gplfd_experiments.speed.policies import (
    compare_fits,
    measure_adaptation,
    measure_alignment,
)
from gplfd_experiments.speed.report import Measurement


@dataclass(frozen=True, kw_only=True, slots=True)
class Part:
    """One part: what is measured together."""

    measures: Mapping[str, Callable[[int], Measurement]]
    """Functions of the number of repeats, by the name of their results."""
    seconds: float
    """Approximate duration of a round on an idle machine."""
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
    """Return what will be measured, roughly how long it takes, and what is missing.

    Args:
        names: Keys of `PARTS`.
        repeats: Measurements of every time.
    """
    parts = {name: PARTS[name] for name in names}
    # One more round warms up the caches.
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
