"""Episodes in a report: what was opened, with which forces, and what differs.

Then a section per trial.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from operator import attrgetter, methodcaller
from typing import Final

from gplfd_experiments.analysis.report import plots
from gplfd_experiments.analysis.report.document import (
    Block,
    Column,
    Plot,
    Section,
    Text,
    code,
    kind_of,
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
    closed_because,
    counted,
    grouped,
    ranked,
    study_rows,
    study_table,
)
from gplfd_experiments.analysis.results.reading import (
    SPLITS,
    EpisodeResult,
    StudyResults,
)
from gplfd_experiments.analysis.results.statistics import (
    FEWEST_PAIRS,
    holm,
    number_text,
    paired,
    shift,
    signed_rank,
    success_rate,
)
from gplfd_experiments.analysis.results.trials import (
    MEASURES,
    Answer,
    ByLevel,
    answered,
    of_trials,
    succeeded,
    summary,
    tier_runs,
)
from gplfd_experiments.files.table import Table
from gplfd_experiments.studies.trials.protocol import (
    SEEDS,
    TIERS,
    TRIALS,
    VERSION,
    Side,
    Trial,
)

Episodes = Sequence[EpisodeResult]

_FORCE: Final = EPISODE_MEASURES["force_radial_peak"]


def _rate(succeeds: Callable[[EpisodeResult], bool], episodes: Episodes) -> str:
    return success_rate((e.task.seed, succeeds(e)) for e in episodes).cell()


def _episodes(conditions: Mapping[str, Runs]) -> list[EpisodeResult]:
    """Return all episodes that count, of all conditions."""
    groups = (group for runs in conditions.values() for group in runs.values())
    return [episode for group in groups for episode in group if episode.counts]


def summary_table(conditions: Mapping[str, Runs]) -> Table:
    """Return rates and forces by policy, by condition and by kind of door."""
    episodes = _episodes(conditions)
    kind_of_door = attrgetter("door_kind")
    several_kinds = len(set(map(kind_of_door, episodes))) > 1
    groups: dict[str, dict[str, Episodes]] = {}
    for condition, runs in conditions.items():
        here = (episode for group in runs.values() for episode in group)
        for kind, of_kind in grouped(here, kind_of_door).items():
            parts = [kind] * several_kinds + [condition] * (len(conditions) > 1)
            for policy, group in ranked(of_kind).items():
                closed = not any(episode.opened() for episode in group)
                title = parts + ["opened no door (not ranked)"] * closed
                groups.setdefault(": ".join(title), {})[policy] = group

    def force(episodes: Episodes) -> str:
        typical = _FORCE.typical(episodes)
        return typical.cell(_FORCE.digits) if typical else "none opened"

    def at(split: str, cell: Callable[[Episodes], str], episodes: Episodes) -> str:
        here = [episode for episode in episodes if episode.split == split]
        return cell(here) if here else "not run"

    columns = (
        Column("seeds", lambda results: str(len({e.task.seed for e in results}))),
        *(
            Column(f"{what},\n{split}", partial(at, split, cell))
            for what, cell in (
                ("opened", partial(_rate, attrgetter("solved"))),
                ("radial force [N]", force),
            )
            for split in SPLITS
            if any(episode.split == split for episode in episodes)
        ),
        Column("not opened because", lambda results: literal(closed_because(results))),
    )
    note = (
        "**Opened:** doors opened by 60° and held there for 0.5 s with the handle in "
        "the hand, with the 95 % interval (Wilson); errors of a policy count as not "
        "opened. **Radial force:** peak force across the path of the handle, which "
        "does no work; a large value means that the motion does not fit the door. "
        "Typical value of a seed over the opened doors, with its 95 % interval from "
        f"{FEWEST_PAIRS} seeds on. Policies are in order of the doors opened to 60°, "
        "then of the radial force."
    )
    return policy_table(groups, columns, note=note)


def doors_section(conditions: Mapping[str, Runs], reference: str) -> Section:
    """All measures of all conditions, with lost episodes; plots of the first one."""
    title, all_runs = next(iter(conditions.items()))
    runs = counted(all_runs)
    several = len(conditions) > 1
    blocks: list[Block] = [
        Text(f"{'Plots: ' * several}{title}."),
        Plot(
            "success",
            partial(plots.success_by_radius, runs, reference),
            "**Doors opened to 60° by the handle's radius,** with Wilson's 95 % "
            "intervals. Blue stripes: demonstrated radii. Pale violet: "
            f"{code(reference)}.",
            "Success rate against radius, a panel per policy",
        ),
        Plot(
            "radial_force",
            partial(plots.force_by_radius, runs, reference),
            "**Peak radial force on the doors opened to 60°:** a dot per episode, a "
            "line through the medians. Red: the 22.2 N of ADA 404.2.9.",
            "Peak radial force against radius, a panel per policy",
        ),
    ]
    errors = (e.metrics["forecast_error_mm"] for e in _episodes({title: runs}))
    if any(error is not None for of_episode in errors for error in of_episode):
        forecast = Plot(
            "forecast",
            partial(plots.forecast_by_progress, runs, reference),
            "**Error of the forecast of the rest of the path** as the door opens: "
            "median and middle half of all episodes.",
            "Forecast error against progress, a panel per policy",
        )
        blocks.append(forecast)
    episodes = _episodes(conditions)
    disturbed = [episode for episode in episodes if episode.task.disturbance != "none"]
    metrics = [
        *COLUMNS["episodes"],
        *(
            pair
            for pair in COLUMNS["disturbed"]
            if any(episode.number(pair[0]) for episode in disturbed)
        ),
    ]
    measures = (EPISODE_MEASURES[metric] for pair in metrics for metric in pair)
    meanings = "; ".join(f"{m.short}: {m.name}" for m in measures if m.name)
    note = (
        "Typical values of a seed: forces, slip and work over the doors opened to 60°, "
        "the others over all episodes that have them. Above 22.2 N: the limit of ADA "
        "404.2.9 for opening an interior door. The last columns count the episodes "
        f"that ended so. {meanings[0].upper()}{meanings[1:]}."
    )
    title = "All measures"
    blocks.append(
        policy_table(conditions, _columns(episodes, metrics), title=title, note=note)
    )
    for name, ran in conditions.items():
        by_door = study_table(study_rows(e for group in ran.values() for e in group))
        heading = f"Door by door: {name}" if several else "Door by door"
        note = "Times, forces and slip: medians over the doors opened and held."
        blocks.append(replace(by_door, title=heading, note=note))
    return Section("Doors opened", blocks)


def _columns(episodes: Episodes, metrics: Sequence[Sequence[str]]) -> list[Column]:
    """Return the columns of rates, measures and failures of episodes."""

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

    failures = sorted({episode.failure for episode in episodes if not episode.solved})
    return [
        Column("solved", partial(_rate, attrgetter("solved"))),
        *(
            Column(f"to {angle}°", partial(_rate, methodcaller("opened", angle)))
            for angle in (60, 30, 15)
        ),
        *(
            measure_column(Measure.seed_value, *(EPISODE_MEASURES[m] for m in pair))
            for pair in metrics
        ),
        Column(f"above {ADA_FORCE} N", above),
        *(Column(literal(name), partial(failed, name)) for name in failures),
        Column("median angle\nlargest", angles),
    ]


def paired_tests(title: str, runs: Runs, reference: str) -> Block:
    """Compare the reference with every other policy on the same tasks."""
    others = [policy for policy in runs if policy != reference]
    if reference not in runs or not others:
        return Text(f"There is nothing to compare {code(reference)} with.")
    rows = {other: {"against": code(other)} for other in others}
    for measure in (None, *(EPISODE_MEASURES[name] for (name,) in COLUMNS["tested"])):
        heading = measure.column if measure else "opened to 60°"
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
        for other in others:
            rows[other][heading] = "–"
        for other, p in zip(both, p_values, strict=True):
            pair = pairs[other]
            if measure:
                typical = shift(*pair.per_seed()).estimate
                text = number_text(typical, measure.digits, signed=True)
            else:
                doors = list(zip(pair.first, pair.second, strict=True))
                won, lost = sum(a > b for a, b in doors), sum(b > a for a, b in doors)
                text = f"{won} : {lost}"
            test = "p < 0.001" if p < 1e-3 else f"p {p:.3f}"
            test = f"**{test}**" if p < 0.05 else test
            rows[other][heading] = f"{text}\n{test}, n {len(set(pair.seeds))}"
    note = (
        f"{code(reference)} against each other policy on the same doors and seeds. "
        f"Success: doors that only one of the two opened ({code(reference)} : other). "
        f"Numbers: {code(reference)} minus the other on doors that both opened, after "
        "Hodges and Lehmann. Wilcoxon's signed ranks of the mean difference of each "
        "seed; p after Holm for all tests of a column; n seeds."
    )
    return replace(Table.of([*rows.values()]), title=title, note=note)


# --- Trials: the question, the numbers, and the effect of each idea

_VERDICTS: Final = {
    "shows": "**better with it**",
    "harms": "worse with it",
    "open": "no significant difference",
}
"""Results of a contrast."""


def trial_sections(results: StudyResults, reference: str) -> list[Section]:
    """Return the sections of trials: all ideas, then each trial."""
    trials = of_trials(results)
    if not trials:
        return []

    def ran(side: Side, levels: ByLevel) -> bool:
        there = (runs for level, runs in levels.items() if side.level in ("", level))
        return any(side.policy in runs for runs in there)

    answers = {
        name: [
            answered(contrast, levels)
            for contrast in TRIALS[name].contrasts
            if ran(contrast.having, levels) and ran(contrast.lacking, levels)
        ]
        for name, levels in trials.items()
    }
    # The part of the protocol that these results cover.
    text = f"Protocol v{VERSION}, {len(trials)} of {len(TRIALS)} trials."
    asked = sum(len(TRIALS[name].contrasts) for name in trials)
    if left_out := asked - sum(map(len, answers.values())):
        text += f" {left_out} of its contrasts were not run and are not listed."
    blocks: list[Block] = [Text(text)]
    seeds = len({e.task.seed for e in results.episodes if e.task.trial in trials})
    if seeds < SEEDS:
        text = (
            f"A first look: {seeds} of the {SEEDS} seeds that the protocol requires. "
            "`gplfd trials --part ideas` runs all of them."
        )
        blocks.append(Text(text, "warning"))
    if any(answers.values()):
        blocks.append(ideas_table(answers))
    if any(answer.shift for group in answers.values() for answer in group):
        caption = (
            "**Differences with and without an idea:** in brackets the policy without "
            "it; a line through the 95 % interval. Right of zero is better with the "
            "idea."
        )
        alternative = "Differences of all contrasts, a panel per measure"
        draw = partial(plots.ideas, answers)
        blocks.append(Plot("trials_ideas", draw, caption, alternative))
    return [
        Section("What each idea is worth", blocks),
        *(trial_section(name, levels, reference) for name, levels in trials.items()),
    ]


def ideas_table(answers: Mapping[str, Sequence[Answer]]) -> Table:
    """Return a row per contrast: the difference, its changed doors, and the result."""
    rows = []
    for trial, answer in ((n, a) for n, group in answers.items() for a in group):
        measure, shift = MEASURES[answer.contrast.measure], answer.shift
        sides = f"{answer.contrast.having} : {answer.contrast.lacking}"
        difference, result = "–", "no value in common"
        if shift is not None:
            # Enough decimals that the ends of the interval differ from zero.
            ends = [e for e in map(abs, (shift.low, shift.high)) if 0.0 < e < math.inf]
            digits = measure.digits
            if ends:
                digits = max(digits, min(-math.floor(math.log10(min(ends))), 3))
            difference = number_text(shift.estimate, digits, signed=True)
            result = "too few seeds for an interval"
            if interval := shift.interval(digits):
                difference += f" ({interval})"
                result = _VERDICTS[answer.verdict]
            if answer.changes:
                doors = (f"{number} {name}" for name, number in answer.changes.items())
                difference += f"\ndoors: {', '.join(doors)}"
        row = (answer.contrast.idea, trial, measure.title, sides, difference, result)
        rows.append(row)
    note = (
        "**Difference:** the policy with the idea minus the otherwise equal policy "
        "without it, seed by seed, with the 95 % interval (Hodges-Lehmann; for shares, "
        "mean and Student's interval). **Result:** better or worse with the idea if "
        "the interval excludes zero."
    )
    columns = ("idea", "trial", "measure", "with : without", "difference", "result")
    return Table(columns=columns, rows=tuple(sorted(rows)), note=note, left=True)


def trial_section(name: str, levels: ByLevel, reference: str) -> Section:
    """Return a trial's question, and its numbers in a table and a plot."""
    trial, deciding = TRIALS[name], MEASURES[TRIALS[name].measures[0]]
    runs, title = ordered(trial, levels), deciding.title
    blocks: list[Block] = [
        Text(trial.question),
        trial_table(trial, runs),
        Plot(
            f"trial_{name}",
            partial(plots.deciding_numbers, runs, deciding.metric, reference),
            f"**{title[0].upper()}{title[1:]}** decides this trial ({deciding.better} "
            "is better). A pale dot per seed; a mark at the share or the typical "
            "value, a line through its 95 % interval.",
            f"{title}, a row per policy",
        ),
    ]
    corrected = {title for title, level in trial.levels.items() if level.corrections}
    able = {p for level in corrected for p in levels.get(level, {})}
    unable = sorted({policy for runs in levels.values() for policy in runs} - able)
    if corrected and unable:
        blocks.append(Text(f"Cannot be corrected: {', '.join(map(code, unable))}."))
    return Section(f"Trial: {name}", blocks)


