"""Learning more and longer demonstrations: python benchmarks/scaling.py."""

import itertools
import warnings
from collections.abc import Sequence
from functools import partial

import numpy as np
import tyro

from gplfd_experiments.speed.known_process import KnownProcess
from gplfd_experiments.speed.report import Measurement, at_most, measure_all
from gplfd_experiments.speed.timing import Action, measure, repeated
from gplfd_policies.movements.skill import fit_skill


def log_log_slopes(
    sizes: Sequence[tuple[int, int]], seconds: Sequence[float]
) -> tuple[float, float]:
    """Exponents a and b of seconds ≈ c · D^a · M^b, by least squares of logarithms.

    Args:
        sizes: Pairs (D, M), of at least two different D and two different M.
        seconds: Time for each.
    """
    logs = np.log(np.asarray(sizes, dtype=np.float64))
    design = np.column_stack([logs, np.ones(len(logs))])
    (a, b, _), *_ = np.linalg.lstsq(design, np.log(seconds), rcond=None)
    return float(a), float(b)


def measure_scaling(
    repeats: int, counts: Sequence[int], samples: Sequence[int]
) -> Measurement:
    """Time learning over numbers and lengths of demonstrations.

    Args:
        repeats: Measurements of each size.
        counts: Numbers of demonstrations D, rising.
        samples: Numbers of samples M of each demonstration, rising.
    """
    rng = np.random.default_rng(0)
    sizes = list(itertools.product(counts, samples))
    fits = {size: repeated(_fit(*size, rng)) for size in sizes}
    with warnings.catch_warnings():
        # Two demonstrations are few, and `fit_skill` says so.
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


def _fit(count: int, samples: int, rng: np.random.Generator) -> Action:
    process = KnownProcess.on_grid(samples)
    return partial(fit_skill, process.demonstrations(count, "independent", rng))


def main(
    repeats: int = 5,
    counts: tuple[int, ...] = (2, 6, 20, 100),
    samples: tuple[int, ...] = (100, 200, 400, 1000),
) -> None:
    """Time learning over numbers and lengths of demonstrations.

    Args:
        repeats: Measurements of each size.
        counts: Numbers of demonstrations, two or more, rising.
        samples: Numbers of samples of each demonstration, two or more, rising.
    """
    run = partial(measure_scaling, counts=counts, samples=samples)
    measure_all({"scaling": run}, repeats)


if __name__ == "__main__":
    tyro.cli(main)
