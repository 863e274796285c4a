"""Results of trials: numbers per seed, contrasts, trials.json, protocol check.

trials.json contains every number of a trial, so that the result files are not needed.
"""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np

from gplfd_experiments.analysis.results.aggregates import interquartile_mean
from gplfd_experiments.analysis.results.measures import (
    EPISODE_MEASURES,
    Runs,
    by_policy,
    grouped,
)
from gplfd_experiments.analysis.results.reading import EpisodeResult, StudyResults
from gplfd_experiments.analysis.results.statistics import (
    Key,
    Pairs,
    Rate,
    Shift,
    mean_shift,
    paired,
    shift,
    success_rate,
)
from gplfd_experiments.episodes.build import demonstrations_hash
from gplfd_experiments.episodes.task import EpisodeTask
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.studies.store import POLICY_ERROR
from gplfd_experiments.studies.trials.plan import named_trials, trial_tasks
from gplfd_experiments.studies.trials.protocol import TIERS, TRIALS, VERSION
from gplfd_experiments.studies.trials.records import Contrast, Side, Trial

FILE: Final = "trials.json"
"""Name of the file of `trial_answers` in the folder of a report."""

Verdict = Literal["shows", "harms", "open"]
"""Better with the idea, worse with the idea, or no significant difference."""

ByLevel = Mapping[str, Mapping[str, Sequence[EpisodeResult]]]
"""Episodes of a trial by policy and level."""

_DIGITS: Final = 5
"""Significant digits in trials.json."""
_LISTED: Final = 3
"""Largest number of tasks that a problem lists."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Answer:
    """The result of a contrast."""

    contrast: Contrast
    shift: Shift | None
    """The measure with the idea minus without it; None without common values."""

    @property
    def verdict(self) -> Verdict:
        """Whether the interval of the difference excludes zero, and its sign."""
        if self.shift is None or self.shift.low <= 0.0 <= self.shift.high:
            return "open"
        less_is_better = EPISODE_MEASURES[self.contrast.measure].better == "less"
        return "shows" if (self.shift.high < 0.0) == less_is_better else "harms"


def of_trials(results: StudyResults) -> dict[str, ByLevel]:
    """Return the episodes of every trial in a study, including errors."""
    found = {name: of_trial(results.episodes, name) for name in TRIALS}
    return {name: own for name, own in found.items() if own}


def of_trial(episodes: Sequence[EpisodeResult], trial: str) -> ByLevel:
    """Return the episodes of a trial by policy and level, including errors."""
    policies = by_policy(one for one in episodes if one.task.trial == trial)
    return {
        policy: grouped(own, lambda one: one.task.level)
        for policy, own in policies.items()
    }


def answered(contrast: Contrast, episodes: ByLevel) -> Answer:
    """Compare both sides of a contrast seed by seed in the episodes of its trial."""
    pairs = contrast_pairs(contrast, episodes)
    if not pairs.seeds:
        return Answer(contrast=contrast, shift=None)
    share = EPISODE_MEASURES[contrast.measure].share
    estimate = mean_shift if share else shift
    return Answer(contrast=contrast, shift=estimate(*pairs.per_seed()))


def contrast_pairs(contrast: Contrast, episodes: ByLevel) -> Pairs:
    """Return the values of both sides of a contrast at their common tasks."""

    def numbers(side: Side) -> dict[Key, float]:
        """Return the measure by seed and door, and by level if levels are pooled."""
        # Levels of a comparison have the same doors.
        return {
            (one.task.seed, f"{'' if side.level else level} {one.task.door}"): value
            for level, own in episodes.get(side.policy, {}).items()
            if side.level in ("", level)
            for one in own
            if (value := _value(one, contrast.measure)) is not None
        }

    return paired(numbers(contrast.having), numbers(contrast.lacking))


def changes(contrast: Contrast, episodes: ByLevel) -> dict[str, int]:
    """Count the doors that a level of a policy gains and forgets against another.

    Gained doors are opened with the idea, but not without it. Forgotten doors are
    opened without it, but not with it. Empty if the sides are not two levels that are
    compared by the opened doors.
    """
    if contrast.measure != "success" or not contrast.lacking.level:
        return {}
    pairs = contrast_pairs(contrast, episodes)
    both = list(zip(pairs.first, pairs.second, strict=True))
    return {
        "gained": sum(having > lacking for having, lacking in both),
        "forgotten": sum(having < lacking for having, lacking in both),
        "opened before": sum(lacking > 0.0 for _, lacking in both),
    }


def summary(episodes: Sequence[EpisodeResult], measure: str) -> Rate | Shift | None:
    """Return a rate, or the typical value of a seed with its 95 % interval."""
    if EPISODE_MEASURES[measure].share:
        outcomes = _by_seed(episodes, measure).items()
        rate = success_rate((seed, bool(one)) for seed, own in outcomes for one in own)
        return rate if rate.trials else None
    means = seed_means(episodes, measure)
    return shift(means, [0.0] * len(means)) if means else None


def seed_means(episodes: Sequence[EpisodeResult], measure: str) -> list[float]:
    """Return the mean of a measure over the episodes of each seed that have it."""
    by_seed = _by_seed(episodes, measure).values()
    return [math.fsum(own) / len(own) for own in by_seed]


def _by_seed(episodes: Sequence[EpisodeResult], measure: str) -> dict[int, list[float]]:
    values: dict[int, list[float]] = {}
    for one in episodes:
        if (value := _value(one, measure)) is not None:
            values.setdefault(one.task.seed, []).append(value)
    return values


def _value(one: EpisodeResult, measure: str) -> float | None:
    """Return a measure of an episode that counts; None if it is missing.

    After an error of the policy, the grasp counts as not kept.
    """
    if not one.counts:
        return None
    if measure == "grasp_kept":
        return float(one.metrics["failure"] not in ("grasp_lost", POLICY_ERROR))
    value = one.number(measure)
    return None if value is None else float(value)


def success_measure(trial: Trial) -> str:
    """Return the success measure of a trial."""
    shares = (one for one in trial.measures if EPISODE_MEASURES[one].share)
    return next(shares, "success")


def deciding_measure(trial: Trial) -> str:
    """Return the first measure of a trial that is not a share."""
    numbers = (name for name in trial.measures if not EPISODE_MEASURES[name].share)
    return next(numbers, trial.measures[0])


def succeeded(one: EpisodeResult) -> bool:
    """Return whether an episode of a trial succeeded by the trial's measure."""
    return bool(_value(one, success_measure(TRIALS[one.task.trial])))


