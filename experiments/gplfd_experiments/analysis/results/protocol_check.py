"""Whether a folder of results follows the frozen protocol of trials."""

import json
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Final

from gplfd_experiments.analysis.results.grouping import by_policy
from gplfd_experiments.analysis.results.records import EpisodeResult, StudyResults
from gplfd_experiments.episodes.build import demonstrations_hash
from gplfd_experiments.episodes.task import EpisodeTask
from gplfd_experiments.studies.trials.plan import named_trials, trial_tasks

_SHOWN: Final = 3


def protocol_problems(results: StudyResults) -> list[str]:
    """Say what a folder lacks of the protocol, and what in it is not the protocol's.

    Every policy must have opened all doors of every trial in which it took part, as
    the protocol draws them, after demonstrations that are the protocol's to a
    micrometre, by one version of the code.
    """
    trials = [one for one in results.episodes if one.task.trial]
    if not trials:
        return ["there is no episode of a trial; `gplfd trials` makes them"]
    problems = [f"not a result: {reason}" for reason in results.unreadable]

    ran = [one for one in trials if not one.error]
    known = {one.task.shown: one.task for one in ran}
    hashes = {shown: demonstrations_hash(task) for shown, task in known.items()}
    if differing := [
        one.task for one in ran if one.demonstrations != hashes[one.task.shown]
    ]:
        problems.append(
            f"{len(differing)} episodes were learned from other demonstrations, or do "
            f"not say from which: {_list(differing)}"
        )

    for policy, own in by_policy(trials).items():
        problems += [f"{policy}: {problem}" for problem in _of_policy(policy, own)]
    return problems


def _of_policy(policy: str, own: Sequence[EpisodeResult]) -> Iterator[str]:
    """Compare the episodes of a policy with those that the protocol plans."""
    names = tuple(dict.fromkeys(one.task.trial for one in own))
    try:
        planned = trial_tasks(named_trials(names), policies=[policy])
    except ValueError as error:
        yield str(error)
        return
    expected = {_draw(task): task for task in planned if task.policy == policy}
    found = {_draw(one.task) for one in own}
    if missing := [task for draw, task in expected.items() if draw not in found]:
        yield f"{len(missing)} of {len(expected)} are missing: {_list(missing)}"
    if strange := [one.task for one in own if _draw(one.task) not in expected]:
        yield f"{len(strange)} are not the protocol's: {_list(strange)}"
    if gone := [one.task for one in own if one.lost]:
        yield f"{len(gone)} episodes were lost by the machine: {_list(gone)}"
    codes = Counter(one.code for one in own)
    if len(codes) > 1:
        yield f"they were made by {len(codes)} versions of the code"
    if edited := [code for code in codes if "with edits" in code]:
        yield f"they were made by code with edits ({edited[0]})"


def _draw(task: EpisodeTask) -> str:
    """Return all fields of a task except those of its policy."""
    fields = task.definition
    for name in ("policy", "policy_source"):
        fields.pop(name, None)
    return json.dumps(fields, sort_keys=True)


def _list(tasks: Sequence[EpisodeTask]) -> str:
    first = [f"{one.trial}, {one.level}, {one.door}, seed {one.seed}" for one in tasks]
    more = f"; and {len(first) - _SHOWN} more" if len(first) > _SHOWN else ""
    return "; ".join(first[:_SHOWN]) + more
