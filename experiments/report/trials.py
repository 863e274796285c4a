"""A section per trial: the question, who answers it, and which ideas show."""

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Final

from gplfd.experiments.files.table import Table
from gplfd.experiments.report.document import (
    Block,
    Items,
    Paragraph,
    Picture,
    Section,
    code,
)
from gplfd.experiments.report.recordings import trial_recording
from gplfd.experiments.report.trial_plots import deciding_numbers, ideas, kind_of
from gplfd.experiments.results.grouping import Runs
from gplfd.experiments.results.measures import number_text
from gplfd.experiments.results.records import EpisodeResult
from gplfd.experiments.results.statistics import Rate, Shift
from gplfd.experiments.results.trials import (
    SHARES,
    Answer,
    answered,
    of_trial,
    summary,
)
from gplfd.experiments.trials.protocol import TRIALS, VERSION
from gplfd.experiments.trials.records import MEASURES, Trial

Levels = Mapping[str, Sequence[EpisodeResult]]

_VERDICTS: Final = {
    "shows": "**shows**",
    "harms": "does\N{NO-BREAK SPACE}harm",
    "open": "not\N{NO-BREAK SPACE}shown",
}


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
                    *_trial(name, own, answers[name], reference),
                    *trial_recording(study, page, name),
                ),
            )
            for name, own in held.items()
        ),
    )


def _together(answers: Mapping[str, Sequence[Answer]]) -> Iterable[str]:
    """Say of policies that lack an idea in several trials who is better where."""
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
        places = {verdict: ", ".join(trials.get(verdict, ())) for verdict in _VERDICTS}
        better = f"better in {places['shows']}" if places["shows"] else "better nowhere"
        worse = f"worse in {places['harms']}" if places["harms"] else "worse nowhere"
        dominated = not places["shows"] and places["harms"]
        verdict = ": **dominated**" if dominated else ""
        yield (
            f"{idea}: than {code(lacking)} without it, the policy that has it is "
            f"{better} and {worse}{verdict}; undecided: "
            f"{', '.join(undecided) or 'none'}."
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
    if together := tuple(_together(answers)):
        yield Items(texts=together)
    yield Table(
        columns=("idea", "trial", "measure", "with : without", "difference", ""),
        rows=tuple(sorted(rows)),
        note=note,
        left=True,
    )
    if any(answer.shift for own in answers.values() for answer in own):
        yield Picture(
            name="trials_ideas",
            draw=partial(ideas, answers),
            caption="**What an idea is worth:** in brackets who lacks it; a point per "
            "difference, a line through its 95 % interval (from six seeds on). To the "
            "right of zero the idea helps, whether more or less is better.",
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
        note="Ordered by the first measure. Shares: of episodes, with clustered Wilson "
        "intervals. Others: typical value of a seed, with its 95 % interval.",
    )
    yield _picture(name, levels, reference)
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


def _picture(name: str, levels: Mapping[str, Runs], reference: str) -> Picture:
    measure = TRIALS[name].measures[0]
    title, better = MEASURES[measure]
    return Picture(
        name=f"trial_{name}",
        draw=partial(deciding_numbers, levels, measure, reference),
        caption=f"**{title[0].upper()}{title[1:]},** what decides this trial ({better} "
        "is better), in the order of the table. A pale dot per seed, larger where "
        "several are alike; a mark at the share or the typical value, a line through "
        "its 95 % interval (of what is no share, from six seeds on). "
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
    """Sort by the measures in order, the best first; without a number last."""
    ranks = []
    for measure in measures:
        found = summary(episodes, measure)
        value = math.nan if found is None else found.estimate
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