def scores(episodes: Iterable[EpisodeResult], measure: str) -> dict[str, FloatArray]:
    """Return each policy's scores for `aggregates`, at the seeds and doors of all.

    For forces and other measures where less is better, a failed episode counts as worse
    than any number; otherwise doing nothing would be best. Levels with a prior mean are
    excluded, because not all policies accept one.
    """
    less = EPISODE_MEASURES[measure].better == "less"
    own = [one for one in episodes if one.counts and one.task.prior_radius is None]
    places = [(one.task.trial, one.task.level, one.task.door) for one in own]
    seeds, strata = sorted({one.task.seed for one in own}), sorted(set(places))
    found: dict[str, FloatArray] = {}
    for one, place in zip(own, places, strict=True):
        value, score = _value(one, measure), -math.inf
        if value is not None and not (less and not succeeded(one)):
            score = -value if less else value
        empty = np.full((len(seeds), len(strata)), math.nan)
        array = found.setdefault(one.policy, empty)
        array[seeds.index(one.task.seed), strata.index(place)] = score
    return found


def interquartile_mean_in_units(array: FloatArray, measure: str) -> Shift:
    """Return the interquartile mean of scores, in the unit of the measure."""
    found = interquartile_mean(array)
    if EPISODE_MEASURES[measure].better == "more":
        return found
    return Shift(estimate=-found.estimate, low=-found.high, high=-found.low, n=found.n)


def tier_runs(results: StudyResults) -> dict[str, Runs]:
    """Return each tier's episodes of policies that took part in all its levels."""
    found: dict[str, Runs] = {}
    for tier, names in TIERS.items():
        here = (one for one in results.episodes if one.task.trial in names)
        runs = by_policy(o for o in here if o.counts and o.task.prior_radius is None)
        met = {
            policy: {(one.task.trial, one.task.level) for one in own}
            for policy, own in runs.items()
        }
        every = set().union(*met.values())
        if every:
            found[tier] = {one: runs[one] for one in runs if met[one] == every}
    return found


