"""Results of trials: contrasts, trials.json with all numbers, check of the protocol."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from operator import itemgetter
from statistics import fmean
from typing import Any, Final, Literal

from gplfd_experiments.analysis.results import measures, statistics
from gplfd_experiments.analysis.results.reading import EpisodeResult, StudyResults
from gplfd_experiments.episodes.build import demonstrations_hash
from gplfd_experiments.episodes.task import EpisodeTask
from gplfd_experiments.studies.trials import protocol

FILE: Final = "trials.json"
"""Name of the file of `trial_answers` in the folder of a report."""

Verdict = Literal["shows", "harms", "open"]
"""Better with the idea, worse with the idea, or no significant difference."""

ByLevel = Mapping[str, measures.Runs]
"""Episodes of a trial by level and policy, including errors."""

MEASURES: Final = {
    name: replace(m, if_opened=False, digits=1 if m.unit == "s" else m.digits)
    for name, m in measures.EPISODE_MEASURES.items()
}
"""Measures of episodes by metric; in trials, closed doors have forces too."""

SMALLEST_SHARE: Final = 0.05
"""Smallest difference of shares that counts."""

_RELEVANT: Final[Mapping[str, float]] = {"N": 1.0, "N s": 1.0, "°": 2.0}
"""The same of other measures, by unit."""

_DIGITS, _LISTED = 8, 3
"""Significant digits in trials.json; largest number of tasks that a problem lists."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Answer:
    """The result of a contrast."""

    contrast: protocol.Contrast
    shift: statistics.Shift | None
    """The measure with the idea minus without it; None without common values."""
    p_value: float
    """Of signed ranks; `answers_by_trial` corrects it for all contrasts of a track."""
    changes: Mapping[str, int]
    """Number of doors that are opened with the idea only ("gained"), without it only
    ("forgotten"), and without it ("opened before"). Empty if the sides are not two
    levels that are compared by the opened doors."""

    @property
    def verdict(self) -> Verdict:
        """Whether the difference is significant and large enough, and its sign."""
        measure = MEASURES[self.contrast.measure]
        relevant = SMALLEST_SHARE if measure.share else _RELEVANT.get(measure.unit, 0.0)
        if (
            self.shift is None
            or self.p_value > 0.05
            or abs(self.shift.estimate) < relevant
        ):
            return "open"
        return "shows" if measure.sign * self.shift.estimate > 0.0 else "harms"


def of_trials(results: StudyResults) -> dict[str, ByLevel]:
    """Return the episodes of every trial in a study, levels in the trial's order."""
    trials: dict[str, ByLevel] = {}
    ran = measures.grouped(results.episodes, "task.trial")
    for name in (name for name in protocol.TRIALS if name in ran):
        levels = measures.grouped(ran[name], "task.level")
        order = dict.fromkeys((*protocol.TRIALS[name].levels, *levels))
        trials[name] = {
            level: measures.grouped(levels[level], "policy")
            for level in order
            if level in levels
        }
    return trials


def answered(contrast: protocol.Contrast, levels: ByLevel) -> Answer:
    """Compare both sides of a contrast seed by seed in the episodes of its trial."""
    measure = MEASURES[contrast.measure]
    # By seed, level if levels are pooled, and door: compared ones have the same doors.
    having, lacking = (
        {
            (e.task.seed, "" if side.level else level, e.task.door): value
            for level, runs in levels.items()
            if side.level in ("", level)
            for e in runs.get(side.policy, ())
            if (value := measure.of(e)) is not None
        }
        for side in (contrast.having, contrast.lacking)
    )
    # Levels have equal weights, whatever their numbers of doors.
    both = sorted(having.keys() & lacking.keys())
    groups = [[*doors] for _, doors in itertools.groupby(both, itemgetter(0, 1))]
    means = statistics.paired(
        *(
            {doors[0][:2]: fmean(values[door] for door in doors) for doors in groups}
            for values in (having, lacking)
        )
    )
    difference, p_value = None, 1.0
    if means[0]:
        p_value = statistics.signed_rank(*means)
        compare = statistics.mean_shift if measure.share else statistics.shift
        difference = compare(*means)
    changes: dict[str, int] = {}
    if contrast.measure == "success" and contrast.lacking.level:
        changes = {
            "gained": sum(having[door] > lacking[door] for door in both),
            "forgotten": sum(having[door] < lacking[door] for door in both),
            "opened before": sum(lacking[door] > 0.0 for door in both),
        }
    return Answer(contrast=contrast, shift=difference, p_value=p_value, changes=changes)


def answers_by_trial(ran: Mapping[str, ByLevel]) -> dict[str, list[Answer]]:
    """Compare the sides of all contrasts that were run, by trial.

    Holm corrects p-values for all contrasts of a track; a trial in two tracks counts in
    the second, whose policies lack the ideas.
    """
    family = {t: track for track, of in protocol.TRACKS.items() for t in of.trials}
    by_track: dict[str, list[tuple[str, Answer]]] = {}
    for name, levels in ran.items():
        sides = {
            protocol.Side(policy=policy, level=at)
            for level, runs in levels.items()
            for policy in runs
            for at in ("", level)
        }
        by_track.setdefault(family[name], []).extend(
            (name, answered(contrast, levels))
            for contrast in protocol.TRIALS[name].contrasts
            if {contrast.having, contrast.lacking} <= sides
        )
    answers: dict[str, list[Answer]] = {name: [] for name in ran}
    for group in by_track.values():
        corrected = statistics.holm([answer.p_value for _, answer in group])
        for (name, answer), p_value in zip(group, corrected, strict=True):
            answers[name].append(replace(answer, p_value=p_value))
    return answers


