"""Does a ranking survive other draws? python benchmarks/robustness.py FOLDER.

The track *learner* of the protocol again, under the variants of robustness.toml.
Learners are ranked by opened doors and by the radial force that lasts for 20 ms; ranks
are compared by Kendall's tau. Writes docs/results/robustness.json.
"""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import fmean, median
from typing import Any, Final

import tyro
from scipy.stats import kendalltau

from gplfd_experiments.analysis.results.reading import EpisodeResult, read_results
from gplfd_experiments.episodes.task import EpisodeTask
from gplfd_experiments.files.folders import folder_in_use
from gplfd_experiments.files.plain_data import write_json
from gplfd_experiments.files.provenance import code_state
from gplfd_experiments.studies.engines import Engine
from gplfd_experiments.studies.runner import run_or_resume
from gplfd_experiments.studies.trials.protocol import (
    REFERENCES,
    TRACKS,
    named_trials,
    trial_tasks,
)
from gplfd_policies.registry.built_in import SPACES, tuned_settings
from gplfd_policies.registry.catalogue import split_name

STORED: Final = Path(__file__).parents[1] / "docs/results/robustness.json"
FORCE: Final = "force_radial_20ms"
VARIANTS: Final = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
"""What differs from the track, by the name of the variant."""


def tasks_of(name: str, seeds: int) -> list[EpisodeTask]:
    """Return the episodes of a variant."""
    arguments, policies = dict(VARIANTS[name]), list(TRACKS["learner"].policies)
    draws = arguments.pop("draws", {})
    if arguments.pop("unchanged", ""):
        best = tuned_settings()
        policies = [f"{p}@tuned" for p in best if best[p] != SPACES[p].published]
    trials = named_trials(TRACKS["learner"].trials)
    tasks = trial_tasks(trials, only=policies, seeds=seeds, **arguments)
    before: list[Any] = [task.randomization for task in tasks]
    drawn = [draws | ({} if each == "none" else each) or "none" for each in before]
    return [
        replace(task, randomization=each)
        for task, each in zip(tasks, drawn, strict=True)
        if task.prior_radius is None
    ]


def numbers_of(episodes: Sequence[EpisodeResult]) -> dict[str, dict[str, float]]:
    """Return opened doors, trials weighted equally, and median force [N], by policy."""
    numbers: dict[str, dict[str, float]] = {}
    for policy in TRACKS["learner"].policies:
        trials: dict[str, dict[str, list[bool]]] = {}
        ran = [e for e in episodes if split_name(e.policy)[0] == policy and e.counts]
        for episode in ran:
            levels = trials.setdefault(episode.task.trial, {})
            levels.setdefault(episode.task.level, []).append(episode.solved)
        if ran:
            forces = [episode.metrics[FORCE] for episode in ran if episode.solved]
            shares = [fmean(map(fmean, levels.values())) for levels in trials.values()]
            numbers[policy] = {"success": fmean(shares), FORCE: median(forces)}
    return numbers


def agreement(
    first: Mapping[str, Mapping[str, float]], second: Mapping[str, Mapping[str, float]]
) -> dict[str, float | None]:
    """Return Kendall's tau-b over learners by measure; None where all are equal."""
    learners = [p for p in first if p in second and p not in REFERENCES]
    taus: dict[str, float | None] = {}
    for measure in ("success", FORCE):
        ranks = [[numbers[p][measure] for p in learners] for numbers in (first, second)]
        tau = float(kendalltau(*ranks).statistic)
        taus[measure] = tau if tau == tau else None  # not a number
    return taus


def main(folder: tyro.conf.Positional[Path], *, seeds: int = 20) -> None:
    """Run or resume the variants in FOLDER, and store and print the numbers."""
    numbers: dict[str, dict[str, dict[str, float]]] = {}
    for name in VARIANTS:
        tasks = tasks_of(name, seeds)
        with folder_in_use(folder / name.replace(",", "").replace(" ", "-")) as used:
            run_or_resume(tasks, {"command": "robustness"}, used, Engine())
            keys = {task.key for task in tasks}
            episodes = read_results(used).episodes
        ran = numbers_of([e for e in episodes if e.task.key in keys])
        numbers[name] = numbers.get(VARIANTS[name].get("unchanged"), {}) | ran
    first, *others = numbers
    taus = {name: agreement(numbers[first], numbers[name]) for name in others}
    content = {**code_state(), "seeds": seeds, "numbers": numbers, "kendall": taus}
    write_json(STORED, content)
    print(taus)


if __name__ == "__main__":
    tyro.cli(main)
