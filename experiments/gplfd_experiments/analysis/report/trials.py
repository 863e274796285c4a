"""A section per trial: the question, the numbers, and the effect of each idea."""

import math
from collections.abc import Mapping, Sequence
from functools import partial
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
    policy_table,
)
from gplfd_experiments.analysis.results.aggregates import probability_of_improvement
from gplfd_experiments.analysis.results.measures import (
    Runs,
    interval_text,
    number_text,
    shift_cell,
)
from gplfd_experiments.analysis.results.reading import EpisodeResult, StudyResults
from gplfd_experiments.analysis.results.statistics import success_rate
from gplfd_experiments.analysis.results.trials import (
    MEASURES,
    Answer,
    ByLevel,
    answered,
    deciding_measure,
    interquartile_mean_in_units,
    of_trials,
    scores,
    succeeded,
    summary,
    tier_runs,
)
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.files.table import Table
from gplfd_experiments.studies.trials.protocol import SEEDS, TIERS, TRIALS, VERSION
from gplfd_experiments.studies.trials.records import RADIAL, Side, Trial

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
        some = [levels.get(side.level, {})] if side.level else levels.values()
        return any(side.policy in runs for runs in some)

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
    blocks += _ideas(answers)
    return [
        Section("What each idea is worth", "ideas", blocks),
        *(trial_section(name, levels, reference) for name, levels in trials.items()),
    ]


def _ideas(answers: Mapping[str, Sequence[Answer]]) -> list[Block]:
    """Return all contrasts in a table and a plot."""
    rows = sorted(
        (
            answer.contrast.idea,
            trial,
            MEASURES[answer.contrast.measure].title,
            f"{answer.contrast.having} : {answer.contrast.lacking}",
            *_difference(answer),
        )
        for trial, of_trial in answers.items()
        for answer in of_trial
    )
    if not rows:
        return [Text("No contrast has both of its policies in these results.")]
    note = (
        "**Difference:** the policy with the idea minus the otherwise equal policy "
        "without it, seed by seed, with the 95 % interval (Hodges-Lehmann; for "
        "shares, mean and Student's interval). **Result:** better or worse with the "
        "idea if the interval excludes zero (in the protocol: the idea shows, or does "
        "harm)."
    )
    columns = ("idea", "trial", "measure", "with : without", "difference", "result")
    table = Table(columns=columns, rows=tuple(rows), note=note, left=True)
    if not any(a.shift for of_trial in answers.values() for a in of_trial):
        return [table]
    plot = Plot(
        "trials_ideas",
        partial(plots.ideas, answers),
        "**Differences with and without an idea:** in brackets the policy without it; "
        "a point per difference, a line through its 95 % interval (from six seeds on). "
        "Right of zero is better with the idea, whether more or less of the measure is "
        "better.",
        "Differences of all contrasts, a panel per measure",
    )
    return [table, plot]


def _difference(answer: Answer) -> tuple[str, str]:
    """Return the difference with its interval and changed doors, and the result."""
    shift = answer.shift
    if shift is None:
        return "–", "no value in common"
    digits = MEASURES[answer.contrast.measure].digits
    # Enough decimals that the ends of the interval differ from zero.
    ends = [abs(end) for end in (shift.low, shift.high) if 0.0 < abs(end) < math.inf]
    if ends:
        digits = max(digits, min(-math.floor(math.log10(min(ends))), 3))
    text = number_text(shift.estimate, digits, signed=True)
    interval = interval_text(shift, digits)
    if interval:
        text += f" ({interval})"
    doors = ", ".join(f"{number} {name}" for name, number in answer.changes.items())
    if doors:
        text += f"\ndoors: {doors}"
    verdict = _VERDICTS[answer.verdict]
    return text, verdict if interval else "too few seeds for an interval"


