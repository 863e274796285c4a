"""Learning from demonstrations of a known distribution.

python benchmarks/learning.py {calibration,scaling}

``calibration`` measures the coverage of the stated uncertainty. ``scaling`` measures
the learning time with more and longer demonstrations.
"""

import itertools
import warnings
from collections.abc import Sequence
from functools import partial
from typing import Final, get_args

import numpy as np
import tyro
from harness import report

from gplfd_experiments.speed.known_process import (
    Deviations,
    KnownProcess,
    mean_scores,
    score,
)
from gplfd_experiments.speed.report import Measurement, at_least, at_most, between
from gplfd_experiments.speed.timing import measure, repeated
from gplfd_policies.movements.skill import fit_skill

CASES: Final = tuple(itertools.product(get_args(Deviations), (6, 20)))
"""Kinds and numbers of demonstrations."""


def measure_calibration(draws: int) -> Measurement:
    """Score the skills learned from a number of draws of each case."""
    process = KnownProcess.on_grid(200)
    rows, targets = {}, []
    for kind, count in CASES:
        scores = []
        for seed in range(draws):
            rng = np.random.default_rng(seed)
            given = process.demonstrations(count, kind, rng)
            held_out = process.draw(100, kind, rng)
            ours = score(fit_skill(given).predict(given.times), held_out)
            truth = score(process.truth, held_out)
            gap = ours.pop("NLPD") - truth["NLPD"]
            scores.append({"NLPD above the truth's": gap, **ours})
        name = f"{count} {kind}"
        rows[name] = own = mean_scores(scores)
        # Where the model is correct, its standard deviation must be correct. Elsewhere,
        # the stated intervals must have their coverage.
        column = "within 1.96 std" if kind == "independent" else "in stated 95 %"
        what = f"accuracy, {name}: {column}", own[column]
        targets.append(
            between(*what, 0.94, 0.96)
            if kind == "independent"
            else at_least(*what, 0.92)
        )
    return Measurement(
        title="accuracy: 200 samples, scored on 100 other demonstrations",
        rows=rows,
        targets=tuple(targets),
    )


def log_log_slopes(
    sizes: Sequence[tuple[int, int]], seconds: Sequence[float]
) -> tuple[float, float]:
    """Return a and b of seconds ≈ c · D^a · M^b, by least squares of logarithms."""
    logs = np.log(np.asarray(sizes, dtype=np.float64))
    design = np.column_stack([logs, np.ones(len(logs))])
    (a, b, _), *_ = np.linalg.lstsq(design, np.log(seconds), rcond=None)
    return float(a), float(b)


def measure_scaling(
    repeats: int, counts: Sequence[int], samples: Sequence[int]
) -> Measurement:
    """Time learning from D demonstrations of M samples, both increasing."""
    rng = np.random.default_rng(0)
    sizes = list(itertools.product(counts, samples))
    fits = {}
    for count, size in sizes:
        given = KnownProcess.on_grid(size).demonstrations(count, "independent", rng)
        fits[count, size] = repeated(partial(fit_skill, given))
    with warnings.catch_warnings():
        # `fit_skill` warns that two demonstrations are few.
        warnings.simplefilter("ignore", UserWarning)
        times = measure(fits, repeats)
    medians = [time.cpu_median for time in times.values()]
    in_counts, in_samples = log_log_slopes(sizes, medians)
    largest, usual = (counts[-1], samples[-1]), (counts[1], samples[1])
    ratio = times[largest].cpu_over(times[usual])
    return Measurement(
        title="scaling: fit of six outputs, CPU ms [quartiles]",
        rows={
            f"{count} demonstrations": {
                f"{size} samples": times[count, size] for size in samples
            }
            for count in counts
        },
        targets=(
            at_most(f"scaling: fit of {largest} / fit of {usual}", ratio, 2.0),
            at_most("scaling: exponent in demonstrations", in_counts, 0.15),
            at_most("scaling: exponent in samples", in_samples, 0.15),
        ),
    )


def calibration(draws: int = 5) -> None:
    """Score predictions of known distributions; takes seconds.

    Args:
        draws: Number of draws of every known distribution.
    """
    report({"calibration": partial(measure_calibration, draws)})


def scaling(
    repeats: int = 5,
    counts: tuple[int, ...] = (2, 6, 20, 100),
    samples: tuple[int, ...] = (100, 200, 400, 1000),
) -> None:
    """Time learning over numbers and lengths of demonstrations.

    Args:
        repeats: Measurements of each size.
        counts: Two or more numbers of demonstrations, increasing.
        samples: Two or more numbers of samples per demonstration, increasing.
    """
    report({"scaling": partial(measure_scaling, repeats, counts, samples)})


COMMANDS: Final = {"calibration": calibration, "scaling": scaling}

if __name__ == "__main__":
    tyro.extras.subcommand_cli_from_dict(COMMANDS)
