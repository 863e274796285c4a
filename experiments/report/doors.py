"""How the policies opened doors under one condition: rates, forces, times, tests."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Final

from experiments.report.document import Block, Items, Paragraph, Table
from experiments.report.verdicts import (
    CHAMPION,
    PRIVILEGED,
    rate_verdict,
    shifts_to,
    value_verdict,
)
from experiments.results.grouping import (
    UNDEMONSTRATED,
    by_pair,
    by_policy,
    kinds,
    places,
    ranked,
)
from experiments.results.measures import (
    ADA_FORCE,
    EPISODE_MEASURES,
    HEADLINES,
    TESTED,
    Measure,
    median,
    number_text,
)
from experiments.results.records import Episode
from experiments.results.statistics import PairedTest, holm, mcnemar, signed_rank
from experiments.results.table import wilson_interval

ANGLES: Final = (60, 30, 15)
"""Angles that count as opened [deg], the task's own first."""

HOW_TO_READ: Final = (
    "Numbers are compared pair by pair, at the same tasks (for forces, times and slip: "
    "doors that both opened), not by their medians: typical difference, its 95 % "
    "interval, number of pairs. Beaten: the interval leaves zero out, or the rate is "
    "below the best's interval. "
    f"{', '.join(f'`{name}`' for name in sorted(PRIVILEGED))} knows what a robot "
    "cannot and is not among the compared."
)
"""What a reader of the sentences has to know."""


def verdicts(episodes: Sequence[Episode]) -> Items:
    """Say how the champion stands, measure by measure."""
    runs = ranked(episodes)
    texts = [rate_verdict("Doors opened to 60°", _opened(runs))]
    new = kinds(episodes).get(UNDEMONSTRATED, [])
    if new and len(new) < len(episodes):
        title = "Of these, doors of undemonstrated radius"
        texts.append(rate_verdict(title, _opened(by_policy(new))))
    held = "Opened and held, the handle in the hand"
    texts.append(rate_verdict(held, _solved(runs)))
    for name in HEADLINES:
        measure = EPISODE_MEASURES[name]
        numbers = {policy: by_pair(own, measure.of) for policy, own in runs.items()}
        texts.append(value_verdict(measure, numbers))
    return Items(texts=tuple(texts))


def _opened(runs: Mapping[str, Sequence[Episode]]) -> dict[str, dict[str, bool]]:
    return {
        policy: {one.pair: one.opened() for one in own} for policy, own in runs.items()
    }


def _solved(runs: Mapping[str, Sequence[Episode]]) -> dict[str, dict[str, bool]]:
    return {
        policy: {one.pair: one.solved for one in own} for policy, own in runs.items()
    }


def rate_tables(episodes: Sequence[Episode]) -> list[Block]:
    """Success and each angle: all doors, by kind of door, and door by door."""
    note = (
        "Solved / tried: open by 60° for 0.5 s with the handle in the hand. Wilson's "
        "95 % intervals; policies in order of opening to 60°, then of radial force."
    )
    columns = {"all doors": list(episodes), **kinds(episodes), **places(episodes)}

    def solved(own: Sequence[Episode]) -> str:
        return rate_text(sum(one.solved for one in own), len(own))

    blocks: list[Block] = [_by_column(episodes, columns, solved, note)]
    for angle in ANGLES:

        def cell(own: Sequence[Episode], angle: int = angle) -> str:
            return rate_text(sum(one.opened(angle) for one in own), len(own))

        note = f"Opened to {angle}° / tried, if only for a moment."
        blocks.append(_by_column(episodes, columns, cell, note))
    return blocks


def rate_text(successes: int, trials: int) -> str:
    """Write a rate with its interval."""
    if not trials:
        return "–"
    low, high = wilson_interval(successes, trials)
    return f"{successes}/{trials}\n{low:.2f}–{high:.2f}"


def quality_tables(episodes: Sequence[Episode]) -> list[Block]:
    """Forces, times and the rest, by kind of door; radial force door by door."""
    order = list(ranked(episodes))
    blocks: list[Block] = []
    for name, group in kinds(episodes).items():
        own = by_policy(group)
        rows = tuple(
            _quality_row(policy, own[policy]) for policy in order if policy in own
        )
        heads = (measure.title for measure in EPISODE_MEASURES.values())
        note = f"Medians on {name}"
        if not blocks:
            note += (
                "; forces, slip and work over the doors opened to 60°, the others over "
                "all episodes that have them. A policy that opens few doors has few "
                "numbers: the paired tests compare equal doors. The last column counts "
                f"openings with a peak, tangential or radial, above {ADA_FORCE} N, the "
                "limit of ADA 404.2.9 for opening an interior door"
            )
        columns = ("policy", "opened", *heads, f"above {ADA_FORCE} N")
        blocks.append(Table(columns=columns, rows=rows, note=f"{note}."))
    radial = EPISODE_MEASURES["radial"]

    def cell(own: Sequence[Episode]) -> str:
        return radial.text(median(map(radial.of, own)))

    note = "Peak radial force [N] door by door, medians over the doors opened to 60°."
    blocks.append(_by_column(episodes, places(episodes), cell, note))
    return blocks


