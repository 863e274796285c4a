"""Which method fits somebody's recordings: each left out in turn, and predicted."""

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

from gplfd_experiments.analysis.report.document import (
    Block,
    Details,
    Items,
    Paragraph,
    Section,
    code,
)
from gplfd_experiments.analysis.report.learning import prediction_plots
from gplfd_experiments.analysis.report.policy_table import Cell, medians, policy_table
from gplfd_experiments.analysis.report.sentences import value_sentence
from gplfd_experiments.analysis.results.grouping import by_policy, numbers
from gplfd_experiments.analysis.results.measures import (
    LEARNING_HEADLINES,
    LEARNING_MEASURES,
    RECORDED_MEASURES,
    Measure,
    median,
)
from gplfd_experiments.analysis.results.records import RecordedResult
from gplfd_experiments.files.table import Table, text_table

Results = Sequence[RecordedResult]

_MEASURES: Final[Mapping[str, Measure]] = {**LEARNING_MEASURES, **RECORDED_MEASURES}
_FORECASTS: Final = ("forecast_25_nlpd", "forecast_25_position_m")
"""Forecasts that get a sentence."""
_TABLES: Final[Mapping[str, tuple[tuple[str, ...], ...]]] = {
    "A recording that was not seen": (
        *(("rmse_position_m",), ("rmse_rotation_rad",), ("nlpd",)),
        *((f"coverage_{level}",) for level in (50, 90, 95)),
        *(("via_error_position_m",), ("log_dimensionless_jerk",)),
        *(("cpu_fit_s",), ("cpu_predict_s",), ("cpu_adapt_s",)),
    ),
    "Its rest, once a part has been seen": tuple(
        (f"forecast_{share}_{name}",)
        for share in (10, 25, 50)
        for name in ("position_m", "rotation_rad", "nlpd", "coverage_95")
    ),
}
"""Columns by the title of their table."""

_HONEST: Final = (0.90, 0.99)
"""Share of what was left out that 95 % intervals should hold; few recordings tell it to
a few hundredths only."""
_MISSED: Final = 2e-3
"""A via-point demanded to a millimetre is missed by more [m]."""
_UNLIKE: Final = 3.5
"""A recording is unlike the others if its score is so many robust standard deviations
above the median; Iglewicz and Hoaglin's limit."""
_ROBUST: Final = 1.4826
"""Standard deviation of a normal variable over its median absolute deviation."""


def recorded_section(results: Results, reference: str) -> Section:
    """All methods on recordings: sentences, tables, plots, and what to do."""
    runs = by_policy(results)
    measures = map(_MEASURES.__getitem__, (*LEARNING_HEADLINES, *_FORECASTS))
    standings = tuple(
        value_sentence(each, numbers(runs, each), reference, "recordings")
        for each in measures
    )
    blocks: list[Block] = [
        Paragraph(
            text="Each recording is left out in turn, the method learns from the "
            "others, and what it predicts is compared with what was done: at the same "
            "phases, told from how much of its path the hand has covered. Less is "
            "better; NLPD of the outputs that move, in natural units of metres and "
            "radians: a difference of 0.1 per number is ten per cent of a density. "
            "Recordings are the independent "
            "trials of the intervals."
        ),
        _summary(results),
        Items(texts=standings),
        *prediction_plots([one for one in results if not one.error], reference),
        Paragraph(text="**What to make of it**"),
        Items(texts=tuple(_advice(runs.get(reference, ()), reference))),
        *(Details(title=title, table=_table(title, runs)) for title in _TABLES),
        Details(title="NLPD recording by recording", table=_by_recording(runs)),
    ]
    return Section(
        title="What was learned from the recordings",
        anchor="recorded",
        blocks=tuple(blocks),
    )


def overview(results: Results) -> str:
    """Return the headlines of all methods as a table of plain text, best first."""
    table = _summary(results)
    # Plain text has neither marks nor lines within a cell.
    rows = tuple(
        (row[0].replace("`", "").replace("\n", ", "), *row[1:]) for row in table.rows
    )
    return text_table(replace(table, rows=rows))


