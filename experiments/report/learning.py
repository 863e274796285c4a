"""What the policies learned, held against demonstrations that they did not see."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from experiments.report.document import Block, Items, Paragraph, Picture, Section, Table
from experiments.report.plots import coverage, skill_scores
from experiments.report.verdicts import value_verdict
from experiments.results.grouping import by_condition, by_pair, by_policy
from experiments.results.measures import SKILL_HEADLINES, SKILL_MEASURES, median
from experiments.results.records import LearningTest

_LEFT_OUT: Final = {
    "demonstration": "one demonstration left out",
    "radius": "the middle radius left out",
}
_OUTPUTS: Final = "outputs_cpu_s"


def learning_section(tests: Sequence[LearningTest]) -> Section:
    """Tables, sentences and plots of the learning tests of the standard condition."""
    blocks: list[Block] = []
    if not any(one.metrics for one in tests):
        blocks.append(
            Paragraph(
                text="This study has no learning test with a result: `gplfd benchmark` "
                "makes them unless told otherwise."
            )
        )
    else:
        blocks.extend(_blocks(tests))
    return Section(
        title="What was learned, without a robot",
        anchor="learning",
        blocks=tuple(blocks),
    )


def _blocks(tests: Sequence[LearningTest]) -> list[Block]:
    condition, shown = next(iter(by_condition(tests).items()))
    shown = [one for one in shown if one.metrics]
    blocks: list[Block] = [
        Paragraph(
            text=f"{condition.demonstrations_per_door} demonstrations per door, "
            f"teacher noise × {condition.teacher_noise:g}; what is left out is "
            "predicted and "
            "compared with what was done. NLPD in natural units of metres and radians; "
            "inside: share of the left-out numbers within the stated intervals."
        ),
    ]
    for held_out in sorted({one.held_out for one in shown}):
        group = [one for one in shown if one.held_out == held_out]
        title = _LEFT_OUT.get(held_out, f"{held_out} left out")
        blocks.append(Paragraph(text=f"**{title[0].upper()}{title[1:]}**"))
        sentences = tuple(_verdict(name, group) for name in SKILL_HEADLINES)
        blocks.append(Items(texts=sentences))
        blocks.append(_table(group, f"Medians over the seeds, {title}."))
    blocks.extend(_outputs(shown))
    blocks.extend(_plots(shown))
    return blocks


def _verdict(name: str, tests: Sequence[LearningTest]) -> str:
    measure = SKILL_MEASURES[name]
    runs = {p: by_pair(own, measure.of) for p, own in by_policy(tests).items()}
    return value_verdict(measure, {p: own for p, own in runs.items() if own})


def _table(tests: Sequence[LearningTest], note: str) -> Table:
    rows = tuple(
        (
            f"`{policy}`",
            str(len(own)),
            *(m.text(median(map(m.of, own))) for m in SKILL_MEASURES.values()),
        )
        for policy, own in by_policy(tests).items()
    )
    heads = (measure.title for measure in SKILL_MEASURES.values())
    return Table(columns=("policy", "n", *heads), rows=rows, note=note)


def _outputs(tests: Sequence[LearningTest]) -> list[Block]:
    """CPU time to learn as the number of outputs grows."""
    times: dict[str, dict[int, list[float]]] = {}
    for one in tests:
        measured = (one.metrics or {}).get(_OUTPUTS)
        for number, seconds in _numbered(measured).items():
            times.setdefault(one.policy, {}).setdefault(number, []).append(seconds)
    numbers = sorted({number for own in times.values() for number in own})
    if not numbers:
        return []
    rows = tuple(
        (f"`{policy}`", *(_seconds(median(own.get(n, []))) for n in numbers))
        for policy, own in times.items()
    )
    return [
        Table(
            columns=("policy", *(f"{n} outputs" for n in numbers)),
            rows=rows,
            note="CPU time to learn [s] as the number of outputs grows, medians.",
        )
    ]


def _numbered(measured: Any) -> dict[int, float]:
    if not isinstance(measured, Mapping):
        return {}
    return {
        int(number): float(seconds)
        for number, seconds in measured.items()
        if seconds is not None
    }


def _seconds(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}"


def _plots(tests: Sequence[LearningTest]) -> list[Block]:
    runs = by_policy(tests)
    blocks: list[Block] = [
        Picture(
            name="skill",
            draw=lambda: skill_scores(tests),
            caption="**Errors and likelihood of predictions.** A dot per seed, a bar "
            "at the median; left is better. The policy with the least position error "
            "is on top.",
            alternative="Dot plot of NLPD, position and rotation error by policy",
        )
    ]
    if any(one.number("coverage_95") is not None for one in tests):
        blocks.insert(
            0,
            Picture(
                name="coverage",
                draw=lambda: coverage(runs),
                caption="**Are stated uncertainties honest?** Share of left-out "
                "numbers inside intervals that state 50, 90 and 95 %. On the grey line "
                "they are; below it they promise too much. Violet: `gp`.",
                alternative="Measured against nominal coverage, a panel per policy",
            ),
        )
    return blocks
