"""A section per trial: the question, the numbers, and the effect of each idea."""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Final

from gplfd_experiments.analysis.report.document import Section, code
from gplfd_experiments.analysis.report.plots import (
    deciding_numbers,
    ideas,
    kind_of,
)
from gplfd_experiments.analysis.results.aggregates import probability_of_improvement
from gplfd_experiments.analysis.results.measures import (
    EPISODE_MEASURES,
    Runs,
    interval_text,
    number_text,
    shift_cell,
)
from gplfd_experiments.analysis.results.reading import EpisodeResult, StudyResults
from gplfd_experiments.analysis.results.statistics import Rate, success_rate
from gplfd_experiments.analysis.results.trials import (
    Answer,
    ByLevel,
    answered,
    changes,
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
    """Return the sections of trials: a summary of all ideas, then each trial."""
    held = of_trials(results)
    if not held:
        return []

    def ran(side: Side, policies: ByLevel) -> bool:
        levels = policies.get(side.policy, {})
        return bool(levels.get(side.level) if side.level else levels)

    answers = {
        name: [
            answered(contrast, own)
            for contrast in TRIALS[name].contrasts
            if ran(contrast.having, own) and ran(contrast.lacking, own)
        ]
        for name, own in held.items()
    }

    # The part of the protocol that these results cover.
    section = Section("What each idea is worth", "ideas")
    text = f"Protocol v{VERSION}, {len(held)} of {len(TRIALS)} trials."
    asked = sum(len(TRIALS[name].contrasts) for name in held)
    if left_out := asked - sum(map(len, answers.values())):
        text += f" {left_out} of its contrasts were not run and are not listed."
    section.say(text)
    seeds = len({one.task.seed for one in results.episodes if one.task.trial in held})
    if seeds < SEEDS:
        section.say(
            f"A first look: {seeds} of the {SEEDS} seeds that the protocol requires. "
            "`gplfd trials --part ideas` runs all of them.",
            warning=True,
        )
    _say_ideas(section, answers)
    sections = [section]
    for name, own in held.items():
        sections.append(_trial_section(name, own, answers[name], reference))
    return sections


def _say_ideas(section: Section, answers: Mapping[str, Sequence[Answer]]) -> None:
    """Show all contrasts in a table and a plot."""
    rows = sorted(
        (
            answer.contrast.idea,
            trial,
            EPISODE_MEASURES[answer.contrast.measure].title,
            f"{answer.contrast.having} : {answer.contrast.lacking}",
            *_found(answer),
        )
        for trial, own in answers.items()
        for answer in own
    )
    if not rows:
        section.say("No contrast has both of its policies in these results.")
        return
    note = (
        "**Difference:** the policy with the idea minus the otherwise equal policy "
        "without it, seed by seed, with the 95 % interval (Hodges-Lehmann; for "
        "shares, mean and Student's interval). **Result:** better or worse with the "
        "idea if the interval excludes zero (in the protocol: the idea shows, or does "
        "harm)."
    )
    columns = ("idea", "trial", "measure", "with : without", "difference", "result")
    section.table(Table(columns=columns, rows=tuple(rows), note=note, left=True))
    if any(answer.shift for own in answers.values() for answer in own):
        section.picture(
            "trials_ideas",
            partial(ideas, answers),
            "**Differences with and without an idea:** in brackets the policy without "
            "it; a point per difference, a line through its 95 % interval (from six "
            "seeds on). Right of zero is better with the idea, whether more or less of "
            "the measure is better.",
            "Differences of all contrasts, a panel per measure",
        )


def _trial_section(
    name: str, policies: ByLevel, answers: Sequence[Answer], reference: str
) -> Section:
    """Return a trial's question, its numbers in a table and a plot, its contrasts."""
    trial = TRIALS[name]
    levels = ordered(trial, policies)
    deciding = EPISODE_MEASURES[trial.measures[0]]
    title = deciding.title
    section = Section(f"Trial: {name}", f"trial-{name}")
    section.say(f"{trial.question}")
    section.table(trial_table(trial, levels))
    section.picture(
        f"trial_{name}",
        partial(deciding_numbers, levels, trial.measures[0], reference),
        f"**{title[0].upper()}{title[1:]}** decides this trial ({deciding.better} is "
        "better). Order as in the table. A pale dot per seed, larger where several are "
        "equal; a mark at the share or the typical value, a line through its 95 % "
        "interval (for values that are not shares, from six seeds "
        f"on). Bold: {code(reference)}.",
        f"{title}, a row per policy",
    )
    measure = deciding_measure(trial)
    arrays = scores(
        (o for levels in policies.values() for own in levels.values() for o in own),
        measure,
    )
    section.table(aggregate_table(arrays, measure, reference))
    texts = []
    for answer in answers:
        contrast, counts = answer.contrast, changes(answer.contrast, policies)
        difference, result = _found(answer)
        doors = [f" {number} {name}" for name, number in counts.items()]
        texts.append(
            f"{contrast.idea}: {code(contrast.having)} against "
            f"{code(contrast.lacking)}, {EPISODE_MEASURES[contrast.measure].title} "
            f"{difference}: {result}." + (f" Doors:{','.join(doors)}." if doors else "")
        )
    section.items(texts)
    asked = {title for title, one in trial.levels.items() if one.corrections}
    unable = [policy for policy, levels in policies.items() if not asked & set(levels)]
    if asked and unable:
        section.say(f"Cannot be corrected: {', '.join(map(code, unable))}.")
    return section


def ordered(trial: Trial, policies: ByLevel) -> dict[str, Runs]:
    """Return a trial's episodes by level and policy, the best first.

    Policies are sorted by the measures in order. Policies without a number come last,
    and so do policies that opened no door, because their small forces are not
    comparable.
    """

    def rank(episodes: Sequence[EpisodeResult]) -> list[float]:
        opened = summary(episodes, "success") if "success" in trial.measures else None
        ranks = [0.0 if opened is None or opened.estimate > 0.0 else 1.0]
        for measure in trial.measures:
            found = summary(episodes, measure)
            value = math.nan if found is None else found.estimate
            sign = EPISODE_MEASURES[measure].sign
            ranks.append(math.inf if math.isnan(value) else -sign * value)
        return ranks

    found: dict[str, Runs] = {}
    for level in trial.levels:
        here = {
            policy: own
            for policy, levels in policies.items()
            if (own := levels.get(level))
        }
        if here:
            order = sorted(here, key=lambda policy: rank(here[policy]))
            found[level] = {policy: here[policy] for policy in order}
    return found


def trial_table(trial: Trial, levels: Mapping[str, Runs]) -> Table:
    """Return a row per policy and level, with all measures of the trial."""
    rows: list[tuple[str, ...]] = []
    for level, own in levels.items():
        if len(trial.levels) > 1:
            rows.append((f"**{level}**", *("" for _ in trial.measures)))
        for policy, episodes in own.items():
            kind = kind_of(policy)
            name = code(policy) if kind == "method" else f"{code(policy)} ({kind})"
            if errors := sum(bool(one.error) for one in episodes):
                name += f"\nerrors: {errors}"
            cells = []
            for measure in trial.measures:
                found = summary(episodes, measure)
                if isinstance(found, Rate):
                    cells.append(found.cell)
                else:
                    digits = _digits(measure)
                    cells.append(shift_cell(found, digits) if found else "no value")
            rows.append((name, *cells))
    return Table(
        columns=("policy", *(EPISODE_MEASURES[name].title for name in trial.measures)),
        rows=tuple(rows),
        note="Ordered by the first measure; policies that opened no door come last. "
        "Shares: of episodes, with clustered Wilson "
        "intervals. Others: typical value of a seed, with its 95 % interval.",
    )


def aggregate_table(
    arrays: Mapping[str, FloatArray], measure: str, reference: str
) -> Table:
    """Return interquartile means and probabilities of improvement, the best first."""
    means = {
        policy: interquartile_mean_in_units(own, measure)
        for policy, own in arrays.items()
    }
    sign = EPISODE_MEASURES[measure].sign
    rows = []
    for policy in sorted(means, key=lambda one: (-sign * means[one].estimate, one)):
        both = arrays.get(reference, arrays[policy]), arrays[policy]
        better = shift_cell(probability_of_improvement(*both), 2)
        rows.append((code(policy), shift_cell(means[policy], _digits(measure)), better))
    head = f"{EPISODE_MEASURES[measure].title}, interquartile mean"
    return Table(
        columns=("policy", head, f"P({reference} better)"),
        rows=tuple(rows),
        note="All doors, and levels without a prior mean. **Interquartile mean:** of "
        "the middle half of the episodes; a dash if more than a quarter failed. "
        "**P:** probability that the reference is better at the same door and level; "
        "a failure is worse than any value, ties count half. 95 % intervals: "
        "stratified bootstrap of the seeds.",
    )


def add_tiers(section: Section, results: StudyResults) -> None:
    """Add a table per tier: policies by share of successes, and their radial force."""
    for tier, runs in tier_runs(results).items():
        episodes = [episode for group in runs.values() for episode in group]
        arrays = scores(episodes, RADIAL)
        rates = {
            policy: success_rate((ep.task.seed, succeeded(ep)) for ep in group)
            for policy, group in runs.items()
        }
        rows = []
        for policy in sorted(rates, key=lambda name: (-rates[name].estimate, name)):
            force = interquartile_mean_in_units(arrays[policy], RADIAL)
            text = shift_cell(force, _digits(RADIAL))
            rows.append((code(policy), kind_of(policy), rates[policy].cell, text))
        ran = len({episode.task.trial for episode in episodes})
        section.say(f"**Tier {tier}**, {ran} of {len(TIERS[tier])} trials")
        columns = (
            "policy",
            "kind",
            "successes",
            "radial force [N],\ninterquartile mean",
        )
        section.table(Table(columns=columns, rows=tuple(rows)))


def _found(answer: Answer) -> tuple[str, str]:
    """Return the difference with its interval, and the result, as text."""
    found = answer.shift
    if found is None:
        return "–", "no value in common"
    digits = _digits(answer.contrast.measure)
    # Enough decimals that the ends of the interval differ from zero.
    ends = [abs(end) for end in (found.low, found.high) if 0.0 < abs(end) < math.inf]
    if ends:
        digits = max(digits, min(-math.floor(math.log10(min(ends))), 3))
    estimate = number_text(found.estimate, digits, signed=True)
    if interval := interval_text(found, digits):
        return f"{estimate} ({interval})", _VERDICTS[answer.verdict]
    return estimate, "too few seeds for an interval"


def _digits(measure: str) -> int:
    one = EPISODE_MEASURES[measure]
    return 1 if one.unit == "s" else one.digits
