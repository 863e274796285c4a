"""The best, the median and the worst episode of every policy of a study, recorded.

A study keeps numbers, no logs. Episodes are deterministic, so that those worth a look
are run again, and their numbers are compared with the stored ones.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from gplfd_experiments.analysis.report.recordings import (
    COMPARISONS,
    FOLDER,
    INDEX,
    RANKS,
    recording_name,
)
from gplfd_experiments.analysis.results.grouping import by_condition, by_policy, ranked
from gplfd_experiments.analysis.results.reading import read_results
from gplfd_experiments.analysis.results.records import NON_STANDARD, EpisodeResult
from gplfd_experiments.console.progress import LOG
from gplfd_experiments.data.teacher import DEMONSTRATED_RADII
from gplfd_experiments.files.plain_data import write_json
from gplfd_experiments.recording import record_episode
from gplfd_experiments.recording.comparison import RADIAL, record_comparison
from gplfd_experiments.workflows.repetition import Repeated, repeat

COMPARED: Final = 6
"""Policies in the comparison: more would be too small to see."""

_ORDER: Final = "success, then peak radial force, then final angle"


def record_extremes(folder: Path, reference: str = "gp") -> Path:
    """Record episodes of a study's standard condition, and a comparison.

    Writes recordings/<policy>-best.rrd, -median.rrd and -worst.rrd, comparison.rrd and
    comparison-widest.rrd (policies side by side at the demonstrated door in the middle
    and at the widest) and index.json, which says what each file shows and whether its
    repetition has the stored numbers. What a policy raises when it is run again stands
    there, too, in place of a recording.

    Args:
        folder: The study's folder.
        reference: Policy that stands first in the comparisons, if the study has it.

    Returns:
        The path of the index.

    Raises:
        FileNotFoundError: There is no such folder.
        ValueError: It is not the folder of a study.
        OSError: A file cannot be written.
    """
    conditions = by_condition(read_results(folder).episodes)
    standard = [one for one in next(iter(conditions.values()), []) if not one.error]
    out = folder / FOLDER
    index = {
        "order": _ORDER,
        "episodes": _record_each(out, standard),
        "comparisons": _record_comparisons(out, standard, reference),
    }
    write_json(out / INDEX, index)
    return out / INDEX


def _record_each(out: Path, episodes: Sequence[EpisodeResult]) -> list[dict[str, Any]]:
    entries = []
    for policy, own in by_policy(episodes).items():
        for rank, episode in extremes(own).items():
            file = recording_name(policy, rank)
            LOG.info("recording %s", file)
            again, entry = _repeated(episode)
            entries.append({"file": file, "rank": rank, **entry})
            if again is not None:
                record_episode(out / file, again.log, again.model, again.demonstrations)
    return entries


def _record_comparisons(
    out: Path, episodes: Sequence[EpisodeResult], reference: str
) -> list[dict[str, Any]]:
    entries = []
    radii = sorted(DEMONSTRATED_RADII)
    shown = (radii[len(radii) // 2], radii[-1])
    for file, radius in zip(COMPARISONS, shown, strict=True):
        if compared := same_door(episodes, radius, reference):
            LOG.info("recording %s", file)
            entries.append(compare(out / file, compared))
    return entries


def extremes(episodes: Sequence[EpisodeResult]) -> dict[str, EpisodeResult]:
    """Return the best, the median and the worst of some episodes that ran.

    Of two there is no median, and one is the best.
    """
    order = sorted(episodes, key=_rank)
    ranks = {0: (), 1: RANKS[:1], 2: (RANKS[0], RANKS[-1])}.get(len(order), RANKS)
    places = {"best": 0, "median": len(order) // 2, "worst": len(order) - 1}
    return {rank: order[places[rank]] for rank in ranks}


def same_door(
    episodes: Sequence[EpisodeResult], radius: float, reference: str
) -> dict[str, EpisodeResult]:
    """Return an episode per policy: a standard door, the first seed.

    The reference first, then the policies in the order of their success; of more than
    `COMPARED`, some from the best to the worst. Empty where no policy has an episode
    at that door.

    Args:
        episodes: Of one condition, without errors.
        radius: The door's [m].
        reference: Name of a policy.
    """
    same = [
        one
        for one in episodes
        if one.kind != NON_STANDARD and math.isclose(one.radius, radius)
    ]
    # Doors of another kind may have the same radius.
    same = [one for one in same if one.door_kind == same[0].door_kind]
    first = min((one.task.seed for one in same), default=0)
    found = {one.policy: one for one in same if one.task.seed == first}
    order = [name for name in ranked(episodes) if name in found]
    order.sort(key=lambda name: name != reference)
    if len(order) > COMPARED:
        step = (len(order) - 2) / (COMPARED - 2)
        order = [order[0], *(order[1 + round(n * step)] for n in range(COMPARED - 1))]
    return {name: found[name] for name in order}


def _rank(one: EpisodeResult) -> tuple[bool, float, float, str]:
    force = one.number("force_radial_peak")
    angle = one.number("final_angle_deg")
    return (
        not one.solved,
        math.inf if force is None else force,
        math.inf if angle is None else -angle,
        one.pair,
    )


def compare(
    path: Path,
    compared: Mapping[str, EpisodeResult],
    measure: str = RADIAL,
    heading: str = "",
) -> dict[str, Any]:
    """Record episodes side by side; leave out those that cannot be run again.

    Args:
        path: File to write.
        compared: Episodes on one door, by what each is called in the recording.
        measure: What they are compared by.
        heading: Of the recording's page.

    Returns:
        What the index says of the file.
    """
    found = {name: _repeated(episode) for name, episode in compared.items()}
    repeated = {name: again for name, (again, _) in found.items() if again is not None}
    if repeated:
        logs = [replace(again.log, policy=name) for name, again in repeated.items()]
        one = next(iter(repeated.values()))
        shown = (logs, one.model, one.demonstrations)
        record_comparison(path, *shown, measure=measure, heading=heading)
    entries = [entry for _, entry in found.values()]
    return {"file": path.name if repeated else None, "episodes": entries}


def _repeated(episode: EpisodeResult) -> tuple[Repeated | None, dict[str, Any]]:
    """Run an episode again; return it, if it ran, and what the index says of it."""
    entry = {
        "policy": episode.policy,
        "door": episode.task.door,
        "radius": episode.radius,
        "seed": episode.task.seed,
        "success": episode.solved,
        "force_radial_peak": episode.number("force_radial_peak"),
        "final_angle_deg": episode.number("final_angle_deg"),
    }
    try:
        again = repeat(episode)
    # Anything: a policy may have a mistake in its code, and takes no other along.
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        return None, {**entry, "repeated": False, "error": reason}
    different = dict(again.different)
    return again, {**entry, "repeated": not different, "different": different}
