"""Episodes in a report: what was opened, with which forces, and what differs."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from operator import attrgetter, methodcaller
from typing import Final

from gplfd_experiments.analysis.report import plots
from gplfd_experiments.analysis.report.document import (
    Block,
    Cell,
    Column,
    Plot,
    Section,
    Text,
    code,
    literal,
    measure_column,
    policy_table,
)
from gplfd_experiments.analysis.results.measures import (
    ADA_FORCE,
    COLUMNS,
    EPISODE_MEASURES,
    Measure,
    Runs,
    by_door_kind,
    closed_because,
    counted,
    number_text,
    ranked,
)
from gplfd_experiments.analysis.results.reading import SPLITS, EpisodeResult
from gplfd_experiments.analysis.results.statistics import (
    FEWEST_PAIRS,
    holm,
    paired,
    shift,
    signed_rank,
    success_rate,
)
from gplfd_experiments.analysis.results.table import study_rows, study_table
from gplfd_experiments.episodes.failures import MEANINGS
from gplfd_experiments.files.table import Table

Episodes = Sequence[EpisodeResult]

_FORCE: Final = EPISODE_MEASURES["force_radial_peak"]


def _rate(succeeds: Callable[[EpisodeResult], bool], episodes: Episodes) -> str:
    return success_rate((e.task.seed, succeeds(e)) for e in episodes).cell


_solved: Final = partial(_rate, attrgetter("solved"))


def summary_table(conditions: Mapping[str, Runs]) -> Table:
    """Return rates and forces by policy, by condition and by kind of door."""
    episodes = _counting(conditions)
    several_kinds = len(by_door_kind(episodes)) > 1
    groups: dict[str, dict[str, Episodes]] = {}
    for condition, runs in conditions.items():
        here = (episode for group in runs.values() for episode in group)
        for kind, of_kind in by_door_kind(here).items():
            parts = [kind] * several_kinds + [condition] * (len(conditions) > 1)
            for policy, group in ranked(of_kind).items():
                closed = not any(episode.opened() for episode in group)
                title = parts + ["opened no door (not ranked)"] * closed
                groups.setdefault(": ".join(title), {})[policy] = group

    def at(split: str, cell: Cell, episodes: Episodes) -> str:
        here = [episode for episode in episodes if episode.split == split]
        return cell(here) if here else "not run"

    def force(episodes: Episodes) -> str:
        typical = _FORCE.typical(episodes)
        return _FORCE.cell(typical) if typical else "none opened"

    splits = [split for split in SPLITS if any(e.split == split for e in episodes)]
    columns = (
        Column("seeds", lambda own: str(len({episode.task.seed for episode in own}))),
        *(
            Column(f"{what},\n{split}", partial(at, split, cell))
            for what, cell in (("opened", _solved), ("radial force [N]", force))
            for split in splits
        ),
        Column("not opened because", lambda own: literal(closed_because(own))),
    )
    note = (
        "**Opened:** doors opened by 60° and held there for 0.5 s with the handle in "
        "the hand, of all episodes, with the 95 % interval (Wilson); errors of a "
        "policy count as not opened. New radii were not demonstrated; other doors "
        "differ in more than the radius. **Radial force:** peak force across the path "
        "of the handle, which does no work; a large value means that the motion does "
        "not fit the door. Typical value of a seed over the opened doors, with its "
        f"95 % interval from {FEWEST_PAIRS} seeds on. Policies are in order of the "
        "doors opened to 60°, then of the radial force."
    )
    return policy_table(groups, columns, note=note)


def doors_section(conditions: Mapping[str, Runs], reference: str) -> Section:
    """All measures of all conditions, with lost episodes; plots of the first one."""
    title, all_runs = next(iter(conditions.items()))
    runs = counted(all_runs)
    drawn = [
        Plot(
            "success",
            partial(plots.success_by_radius, runs, reference),
            "**Doors opened to 60° by the handle's radius,** with Wilson's 95 % "
            "intervals. Blue stripes: radii that were demonstrated. Pale violet: "
            f"{code(reference)}. Other doors are left out.",
            "Success rate against radius, a panel per policy",
        ),
        Plot(
            "radial_force",
            partial(plots.force_by_radius, runs, reference),
            "**Peak radial force on the doors opened to 60°:** a dot per episode, a "
            "line through the medians. Red: the 22.2 N of ADA 404.2.9.",
            "Peak radial force against radius, a panel per policy",
        ),
        Plot(
            "forecast",
            partial(plots.forecast_by_progress, runs, reference),
            "**Error of the forecast of the rest of the path** as the door opens: "
            "median and middle half of all episodes, those included that failed later. "
            "A falling curve: the policy adapts to the door.",
            "Forecast error against progress, a panel per policy",
        ),
    ]
    forecasts = (e.metrics["forecast_error_mm"] for e in _counting({title: runs}))
    if not any(error is not None for errors in forecasts for error in errors):
        drawn.pop()
    columns = _columns(_counting(conditions))
    note = (
        "Typical values of a seed: forces, slip and work over the doors opened to 60°, "
        "the others over all episodes that have them. A policy that opens few doors "
        "has few numbers: the paired tests compare equal doors."
    )
    blocks: list[Block] = [
        Text(f"Plots: {title}." if len(conditions) > 1 else f"{title}."),
        *drawn,
        policy_table(conditions, columns, title="All measures", note=note),
        Table(
            columns=("column", "meaning"),
            rows=tuple((column.heading, column.meaning) for column in columns),
            title="What the columns mean",
            left=True,
        ),
    ]
    for name, ran in conditions.items():
        by_door = study_table(study_rows(e for group in ran.values() for e in group))
        heading = f"Door by door: {name}" if len(conditions) > 1 else "Door by door"
        note = "Times, forces and slip: medians over the doors opened and held."
        blocks.append(replace(by_door, title=heading, note=note))
    return Section("Doors opened", "doors", blocks)


def _columns(episodes: Episodes) -> list[Column]:
    """Return the columns with all measures that these episodes have."""

    def above(episodes: Episodes) -> str:
        forces = ("force_tangential_peak", "force_radial_peak")
        peaks = [
            max(episode.number(force) or 0.0 for force in forces)
            for episode in episodes
            if episode.opened()
        ]
        count = sum(peak > ADA_FORCE for peak in peaks)
        return f"{count}/{len(peaks)}" if peaks else "–"

    def failed(failure: str, episodes: Episodes) -> str:
        return str(sum(e.failure == failure for e in episodes if not e.solved))

    def angles(episodes: Episodes) -> str:
        angle = EPISODE_MEASURES["final_angle_deg"]
        ends = angle.median(episodes), max(angle.values(episodes), default=None)
        return "\n".join(angle.text(end, unit=True) for end in ends)

    disturbed = [episode for episode in episodes if episode.task.disturbance != "none"]
    metrics = [
        *COLUMNS["episodes"],
        *(
            pair
            for pair in COLUMNS["disturbed"]
            if any(e.number(pair[0]) for e in disturbed)
        ),
    ]
    failures = sorted({episode.failure for episode in episodes if not episode.solved})
    ever = "door angle ever reached"
    return [
        Column("solved", _solved, "open by 60° and held there for 0.5 s, as above"),
        *(
            Column(f"to {angle}°", partial(_rate, methodcaller("opened", angle)), ever)
            for angle in (60, 30, 15)
        ),
        *(
            measure_column(Measure.seed_value, *(EPISODE_MEASURES[m] for m in pair))
            for pair in metrics
        ),
        Column(
            f"above {ADA_FORCE} N",
            above,
            "opened doors with a peak force, tangential or radial, above the limit of "
            "ADA 404.2.9 for opening an interior door",
        ),
        *(
            Column(literal(name), partial(failed, name), MEANINGS.get(name, ""))
            for name in failures
        ),
        Column("median angle\nlargest", angles, "door angle at the end of the episode"),
    ]


def paired_tests(title: str, runs: Runs, reference: str) -> Block:
    """Compare the reference with every other policy on the same tasks."""
    others = [policy for policy in runs if policy != reference]
    if reference not in runs or not others:
        return Text(f"There is nothing to compare {code(reference)} with.")
    cells: dict[str, list[str]] = {other: [] for other in others}
    columns = ["against", "opened to 60°"]
    for measure in (None, *(EPISODE_MEASURES[name] for (name,) in COLUMNS["tested"])):
        columns += [measure.column] if measure else []
        values = {
            policy: {
                episode.key: value
                for episode in group
                if (value := measure.of(episode) if measure else episode.opened())
                is not None
            }
            for policy, group in runs.items()
        }
        pairs = {other: paired(values[reference], values[other]) for other in others}
        both = [other for other in others if pairs[other].seeds]
        p_values = holm([signed_rank(*pairs[other].per_seed()) for other in both])
        corrected = dict(zip(both, p_values, strict=True))
        for other, pair in pairs.items():
            if other not in corrected:
                cells[other].append("–")
                continue
            if measure:
                typical = shift(*pair.per_seed()).estimate
                text = number_text(typical, measure.digits, signed=True)
            else:
                doors = list(zip(pair.first, pair.second, strict=True))
                won, lost = sum(a > b for a, b in doors), sum(b > a for a, b in doors)
                text = f"{won} : {lost}"
            p = corrected[other]
            test = "p < 0.001" if p < 1e-3 else f"p {p:.3f}"
            test = f"**{test}**" if p < 0.05 else test
            cells[other].append(f"{text}\n{test}, n {len(set(pair.seeds))}")
    return Table(
        columns=tuple(columns),
        rows=tuple((code(other), *texts) for other, texts in cells.items()),
        title=title,
        note=f"{code(reference)} against each other policy on the same doors and "
        f"seeds. Success: doors that only one of the two opened ({code(reference)} : "
        f"other). Numbers: {code(reference)} minus the other on doors that both "
        "opened, after Hodges and Lehmann. Both are tested by Wilcoxon's signed ranks "
        "of the mean difference of each seed, as doors of a seed share what was "
        "learned from. p after Holm for all tests of a column; n seeds.",
    )


def _counting(conditions: Mapping[str, Runs]) -> list[EpisodeResult]:
    """Return all episodes that count, of all conditions."""
    runs = (group for runs in conditions.values() for group in runs.values())
    return [episode for group in runs for episode in group if episode.counts]
