"""The sections of a report: a function per question, which a table answers."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Final

from gplfd_experiments.analysis.report import document, plots
from gplfd_experiments.analysis.report.document import Block, Plot, Section, Text, code
from gplfd_experiments.analysis.results import measures, reading, statistics, trials
from gplfd_experiments.analysis.results.measures import EPISODE_MEASURES, Runs
from gplfd_experiments.analysis.results.trials import MEASURES, Answer, ByLevel
from gplfd_experiments.files.table import Table
from gplfd_experiments.studies.learning_tests.criteria import CRITERIA, mark
from gplfd_experiments.studies.trials import protocol
from gplfd_policies.registry.built_in import TABLE_1

Results = Sequence[reading.TaskResult]
EpisodeResults = Sequence[reading.EpisodeResult]

_FORCE: Final = EPISODE_MEASURES["force_radial_peak"]


def summary_table(conditions: Mapping[str, Runs]) -> Table:
    """Return rates and forces by policy, by condition and by kind of door."""
    everything = (group for runs in conditions.values() for group in runs.values())
    counting = [episode for group in everything for episode in group if episode.counts]
    several_kinds = len({episode.door_kind for episode in counting}) > 1
    groups: dict[str, dict[str, EpisodeResults]] = {}
    for condition, runs in conditions.items():
        here = (episode for group in runs.values() for episode in group)
        for kind, of_kind in measures.grouped(here, "door_kind").items():
            parts = [kind] * several_kinds + [condition] * (len(conditions) > 1)
            for policy, group in measures.ranked(of_kind).items():
                closed = not any(episode.opened() for episode in group)
                title = parts + ["opened no door (not ranked)"] * closed
                groups.setdefault(": ".join(title), {})[policy] = group
    seen = {episode.split for episode in counting}
    splits = [split for split in reading.SPLITS if split in seen]

    def row(episodes: EpisodeResults) -> document.Cells:
        rates, forces = [], []
        for split in splits:
            rate = force = "not run"
            if here := [episode for episode in episodes if episode.split == split]:
                solved = [(episode.task.seed, episode.solved) for episode in here]
                rate = statistics.success_rate(solved).cell()
                typical = _FORCE.typical(here)
                force = typical.cell(_FORCE.digits) if typical else "none opened"
            rates.append((f"opened,\n{split}", rate))
            forces.append((f"radial force [N],\n{split}", force))
        seeds = {episode.task.seed for episode in episodes}
        reasons = document.literal(measures.closed_because(episodes))
        end = "not opened because", reasons
        return [("seeds", str(len(seeds))), *rates, *forces, end]

    note = (
        "**Opened:** doors opened by 60° and held there for 0.5 s with the handle in "
        "the hand, with the 95 % interval (Wilson); errors of a policy count as not "
        "opened. **Radial force:** peak force across the path of the handle, which "
        "does no work; a large value means that the motion does not fit the door. "
        "Typical value of a seed over the opened doors, with its 95 % interval from "
        f"{statistics.FEWEST_PAIRS} seeds on. Policies are in order of the doors "
        "opened to 60°, then of the radial force."
    )
    return document.policy_table(groups, row, note=note)


def doors_section(conditions: Mapping[str, Runs], reference: str) -> Section:
    """All measures of all conditions, with lost episodes; plots of the first one."""
    title, first = next(iter(conditions.items()))
    runs = {policy: [e for e in group if e.counts] for policy, group in first.items()}
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
    ran = [episode for group in runs.values() for episode in group]
    if any(e is not None for run in ran for e in run.metrics["forecast_error_mm"]):
        forecast = Plot(
            "forecast",
            partial(plots.forecast_by_progress, runs, reference),
            "**Error of the forecast of the rest of the path** as the door opens: "
            "median and middle half of all episodes.",
            "Forecast error against progress, a panel per policy",
        )
        blocks.append(forecast)
    blocks.append(measures_table(conditions))
    for name, policies in conditions.items():
        rows = measures.study_rows(e for group in policies.values() for e in group)
        heading = f"Door by door: {name}" if several else "Door by door"
        note = "Times, forces and slip: medians over the doors opened and held."
        blocks.append(replace(measures.study_table(rows), title=heading, note=note))
    return Section("Doors opened", blocks)


def measures_table(conditions: Mapping[str, Runs]) -> Table:
    """Return rates, all measures and failures by policy and condition."""
    groups = (group for runs in conditions.values() for group in runs.values())
    counting = [episode for group in groups for episode in group if episode.counts]
    disturbed = [episode for episode in counting if episode.task.disturbance != "none"]
    columns = [
        [EPISODE_MEASURES[metric] for metric in metrics]
        for table in ("episodes", "disturbed")
        for metrics in measures.COLUMNS[table]
        if table == "episodes" or any(e.number(metrics[0]) for e in disturbed)
    ]
    failures = sorted({e.failure for e in counting if not e.solved})
    angle = EPISODE_MEASURES["final_angle_deg"]

    def row(episodes: EpisodeResults) -> document.Cells:
        outcomes = {"solved": [episode.solved for episode in episodes]}
        for degrees in (60, 30, 15):
            outcomes[f"to {degrees}°"] = [e.opened(degrees) for e in episodes]
        seeds = [episode.task.seed for episode in episodes]
        cells = [
            (heading, statistics.success_rate(zip(seeds, reached, strict=True)).cell())
            for heading, reached in outcomes.items()
        ]
        for column in columns:
            typical = [(measure, measure.typical(episodes)) for measure in column]
            texts = [m.text(value.estimate if value else None) for m, value in typical]
            heads = [measure.column for measure in column]
            cells.append(("\n".join(heads), "\n".join(texts)))
        opened = [e for e in episodes if e.opened()]
        ways = ("force_tangential_peak", "force_radial_peak")
        peaks = [max(e.number(way) or 0.0 for way in ways) for e in opened]
        strong = sum(peak > measures.ADA_FORCE for peak in peaks)
        share = f"{strong}/{len(peaks)}" if peaks else "–"
        cells.append((f"above {measures.ADA_FORCE} N", share))
        for name in failures:
            number = sum(e.failure == name for e in episodes if not e.solved)
            cells.append((document.literal(name), str(number)))
        ends = angle.median(episodes), max(angle.values(episodes), default=None)
        texts = [angle.text(end, unit=True) for end in ends]
        return [*cells, ("median angle\nlargest", "\n".join(texts))]

    named = [m for column in columns for m in column if m.name]
    meanings = "; ".join(f"{measure.short}: {measure.name}" for measure in named)
    note = (
        "Typical values of a seed: forces, slip and work over the doors opened to 60°, "
        "the others over all episodes that have them. Above 22.2 N: the limit of ADA "
        "404.2.9 for opening an interior door. The last columns count the episodes "
        f"that ended so. {meanings[0].upper()}{meanings[1:]}."
    )
    return document.policy_table(conditions, row, title="All measures", note=note)


def paired_tests(title: str, runs: Runs, reference: str) -> Block:
    """Compare the reference with every other policy on the same tasks."""
    others = [policy for policy in runs if policy != reference]
    if reference not in runs or not others:
        return Text(f"There is nothing to compare {code(reference)} with.")
    rows = {other: {"against": code(other)} for other in others}
    for measure in (
        None,
        *(EPISODE_MEASURES[name] for (name,) in measures.COLUMNS["tested"]),
    ):
        heading = measure.column if measure else "opened to 60°"
        values = {
            policy: {
                e.key: value
                for e in group
                if e.counts
                and (value := measure.of(e) if measure else e.opened()) is not None
            }
            for policy, group in runs.items()
        }
        ours = values[reference]
        seeds = {other: statistics.paired(ours, values[other]) for other in others}
        both = [other for other in others if seeds[other][0]]
        p_values = statistics.holm([statistics.signed_rank(*seeds[o]) for o in both])
        for other in others:
            rows[other][heading] = "–"
        for other, p in zip(both, p_values, strict=True):
            if measure:
                typical = statistics.shift(*seeds[other]).estimate
                text = statistics.number_text(typical, measure.digits, signed=True)
            else:
                theirs = values[other]
                pairs = [(a, theirs[d]) for d, a in ours.items() if d in theirs]
                won, lost = sum(a > b for a, b in pairs), sum(b > a for a, b in pairs)
                text = f"{won} : {lost}"
            test = "p < 0.001" if p < 1e-3 else f"p {p:.3f}"
            test = f"**{test}**" if p < 0.05 else test
            rows[other][heading] = f"{text}\n{test}, n {len(seeds[other][0])}"
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


def trial_sections(results: reading.StudyResults, reference: str) -> list[Section]:
    """Return the sections of trials: all ideas, then each trial."""
    ran = trials.of_trials(results)
    if not ran:
        return []
    answers = trials.answers_by_trial(ran)
    # The part of the protocol that these results cover.
    text = f"Protocol v{protocol.VERSION}, {len(ran)} of {len(protocol.TRIALS)} trials."
    asked = sum(len(protocol.TRIALS[name].contrasts) for name in ran)
    if left_out := asked - sum(map(len, answers.values())):
        text += f" {left_out} of its contrasts were not run and are not listed."
    blocks: list[Block] = [Text(text)]
    seeds = len({e.task.seed for e in results.episodes if e.task.trial in ran})
    if seeds < protocol.SEEDS:
        text = (
            f"A first look: {seeds} of the {protocol.SEEDS} seeds that the protocol "
            "requires. `gplfd trials --part ideas` runs all of them."
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
        *(trial_section(name, levels, reference) for name, levels in ran.items()),
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
            difference = statistics.number_text(shift.estimate, digits, signed=True)
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
        "signed ranks, after Holm over all contrasts of the track, give at most 5 %, "
        "and the difference is at least 1 N, 1 N s, 2° or 5 points."
    )
    columns = ("idea", "trial", "measure", "with : without", "difference", "result")
    return Table(columns=columns, rows=tuple(sorted(rows)), note=note, left=True)


def trial_section(name: str, levels: ByLevel, reference: str) -> Section:
    """Return a trial's question, and its numbers in a table and a plot."""
    trial, deciding = protocol.TRIALS[name], MEASURES[protocol.TRIALS[name].measures[0]]
    runs, title = ordered(trial, levels), deciding.title
    # A row per policy and level, with all measures of the trial.
    table = document.policy_table(
        runs,
        lambda episodes: [
            (m.title, t.cell(m.digits) if (t := m.typical(episodes)) else "no value")
            for m in map(MEASURES.__getitem__, trial.measures)
        ],
        note="Ordered by the first measure; policies that opened no door come last. "
        "Shares: of episodes, with clustered Wilson intervals. Others: typical value "
        "of a seed, with its 95 % interval.",
    )
    blocks: list[Block] = [
        Text(trial.question),
        table,
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


def ordered(trial: protocol.Trial, levels: ByLevel) -> dict[str, Runs]:
    """Return a trial's episodes by level and policy, the best by its measures first.

    Policies without a number, or without an opened door, come last.
    """
    ordered_levels: dict[str, Runs] = {}
    for level in (level for level in trial.levels if level in levels):
        ranks: dict[str, list[float]] = {}
        for policy, episodes in levels[level].items():
            typical = {m: MEASURES[m].typical(episodes) for m in trial.measures}
            opened = typical.get("success")
            rank = [0.0 if opened is None or opened.estimate > 0.0 else 1.0]
            for name, estimate in typical.items():
                number = estimate.estimate if estimate else math.nan
                better = -MEASURES[name].sign * number
                rank.append(math.inf if math.isnan(better) else better)
            ranks[policy] = rank
        order = sorted(ranks, key=ranks.__getitem__)
        ordered_levels[level] = {policy: levels[level][policy] for policy in order}
    return ordered_levels


# --- Predictions of left-out demonstrations, without a robot

_LEFT_OUT: Final = {
    "demonstration": "One demonstration left out",
    "radius": "The middle radius left out",
}
_SUMMARY: Final = (
    *("nlpd", "rmse_position_m", "rmse_rotation_rad", "coverage_95"),
    *("forecast_25_nlpd", "forecast_25_position_m"),
    *("online_25_nlpd", "online_25_position_m", "online_25_coverage_95"),
)
_NOTE: Final = (
    "Medians. NLPD: negative log predictive density, in natural units of metres and "
    "radians, of forces in newtons and newton metres; less is better. Inside: share of "
    "the left-out numbers within the stated intervals. After a part: errors of the "
    "rest, at known phases; online: with the phase estimated from the samples so far."
)
_SIGN: Final = {True: "✓", False: "✗", None: "?"}
_MARKS_NOTE: Final = (
    "✓ and ✗: whether the number earns the mark by the limits below; where the "
    "paper says otherwise, its own mark is given. Means over the learning tests. "
    "The paper's column GP is `local-gp` and `wishart-gp`, its last one `gp-paper` "
    "as published and `gp` as developed here. Tuned: with the settings that "
    "benchmarks/tune.py found for each method."
)


def learning_section(tests: Results, title: str, *lead: Block) -> Section:
    """Return all measures of learning tests of any kind, without a robot."""
    groups = {
        f"{left_out}: {condition.teaching}": measures.grouped(here, "policy")
        for condition, those in measures.by_condition(tests).items()
        for held_out, left_out in _LEFT_OUT.items()
        if (here := [test for test in those if test.left_out == held_out])
    }
    metrics = [n for n in measures.PREDICTED if {t.number(n) for t in tests} - {None}]
    table = document.policy_table(
        groups or {"": measures.grouped(tests, "policy")},
        partial(_medians, ("n", *metrics)),
        title="All measures",
        note=_NOTE,
    )
    return Section(title, [*lead, table])


def overview(results: Results) -> Table:
    """Return the headlines of all methods, ordered by likelihood."""
    nlpd, groups = measures.PREDICTED["nlpd"], measures.grouped(results, "policy")
    medians = {p: nlpd.median(t for t in groups[p] if not t.error) for p in groups}
    ends = {p: math.inf if value is None else value for p, value in medians.items()}
    order = {policy: groups[policy] for policy in sorted(ends, key=ends.__getitem__)}
    note = f"**n:** recordings left out, one at a time. {_NOTE}"
    row = partial(_medians, (*_SUMMARY, "n"))
    return document.policy_table({"": order}, row, note=note)


def _medians(metrics: Sequence[str], tests: Results) -> document.Cells:
    """Return the median of each measure; "n" is the number of tests."""
    columns = {name: measures.PREDICTED[name] for name in metrics if name != "n"}
    cells = {n: (c.column, c.text(c.median(tests))) for n, c in columns.items()}
    cells["n"] = "n", str(len(tests))
    return [cells[name] for name in metrics]


def table_one_section(tests: Results) -> Section:
    """The paper's rows and methods, measured marks, and differences."""
    # The condition with most tests.
    ran = measures.by_condition(test for test in tests if not test.error)
    standard = measures.grouped(next(iter(ran.values()), []), "policy")
    foreign = dict.fromkeys(test.policy for test in tests if test.policy_source)
    blocks: list[Block] = []
    for title, policies in (
        ("Marks with their numbers", (*TABLE_1, *foreign)),
        ("Marks of the methods as published", [f"{p}@published" for p in TABLE_1]),
        ("Marks of the tuned learners", [f"{p}@tuned" for p in TABLE_1]),
    ):
        runs = {p: [t.metrics for t in standard[p]] for p in policies if p in standard}
        rows = []
        for row, criterion in CRITERIA.items():
            limit = criterion.limits[0]
            bound = f"≤ {limit.high:g}" if limit.high < math.inf else f"≥ {limit.low:g}"
            cells = {"": f"{row}\n{limit.symbol} {bound}"}
            for policy, metrics in runs.items():
                earned, published = mark(criterion, metrics), policy in criterion.paper
                text, value = _SIGN[earned.passed], earned.value
                if value is not None and 0.0 < abs(value) < 1e-3:
                    text += " < 0.001" if value > 0.0 else " > −0.001"
                elif value is not None:
                    text += f" {value:.3g}".replace("-", "−")
                if policy in TABLE_1 and earned.passed not in (None, published):
                    text = f"**{text}**\n(paper {_SIGN[published]})"
                cells[code(policy)] = text
            rows.append(cells)
        if runs:
            blocks.append(replace(Table.of(rows), title=title, note=_MARKS_NOTE))
    meanings = Table(
        columns=("row", "what is measured"),
        rows=tuple((item.row, item.sentence) for item in CRITERIA.values()),
        title="What the rows mean",
        left=True,
    )
    return Section("Table 1 of the paper, measured", [*blocks, meanings])
