"""Candidates and objective of tuning; fixed before anything was measured.

The objective is two numbers. Their seeds and doors are used by no study:

1. *Density*: the mean negative log predictive density of demonstrations left out, two
   per seed, one at a time, as in the learning tests of a study. A candidate without a
   density comes after all that have one.
2. *Task*: first the number of doors that stayed closed, then the median over all
   episodes of the peak radial force.

Within a method the candidates are ranked by each number, and the best has the smallest
mean of both ranks. Ties are decided by the better task, then by the order, in which the
method as published is first. A candidate that ends in an error is last in both.

A method is tuned for neither number alone: densities can be improved by a spread that
makes the hand soft everywhere, and forces by one that is far too wide.
"""

from __future__ import annotations

import dataclasses
import json
import math
import statistics
import sys
import time
import traceback
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.stats import qmc, rankdata

from gplfd_env.doors.config import DoorConfig
from gplfd_env.validation.named import nearest_name
from gplfd_experiments.episodes.build import (
    demonstrations_of,
    learned_agents,
    open_together,
)
from gplfd_experiments.episodes.metrics import episode_metrics
from gplfd_experiments.episodes.task import definition_hash, episode_task
from gplfd_experiments.files.provenance import code_state
from gplfd_experiments.studies.learning_tests.folds import aligned_to, by_door, folds
from gplfd_experiments.studies.learning_tests.methods import learn
from gplfd_experiments.studies.learning_tests.scores import prediction_scores
from gplfd_policies.arrays.one_thread import one_thread
from gplfd_policies.registry.catalogue import tuned
from gplfd_policies.registry.policy import Policy
from gplfd_policies.registry.tuning_spaces import SPACES, Values


@dataclass(frozen=True, kw_only=True, slots=True)
class Protocol:
    """Budget, seeds and doors; the same for every candidate of every method."""

    evaluations: int = 24
    """Candidates per method; the first is the method as published."""
    seeds: tuple[int, ...] = (1000, 1001, 1002)
    """Of teacher, method and environment. Studies count theirs from 0."""
    radii: tuple[float, ...] = (0.38, 0.46, 0.54)
    """Doors to open [m]; none of them in a study."""
    demonstrations_per_door: int = 2
    """How often the teacher opens each demonstrated door."""
    sequence: int = 1
    """Seed of the scrambled Sobol sequence."""


STANDARD: Final = Protocol()
"""The protocol of the tuned policies."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Candidate:
    """A method with some settings, to be evaluated."""

    policy: str
    number: int
    """Index among the method's candidates; 0 is as published."""
    settings: Values
    protocol: Protocol = STANDARD

    @property
    def definition(self) -> dict[str, Any]:
        """Everything that defines it, as JSON returns it."""
        fields: dict[str, Any] = json.loads(json.dumps(dataclasses.asdict(self)))
        return fields

    @property
    def key(self) -> str:
        """Hash of the definition."""
        return definition_hash(self.definition)


def checked_policies(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return names of policies that have a space; all of them for none."""
    for name in names:
        if name not in SPACES:
            raise ValueError(
                f"{name!r} has no settings to tune{nearest_name(name, SPACES)}; "
                f"policies: {', '.join(SPACES)}"
            )
        if names.count(name) > 1:
            raise ValueError(f"{name} is given twice in --policies")
    return names or tuple(SPACES)


def candidates(policy: str, protocol: Protocol = STANDARD) -> tuple[Candidate, ...]:
    """Return a method as published, and points of a Sobol sequence in its space."""
    space = SPACES[policy]
    sequence = qmc.Sobol(len(space.settings), scramble=True, seed=protocol.sequence)
    # The sequence is balanced for powers of two.
    exponent = max(protocol.evaluations - 2, 0).bit_length()
    points = sequence.random_base2(exponent)[: protocol.evaluations - 1]
    tried = [space.published, *(space.at(point) for point in points.tolist())]
    return tuple(
        Candidate(policy=policy, number=number, settings=settings, protocol=protocol)
        for number, settings in enumerate(tried)
    )


Evaluation = dict[str, Any]
"""Result of a candidate: ``candidate``, ``versions``, ``git``, ``arithmetic``,
``cpu_s``, and ``nlpd`` (None without a density) and ``episodes``, or ``error`` and
``traceback``."""


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
        failure = "error" in one
        tasks.append((math.inf, math.inf) if failure else task_numbers(one))
        nlpd = math.inf if failure else one["nlpd"]
        densities.append(sys.float_info.max if nlpd is None else float(nlpd))
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
                left_out = aligned_to(one, movement.aligned)
                densities.append(prediction_scores(movement, left_out)["nlpd"])
        make = learned_agents(tasks[0], policy)
        for log in open_together(tasks, [make() for _ in tasks]):
            metrics = episode_metrics(log)
            kept = ("radius", "success", "force_radial_peak")
            numbers = {name: getattr(metrics, name) for name in kept}
            episodes.append({"seed": seed, **numbers})
    known = [density for density in densities if density is not None]
    nlpd = float(np.mean(known)) if len(known) == len(densities) else None
    return {"nlpd": nlpd, "episodes": episodes}
