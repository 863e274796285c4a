"""Tuning of methods by one objective and budget, on any engine, resumable.

The objective and the candidates were fixed before anything was measured.

The objective has two numbers. Studies do not use their seeds and doors:

1. *Density*: the mean negative log predictive density of demonstrations left out, two
   per seed, one at a time, as in the learning tests of a study. A candidate without a
   density comes after all that have one.
2. *Task*: first the number of doors that stayed closed, then the median over all
   episodes of the peak radial force.

Within a method, the candidates are ranked by each number, and the best has the smallest
mean of both ranks. Ties are decided by the better task, then by the order; the
published settings are first. A candidate that ends in an error is last in both ranks.

Neither number is used alone: a spread that makes the hand soft everywhere can improve
densities, and a spread that is far too wide can reduce forces.
"""

import contextlib
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
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.stats import qmc, rankdata

from gplfd_env.doors.config import DoorConfig
from gplfd_env.validation.named import nearest_name
from gplfd_experiments.console.arguments import check_folder
from gplfd_experiments.console.progress import LOG, counter
from gplfd_experiments.episodes.build import (
    demonstrations_of,
    learned_agents,
    open_together,
)
from gplfd_experiments.episodes.metrics import episode_metrics
from gplfd_experiments.episodes.task import (
    EpisodeTask,
    definition_hash,
    episode_task,
)
from gplfd_experiments.files.plain_data import entry, read_json, write_json
from gplfd_experiments.files.provenance import code_state, provenance
from gplfd_experiments.files.table import Table, text_table
from gplfd_experiments.studies.engines import Engine, Lost
from gplfd_experiments.studies.learning_tests.folds import (
    aligned_to,
    by_door,
    folds,
    learn,
)
from gplfd_experiments.studies.learning_tests.scores import prediction_scores
from gplfd_policies.agents.agent import Agent
from gplfd_policies.registry.catalogue import tuned
from gplfd_policies.registry.tuning_spaces import SPACES, Values

FILE: Final = "tuned.json"
"""Name of the file of the best settings, in the folder of a tuning."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Protocol:
    """Budget, seeds and doors; the same for every candidate of every method."""

    evaluations: int = 24
    """Candidates per method; the first has the published settings."""
    seeds: tuple[int, ...] = (1000, 1001, 1002)
    """Seeds of teacher, method and environment. Seeds of studies begin at 0."""
    radii: tuple[float, ...] = (0.38, 0.46, 0.54)
    """Radii of the doors to open [m]; studies do not use them."""
    demonstrations_per_door: int = 2
    """Number of demonstrations at each demonstrated door."""
    sequence: int = 1
    """Seed of the scrambled Sobol sequence."""


STANDARD: Final = Protocol()
"""The protocol of the tuned policies."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Candidate:
    """A method with settings to evaluate."""

    policy: str
    number: int
    """Index among the method's candidates; 0 has the published settings."""
    settings: Values
    protocol: Protocol = STANDARD

    @property
    def definition(self) -> dict[str, Any]:
        """The definition of the candidate, as JSON returns it."""
        fields: dict[str, Any] = json.loads(json.dumps(dataclasses.asdict(self)))
        return fields

    @property
    def key(self) -> str:
        """Hash of the definition."""
        return definition_hash(self.definition)


