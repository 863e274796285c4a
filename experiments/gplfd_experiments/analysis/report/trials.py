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
from gplfd_experiments.analysis.results.measures import EPISODE_MEASURES, Runs
from gplfd_experiments.analysis.results.reading import EpisodeResult, StudyResults
from gplfd_experiments.analysis.results.statistics import number_text, success_rate
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
    RADIAL,
    SEEDS,
    TIERS,
    TRIALS,
    VERSION,
    Side,
    Trial,
)

_FORCE: Final = EPISODE_MEASURES[RADIAL]  # over opened doors
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
    for trial, answer in (
        (n, answer) for n, group in answers.items() for answer in group
    ):
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
    episodes = [e for runs in levels.values() for group in runs.values() for e in group]
    blocks: list[Block] = [
        Text(trial.question),
        trial_table(trial, runs),
        Plot(
            f"trial_{name}",
            partial(plots.deciding_numbers, runs, deciding.metric, reference),
            f"**{title[0].upper()}{title[1:]}** decides this trial ({deciding.better} "
            "is better). A pale dot per seed, larger where several are equal; a mark "
            "at the share or the typical value, a line through its 95 % interval.",
            f"{title}, a row per policy",
        ),
    ]
    corrected = {title for title, level in trial.levels.items() if level.corrections}
    able = {p for level in corrected for p in levels.get(level, {})}
    unable = sorted({episode.policy for episode in episodes} - able)
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
