"""Methods over many recorded tasks: python benchmarks/recorded_tasks.py SETS."""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Final

import numpy as np
import tyro

from gplfd_experiments.console.progress import LOG
from gplfd_experiments.speed.report import Measurement, at_most, between, measure_all
from gplfd_experiments.studies.learning_tests.scores import (
    FEWEST,
    prediction_scores,
    without,
)
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.demonstrations.npz import load_demonstrations
from gplfd_policies.registry.catalogue import policy_named
from gplfd_policies.registry.method import Method

_BEHIND: Final = 0.5
"""How far behind the best method's density a task may be [nats per number]."""
_HOLD: Final = "stated 95 % holds"
Scores = Mapping[str, float]
"""Negative log densities per number by method."""


def scores_of(
    method: Method, recordings: Sequence[Demonstration]
) -> tuple[float, float]:
    """Leave every recording out once.

    Args:
        method: One that states a density.
        recordings: At least `FEWEST`, in one frame.

    Returns:
        Means of the negative log density per number, and of the share that the
        method's 95 % intervals hold: its own, or those of a normal distribution.
    """
    found = []
    for number in range(len(recordings)):
        movement, left_out, _ = without(method, recordings, number)
        one = prediction_scores(movement, left_out)
        held = one["coverage_95_stated"]
        found.append((one["nlpd"], one["coverage_95"] if held is None else held))
    density, share = np.array(found, dtype=np.float64).mean(axis=0)
    return float(density), float(share)


def compare(tasks: Mapping[str, Scores], held: Sequence[float]) -> Measurement:
    """Compare methods over tasks, each of which counts once.

    Args:
        tasks: Scores by task, of the same methods; the first of them is to be close to
            the best in every task.
        held: Share of every task within the first method's stated 95 % intervals.
    """
    methods = list(next(iter(tasks.values())))
    table = np.array([[one[method] for method in methods] for one in tasks.values()])
    behind = table - table.min(axis=1, keepdims=True)
    means = table.mean(axis=0)
    rows = {
        method: {
            "mean NLPD": float(means[column]),
            "median": float(np.median(table[:, column])),
            "best in": int(np.sum(behind[:, column] == 0.0)),
            "most behind": float(behind[:, column].max()),
            "where": list(tasks)[int(behind[:, column].argmax())],
        }
        for column, method in enumerate(methods)
    }
    first = methods[0]
    return Measurement(
        title=f"{len(tasks)} tasks, each recording left out once; NLPD per number that "
        "moves, m and rad",
        rows=rows,
        targets=(
            at_most(f"{first}: nats behind a task's best", behind[:, 0].max(), _BEHIND),
            at_most(
                f"{first}: mean NLPD less the best other's",
                float(means[0] - means[1:].min()),
                0.0,
            ),
            between(f"{first}: {_HOLD}", float(np.mean(held)), 0.92, 0.98),
        ),
    )


def main(
    sets: Annotated[Sequence[Path], tyro.conf.Positional],
    policies: Sequence[str] = ("gp", "promp", "kmp", "gmr"),
) -> None:
    """Judge methods by their densities on several sets of recordings.

    Args:
        sets: Files of `gplfd demos import`, one per task.
        policies: Two or more policies that state densities; the first is judged.
    """
    try:
        methods = {}
        for name in policies:
            method = policy_named(name).method
            if method is None:
                raise ValueError(f"{name} learns nothing")
            methods[name] = method
        if len(methods) < 2:
            raise ValueError("--policies needs two or more, to compare")
        tasks, held = {}, []
        for file in sets:
            recordings = load_demonstrations(file).demonstrations
            if len(recordings) < FEWEST:
                raise ValueError(f"{file} holds fewer than {FEWEST} recordings")
            LOG.info("judging: %s", file)
            found = {name: scores_of(one, recordings) for name, one in methods.items()}
            tasks[file.stem] = {name: density for name, (density, _) in found.items()}
            held.append(found[policies[0]][1])
    except (ValueError, OSError) as error:
        sys.exit(f"recorded_tasks.py: {error}")
    measure_all({"recorded tasks": lambda _: compare(tasks, held)}, 1)


if __name__ == "__main__":
    tyro.cli(main)
