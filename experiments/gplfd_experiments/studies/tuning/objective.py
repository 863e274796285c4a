"""What makes a candidate good; fixed before anything was measured.

Two numbers, from the seeds and doors of the protocol, which no study uses:

1. *Density*: the mean negative log predictive density of demonstrations left out, two
   per seed, one at a time, as in the learning tests of a study
   (`gplfd_experiments.studies.learning_tests`). A candidate without a density comes
   after all that have one.
2. *Task*: first the number of doors that stayed closed, then the median over all
   episodes of the peak radial force.

Within a method the candidates are ranked by each, equal ones with the mean of their
ranks. The best one has the least mean of both ranks; of several, that of the better
task, and of these the first, which is the method as published. A candidate that ends in
an error is last in both. The ranks of a method say nothing about those of another.

So a method is tuned for neither number alone: densities can be improved by a spread
that makes the hand soft everywhere, and forces by one that is far too wide.
"""

from __future__ import annotations

import math
import statistics
import sys
import time
import traceback
import warnings
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from scipy.stats import rankdata

from gplfd_env.doors.config import DoorConfig
from gplfd_experiments.episodes.build import (
    demonstrations_of,
    learned_agents,
    open_together,
)
from gplfd_experiments.episodes.metrics import episode_metrics
from gplfd_experiments.episodes.task import episode_task
from gplfd_experiments.files.provenance import code_state
from gplfd_experiments.studies.learning_tests.accuracy import accuracy
from gplfd_experiments.studies.learning_tests.folds import aligned_to, folds
from gplfd_experiments.studies.learning_tests.methods import learn
from gplfd_experiments.studies.tuning.candidates import Candidate
from gplfd_policies.arrays.one_thread import one_thread
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.registry.catalogue import tuned
from gplfd_policies.registry.method import Method
from gplfd_policies.registry.policy import Policy

Evaluation = dict[str, Any]
"""What a candidate came to: ``candidate``, ``versions``, ``git``, ``arithmetic``,
``cpu_s``, and ``nlpd`` (None without a density) and ``episodes``, or ``error`` and
``traceback``."""

_SAMPLES: Final = 200
"""Poses of a demonstration left out that are predicted, as in the learning tests."""


def evaluate(candidate: Candidate) -> Evaluation:
    """Try a candidate; whatever goes wrong with it is its result."""
    started = time.process_time()
    with one_thread, warnings.catch_warnings():
        # Of few demonstrations, or a mixture that is still moving: that is measured.
        warnings.simplefilter("ignore", UserWarning)
        try:
            policy = tuned(candidate.policy, candidate.settings)
            outcome = _measured(policy, candidate)
        # Anything: settings with which a method cannot learn are a finding.
        except Exception as error:
            outcome = failed(f"{type(error).__name__}: {error}", traceback.format_exc())
    cpu_s = round(time.process_time() - started, 3)
    return {
        "candidate": candidate.definition,
        **code_state(),
        **outcome,
        "cpu_s": cpu_s,
    }


def failed(reason: str, trace: str = "") -> Evaluation:
    """Return what an evaluation that came to nothing says of it."""
    return {"error": reason, "traceback": trace}


def best(evaluations: Sequence[Evaluation]) -> tuple[int, list[float]]:
    """Return the place of the best of a method's evaluations, and all mean ranks."""
    densities = [_density(each) for each in evaluations]
    tasks = [_task(each) for each in evaluations]
    # Tuples are ranked by their place among all that differ.
    order = {task: place for place, task in enumerate(sorted(set(tasks)))}
    by_task = rankdata([order[task] for task in tasks])
    means = 0.5 * (rankdata(densities) + by_task)
    place = min(range(len(evaluations)), key=lambda one: (means[one], tasks[one], one))
    return place, means.tolist()


def task_numbers(evaluation: Evaluation) -> tuple[int, float]:
    """Return the doors that stayed closed and the median peak radial force [N]."""
    episodes = evaluation["episodes"]
    closed = sum(not episode["success"] for episode in episodes)
    forces = [episode["force_radial_peak"] for episode in episodes]
    return closed, statistics.median(forces)


def _density(evaluation: Evaluation) -> float:
    if "error" in evaluation:
        return math.inf
    nlpd = evaluation["nlpd"]
    return sys.float_info.max if nlpd is None else float(nlpd)


def _task(evaluation: Evaluation) -> tuple[float, float]:
    if "error" in evaluation:
        return math.inf, math.inf
    return task_numbers(evaluation)


def _measured(policy: Policy, candidate: Candidate) -> Evaluation:
    assert policy.method is not None
    protocol = candidate.protocol
    densities: list[float | None] = []
    episodes: list[dict[str, Any]] = []
    for seed in protocol.seeds:
        tasks = [
            episode_task(
                f"{radius:g}",
                DoorConfig(radius=radius),
                policy=candidate.policy,
                seed=seed,
                demonstrations_per_door=protocol.demonstrations_per_door,
            )
            for radius in protocol.radii
        ]
        demonstrations = demonstrations_of(tasks[0]).demonstrations
        densities += _densities(
            policy.method, demonstrations, seed, protocol.demonstrations_per_door
        )
        make = learned_agents(tasks[0], policy)
        logs = open_together(tasks, [make() for _ in tasks])
        episodes += [
            {
                "seed": seed,
                "radius": one.radius,
                "success": one.success,
                "force_radial_peak": one.force_radial_peak,
            }
            for one in map(episode_metrics, logs)
        ]
    known = [density for density in densities if density is not None]
    nlpd = float(np.mean(known)) if len(known) == len(densities) else None
    return {"nlpd": nlpd, "episodes": episodes}


def _densities(
    method: Method,
    demonstrations: Sequence[Demonstration],
    seed: int,
    per_door: int,
) -> list[float | None]:
    doors = [
        demonstrations[first : first + per_door]
        for first in range(0, len(demonstrations), per_door)
    ]
    found: list[float | None] = []
    for fold in folds(doors, "demonstration", seed):
        movement, _ = learn(method, fold.given, seed)
        for one in fold.left_out:
            asked = aligned_to(one, movement.aligned).thinned(_SAMPLES)
            found.append(accuracy(movement.predict(asked.phases), asked.poses)["nlpd"])
    return found
