"""How the reference stands beside the other policies on the same doors and seeds."""

from collections.abc import Callable, Mapping
from functools import partial

from gplfd_experiments.analysis.report.document import Block, Items, Paragraph, code
from gplfd_experiments.analysis.report.sentences import rate_sentence, value_sentence
from gplfd_experiments.analysis.results.grouping import Runs, numbers, of_kind
from gplfd_experiments.analysis.results.measures import (
    EPISODE_MEASURES,
    HEADLINES,
    TESTED,
    Measure,
    number_text,
)
from gplfd_experiments.analysis.results.records import UNDEMONSTRATED
from gplfd_experiments.analysis.results.statistics import (
    Key,
    Pairs,
    holm,
    paired,
    shift,
    signed_rank,
)
from gplfd_experiments.files.table import Table


def standing(runs: Runs, reference: str) -> Items:
    """Say how the reference stands, measure by measure.

    Args:
        runs: Episodes that ran, of one condition.
        reference: Name of a policy.
    """
    opened = _successes(runs)
    texts = [rate_sentence("Doors opened to 60°", opened, reference)]
    kinds = {one.kind for own in runs.values() for one in own}
    if len(kinds) > 1 and UNDEMONSTRATED in kinds:
        title = "Of these, doors of new radii"
        new = _successes(of_kind(runs, UNDEMONSTRATED))
        texts.append(rate_sentence(title, new, reference))
    title = "Opened and held, the handle in the hand"
    texts.append(rate_sentence(title, _successes(runs, held=True), reference))
    # Policies that opened no door are not ranked.
    able = {
        policy: own
        for policy, own in runs.items()
        if policy == reference or any(one.opened() for one in own)
    }
    for measure in map(EPISODE_MEASURES.__getitem__, HEADLINES):
        texts.append(value_sentence(measure, numbers(able, measure), reference))
    return Items(texts=tuple(texts))


def _successes(runs: Runs, *, held: bool = False) -> dict[str, dict[Key, bool]]:
    """Return success by policy and task: opened to 60 degrees, or held there, too."""
    return {
        policy: {one.key: one.solved if held else one.opened() for one in own}
        for policy, own in runs.items()
    }


def paired_tests(runs: Runs, reference: str) -> Block:
    """Compare the reference with every other policy on the same tasks."""
    others = [policy for policy in runs if policy != reference]
    if reference not in runs or not others:
        return Paragraph(text=f"There is nothing to compare {code(reference)} with.")
    columns = {"opened to 60°": _tests(_successes(runs), reference, _wins)}
    for measure in map(EPISODE_MEASURES.__getitem__, TESTED):
        values = numbers(runs, measure)
        columns[measure.title] = _tests(values, reference, partial(_shift, measure))
    rows = tuple(
        (code(other), *(column.get(other, "–") for column in columns.values()))
        for other in others
    )
    note = (
        f"{code(reference)} against each other policy on the same doors and seeds. "
        f"Success: doors that only one of the two opened ({code(reference)} : other). "
        f"Numbers: {code(reference)} minus the other on doors that both opened, after "
        "Hodges and Lehmann; – where there is none. Both are tested by Wilcoxon's "
        "signed ranks of the mean difference of each seed, as doors of a seed share "
        "what was learned from. p after Holm for all tests of a column; n seeds."
    )
    return Table(columns=("against", *columns), rows=rows, note=note)


def _tests(
    values: Mapping[str, Mapping[Key, float]],
    reference: str,
    show: Callable[[Pairs], str],
) -> dict[str, str]:
    """Compare the reference with the others; p corrected for all of them."""
    pairs = {
        other: paired(values[reference], values[other])
        for other in values
        if other != reference and values[reference].keys() & values[other].keys()
    }
    corrected = holm([signed_rank(*both.per_seed()) for both in pairs.values()])
    return {
        other: f"{show(both)}\n{_p_text(p)}, n {len(set(both.seeds))}"
        for (other, both), p in zip(pairs.items(), corrected, strict=True)
    }


def _wins(pairs: Pairs) -> str:
    wins = sum(a > b for a, b in zip(pairs.first, pairs.second, strict=True))
    losses = sum(b > a for a, b in zip(pairs.first, pairs.second, strict=True))
    return f"{wins} : {losses}"


def _shift(measure: Measure, pairs: Pairs) -> str:
    typical = shift(*pairs.per_seed()).estimate
    return number_text(typical, measure.digits, signed=True)


def _p_text(p: float) -> str:
    """Write a probability; bold when below 5 %."""
    text = "p < 0.001" if p < 1e-3 else f"p {p:.3f}"
    return f"**{text}**" if p < 0.05 else text