def success_measure(trial: protocol.Trial) -> str:
    """Return the success measure of a trial."""
    shares = (name for name in trial.measures if MEASURES[name].share)
    return next(shares, "success")


def trial_answers(results: StudyResults) -> dict[str, Any]:
    """Return every number of trials, seed by seed, and every contrast, for JSON."""

    def rounded(*values: float) -> list[float | None]:
        """Return numbers with few digits; None for those that are unknown."""
        return [float(f"{v:.{_DIGITS}g}") if math.isfinite(v) else None for v in values]

    def interval(estimate: statistics.Estimate | None) -> dict[str, Any]:
        """Return an estimate and its 95 % interval."""
        ends = ("estimate", "low", "high")
        numbers = rounded(*(getattr(estimate, end, math.nan) for end in ends))
        return dict(zip(ends, numbers, strict=True))

    def measured(name: str, episodes: Sequence[EpisodeResult]) -> dict[str, Any]:
        measure = MEASURES[name]
        means = measure.seed_means(episodes)
        seeds = dict(zip(map(str, means), rounded(*means.values()), strict=True))
        return interval(measure.typical(episodes)) | {"seeds": seeds}

    trials: dict[str, Any] = {}
    contrasts: list[dict[str, Any]] = []
    ran = of_trials(results)
    answers = answers_by_trial(ran)
    for name, levels in ran.items():
        trial = protocol.TRIALS[name]
        trials[name] = {
            level: {
                policy: {
                    "episodes": len(episodes),
                    "errors": sum(bool(e.error) for e in episodes if e.counts),
                    "lost": sum(e.lost for e in episodes),
                    **{m: measured(m, episodes) for m in trial.measures},
                }
                for policy, episodes in levels.get(level, {}).items()
            }
            for level in trial.levels
        }
        for answer in answers[name]:
            contrast = answer.contrast
            contrasts.append(
                {
                    "idea": contrast.idea,
                    "trial": name,
                    "measure": contrast.measure,
                    "with": str(contrast.having),
                    "without": str(contrast.lacking),
                    **interval(answer.shift),
                    "p": rounded(answer.p_value)[0],
                    "verdict": answer.verdict,
                    **answer.changes,
                }
            )
    return {
        "protocol": protocol.VERSION,
        "code": sorted({e.code for e in results.episodes if e.task.trial}),
        "trials": trials,
        "contrasts": contrasts,
    }


def protocol_problems(results: StudyResults) -> list[str]:
    """Return what a folder lacks of the protocol, and what deviates from it.

    Every policy must have run at all doors that the protocol draws for the trials in
    which it took part. Its demonstrations must equal those of the protocol to a
    micrometre. All episodes must be from one version of the code.
    """
    trials = [episode for episode in results.episodes if episode.task.trial]
    if not trials:
        return ["there is no episode of a trial; `gplfd trials` makes them"]
    problems = [f"not a result: {reason}" for reason in results.unreadable]

    def check(deviating: Sequence[EpisodeTask], text: str, who: str = "") -> None:
        texts = [f"{t.trial}, {t.level}, {t.door}, seed {t.seed}" for t in deviating]
        if len(deviating) > _LISTED:
            texts[_LISTED:] = [f"and {len(deviating) - _LISTED} more"]
        if deviating:
            problems.append(f"{who}{len(deviating)} {text}: {'; '.join(texts)}")

    ran = [episode for episode in trials if not episode.error]
    taught = {episode.task.demonstrations_key: episode.task for episode in ran}
    hashes = {key: demonstrations_hash(task) for key, task in taught.items()}
    differing = [
        episode.task
        for episode in ran
        if episode.demonstrations != hashes[episode.task.demonstrations_key]
    ]
    check(differing, "episodes used other demonstrations, or do not state which")
    for policy, episodes in measures.grouped(trials, "policy").items():
        # Comparison with the episodes that the protocol plans.
        names = tuple(dict.fromkeys(episode.task.trial for episode in episodes))
        try:
            tasks = protocol.trial_tasks(protocol.named_trials(names), only=[policy])
        except ValueError as error:
            problems.append(f"{policy}: {error}")
            continue
        planned = {replace(t, policy="", policy_source=None).key: t for t in tasks}
        drawn = {episode.pair: episode.task for episode in episodes}
        missing = [task for draw, task in planned.items() if draw not in drawn]
        strange = [task for draw, task in drawn.items() if draw not in planned]
        lost = [episode.task for episode in episodes if episode.lost]
        who = f"{policy}: "
        check(missing, f"of {len(planned)} are missing", who)
        check(strange, "are not the protocol's", who)
        check(lost, "episodes were lost by the machine", who)
        made = f"{policy}: they were made by"
        codes = list(dict.fromkeys(episode.code for episode in episodes))
        if len(codes) > 1:
            problems.append(f"{made} {len(codes)} versions of the code")
        if edited := [code for code in codes if "with edits" in code]:
            problems.append(f"{made} code with edits ({edited[0]})")
    return problems