def _summary(results: Results) -> Table:
    """Return the headlines of all methods, those with the best likelihood first."""
    order = sorted(by_policy(results).items(), key=_likelihood)
    columns: dict[str, Cell] = {"n": lambda own: str(len(own))}
    for name in (*LEARNING_HEADLINES, "coverage_95", *_FORECASTS):
        columns |= medians(_MEASURES[name])
    note = (
        "Medians over recordings. **n:** recordings left out, one at a time. "
        "**NLPD:** negative log predictive density of the outputs that move, less is "
        "better. **Position, rotation:** error of the prediction. **Inside 95 %:** "
        "share of the recording inside the stated 95 % intervals, 0.95 is right. "
        "**After 25 %:** error and NLPD of the rest once a quarter has been seen."
    )
    return policy_table({"": dict(order)}, columns, note)


def _likelihood(item: tuple[str, Results]) -> float:
    middle = _MEASURES["nlpd"].median(one for one in item[1] if not one.error)
    return math.inf if middle is None else middle


def _table(title: str, runs: Mapping[str, Results]) -> Table:
    columns: dict[str, Cell] = {"n": lambda own: str(len(own))}
    for names in _TABLES[title]:
        columns |= medians(*map(_MEASURES.__getitem__, names))
    return policy_table({"": runs}, columns, "Medians over recordings.")


def _by_recording(runs: Mapping[str, Results]) -> Table:
    """Return the likelihood of every recording under every method."""
    measure = _MEASURES["nlpd"]
    every = sorted({one.task.seed for own in runs.values() for one in own})
    scores = {
        policy: {one.task.seed: measure.of(one) for one in own}
        for policy, own in runs.items()
    }
    rows = tuple(
        (str(number), *(measure.text(own.get(number)) for own in scores.values()))
        for number in every
    )
    return Table(
        columns=("left out", *map(code, runs)),
        rows=rows,
        note="Recordings are numbered from 0 in the order of the file.",
    )


def _advice(own: Results, policy: str) -> list[str]:
    """Say what of a method's numbers is bad, and what to try."""
    ran = [one for one in own if not one.error]
    texts = [*_of_coverage(ran, policy), *_of_outliers(ran)]
    missed = median(one.number("via_error_position_m") for one in ran)
    if missed is not None and missed > _MISSED:
        texts.append(
            f"{code(policy)} passes a via-point demanded to a millimetre by "
            f"{1e3 * missed:.1f} mm: the recordings leave it no freedom there. Record "
            "the task in more of the ways in which it can be done."
        )
    return texts or [
        f"Nothing of {code(policy)} stands out: its intervals hold what they state, no "
        "recording is unlike the others, and via-points are met."
    ]


def _of_coverage(ran: Results, policy: str) -> list[str]:
    shares = [value for one in ran if (value := one.number("coverage_95")) is not None]
    if not shares:
        return [f"{code(policy)} states no uncertainty."] if ran else []
    held = statistics.fmean(shares)
    low, high = _HONEST
    if held < low:
        return [
            f"{code(policy)} is too sure: its 95 % intervals hold {held:.2f}. A new "
            "repetition differs by more than these differ from each other. Record more "
            "of them, or in more different circumstances; and look whether they begin "
            "at the same place of the task."
        ]
    if held > high:
        return [
            f"{code(policy)} is too unsure: its 95 % intervals hold {held:.2f}. One "
            "recording unlike the others widens them for all."
        ]
    return []


def _of_outliers(ran: Results) -> list[str]:
    scores = {
        one.task.seed: value for one in ran if (value := one.number("nlpd")) is not None
    }
    if len(scores) < 4:
        return []
    middle = statistics.median(scores.values())
    spread = _ROBUST * statistics.median(abs(one - middle) for one in scores.values())
    return [
        f"Recording {number} is unlike the others: NLPD {score:.1f}, where the median "
        f"is {middle:.1f}. Look at it in skill.rrd: another way of doing the task, a "
        "jump of the tracker, or a wrong unit or quaternion order in one file?"
        for number, score in scores.items()
        if score - middle > _UNLIKE * max(spread, 1e-9)
    ]