def _quality_row(policy: str, own: Sequence[Episode]) -> tuple[str, ...]:
    opened = [one for one in own if one.opened()]
    above = sum(
        max(
            one.number("force_tangential_peak") or 0.0,
            one.number("force_radial_peak") or 0.0,
        )
        > ADA_FORCE
        for one in opened
    )
    return (
        f"`{policy}`",
        f"{len(opened)}/{len(own)}",
        *(
            measure.text(median(map(measure.of, own)))
            for measure in EPISODE_MEASURES.values()
        ),
        f"{above}/{len(opened)}" if opened else "–",
    )


def _by_column(
    episodes: Sequence[Episode],
    columns: Mapping[str, Iterable[Episode]],
    cell: Callable[[Sequence[Episode]], str],
    note: str,
) -> Table:
    """A row per policy, a column per group of episodes."""
    groups = {name: by_policy(group) for name, group in columns.items()}
    rows = tuple(
        (f"`{policy}`", *(cell(group.get(policy, [])) for group in groups.values()))
        for policy in ranked(episodes)
    )
    return Table(columns=("policy", *columns), rows=rows, note=note)


def paired_tests(episodes: Sequence[Episode]) -> list[Block]:
    """Compare the champion with every other policy on the same tasks."""
    runs = ranked(episodes)
    others = [policy for policy in runs if policy != CHAMPION]
    if CHAMPION not in runs or not others:
        return [Paragraph(text=f"There is nothing to compare `{CHAMPION}` with.")]
    columns = {"opened to 60°": _success_tests(runs, others)}
    for name in TESTED:
        measure = EPISODE_MEASURES[name]
        columns[measure.title] = _value_tests(measure, runs, others)
    rows = tuple(
        (f"`{other}`", *(column[other] for column in columns.values()))
        for other in others
    )
    note = (
        f"`{CHAMPION}` against each other policy on the same door and seed. Success: "
        "doors that only "
        f"one of the two opened (`{CHAMPION}` : other), McNemar's exact test. Numbers: "
        f"`{CHAMPION}` minus the other on doors that both opened, after Hodges and "
        "Lehmann, Wilcoxon's signed-rank test. p after Holm for all tests of a column; "
        "n pairs."
    )
    return [Table(columns=("against", *columns), rows=rows, note=note)]


def _success_tests(
    runs: Mapping[str, Sequence[Episode]], others: Sequence[str]
) -> dict[str, str]:
    opened = _opened(runs)
    own, tests, counts = opened[CHAMPION], {}, {}
    for other in others:
        shared = sorted(own.keys() & opened[other].keys())
        ours, theirs = [own[k] for k in shared], [opened[other][k] for k in shared]
        tests[other] = mcnemar(ours, theirs)
        wins = sum(a > b for a, b in zip(ours, theirs, strict=True))
        counts[other] = f"{wins} : {tests[other].n_different - wins}"
    return _with_p(tests, counts)


def _value_tests(
    measure: Measure, runs: Mapping[str, Sequence[Episode]], others: Sequence[str]
) -> dict[str, str]:
    numbers = {policy: by_pair(own, measure.of) for policy, own in runs.items()}
    own, tests = numbers[CHAMPION], {}
    shifts = shifts_to(own, {other: numbers[other] for other in others})
    for other in shifts:
        shared = sorted(own.keys() & numbers[other].keys())
        tests[other] = signed_rank(
            [own[k] for k in shared], [numbers[other][k] for k in shared]
        )
    texts = {
        other: number_text(found.estimate, measure.digits, signed=True)
        for other, found in shifts.items()
    }
    return dict.fromkeys(others, "no door both opened") | _with_p(tests, texts)


def _with_p(
    tests: Mapping[str, PairedTest], texts: Mapping[str, str]
) -> dict[str, str]:
    corrected = holm([test.p for test in tests.values()])
    return {
        other: f"{texts[other]}\n{p_text(p)}, n {test.n}"
        for (other, test), p in zip(tests.items(), corrected, strict=True)
    }


def p_text(p: float) -> str:
    """Write a probability; bold when below 5 %."""
    text = "p < 0.001" if p < 1e-3 else f"p {p:.3f}"
    return f"**{text}**" if p < 0.05 else text