def trial_section(name: str, levels: ByLevel, reference: str) -> Section:
    """Return a trial's question, its numbers in a table and a plot, and aggregates."""
    trial, deciding = TRIALS[name], MEASURES[TRIALS[name].measures[0]]
    runs, title = ordered(trial, levels), deciding.title
    measure = deciding_measure(trial)
    episodes = [e for runs in levels.values() for own in runs.values() for e in own]
    blocks: list[Block] = [
        Text(trial.question),
        trial_table(trial, runs),
        Plot(
            f"trial_{name}",
            partial(plots.deciding_numbers, runs, deciding.metric, reference),
            f"**{title[0].upper()}{title[1:]}** decides this trial ({deciding.better} "
            "is better). Order as in the table. A pale dot per seed, larger where "
            "several are equal; a mark at the share or the typical value, a line "
            "through its 95 % interval (for values that are not shares, from six "
            f"seeds on). Bold: {code(reference)}.",
            f"{title}, a row per policy",
        ),
        aggregate_table(scores(episodes, measure), measure, reference),
    ]
    corrected = {title for title, level in trial.levels.items() if level.corrections}
    able = {p for level in corrected for p in levels.get(level, {})}
    unable = sorted({episode.policy for episode in episodes} - able)
    if corrected and unable:
        blocks.append(Text(f"Cannot be corrected: {', '.join(map(code, unable))}."))
    return Section(f"Trial: {name}", f"trial-{name}", blocks)


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
            worst = math.isnan(value)
            ranks.append(math.inf if worst else -MEASURES[name].sign * value)
        return ranks

    return {
        level: dict(sorted(levels[level].items(), key=lambda item: rank(item[1])))
        for level in trial.levels
        if level in levels
    }


def trial_table(trial: Trial, levels: Mapping[str, Runs]) -> Table:
    """Return a row per policy and level, with all measures of the trial."""

    def cell(name: str, episodes: Sequence[EpisodeResult]) -> str:
        return MEASURES[name].cell(summary(episodes, name))

    return policy_table(
        levels,
        [Column(MEASURES[name].title, partial(cell, name)) for name in trial.measures],
        note="Ordered by the first measure; policies that opened no door come last. "
        "Shares: of episodes, with clustered Wilson intervals. Others: typical value "
        "of a seed, with its 95 % interval.",
    )


def aggregate_table(
    arrays: Mapping[str, FloatArray], name: str, reference: str
) -> Table:
    """Return interquartile means and probabilities of improvement, the best first."""
    measure = MEASURES[name]
    means = {
        policy: interquartile_mean_in_units(array, name)
        for policy, array in arrays.items()
    }
    rows = []
    for policy in sorted(means, key=lambda p: (-measure.sign * means[p].estimate, p)):
        both = arrays.get(reference, arrays[policy]), arrays[policy]
        better = shift_cell(probability_of_improvement(*both), 2)
        rows.append((code(policy), measure.cell(means[policy]), better))
    return Table(
        columns=(
            *("policy", f"{measure.title}, interquartile mean"),
            f"P({reference} better)",
        ),
        rows=tuple(rows),
        note="All doors, and levels without a prior mean. **Interquartile mean:** of "
        "the middle half of the episodes; a dash if more than a quarter failed. "
        "**P:** probability that the reference is better at the same door and level; "
        "a failure is worse than any value, ties count half. 95 % intervals: "
        "stratified bootstrap of the seeds.",
    )


def tier_tables(results: StudyResults) -> list[Block]:
    """Return a table per tier: policies by share of successes, and radial force."""
    blocks: list[Block] = []
    for tier, runs in tier_runs(results).items():
        episodes = [episode for group in runs.values() for episode in group]
        arrays = scores(episodes, RADIAL)
        rates = {
            policy: success_rate((e.task.seed, succeeded(e)) for e in group)
            for policy, group in runs.items()
        }
        rows = []
        for policy in sorted(rates, key=lambda name: (-rates[name].estimate, name)):
            force = interquartile_mean_in_units(arrays[policy], RADIAL)
            cells = rates[policy].cell, MEASURES[RADIAL].cell(force)
            rows.append((code(policy), kind_of(policy), *cells))
        ran = len({episode.task.trial for episode in episodes})
        heads = "successes", "radial force [N],\ninterquartile mean"
        blocks += [
            Text(f"**Tier {tier}**, {ran} of {len(TIERS[tier])} trials"),
            Table(columns=("policy", "kind", *heads), rows=tuple(rows)),
        ]
    return blocks
