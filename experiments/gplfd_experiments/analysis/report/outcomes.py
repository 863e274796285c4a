"""How the policies opened doors: one table, the same by kind of door, and by door."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from operator import attrgetter, methodcaller
from statistics import median
from typing import Final

from gplfd_experiments.analysis.report.document import Details, literal
from gplfd_experiments.analysis.report.policy_table import Cell, medians, policy_table
from gplfd_experiments.analysis.results import failures
from gplfd_experiments.analysis.results.failures import failure_of
from gplfd_experiments.analysis.results.grouping import (
    Runs,
    counted,
    door_name,
    of_kind,
)
from gplfd_experiments.analysis.results.measures import (
    ADA_FORCE,
    EPISODE_MEASURES,
    WALL_TIME,
)
from gplfd_experiments.analysis.results.records import KINDS, EpisodeResult
from gplfd_experiments.analysis.results.statistics import success_rate
from gplfd_experiments.files.table import Table

Episodes = Sequence[EpisodeResult]

_SOLVED: Final = attrgetter("solved")
_ANGLES: Final = (60, 30, 15)
"""Angles that count as opened [deg], the task's own first."""
_TOGETHER: Final = (
    ("time_to_60_deg", "time_to_30_deg"),
    ("force_tangential_peak", "force_tangential_p95"),
    ("force_radial_peak", "force_radial_p95"),
    ("force_handle_peak", "door_acceleration_peak"),
    ("slip_max_mm",),
    ("work",),
    ("prediction_error_position",),
    ("stability_margin_translation",),
    ("latency_median_ms",),
    (WALL_TIME,),
)
"""Metrics of a column, the first above the second."""
_DISTURBED: Final = (
    ("person_force_peak", "person_force_sustained"),
    ("stop_force_peak", "stop_force_sustained"),
    ("push_displacement_mm",),
    ("release_speed", "recovery_time"),
)
"""The same of what a disturbance did, where there was one."""
_MEANINGS: Final[Mapping[str, str]] = {
    "solved": "open by 60° and held there for 0.5 s with the handle in the hand, of "
    "all that ran; below it the 95 % interval (Wilson's, wider where doors of a seed "
    "are alike)",
    "to 60°": "ever open so far, with the same interval",
    "to 30°": "the same at 30°",
    "to 15°": "the same at 15°",
    "time_to_60_deg": "simulated time until the door was first open so far",
    "force_tangential_peak": "force along the path of the handle: its peak, and what "
    "95 % of the samples stay below (p95)",
    "force_radial_peak": "force across the path, which does no work: peak and p95",
    "force_handle_peak": "largest force on the handle in any direction, and largest "
    "angular acceleration of the door",
    "slip_max_mm": "largest distance of the hand from where it grasped the handle",
    "work": "work of the hand on the door",
    "prediction_error_position": "prediction error: root of the squared distance "
    "between predicted and true position plus the stated variance, averaged over the "
    "opening",
    "stability_margin_translation": "smallest distance of dk/dt from its bound",
    "latency_median_ms": "processor time of a call of the policy, without waiting",
    WALL_TIME: "time on the clock of a call of the policy",
    "person_force_peak": "peak force on the person, and the largest borne for 0.5 s",
    "stop_force_peak": "peak force on the stop, and the largest borne for 0.5 s",
    "push_displacement_mm": "largest displacement of the hand by the push",
    "release_speed": "largest speed of the door in the second after a disturbance, and "
    "time until it was 5° further open",
    f"above {ADA_FORCE} N": "opened doors with a peak force, tangential or radial, "
    "above the limit of ADA 404.2.9 for opening an interior door",
    "median angle\nlargest": "door angle at the end of the episode",
}
"""What a column means, by its head or by its first metric."""


def outcome_table(conditions: Mapping[str, Runs]) -> Table:
    """All measures on all doors, the policies of each condition in a group."""
    note = (
        "Medians: forces, slip and work over the doors opened to 60°, the others over "
        "all episodes that have them. A policy that opens few doors has few numbers: "
        "the paired tests compare equal doors."
    )
    return policy_table(conditions, _columns(conditions), note)


