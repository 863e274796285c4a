"""A section per trial: the question, who answers it, and which ideas show."""

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Final

from experiments.files.table import Table
from experiments.report.document import Block, Items, Paragraph, Section, code
from experiments.report.recordings import trial_recording
from experiments.results.measures import number_text
from experiments.results.records import EpisodeResult
from experiments.results.statistics import Rate, Shift
from experiments.results.trials import (
    SHARES,
    Answer,
    answered,
    of_trial,
    summary,
)
from experiments.trials.protocol import TRIALS, VERSION
from experiments.trials.records import MEASURES, Trial
from policies.registry import POLICIES

Levels = Mapping[str, Sequence[EpisodeResult]]

_VERDICTS: Final = {"shows": "**shows**", "harms": "does harm", "open": "not shown"}


def trial_sections(
    episodes: Iterable[EpisodeResult], study: Path, page: Path
) -> tuple[Section, ...]:
    """Return what trials answer: first all ideas together, then trial after trial.

    Args:
        episodes: Of a study.
        study: Its folder, for links to recordings.
        page: Folder in which the page will be.
    """
    every = list(episodes)
    found = {name: of_trial(every, name) for name in TRIALS}
    held = {name: own for name, own in found.items() if own}
    if not held:
        return ()
    answers = {
        name: [answered(contrast, own) for contrast in TRIALS[name].contrasts]
        for name, own in held.items()
    }
    return (
        Section(title="Ideas on trial", anchor="ideas", blocks=tuple(_ideas(answers))),
        *(
            Section(
                title=f"Trial: {name}",
                anchor=f"trial-{name}",
                blocks=(
                    *_trial(TRIALS[name], own, answers[name]),
                    *trial_recording(study, page, name),
                ),
            )
            for name, own in held.items()
        ),
    )


def _ideas(answers: Mapping[str, Sequence[Answer]]) -> Iterable[Block]:
    rows = tuple(
        (
            answer.contrast.idea,
            trial,
            MEASURES[answer.contrast.measure][0],
            f"{answer.contrast.having} : {answer.contrast.lacking}",
            _difference(answer),
            _VERDICTS[answer.verdict],
        )
        for trial, own in answers.items()
        for answer in own
    )
    note = (
        "What an idea is worth: the policy that has it minus the one that lacks it and "
        "nothing else, seed by seed, with the 95 % interval of the difference "
        "(Hodges-Lehmann; of shares, mean and Student's). An idea **shows** where the "
        "interval leaves zero out on its side."
    )
    yield Paragraph(text=f"Protocol v{VERSION}.")
    yield Table(
        columns=("idea", "trial", "measure", "with : without", "difference", ""),
        rows=tuple(sorted(rows)),
        note=note,
        left=True,
    )


def _trial(
    trial: Trial, policies: Mapping[str, Levels], answers: Sequence[Answer]
) -> Iterable[Block]:
    yield Paragraph(text=f"{trial.question} Tests: {', '.join(trial.claims)}.")
    yield Table(
        columns=("policy", *(MEASURES[name][0] for name in trial.measures)),
        rows=tuple(_rows(trial, policies)),
        note="Ordered by the first measure. Shares: of episodes, with clustered Wilson "
        "intervals. Others: typical value of a seed, with its 95 % interval.",
    )
    if answers:
        yield Items(
            texts=tuple(
                f"{answer.contrast.idea}: {code(answer.contrast.having)} against "
                f"{code(answer.contrast.lacking)}, "
                f"{MEASURES[answer.contrast.measure][0]} {_difference(answer)}: "
                f"{_VERDICTS[answer.verdict]}."
                for answer in answers
            )
        )


def _rows(trial: Trial, policies: Mapping[str, Levels]) -> Iterable[tuple[str, ...]]:
    for level in trial.levels:
        if len(trial.levels) > 1:
            yield (f"**{level}**", *("" for _ in trial.measures))
        here = {
            policy: own
            for policy, levels in policies.items()
            if (own := levels.get(level))
        }
        for policy in sorted(here, key=lambda one: _rank(here[one], trial.measures)):
            errors = sum(bool(one.error) for one in here[policy])
            kind = POLICIES[policy].kind if policy in POLICIES else "own"
            name = code(policy) if kind == "method" else f"{code(policy)} ({kind})"
            yield (
                f"{name}\nerrors: {errors}" if errors else name,
                *(_cell(here[policy], measure) for measure in trial.measures),
            )


def _rank(episodes: Sequence[EpisodeResult], measures: Sequence[str]) -> list[float]:
    """Sort by the measures in order, the best first; without a number last."""
    ranks = []
    for measure in measures:
        found = summary(episodes, measure)
        value = math.nan
        if isinstance(found, Rate):
            value = found.successes / found.trials
        elif found is not None:
            value = found.estimate
        sign = 1.0 if MEASURES[measure][1] == "less" else -1.0
        ranks.append(math.inf if math.isnan(value) else sign * value)
    return ranks


def _cell(episodes: Sequence[EpisodeResult], measure: str) -> str:
    found = summary(episodes, measure)
    if found is None:
        return "–"
    if isinstance(found, Rate):
        return f"{found.successes}/{found.trials}\n{found.interval}"
    digits = _digits(measure)
    return f"{number_text(found.estimate, digits)}\n{_interval(found, digits)}".strip()


def _difference(answer: Answer) -> str:
    found = answer.shift
    if found is None:
        return "–"
    digits = _digits(answer.contrast.measure)
    estimate = number_text(found.estimate, digits, signed=True)
    interval = _interval(found, digits)
    return f"{estimate} ({interval})" if interval else estimate


def _interval(found: Shift, digits: int) -> str:
    if math.isinf(found.low):
        return ""  # Too few seeds.
    return " to ".join(number_text(end, digits) for end in (found.low, found.high))


def _digits(measure: str) -> int:
    return 2 if measure in SHARES or measure == "release_speed" else 1
