"""A section per trial: the question, who answers it, and which ideas show."""

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Final

from gplfd_experiments.analysis.report.document import (
    Block,
    Items,
    Paragraph,
    Picture,
    Section,
    code,
)
from gplfd_experiments.analysis.report.recordings import trial_recording
from gplfd_experiments.analysis.report.trial_plots import (
    deciding_numbers,
    ideas,
    kind_of,
)
from gplfd_experiments.analysis.results.grouping import Runs
from gplfd_experiments.analysis.results.measures import number_text
from gplfd_experiments.analysis.results.records import EpisodeResult
from gplfd_experiments.analysis.results.statistics import Rate, Shift
from gplfd_experiments.analysis.results.trials import (
    SHARES,
    Answer,
    answered,
    of_trial,
    summary,
)
from gplfd_experiments.files.table import Table
from gplfd_experiments.studies.trials.protocol import SEEDS, TRIALS, VERSION
from gplfd_experiments.studies.trials.records import MEASURES, Side, Trial

Levels = Mapping[str, Sequence[EpisodeResult]]

_VERDICTS: Final = {
    "shows": "**better with it**",
    "harms": "worse with it",
    "open": "no significant difference",
}
"""How an idea did in a contrast."""


def trial_sections(
    episodes: Iterable[EpisodeResult], study: Path, page: Path, reference: str
) -> tuple[Section, ...]:
    """Return what trials answer: first all ideas together, then trial after trial.

    Args:
        episodes: Of a study.
        study: Its folder, for links to recordings.
        page: Folder in which the page will be.
        reference: Policy that is highlighted.
    """
    every = list(episodes)
    found = {name: of_trial(every, name) for name in TRIALS}
    held = {name: own for name, own in found.items() if own}
    if not held:
        return ()
    answers = {
        name: [
            answered(contrast, own)
            for contrast in TRIALS[name].contrasts
            if _ran(contrast.having, own) and _ran(contrast.lacking, own)
        ]
        for name, own in held.items()
    }
    asked = sum(len(TRIALS[name].contrasts) for name in held)
    left_out = asked - sum(map(len, answers.values()))
    blocks = (*_extent(held, left_out), *_ideas(answers))
    return (
        Section(title="What each idea is worth", anchor="ideas", blocks=blocks),
        *(
            Section(
                title=f"Trial: {name}",
                anchor=f"trial-{name}",
                blocks=(
                    *_trial(name, own, answers[name], reference),
                    *trial_recording(study, page, name),
                ),
            )
            for name, own in held.items()
        ),
    )


def _ran(side: Side, policies: Mapping[str, Levels]) -> bool:
    """Whether a side of a contrast has episodes."""
    levels = policies.get(side.policy, {})
    return bool(levels.get(side.level) if side.level else levels)


def _extent(
    trials: Mapping[str, Mapping[str, Levels]], left_out: int
) -> Iterable[Paragraph]:
    """Say which part of the protocol these results are."""
    seeds = {
        one.task.seed
        for policies in trials.values()
        for levels in policies.values()
        for own in levels.values()
        for one in own
    }
    text = f"Protocol v{VERSION}, {len(trials)} of {len(TRIALS)} trials."
    if left_out:
        text += f" {left_out} of its contrasts were not run and are not listed."
    yield Paragraph(text=text)
    if len(seeds) < SEEDS:
        text = (
            f"A first look: {len(seeds)} of the {SEEDS} seeds with which the protocol "
            "decides. `gplfd trials --part ideas` runs all of them."
        )
        yield Paragraph(text=text, warning=True)


def _together(answers: Mapping[str, Sequence[Answer]]) -> Iterable[str]:
    """Summarise the contrasts with a policy that takes part in several trials."""
    asked: dict[tuple[str, str], dict[str, dict[str, None]]] = {}
    for trial, own in answers.items():
        for one in own:
            if one.contrast.having.policy != one.contrast.lacking.policy:
                pair = one.contrast.idea, one.contrast.lacking.policy
                asked.setdefault(pair, {}).setdefault(one.verdict, {})[trial] = None
    for (idea, lacking), trials in asked.items():
        decided = {*trials.get("shows", ()), *trials.get("harms", ())}
        undecided = [one for one in trials.get("open", ()) if one not in decided]
        if len(decided) + len(undecided) < 2:
            continue
        subject = f"**{idea[0].upper()}{idea[1:]}:**"
        if not decided:
            yield (
                f"{subject} no significant difference to {code(lacking)} "
                f"({', '.join(undecided)})."
            )
            continue
        found = [
            f"{said} in {', '.join(places)}"
            for said, places in (
                ("better", trials.get("shows", ())),
                ("worse", trials.get("harms", ())),
                ("no significant difference", undecided),
            )
            if places
        ]
        never = "" if trials.get("shows") else " **It is better in no trial.**"
        yield f"{subject} compared with {code(lacking)}, {'; '.join(found)}.{never}"


def _ideas(answers: Mapping[str, Sequence[Answer]]) -> Iterable[Block]:
    rows = tuple(
        (
            answer.contrast.idea,
            trial,
            MEASURES[answer.contrast.measure][0],
            f"{answer.contrast.having} : {answer.contrast.lacking}",
            _difference(answer),
            _result(answer),
        )
        for trial, own in answers.items()
        for answer in own
    )
    note = (
        "**Difference:** the policy with the idea minus the one without it, which is "
        "equal in everything else, seed by seed, with the 95 % interval "
        "(Hodges-Lehmann; of shares, mean and Student's). **Result:** better or worse "
        "with the idea where the interval excludes zero (the protocol says that the "
        "idea shows, or does harm)."
    )
    if together := tuple(_together(answers)):
        yield Items(texts=together)
    if not rows:
        yield Paragraph(text="No contrast has both of its policies in these results.")
        return
    yield Table(
        columns=("idea", "trial", "measure", "with : without", "difference", "result"),
        rows=tuple(sorted(rows)),
        note=note,
        left=True,
    )
    if any(answer.shift for own in answers.values() for answer in own):
        yield Picture(
            name="trials_ideas",
            draw=partial(ideas, answers),
            caption="**Differences with and without an idea:** in brackets the policy "
            "without it; a point per difference, a line through its 95 % interval "
            "(from six seeds on). Right of zero is better with the idea, whether more "
            "or less of the measure is better.",
            alternative="Differences of all contrasts, a panel per measure",
        )


