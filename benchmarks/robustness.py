"""Does a ranking survive other draws? python benchmarks/robustness.py FOLDER.

The track *learner* of the protocol again: with fresh seeds, with demonstrations of a
second synthetic human, and with another arm. Learners are ranked by the share of opened
doors and by the radial force that lasts for 20 ms; ranks are compared with those that
the seeds of the protocol give, by Kendall's tau. Writes docs/results/robustness.json.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import fmean, median
from typing import Any, Final

import tyro
from scipy.stats import kendalltau

from gplfd_experiments.analysis.results.reading import EpisodeResult, read_results
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

STORED: Final = Path(__file__).parents[1] / "docs/results/robustness.json"
FORCE: Final = "force_radial_20ms"
VARIANTS: Final[Mapping[str, Mapping[str, Any]]] = {
    "seeds of the protocol": {},
    "fresh seeds": {"first_seed": 120},
    "second synthetic human": {"taught_by": "second"},
    "another arm": {"robot": "panda-like"},
}
"""Arguments of `trial_tasks`."""


def numbers_of(episodes: Sequence[EpisodeResult]) -> dict[str, dict[str, float]]:
    """Return the share of opened doors, and the median force [N], by policy."""
    numbers: dict[str, dict[str, float]] = {}
    for policy in TRACKS["learner"].policies:
        by_level: dict[tuple[str, str], list[EpisodeResult]] = {}
        for episode in episodes:
            if episode.policy == policy and episode.counts:
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
    trials = named_trials(TRACKS["learner"].trials)
    numbers: dict[str, dict[str, dict[str, float]]] = {}
    for name, variant in VARIANTS.items():
        tasks = [
            task
            for task in trial_tasks(
                trials, only=TRACKS["learner"].policies, seeds=seeds, **variant
            )
            if task.prior_radius is None
        ]
        with folder_in_use(folder / name.replace(" ", "-")) as used:
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
