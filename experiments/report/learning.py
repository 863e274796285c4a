"""How well policies predicted demonstrations that they did not see."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Final

from experiments.files.table import Table
from experiments.report.columns import count, medians, policy_table
from experiments.report.document import (
    Block,
    Items,
    Paragraph,
    Picture,
    Section,
    code,
)
from experiments.report.plots import coverage, prediction_scores
from experiments.report.sentences import value_sentence
from experiments.results.grouping import by_condition, by_policy, grouped, numbers
from experiments.results.measures import LEARNING_HEADLINES, LEARNING_MEASURES, median
from experiments.results.records import LearningTestResult

Runs = Mapping[str, Sequence[LearningTestResult]]

_LEFT_OUT: Final = {
    "demonstration": "one demonstration left out",
    "radius": "the middle radius left out",
}


def learning_section(tests: Sequence[LearningTestResult], reference: str) -> Section:
    """Tables, sentences and plots of the learning tests of the standard condition."""
    conditions = by_condition(one for one in tests if not one.error)
    shown = next(iter(conditions.values()), [])
    text = (
        "This study has no learning test with a result: `gplfd benchmark` makes them "
        "unless it is given `--no-skill`."
    )
    return Section(
        title="What was learned, without a robot",
        anchor="learning",
        blocks=_blocks(shown, reference) if shown else (Paragraph(text=text),),
    )


def _blocks(tests: Sequence[LearningTestResult], reference: str) -> tuple[Block, ...]:
    condition = tests[0].condition
    text = (
        f"{condition.demonstrations_per_door} demonstrations per door, teacher noise "
        f"× {condition.teacher_noise:g}; what is left out is predicted and compared "
        "with what was done. NLPD in natural units of metres and radians; inside: "
        "share of the left-out numbers within the stated intervals."
    )
    blocks: list[Block] = [Paragraph(text=text)]
    groups = grouped(tests, lambda one: one.task.held_out)
    for held_out in sorted(groups):
        runs = by_policy(groups[held_out])
        title = _LEFT_OUT[held_out]
        blocks.append(Paragraph(text=f"**{title[0].upper()}{title[1:]}**"))
        sentences = (
            value_sentence(measure, numbers(runs, measure), reference)
            for measure in map(LEARNING_MEASURES.__getitem__, LEARNING_HEADLINES)
        )
        blocks.append(Items(texts=tuple(sentences)))
        blocks.append(_table(runs, f"Medians over the seeds, {title}."))
    return (*blocks, *_outputs(tests), *_plots(tests, reference))


def _table(runs: Runs, note: str) -> Table:
    columns = {"n": (runs, count), **medians(runs, LEARNING_MEASURES.values())}
    return policy_table(runs, columns, note)


def _outputs(tests: Sequence[LearningTestResult]) -> list[Block]:
    """CPU time to learn as the number of outputs grows."""
    timed = by_policy(one for one in tests if one.outputs_cpu_s)
    columns = {
        f"{outputs} outputs": (timed, partial(_seconds, outputs))
        for outputs in sorted({n for one in tests for n in one.outputs_cpu_s})
    }
    note = "CPU time to learn [s] as the number of outputs grows, medians."
    return [policy_table(timed, columns, note)] if timed else []


def _seconds(outputs: int, own: Sequence[LearningTestResult]) -> str:
    value = median(one.outputs_cpu_s.get(outputs) for one in own)
    return "–" if value is None else f"{value:.3g}"


def _plots(tests: Sequence[LearningTestResult], reference: str) -> list[Block]:
    runs = by_policy(tests)
    blocks: list[Block] = []
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
        caption="**Errors and likelihood of predictions.** A dot per seed, a bar at "
        "the median; left is better. The policy with the least position error is on "
        "top.",
        alternative="Dot plot of NLPD, position and rotation error by policy",
    )
    return [*blocks, picture]
