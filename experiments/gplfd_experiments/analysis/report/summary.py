"""The summary of a study: what each policy opened, how gently, and what went wrong."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial

from gplfd_experiments.analysis.report.document import code, literal
from gplfd_experiments.analysis.report.sentences import PRIVILEGED
from gplfd_experiments.analysis.results.failures import closed_because
from gplfd_experiments.analysis.results.grouping import (
    Runs,
    by_door_kind,
    numbers,
    ranked,
)
from gplfd_experiments.analysis.results.measures import EPISODE_MEASURES
from gplfd_experiments.analysis.results.records import (
    KINDS,
    EpisodeResult,
)
from gplfd_experiments.analysis.results.statistics import (
    FEWEST_PAIRS,
    shift,
    success_rate,
)
from gplfd_experiments.files.table import Table

Episodes = Sequence[EpisodeResult]


def summary_table(conditions: Mapping[str, Runs]) -> Table:
    """Return a row per policy, in groups by condition and by kind of door.

    Args:
        conditions: All episodes by condition and policy, those with errors included.
    """
    episodes = [
        one for runs in conditions.values() for own in runs.values() for one in own
    ]
    there = [kind for kind in KINDS if any(one.kind == kind for one in episodes)]
    columns: dict[str, Callable[[Episodes], str]] = {
        "seeds": lambda own: str(len({one.task.seed for one in own}))
    }
    for kind in there:
        columns[f"opened,\n{kind}"] = partial(_rate, kind)
    for kind in there:
        columns[f"radial force [N],\n{kind}"] = partial(_force, kind)
    columns["not opened because"] = lambda own: literal(closed_because(own))
    columns["errors"] = lambda own: str(sum(bool(one.error) for one in own))
    several = len(by_door_kind(episodes)) > 1
    rows: list[tuple[str, ...]] = []
    for condition, runs in conditions.items():
        here = [one for own in runs.values() for one in own]
        for door_kind, group in by_door_kind(here).items():
            parts = [door_kind] * several + [condition] * (len(conditions) > 1)
            rows += _group(literal(": ".join(parts)), group, columns)
    note = (
        "**Opened:** doors opened by 60° and held there for 0.5 s with the handle in "
        "the hand, of all episodes; below it the 95 % interval (Wilson). New radii "
        "were not demonstrated; other doors differ in more than the radius. "
        "**Radial force:** peak force across the path of the handle, which does no "
        "work; it shows how badly the motion fits the door. Typical value of a seed "
        f"over the opened doors, with its 95 % interval from {FEWEST_PAIRS} seeds on. "
        "**Errors:** episodes in which the policy raised an error; they count as not "
        "opened. Policies are in order of the doors opened to 60°, then of the radial "
        "force."
    )
    return Table(columns=("policy", *columns), rows=tuple(rows), note=note)


def _group(
    title: str, group: Episodes, columns: Mapping[str, Callable[[Episodes], str]]
) -> list[tuple[str, ...]]:
    """Return the rows of a group; policies that opened nothing come last, unranked."""
    runs = ranked(group)
    opened = [name for name, own in runs.items() if any(one.opened() for one in own)]
    rest = [name for name in runs if name not in opened]
    empty = ("",) * len(columns)
    rows: list[tuple[str, ...]] = [(f"**{title}**", *empty)] if title else []
    for policy in (*opened, *rest):
        if rest and policy == rest[0]:
            rows.append(("**opened no door (not ranked)**", *empty))
        known = "\nknows the door" if policy in PRIVILEGED else ""
        cells = (cell(runs[policy]) for cell in columns.values())
        rows.append((f"{code(policy)}{known}", *cells))
    return rows


def _rate(kind: str, own: Episodes) -> str:
    here = [one for one in own if one.kind == kind]
    if not here:
        return "not run"
    rate = success_rate((one.task.seed, one.solved) for one in here)
    return f"{rate.successes}/{rate.trials}\n{rate.interval}"


def _force(kind: str, own: Episodes) -> str:
    measure = EPISODE_MEASURES["force_radial_peak"]
    here = [one for one in own if one.kind == kind]
    forces: dict[int, list[float]] = {}
    for (seed, _), force in numbers({"": here}, measure)[""].items():
        forces.setdefault(seed, []).append(force)
    if not forces:
        return "none opened" if here else "not run"
    means = [sum(each) / len(each) for each in forces.values()]
    typical = shift(means, [0.0] * len(means))
    if len(means) < FEWEST_PAIRS:
        return measure.text(typical.estimate)
    interval = f"{measure.text(typical.low)} to {measure.text(typical.high)}"
    return f"{measure.text(typical.estimate)}\n{interval}"