def trial_answers(results: StudyResults) -> dict[str, Any]:
    """Return every number of trials, seed by seed, and every contrast, for JSON."""
    trials: dict[str, Any] = {}
    contrasts: list[dict[str, Any]] = []
    for name, policies in of_trials(results).items():
        trial = TRIALS[name]
        trials[name] = {
            level: {
                policy: {
                    "episodes": len(own),
                    "errors": sum(bool(one.error) for one in own if one.counts),
                    "lost": sum(one.lost for one in own),
                }
                | {
                    measure: _interval(summary(own, measure))
                    | {"seeds": list(map(_rounded, seed_means(own, measure)))}
                    for measure in trial.measures
                }
                for policy, levels in policies.items()
                if (own := levels.get(level))
            }
            for level in trial.levels
        }
        for answer in (answered(contrast, policies) for contrast in trial.contrasts):
            contrasts.append(
                {
                    "idea": answer.contrast.idea,
                    "trial": name,
                    "measure": answer.contrast.measure,
                    "with": str(answer.contrast.having),
                    "without": str(answer.contrast.lacking),
                    **_interval(answer.shift),
                    "verdict": answer.verdict,
                }
                | changes(answer.contrast, policies)
            )
    return {
        "protocol": VERSION,
        "code": sorted({one.code for one in results.episodes if one.task.trial}),
        "trials": trials,
        "contrasts": contrasts,
    }


def _interval(found: Rate | Shift | None) -> dict[str, Any]:
    """Return an estimate and its 95 % interval; None for unknown values."""
    names = ("estimate", "low", "high")
    if found is None:
        return dict.fromkeys(names)
    return {name: _rounded(getattr(found, name)) for name in names}


def _rounded(value: float) -> float | None:
    return float(f"{value:.{_DIGITS}g}") if math.isfinite(value) else None


def protocol_problems(results: StudyResults) -> list[str]:
    """Return what a folder lacks of the protocol, and what deviates from it.

    Every policy must have run at all doors that the protocol draws for the trials in
    which it took part. Its demonstrations must equal those of the protocol to a
    micrometre. All episodes must be from one version of the code.
    """
    trials = [one for one in results.episodes if one.task.trial]
    if not trials:
        return ["there is no episode of a trial; `gplfd trials` makes them"]
    problems = [f"not a result: {reason}" for reason in results.unreadable]

    ran = [one for one in trials if not one.error]
    known = {one.task.demonstrations_key: one.task for one in ran}
    hashes = {shown: demonstrations_hash(task) for shown, task in known.items()}
    if differing := [
        one.task
        for one in ran
        if one.demonstrations != hashes[one.task.demonstrations_key]
    ]:
        problems.append(
            f"{len(differing)} episodes used other demonstrations, or do not state "
            f"which: {_listed(differing)}"
        )

    for policy, own in by_policy(trials).items():
        # Comparison with the episodes that the protocol plans.
        try:
            names = tuple(dict.fromkeys(one.task.trial for one in own))
            planned = trial_tasks(named_trials(names), policies=[policy])
        except ValueError as error:
            problems.append(f"{policy}: {error}")
            continue
        expected = {_draw_of(task): task for task in planned if task.policy == policy}
        found = {_draw_of(one.task) for one in own}
        missing = [task for draw, task in expected.items() if draw not in found]
        strange = [one.task for one in own if _draw_of(one.task) not in expected]
        gone = [one.task for one in own if one.lost]
        for tasks, said in (
            (missing, f"of {len(expected)} are missing"),
            (strange, "are not the protocol's"),
            (gone, "episodes were lost by the machine"),
        ):
            if tasks:
                problems.append(f"{policy}: {len(tasks)} {said}: {_listed(tasks)}")
        made = f"{policy}: they were made by"
        codes = list(dict.fromkeys(one.code for one in own))
        if len(codes) > 1:
            problems.append(f"{made} {len(codes)} versions of the code")
        if edited := [code for code in codes if "with edits" in code]:
            problems.append(f"{made} code with edits ({edited[0]})")
    return problems


def _draw_of(task: EpisodeTask) -> str:
    """Return all fields of a task except its policy."""
    fields = task.definition
    for name in ("policy", "policy_source"):
        fields.pop(name, None)
    return json.dumps(fields, sort_keys=True)


def _listed(tasks: Sequence[EpisodeTask]) -> str:
    first = [f"{one.trial}, {one.level}, {one.door}, seed {one.seed}" for one in tasks]
    more = f"; and {len(first) - _LISTED} more" if len(first) > _LISTED else ""
    return "; ".join(first[:_LISTED]) + more
