"""Does a ranking survive other draws? python benchmarks/robustness.py FOLDER.

The track *learner* of the protocol again: with fresh seeds, with demonstrations of a
second synthetic human, with another arm, with other friction, servo and sensors, and
with tuned settings on the fresh seeds. Learners are ranked by the share of opened
doors and by the radial force that lasts for 20 ms; ranks are compared with those that
the seeds of the protocol give, by Kendall's tau. Writes docs/results/robustness.json.
"""

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
from gplfd_policies.registry.built_in import SPACES
from gplfd_policies.registry.catalogue import split_name

STORED: Final = Path(__file__).parents[1] / "docs/results/robustness.json"
FORCE: Final = "force_radial_20ms"
VARIANTS: Final[Mapping[str, Mapping[str, Any]]] = {
    "seeds of the protocol": {},
    "fresh seeds": {"first_seed": 120},
    "second synthetic human": {"taught_by": "second"},
    "another arm": {"robot": "panda-like"},
    "friction, servo, sensors": {},
    "tuned, fresh seeds": {"first_seed": 120},
}
"""Arguments of `trial_tasks`."""
DRAWS: Final = {
    "hinge_friction": [1.0, 4.0],
    "hinge_damping": [0.5, 2.0],
    "shortest_delay": 1,
    "longest_delay": 1,
    "pose_noise": [0.001, 0.004],
    "wrench_noise": [0.6, 0.04],
}
"""Of other friction, servo and sensors; those of a condition come first."""


def tasks_of(name: str, seeds: int) -> list[EpisodeTask]:
    """Return the episodes of a variant."""
    policies = list(TRACKS["learner"].policies)
    if name.startswith("tuned"):
        policies = [f"{p}@tuned" if p in SPACES else p for p in policies]
    trials, arguments = named_trials(TRACKS["learner"].trials), VARIANTS[name]
    tasks = [
        task
        for task in trial_tasks(trials, only=policies, seeds=seeds, **arguments)
        if task.prior_radius is None
    ]
    if not name.startswith("friction"):
        return tasks
    draws: list[Any] = [task.randomization for task in tasks]
    own = [{} if draw == "none" else draw for draw in draws]
    return [
        replace(task, randomization=DRAWS | each)
        for task, each in zip(tasks, own, strict=True)
    ]


def numbers_of(episodes: Sequence[EpisodeResult]) -> dict[str, dict[str, float]]:
    """Return the share of opened doors, and the median force [N], by policy."""
    numbers: dict[str, dict[str, float]] = {}
    for policy in TRACKS["learner"].policies:
        by_level: dict[tuple[str, str], list[EpisodeResult]] = {}
        for episode in episodes:
            if split_name(episode.policy)[0] == policy and episode.counts:
                place = episode.task.trial, episode.task.level
                by_level.setdefault(place, []).append(episode)
        if by_level:
            levels = by_level.values()
            shares = [fmean(e.solved for e in level) for level in levels]
            forces = [e.metrics[FORCE] for level in levels for e in level if e.solved]
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
        numbers[name] = numbers_of([e for e in episodes if e.task.key in keys])
    first, *others = numbers
    taus = {name: agreement(numbers[first], numbers[name]) for name in others}
    content = {**code_state(), "seeds": seeds, "numbers": numbers, "kendall": taus}
    write_json(STORED, content)
    for name, tau in taus.items():
        print(name, tau)


if __name__ == "__main__":
    tyro.cli(main)
