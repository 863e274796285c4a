"""The parts of ``gplfd speed`` by name."""

from collections.abc import Callable, Iterable, Mapping
from typing import Final, NamedTuple

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


class SpeedPart(NamedTuple):
    """Measurements of a part, as functions of the number of repeats."""

    measures: Mapping[str, Callable[[int], Measurement]]
    seconds: float
    """Approximate duration of a round on an idle machine."""
    peers: tuple[str, ...] = ()
    """Import names of the libraries that it compares with."""


_ENVIRONMENT: Final = {
    "steps": measure_steps,
    "resets": measure_resets,
    "vectors": measure_vectors,
}
PARTS: Final[Mapping[str, SpeedPart]] = {
    "fit": SpeedPart({"fit": compare_fits}, 9.0, ("hetgpy", "sklearn")),
    "adapt": SpeedPart({"adapt": measure_adaptation}, 1.0),
    "align": SpeedPart({"align": measure_alignment}, 3.0, ("dtw",)),
    "environment": SpeedPart(_ENVIRONMENT, 8.0),
}
"""Parts in the order of the report."""


def announcement(names: Iterable[str], repeats: int) -> str:
    """Return the parts, their approximate duration, and missing libraries."""
    parts = {name: PARTS[name] for name in names}
    # One more round warms up the caches.
    minutes = (repeats + 1) * sum(part.seconds for part in parts.values()) / 60.0
    text = (
        f"measuring {', '.join(parts)}: about {max(1, round(minutes))} min where "
        "nothing else runs"
    )
    peers = [peer for part in parts.values() for peer in part.peers]
    missing = " and ".join(DISTRIBUTIONS[one] for one in peers if not installed(one))
    if missing:
        text += f"; without {missing}, not installed (pip install 'gplfd[bench]')"
    return text
