"""The objective of tuning; fixed before anything was measured.

Two numbers, from the seeds and doors of the protocol, which no study uses:

1. *Density*: the mean negative log predictive density of demonstrations left out, two
   per seed, one at a time, as in the learning tests of a study
   (`gplfd_experiments.studies.learning_tests`). A candidate without a density comes
   after all that have one.
2. *Task*: first the number of doors that stayed closed, then the median over all
   episodes of the peak radial force.

Within a method the candidates are ranked by each number; equal ones get the mean of
their ranks. The best candidate has the smallest mean of both ranks. Ties are decided by
the better task, then by the order, in which the method as published is first. A
candidate that ends in an error is last in both. Ranks are comparable within a method
only.

A method is tuned for neither number alone: densities can be improved by a spread that
makes the hand soft everywhere, and forces by one that is far too wide.
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
from gplfd_experiments.studies.learning_tests.folds import aligned_to, by_door, folds
from gplfd_experiments.studies.learning_tests.methods import learn
from gplfd_experiments.studies.tuning.candidates import Candidate
from gplfd_policies.arrays.one_thread import one_thread
from gplfd_policies.registry.catalogue import tuned
from gplfd_policies.registry.policy import Policy

Evaluation = dict[str, Any]
"""Result of a candidate: ``candidate``, ``versions``, ``git``, ``arithmetic``,
``cpu_s``, and ``nlpd`` (None without a density) and ``episodes``, or ``error`` and
``traceback``."""

_SAMPLES: Final = 200
"""Poses of a demonstration left out that are predicted, as in the learning tests."""


def evaluate(candidate: Candidate) -> Evaluation:
    """Evaluate a candidate; an error is its result."""
    started = time.process_time()
    with one_thread, warnings.catch_warnings():
        # Warnings of few demonstrations or of no convergence: their effect is measured.
        warnings.simplefilter("ignore", UserWarning)
        try:
            policy = tuned(candidate.policy, candidate.settings)
            outcome = _measured(policy, candidate)
        # With some settings a method cannot learn, and may raise anything.
        except Exception as error:
            outcome = failed(f"{type(error).__name__}: {error}", traceback.format_exc())
    return {
        "candidate": candidate.definition,
        **code_state(),
        **outcome,
        "cpu_s": round(time.process_time() - started, 3),
    }


def failed(reason: str, trace: str = "") -> Evaluation:
    """Return the entries of an evaluation that ended in an error."""
    return {"error": reason, "traceback": trace}


def best(evaluations: Sequence[Evaluation]) -> tuple[int, list[float]]:
    """Return the index of the best of a method's evaluations, and all mean ranks."""
    densities, tasks = [], []
    for one in evaluations:
        if "error" in one:
            densities.append(math.inf)
            tasks.append((math.inf, math.inf))
        else:
            known = one["nlpd"] is not None
            densities.append(float(one["nlpd"]) if known else sys.float_info.max)
            tasks.append(task_numbers(one))
    # SciPy ranks numbers, not tuples.
    order = {task: place for place, task in enumerate(sorted(set(tasks)))}
    by_task = rankdata([order[task] for task in tasks])
    means = 0.5 * (rankdata(densities) + by_task)
    place = min(range(len(evaluations)), key=lambda one: (means[one], tasks[one], one))
    return place, means.tolist()


def task_numbers(evaluation: Evaluation) -> tuple[float, float]:
    """Return the doors that stayed closed and the median peak radial force [N]."""
    episodes = evaluation["episodes"]
    closed = sum(not episode["success"] for episode in episodes)
    forces = [episode["force_radial_peak"] for episode in episodes]
    return closed, statistics.median(forces)


def _measured(policy: Policy, candidate: Candidate) -> Evaluation:
    assert policy.method is not None
    protocol = candidate.protocol
    per_door = protocol.demonstrations_per_door
    densities: list[float | None] = []
    episodes: list[dict[str, Any]] = []
    for seed in protocol.seeds:
        tasks = [
            episode_task(
                f"{radius:g}",
                DoorConfig(radius=radius),
                policy=candidate.policy,
                seed=seed,
                demonstrations_per_door=per_door,
            )
            for radius in protocol.radii
        ]
        doors = by_door(demonstrations_of(tasks[0]).demonstrations, per_door)
        for fold in folds(doors, "demonstration", seed):
            movement, _ = learn(policy.method, fold.given, seed)
            for one in fold.left_out:
                asked = aligned_to(one, movement.aligned).thinned(_SAMPLES)
                score = accuracy(movement.predict(asked.phases), asked.poses)
                densities.append(score["nlpd"])
        make = learned_agents(tasks[0], policy)
        episodes += [
            {
                "seed": seed,
                "radius": one.radius,
                "success": one.success,
                "force_radial_peak": one.force_radial_peak,
            }
            for one in map(
                episode_metrics, open_together(tasks, [make() for _ in tasks])
            )
        ]
    known = [density for density in densities if density is not None]
    nlpd = float(np.mean(known)) if len(known) == len(densities) else None
    return {"nlpd": nlpd, "episodes": episodes}