def ordered(trial: Trial, levels: ByLevel) -> dict[str, Runs]:
    """Return a trial's episodes by level and policy, the best first.

    Policies are sorted by the measures in order. Policies without a number come last,
    and so do policies that opened no door, because their small forces are not
    comparable.
    """

    def rank(episodes: Sequence[EpisodeResult]) -> list[float]:
        opened = summary(episodes, "success") if "success" in trial.measures else None
        ranks = [0.0 if opened is None or opened.estimate > 0.0 else 1.0]
        for name in trial.measures:
            typical = summary(episodes, name)
            value = math.nan if typical is None else typical.estimate
            value *= -MEASURES[name].sign
            ranks.append(math.inf if math.isnan(value) else value)
        return ranks

    return {
        level: dict(sorted(levels[level].items(), key=lambda item: rank(item[1])))
        for level in trial.levels
        if level in levels
    }


def trial_table(trial: Trial, levels: Mapping[str, Runs]) -> Table:
    """Return a row per policy and level, with all measures of the trial."""

    def cell(name: str, episodes: Sequence[EpisodeResult]) -> str:
        estimate = summary(episodes, name)
        return estimate.cell(MEASURES[name].digits) if estimate else "no value"

    return policy_table(
        levels,
        [Column(MEASURES[name].title, partial(cell, name)) for name in trial.measures],
        note="Ordered by the first measure; policies that opened no door come last. "
        "Shares: of episodes, with clustered Wilson intervals. Others: typical value "
        "of a seed, with its 95 % interval.",
    )


def tier_tables(results: StudyResults) -> list[Block]:
    """Return a table per tier: policies by share of successes, and radial force."""
    blocks: list[Block] = []
    for tier, runs in tier_runs(results).items():
        rates = {
            policy: success_rate((e.task.seed, succeeded(e)) for e in group)
            for policy, group in runs.items()
        }
        rows = []
        for policy in sorted(rates, key=lambda name: (-rates[name].estimate, name)):
            force = _FORCE.typical(runs[policy])
            cells = rates[policy].cell(), force.cell(_FORCE.digits) if force else "–"
            rows.append((code(policy), kind_of(policy), *cells))
        ran = {episode.task.trial for group in runs.values() for episode in group}
        columns = ("policy", "kind", "successes", "radial force [N]")
        blocks += [
            Text(f"**Tier {tier}**, {len(ran)} of {len(TIERS[tier])} trials"),
            Table(columns=columns, rows=tuple(rows)),
        ]
    return blocks
