"""Tune learners and their pipeline with equal budgets on doors and seeds of their own.

``pip install optuna`` and ``python benchmarks/tune.py DIR [LEARNER ...]``. The same
command resumes the evaluations in DIR/tuning.db. DIR/tuned.json has the best settings;
as ``policies/gplfd_policies/registry/tuned.json`` it defines ``<name>@tuned``.

docs/notes/methods.md has the objective, which was fixed before any measurement.
"""

import functools
import statistics
import sys
import warnings
from pathlib import Path
from typing import Any, Final

import numpy as np
import optuna
from scipy.stats import rankdata

from gplfd_experiments.episodes import build
from gplfd_experiments.episodes.metrics import episode_metrics
from gplfd_experiments.episodes.task import episode_task, named_doors
from gplfd_experiments.files.plain_data import write_json
from gplfd_experiments.files.provenance import provenance
from gplfd_experiments.studies.learning_tests import folds
from gplfd_experiments.studies.learning_tests.scores import prediction_scores
from gplfd_policies.registry.built_in import SPACES, Values, tuned

EVALUATIONS: Final = 24  # per learner; the first has the published settings
SEEDS: Final = (1000, 1001, 1002)
DOORS: Final = ("0.46", "wardrobe", "room-584", "barn-door", "oven", "rising-butt")
PER_DOOR: Final = 2  # demonstrations at each demonstrated door
NOISE: Final = {"pose_noise": [0.001, 0.004], "wrench_noise": [0.6, 0.04]}
WORST: Final = 1e100  # for a candidate that raises an error or predicts no density


def proposed(policy: str, trial: optuna.Trial) -> Values:
    """Return the settings of a candidate."""
    values: dict[str, int | float] = {}
    for name, (published, low, high, scale) in SPACES[policy].settings.items():
        whole = isinstance(published, int)
        suggest: Any = trial.suggest_int if whole else trial.suggest_float
        values[name] = suggest(name, low, high, log=scale)
    return values


def objective(policy: str, trial: optuna.Trial) -> tuple[float, float, float]:
    """Return density, number of closed doors, and median radial force [N]."""
    candidate = tuned(policy, proposed(policy, trial))
    assert candidate.method is not None
    densities, tasks = [], []
    shared: Any = {"demonstrations_per_door": PER_DOOR, "randomization": NOISE}
    for seed in SEEDS:
        opened = [
            episode_task(door, config, policy=policy, seed=seed, **shared)
            for door, config in named_doors(DOORS).items()
        ]
        tasks += opened
        demonstrations = build.demonstrations_of(opened[0]).demonstrations
        doors_shown = folds.by_door(demonstrations, PER_DOOR)
        for fold in folds.folds(doors_shown, "demonstration", seed):
            movement, _ = folds.learn(candidate.method, fold.training, seed)
            for demonstration in fold.left_out:
                left_out = folds.aligned_to(demonstration, movement.aligned)
                nlpd = prediction_scores(movement, left_out)["nlpd"]
                densities.append(WORST if nlpd is None else nlpd)
    lessons = {task.training_key: task for task in tasks}
    make = {k: build.learned_agents(task, candidate) for k, task in lessons.items()}
    metrics: list[dict[str, Any]] = []
    for base in {task.base for task in tasks}:  # of the scenes in one lockstep
        together = [task for task in tasks if task.base == base]
        agents = [make[task.training_key]() for task in together]
        metrics += map(episode_metrics, build.open_together(together, agents))
    closed = sum(not episode["success"] for episode in metrics)
    force = statistics.median(episode["force_radial_20ms"] for episode in metrics)
    return float(np.mean(densities)), float(closed), force


def main(folder: Path, policies: tuple[str, ...]) -> None:
    """Evaluate missing candidates and write the best."""
    folder.mkdir(parents=True, exist_ok=True)
    warnings.simplefilter("ignore", UserWarning)
    results = {}
    for policy in policies:
        study = optuna.create_study(
            storage=f"sqlite:///{folder / 'tuning.db'}",
            study_name=policy,
            directions=["minimize"] * 3,
            sampler=optuna.samplers.QMCSampler(scramble=True, seed=1),
            load_if_exists=True,
        )
        if not study.trials:
            study.enqueue_trial(dict(SPACES[policy].published))
        done = sum(trial.state.is_finished() for trial in study.trials)
        study.optimize(
            functools.partial(objective, policy),
            n_trials=max(EVALUATIONS - done, 0),
            catch=(Exception,),
        )
        values = [trial.values or [WORST] * 3 for trial in study.trials]
        tasks = [tuple(numbers[1:]) for numbers in values]
        ranks = rankdata([numbers[0] for numbers in values])
        ranks += rankdata([sorted(set(tasks)).index(task) for task in tasks])
        best = min(range(len(values)), key=lambda k: (ranks[k], tasks[k], k))
        results[policy] = {
            name: {"settings": study.trials[k].params, "values": values[k]}
            for name, k in {"published": 0, "tuned": best}.items()
        }
    write_json(folder / "tuned.json", provenance({}) | {"policies": results})
    print(f"wrote {folder / 'tuned.json'}")


if __name__ == "__main__":
    main(Path(sys.argv[1]), tuple(sys.argv[2:]) or tuple(SPACES))
