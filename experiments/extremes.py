"""The best, the median and the worst episode of every policy of a study, recorded.

A study keeps numbers, no logs. Episodes are deterministic, so that those worth a look
are run again, and their numbers are held against the stored ones.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from experiments.files.plain_data import write_json
from experiments.repetition import Repeated, repeat
from experiments.report.recordings import COMPARISONS, FOLDER, INDEX, RANKS
from experiments.report.verdicts import CHAMPION
from experiments.results.grouping import by_condition, by_policy, ranked
from experiments.results.records import Episode, read_results
from experiments.teacher import DEMONSTRATED_RADII

COMPARED: Final = 6
"""Policies in the comparison: more would be too small to see."""

_ORDER: Final = "success, then peak radial force, then final angle"


def record_extremes(
    folder: Path, progress: Callable[[str], None] = lambda _: None
) -> Path:
    """Record episodes of a study's standard condition, and a comparison.

    Writes recordings/<policy>-best.rrd, -median.rrd and -worst.rrd, comparison.rrd and
    comparison-widest.rrd (policies side by side at the demonstrated door in the middle
    and at the widest) and index.json, which says what each file shows and whether its
    repetition has the stored numbers.

    Args:
        folder: The study's folder.
        progress: Called with the name of each file before it is made.

    Returns:
        The path of the index.

    Raises:
        FileNotFoundError: There is no such folder.
        ValueError: It is not the folder of a study.
        OSError: A file cannot be written.
    """
    from experiments.recording import record_episode

    episodes = _standard(read_results(folder).episodes)
    out = folder / FOLDER
    entries: list[dict[str, Any]] = []
    for policy, own in by_policy(episodes).items():
        for rank, episode in extremes(own).items():
            file = f"{policy}-{rank}.rrd"
            progress(file)
            entry = {"file": file, "rank": rank, **_described(episode)}
            with _noted(entry):
                again = repeat(episode)
                record_episode(out / file, again.log, again.model, again.demonstrations)
                entry |= _verdict(again)
            entries.append(entry)
    index: dict[str, Any] = {"order": _ORDER, "episodes": entries, "comparisons": []}
    radii = sorted(DEMONSTRATED_RADII)
    shown = (radii[len(radii) // 2], radii[-1])
    for file, radius in zip(COMPARISONS, shown, strict=True):
        compared = same_door(episodes, radius)
        if compared:
            progress(file)
            index["comparisons"].append(_compare(out / file, compared))
    write_json(out / INDEX, index)
    return out / INDEX


def extremes(episodes: Sequence[Episode]) -> dict[str, Episode]:
    """Return the best, the median and the worst of some episodes with metrics.

    Of two there is no median, and one is the best.
    """
    order = sorted((one for one in episodes if one.metrics), key=_rank)
    last = len(order) - 1
    places = dict(zip(RANKS, (0, (last + 1) // 2, last), strict=True))
    chosen = {rank: place for rank, place in places.items() if place <= last}
    if last < 2:
        chosen = {rank: chosen[rank] for rank in ("best", "worst")[: last + 1]}
    return {rank: order[place] for rank, place in chosen.items()}


def same_door(episodes: Sequence[Episode], radius: float) -> dict[str, Episode]:
    """Return an episode per policy: a door without other difficulty, the first seed.

    The champion first, then the policies in the order of their success; of more than
    `COMPARED`, some from the best to the worst. Empty where no policy has an episode
    at that door.

    Args:
        episodes: Of one condition.
        radius: The door's [m].
    """
    same = [
        one
        for one in episodes
        if one.metrics and one.ordinary and math.isclose(one.radius, radius)
    ]
    first = min((one.seed for one in same), default=0)
    found = {one.policy: one for one in same if one.seed == first}
    order = [name for name in ranked(episodes) if name in found]
    order.sort(key=lambda name: name != CHAMPION)
    if len(order) > COMPARED:
        step = (len(order) - 2) / (COMPARED - 2)
        order = [order[0], *(order[1 + round(n * step)] for n in range(COMPARED - 1))]
    return {name: found[name] for name in order}


def _standard(episodes: Sequence[Episode]) -> list[Episode]:
    return next(iter(by_condition(episodes).values()), [])


def _rank(one: Episode) -> tuple[bool, float, float, str]:
    success = bool((one.metrics or {}).get("success"))
    force = one.number("force_radial_peak")
    angle = one.number("final_angle_deg")
    return (
        not success,
        math.inf if force is None else force,
        math.inf if angle is None else -angle,
        one.pair,
    )


def _compare(path: Path, compared: Mapping[str, Episode]) -> dict[str, Any]:
    """Record policies side by side; leave out those that cannot be repeated."""
    from experiments.recording.comparison import record_comparison

    entries, repeated = [], []
    for episode in compared.values():
        entry = _described(episode)
        with _noted(entry):
            again = repeat(episode)
            repeated.append(again)
            entry |= _verdict(again)
        entries.append(entry)
    if repeated:
        logs = [each.log for each in repeated]
        first = repeated[0]
        record_comparison(path, logs, first.model, first.demonstrations)
    return {"file": path.name if repeated else None, "episodes": entries}


@contextlib.contextmanager
def _noted(entry: dict[str, Any]) -> Iterator[None]:
    """Note what a policy raises, which then has no recording, and go on."""
    try:
        yield
    except (ValueError, TypeError, ArithmeticError) as error:
        entry |= {"repeated": False, "error": f"{type(error).__name__}: {error}"}


def _described(episode: Episode) -> dict[str, Any]:
    return {
        "policy": episode.policy,
        "door": episode.door,
        "radius": episode.radius,
        "seed": episode.seed,
        "success": bool((episode.metrics or {}).get("success")),
        "force_radial_peak": episode.number("force_radial_peak"),
        "final_angle_deg": episode.number("final_angle_deg"),
    }


def _verdict(again: Repeated) -> dict[str, Any]:
    return {"repeated": not again.different, "different": dict(again.different)}
