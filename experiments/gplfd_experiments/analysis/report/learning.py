"""How well policies predicted demonstrations that they did not see."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Final

from gplfd_experiments.analysis.report.document import (
    Block,
    Details,
    Items,
    Paragraph,
    Picture,
    Section,
    code,
)
from gplfd_experiments.analysis.report.plots import LeftOut, coverage, prediction_scores
from gplfd_experiments.analysis.report.policy_table import Cell, medians, policy_table
from gplfd_experiments.analysis.report.sentences import value_sentence
from gplfd_experiments.analysis.results.grouping import by_condition, by_policy, numbers
from gplfd_experiments.analysis.results.measures import (
    LEARNING_HEADLINES,
    LEARNING_MEASURES,
    median,
)
from gplfd_experiments.analysis.results.records import (
    LearningTestResult,
    RecordedResult,
)
from gplfd_experiments.files.table import Table

Tests = Sequence[LearningTestResult]

_LEFT_OUT: Final = {
    "demonstration": "one demonstration left out",
    "radius": "the middle radius left out",
}


def learning_section(tests: Tests, reference: str) -> Section:
    """All learning tests in one table, with sentences; plots of the first condition."""
    blocks: list[Block] = []
    if ran := [one for one in tests if not one.error]:
        standard = next(iter(by_condition(ran).values()))
        groups = _groups(tests)
        for title, runs in groups.items():
            blocks += [Paragraph(text=f"**{title}**"), _standing(runs, reference)]
        blocks += [
            Details(title="All measures of the learning tests", table=_table(groups)),
            *_outputs(standard),
            *prediction_plots(standard, reference),
        ]
    else:
        text = (
            "This study has no learning test with a result: `gplfd benchmark` makes "
            "them unless it is given `--no-skill`."
        )
        blocks.append(Paragraph(text=text))
    title = "What was learned, without a robot"
    return Section(title=title, anchor="learning", blocks=tuple(blocks))


def _groups(tests: Tests) -> dict[str, dict[str, list[LearningTestResult]]]:
    """Return tests by condition and what was left out, and by policy."""
    return {
        f"{_LEFT_OUT[held_out].capitalize()}: {condition.teaching}": by_policy(own)
        for condition, those in by_condition(tests).items()
        for held_out in _LEFT_OUT
        if (own := [one for one in those if one.task.held_out == held_out])
    }


def _standing(runs: Mapping[str, Tests], reference: str) -> Items:
    measures = map(LEARNING_MEASURES.__getitem__, LEARNING_HEADLINES)
    return Items(
        texts=tuple(
            value_sentence(measure, numbers(runs, measure), reference)
            for measure in measures
        )
    )


def _table(groups: Mapping[str, Mapping[str, Tests]]) -> Table:
    columns: dict[str, Cell] = {"n": lambda own: str(len(own))}
    for measure in LEARNING_MEASURES.values():
        columns |= medians(measure)
    note = (
        "What is left out is predicted and compared with what was done: medians over "
        "the seeds. NLPD in natural units of metres and radians; inside: share of the "
        "left-out numbers within the stated intervals."
    )
    return policy_table(groups, columns, note)


def _outputs(tests: Tests) -> list[Block]:
    """CPU time to learn as the number of outputs grows."""
    timed = by_policy(one for one in tests if one.outputs_cpu_s)
    columns: dict[str, Cell] = {
        f"{outputs} outputs": partial(_seconds, outputs)
        for outputs in sorted({n for one in tests for n in one.outputs_cpu_s})
    }
    note = "CPU time to learn [s] as the number of outputs grows, medians."
    if not timed:
        return []
    table = policy_table({"": timed}, columns, note)
    return [Details(title="CPU time to learn by number of outputs", table=table)]


def _seconds(outputs: int, own: Tests) -> str:
    value = median(one.outputs_cpu_s.get(outputs) for one in own)
    return "–" if value is None else f"{value:.3g}"


def prediction_plots(
    tests: Tests | Sequence[RecordedResult], reference: str
) -> list[Block]:
    """Return plots of how honest and how near predictions are, none of no test."""
    runs: Mapping[str, Sequence[LeftOut]] = by_policy(tests)
    blocks: list[Block] = []
    if not tests:
        return blocks
    if any(one.number("coverage_95") is not None for one in tests):
        picture = Picture(
            name="coverage",
            draw=partial(coverage, runs, reference),
            caption="**Are stated uncertainties honest?** Share of left-out numbers "
            "inside intervals that state 50, 90 and 95 %. On the grey line they are; "
            f"below it they promise too much. Violet: {code(reference)}.",
            alternative="Measured against nominal coverage, a panel per policy",
        )
        blocks.append(picture)
    picture = Picture(
        name="skill",
        draw=partial(prediction_scores, runs),
        caption="**Errors and likelihood of predictions.** A dot per test, a bar at "
        "the median; left is better. The policy with the least position error is on "
        "top.",
        alternative="Dot plot of NLPD, position and rotation error by policy",
    )
    return [*blocks, picture]
