"""Run two policies seed after seed until they are separated."""

import dataclasses
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from gplfd_experiments.analysis.results import sequential
from gplfd_experiments.analysis.results.measures import EPISODE_MEASURES, by_policy
from gplfd_experiments.analysis.results.reading import EpisodeResult, read_files
from gplfd_experiments.analysis.results.trials import contrast_pairs
from gplfd_experiments.console.progress import LOG
from gplfd_experiments.studies.engines import Engine
from gplfd_experiments.studies.runner import run_or_resume
from gplfd_experiments.studies.store import result_path
from gplfd_experiments.studies.trials.plan import named_trials, trial_tasks
from gplfd_experiments.studies.trials.records import Contrast, Side

_FIRST, _STEP = 8, 4
"""Seeds before the first look, the fewest that can separate, and between looks."""


def run_until_separated(
    names: Sequence[str],
    policies: Sequence[str],
    measure: str,
    folder: Path,
    engine: Engine,
    max_seeds: int,
    options: Mapping[str, Any],
) -> tuple[dict[str, Any], int]:
    """Run two policies until they are separated, or up to a number of seeds; resumable.

    The outcome of a seed is the mean over the tasks in which both have the measure.
    Returns the fields of `sequential.Comparison`, ``better`` and ``text``, a summary in
    a line; and the number of errors, which also end the run.
    """
    trials = named_trials(names)
    for name, trial in trials.items():
        if measure not in trial.measures:
            raise ValueError(
                f"--measure {measure} is no measure of trial {name}, which has "
                f"{', '.join(trial.measures)}; choose trials with --trials"
            )
    if len(policies) != 2 or len(set(policies)) != 2 or max_seeds < _FIRST:
        raise ValueError(
            f"--until-separated takes two --policies, got {[*policies]}, and "
            f"--max-seeds of {_FIRST} or more, got {max_seeds}"
        )
    measured = EPISODE_MEASURES[measure]
    if measured.share:
        known = (f"{p} in {sequential.seeds_needed(0.9, p)}" for p in (0.5, 0.7, 0.8))
        LOG.info(f"4 of 5 times, 0.9 is separated from {', '.join(known)} seeds")
    having, lacking = (Side(policy=name) for name in policies)
    contrast = Contrast(idea="", measure=measure, having=having, lacking=lacking)
    for seeds in (*range(_FIRST, max_seeds, _STEP), max_seeds):
        tasks = trial_tasks(trials, only=policies, seeds=seeds)
        errors = run_or_resume(tasks, options, folder, engine)
        found, _ = read_files(result_path(folder, task) for task in tasks)
        runs = by_policy(one for one in found if isinstance(one, EpisodeResult))
        pairs = contrast_pairs(
            contrast, {name: {"": own} for name, own in runs.items()}
        )
        if not pairs.seeds:
            raise ValueError(f"no seed has {measure} of both policies")
        state = sequential.compare(*pairs.per_seed(), shares=measured.share)
        ahead = measured.sign * state.ahead
        better = {1.0: policies[0], -1.0: policies[1]}.get(ahead)
        verdict = f"separated at seed {state.separated_at}, {better} is better"
        text = (
            f"{state.seeds} seeds, {measured.title}: {having} {state.first:.2f}, "
            f"{lacking} {state.second:.2f}; e-value {state.e_value:.3g}: "
            f"{verdict if better else 'not separated (requires 20)'}"
        )
        if errors or better:
            break
        LOG.info(text)
    return {**dataclasses.asdict(state), "better": better, "text": text}, errors