def checked_policies(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return names of policies that have a space; all without names."""
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
    """Return the published settings, and points of a Sobol sequence in the space."""
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
    outcome: Evaluation
    with warnings.catch_warnings():
        # Warnings about few demonstrations or convergence, because their effect is
        # measured.
        warnings.simplefilter("ignore", UserWarning)
        try:
            policy = tuned(candidate.policy, candidate.settings)
            assert policy.method is not None
            protocol = candidate.protocol
            per_door = protocol.demonstrations_per_door
            densities: list[float | None] = []
            tasks: list[EpisodeTask] = []
            agents: list[Agent] = []
            for seed in protocol.seeds:
                own = [
                    episode_task(
                        f"{radius:g}",
                        DoorConfig(radius=radius),
                        policy=candidate.policy,
                        seed=seed,
                        demonstrations_per_door=per_door,
                    )
                    for radius in protocol.radii
                ]
                doors = by_door(demonstrations_of(own[0]).demonstrations, per_door)
                for fold in folds(doors, "demonstration", seed):
                    movement, _ = learn(policy.method, fold.given, seed)
                    for one in fold.left_out:
                        left_out = aligned_to(one, movement.aligned)
                        densities.append(prediction_scores(movement, left_out)["nlpd"])
                make = learned_agents(own[0], policy)
                tasks += own
                agents += [make() for _ in own]
            episodes: list[dict[str, Any]] = []
            for task, log in zip(tasks, open_together(tasks, agents), strict=True):
                metrics = episode_metrics(log)
                kept = ("radius", "success", "force_radial_peak")
                numbers = {name: getattr(metrics, name) for name in kept}
                episodes.append({"seed": task.seed, **numbers})
            known = [density for density in densities if density is not None]
            nlpd = float(np.mean(known)) if len(known) == len(densities) else None
            outcome = {"nlpd": nlpd, "episodes": episodes}
        # With some settings a method cannot learn, and may raise any exception.
        except Exception as error:
            reason = f"{type(error).__name__}: {error}"
            outcome = {"error": reason, "traceback": traceback.format_exc()}
    return {
        "candidate": candidate.definition,
        **code_state(),
        **outcome,
        "cpu_s": round(time.process_time() - started, 3),
    }


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


def tune(
    policies: Sequence[str], folder: Path, engine: Engine, protocol: Protocol = STANDARD
) -> str:
    """Evaluate missing or failed candidates; write the best, and return a table."""
    check_folder(folder)
    every = {policy: candidates(policy, protocol) for policy in policies}
    several = [one for own in every.values() for one in own]
    missing = [
        one for one in several if "error" in (_stored(folder, one) or {"error": ""})
    ]
    with (
        contextlib.closing(engine.run(evaluate, missing)) as finished,
        counter("candidate", len(several), len(several) - len(missing)) as bar,
    ):
        for candidate, outcome in finished:
            evaluation = outcome
            if isinstance(outcome, Lost):
                error = {"error": outcome.reason, "traceback": "", "cpu_s": 0.0}
                evaluation = {"candidate": candidate.definition, **code_state()} | error
            write_json(_path(folder, candidate), evaluation)
            bar.update()

    results: dict[str, Any] = {}
    seconds = 0.0
    for policy, own in every.items():
        evaluations = []
        for one in own:
            if (kept := _stored(folder, one)) is None:
                path = _path(folder, one)
                raise ValueError(f"{path} has gone or changed; run the command again")
            evaluations.append(kept)
        seconds += sum(one["cpu_s"] for one in evaluations)
        place, ranks = best(evaluations)
        results[policy] = {
            "evaluations": len(evaluations),
            "errors": sum("error" in one for one in evaluations),
            "published": _summary(evaluations[0], ranks[0]),
            "tuned": _summary(evaluations[place], ranks[place]),
        }
        for number, evaluation in enumerate(evaluations):
            if "error" in evaluation:
                message = "warning: %s, candidate %d: %s"
                LOG.warning(message, policy, number, evaluation["error"])
    LOG.info("%d evaluations took %.0f s of a core", len(several), seconds)
    write_json(
        folder / FILE,
        {
            "command": provenance({})["command"],
            **_code(),
            "protocol": several[0].definition["protocol"],
            "policies": results,
        },
    )
    # Published and tuned settings side by side.
    rows = []
    for policy, result in results.items():
        for kind in ("published", "tuned"):
            one = result[kind]
            numbers = ["-", "-", "-"]
            if "error" not in one:
                nlpd = "-" if one["nlpd"] is None else f"{one['nlpd']:.2f}"
                closed = f"{one['closed']}/{one['episodes']}"
                numbers = [nlpd, closed, f"{one['force_radial_peak_median']:.2f}"]
            settings = ", ".join(f"{n} {value}" for n, value in one["settings"].items())
            rank = f"{one['mean_rank']:.1f}"
            rows.append((f"{policy} {kind}", rank, *numbers, settings))
    heads = ("method", "rank", "NLPD", "closed", "radial force [N]", "settings")
    return text_table(Table(columns=heads, rows=tuple(rows), left=True))


def _code() -> dict[str, Any]:
    return {name: code_state()[name] for name in ("versions", "git")}


def _path(folder: Path, candidate: Candidate) -> Path:
    return folder / "evaluations" / f"{candidate.key}.json"


def _stored(folder: Path, candidate: Candidate) -> Evaluation | None:
    """Return the evaluation of a candidate by the present code.

    None if it is missing, damaged or by other code, because methods are compared by one
    version.
    """
    try:
        evaluation = read_json(_path(folder, candidate))
        if entry(evaluation, "candidate", dict[str, Any]) != candidate.definition:
            return None
        if any(evaluation.get(name) != state for name, state in _code().items()):
            return None
        entry(evaluation, "cpu_s", float)
        if "error" not in evaluation:
            entry(evaluation, "nlpd", float | None)
            entry(evaluation, "episodes", tuple[dict[str, Any], ...])
    except (OSError, ValueError):
        return None
    return evaluation


def _summary(evaluation: Evaluation, rank: float) -> dict[str, Any]:
    """Return the settings of a candidate, its rank and its numbers."""
    numbers: dict[str, Any] = {"mean_rank": rank}
    if "error" in evaluation:
        numbers["error"] = evaluation["error"]
    else:
        closed, force = task_numbers(evaluation)
        numbers |= {
            "nlpd": evaluation["nlpd"],
            "episodes": len(evaluation["episodes"]),
            "closed": closed,
            "force_radial_peak_median": force,
        }
    return {"settings": evaluation["candidate"]["settings"], **numbers}
