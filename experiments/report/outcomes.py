"""How the policies opened doors: one table, the same by kind of door, and by door."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from operator import attrgetter, methodcaller
from statistics import median
from typing import Final

from gplfd.experiments.files.table import Table
from gplfd.experiments.report.document import Details, literal
from gplfd.experiments.report.policy_table import Cell, medians, policy_table
from gplfd.experiments.results.grouping import Runs, counted, door_name, of_kind
from gplfd.experiments.results.measures import ADA_FORCE, EPISODE_MEASURES
from gplfd.experiments.results.records import KINDS, EpisodeResult
from gplfd.experiments.results.statistics import success_rate

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
)
"""Metrics of a column, the first above the second."""
_DISTURBED: Final = (
    ("person_force_peak", "person_force_sustained"),
    ("stop_force_peak", "stop_force_sustained"),
    ("push_displacement_mm",),
    ("release_speed", "recovery_time"),
)
"""The same of what a disturbance did, where there was one."""
_FAILURES: Final = {
    "stalled": "the hand held on and the door gained no more angle",
    "latched": "the latch held the door, whose handle was not turned far enough",
    "not grasped": "the hand did not take hold of the handle",
    "grasp lost": "the handle left the hand",
    "simulation error": "the simulation diverged",
    "time limit": "the episode's time was over",
    "policy error": "the policy raised an error, in learning or acting",
}


def outcome_table(conditions: Mapping[str, Runs]) -> Table:
    """All measures on all doors, the policies of each condition in a group."""
    meanings = "; ".join(
        f"{reason}: {_FAILURES[reason]}"
        for reason in _reasons(conditions)
        if reason in _FAILURES
    )
    note = (
        "**Solved:** solved / ran, open by 60° for 0.5 s with the handle in the hand. "
        "**To 60°, 30°, 15°:** opened so far, if only for a moment. Below both, "
        "95 % intervals (Wilson's, for fewer trials where doors of a seed are alike). "
        "Then medians: forces, slip and work over the doors "
        "opened to 60°, the others over all episodes that have them. A policy that "
        "opens few doors has few numbers: the paired tests compare equal doors. "
        f"**Above {ADA_FORCE} N:** openings with a peak, tangential or radial, above "
        "the limit of ADA 404.2.9 for opening an interior door. Policies are in order "
        "of opening to 60°, then of radial force."
    )
    if meanings:
        note += f" **Not solved**, by the environment's reason: {meanings}."
    return policy_table(conditions, _columns(conditions), note)


def outcome_details(conditions: Mapping[str, Runs]) -> list[Details]:
    """The same table by kind of door, and the most telling numbers door by door."""
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
    return [
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
    return sorted({_reason(one) for one in _episodes(conditions) if not one.solved})


def _episodes(conditions: Mapping[str, Runs]) -> Iterator[EpisodeResult]:
    """Yield all episodes that count."""
    for runs in conditions.values():
        for own in counted(runs).values():
            yield from own


def _reason(one: EpisodeResult) -> str:
    return one.metrics["failure"].replace("_", " ") or "no reason given"


def _count(reason: str, own: Episodes) -> str:
    return str(sum(_reason(one) == reason for one in own if not one.solved))


def _angles(own: Episodes) -> str:
    angles = [one.number("final_angle_deg") for one in own]
    known = [angle for angle in angles if angle is not None]
    return f"{median(known):.1f}°\n{max(known):.1f}°" if known else "–"