def outcome_details(conditions: Mapping[str, Runs]) -> list[Details]:
    """All measures, the same by kind of door, and the main numbers door by door."""
    by_kind = {}
    for title, runs in conditions.items():
        for kind in KINDS:
            if any((group := of_kind(runs, kind)).values()):
                by_kind[f"{kind}: {title}" if len(conditions) > 1 else kind] = group
    doors = sorted({(one.radius, door_name(one)) for one in _episodes(conditions)})
    by_door: dict[str, Cell] = {
        literal(door): partial(_at_door, door)
        for door in dict.fromkeys(door for _, door in doors)
    }
    note = (
        "Solved / ran with Wilson's 95 % interval, how many were opened to 60° if not "
        "as many, and the median peak radial force of these [N]."
    )
    meanings = Table(
        columns=("column", "meaning"),
        rows=tuple(
            (head, meaning)
            for head in _columns(conditions)
            if (meaning := _meaning(head))
        ),
        left=True,
    )
    return [
        Details(title="All measures", table=outcome_table(conditions)),
        Details(title="What the columns mean", table=meanings),
        Details(
            title="By kind of door", table=policy_table(by_kind, _columns(conditions))
        ),
        Details(title="Door by door", table=policy_table(conditions, by_door, note)),
    ]


def _columns(conditions: Mapping[str, Runs]) -> dict[str, Cell]:
    columns: dict[str, Cell] = {"solved": partial(_rate, _SOLVED)}
    for angle in _ANGLES:
        columns[f"to {angle}°"] = partial(_rate, methodcaller("opened", angle))
    for metrics in _TOGETHER:
        if metrics == (WALL_TIME,) and not _any(conditions, WALL_TIME):
            continue
        columns |= medians(*map(EPISODE_MEASURES.__getitem__, metrics))
    disturbed = [one for one in _episodes(conditions) if one.task.disturbance != "none"]
    for metrics in _DISTURBED:
        if any(one.number(metrics[0]) for one in disturbed):
            columns |= medians(*map(EPISODE_MEASURES.__getitem__, metrics))
    columns[f"above {ADA_FORCE} N"] = _above
    for reason in _reasons(conditions):
        columns[literal(reason)] = partial(_count, reason)
    columns["median angle\nlargest"] = _angles
    return columns


def _meaning(head: str) -> str:
    """Explain a column by its head; a reason of failure as the environment means it."""
    first, _, _ = head.partition("\n")
    titles = {one.title: name for name, one in EPISODE_MEASURES.items()}
    key = titles.get(first, head)
    return _MEANINGS.get(key, "") or failures.MEANINGS.get(key, "")


def _rate(succeeds: Callable[[EpisodeResult], bool], own: Episodes) -> str:
    rate = success_rate((one.task.seed, succeeds(one)) for one in own)
    return f"{rate.successes}/{rate.trials}\n{rate.interval}"


def _at_door(door: str, own: Episodes) -> str:
    here = [one for one in own if door_name(one) == door]
    if not here:
        return "–"
    opened = [one for one in here if one.opened()]
    rate, force = _rate(_SOLVED, here), EPISODE_MEASURES["force_radial_peak"]
    if len(opened) != sum(map(_SOLVED, here)):
        rate += f"\nto 60°: {len(opened)}"
    return f"{rate}\n{force.text(force.median(opened), unit=True)}"


def _above(own: Episodes) -> str:
    opened = [one for one in own if one.opened()]
    forces = ("force_tangential_peak", "force_radial_peak")
    above = sum(
        any((one.number(force) or 0.0) > ADA_FORCE for force in forces)
        for one in opened
    )
    return f"{above}/{len(opened)}" if opened else "–"


def _reasons(conditions: Mapping[str, Runs]) -> list[str]:
    """Why episodes did not solve the task, in words of the environment."""
    return sorted({failure_of(one) for one in _episodes(conditions) if not one.solved})


def _episodes(conditions: Mapping[str, Runs]) -> Iterator[EpisodeResult]:
    """Yield all episodes that count."""
    for runs in conditions.values():
        for own in counted(runs).values():
            yield from own


def _any(conditions: Mapping[str, Runs], metric: str) -> bool:
    return any(one.number(metric) is not None for one in _episodes(conditions))


def _count(reason: str, own: Episodes) -> str:
    return str(sum(failure_of(one) == reason for one in own if not one.solved))


def _angles(own: Episodes) -> str:
    angles = [one.number("final_angle_deg") for one in own]
    known = [angle for angle in angles if angle is not None]
    return f"{median(known):.1f}°\n{max(known):.1f}°" if known else "–"