def _trial(
    name: str,
    policies: Mapping[str, Levels],
    answers: Sequence[Answer],
    reference: str,
) -> Iterable[Block]:
    trial = TRIALS[name]
    levels = _ordered(trial, policies)
    yield Paragraph(text=f"{trial.question} Tests: {', '.join(trial.claims)}.")
    yield Table(
        columns=("policy", *(MEASURES[name][0] for name in trial.measures)),
        rows=tuple(_rows(trial, levels)),
        note="Ordered by the first measure; policies that opened no door come last. "
        "Shares: of episodes, with clustered Wilson "
        "intervals. Others: typical value of a seed, with its 95 % interval.",
    )
    yield _picture(name, levels, reference)
    if answers:
        yield Items(
            texts=tuple(
                f"{answer.contrast.idea}: {code(answer.contrast.having)} against "
                f"{code(answer.contrast.lacking)}, "
                f"{MEASURES[answer.contrast.measure][0]} {_difference(answer)}: "
                f"{_result(answer)}."
                for answer in answers
            )
        )


def _picture(name: str, levels: Mapping[str, Runs], reference: str) -> Picture:
    measure = TRIALS[name].measures[0]
    title, better = MEASURES[measure]
    return Picture(
        name=f"trial_{name}",
        draw=partial(deciding_numbers, levels, measure, reference),
        caption=f"**{title[0].upper()}{title[1:]}** decides this trial ({better} is "
        "better). Order as in the table. A pale dot per seed, larger where several are "
        "equal; a mark at the share or the typical value, a line through its 95 % "
        "interval (for values that are not shares, from six seeds on). "
        f"Bold: {code(reference)}.",
        alternative=f"{title}, a row per policy",
    )


def _ordered(trial: Trial, policies: Mapping[str, Levels]) -> dict[str, Runs]:
    """Return a trial's episodes by level and policy, the best first."""
    found = {}
    for level in trial.levels:
        here = {
            policy: own
            for policy, levels in policies.items()
            if (own := levels.get(level))
        }
        order = sorted(here, key=lambda one: _rank(here[one], trial.measures))
        found[level] = {policy: here[policy] for policy in order}
    return {level: own for level, own in found.items() if own}


def _rows(trial: Trial, levels: Mapping[str, Runs]) -> Iterable[tuple[str, ...]]:
    for level, own in levels.items():
        if len(trial.levels) > 1:
            yield (f"**{level}**", *("" for _ in trial.measures))
        for policy, episodes in own.items():
            errors = sum(bool(one.error) for one in episodes)
            kind = kind_of(policy)
            name = code(policy) if kind == "method" else f"{code(policy)} ({kind})"
            yield (
                f"{name}\nerrors: {errors}" if errors else name,
                *(_cell(episodes, measure) for measure in trial.measures),
            )


def _rank(episodes: Sequence[EpisodeResult], measures: Sequence[str]) -> list[float]:
    """Sort by the measures in order, the best first; without a number last.

    Policies that opened no door come last: their small forces are not comparable.
    """
    opened = summary(episodes, "success") if "success" in measures else None
    ranks = [0.0 if opened is None or opened.estimate > 0.0 else 1.0]
    for measure in measures:
        found = summary(episodes, measure)
        value = math.nan if found is None else found.estimate
        sign = 1.0 if MEASURES[measure][1] == "less" else -1.0
        ranks.append(math.inf if math.isnan(value) else sign * value)
    return ranks


def _cell(episodes: Sequence[EpisodeResult], measure: str) -> str:
    found = summary(episodes, measure)
    if found is None:
        return "no value"
    if isinstance(found, Rate):
        return f"{found.successes}/{found.trials}\n{found.interval}"
    digits = _digits(measure)
    return f"{number_text(found.estimate, digits)}\n{_interval(found, digits)}".strip()


def _result(answer: Answer) -> str:
    if answer.shift is None:
        return "no value in common"
    if math.isinf(answer.shift.low):
        return "too few seeds for an interval"
    return _VERDICTS[answer.verdict]


def _difference(answer: Answer) -> str:
    found = answer.shift
    if found is None:
        return "–"
    digits = max(_digits(answer.contrast.measure), _telling_digits(found))
    estimate = number_text(found.estimate, digits, signed=True)
    interval = _interval(found, digits)
    return f"{estimate} ({interval})" if interval else estimate


def _interval(found: Shift, digits: int) -> str:
    if math.isinf(found.low):
        return ""  # Too few seeds.
    return " to ".join(number_text(end, digits) for end in (found.low, found.high))


def _telling_digits(found: Shift) -> int:
    """Return after how many decimals the ends of an interval differ from zero."""
    ends = [abs(end) for end in (found.low, found.high) if 0.0 < abs(end) < math.inf]
    return min(max(-math.floor(math.log10(min(ends))), 0), 3) if ends else 0


def _digits(measure: str) -> int:
    return 2 if measure in SHARES or measure == "release_speed" else 1
