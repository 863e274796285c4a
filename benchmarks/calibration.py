"""How honest the stated uncertainty is: python benchmarks/calibration.py."""

import itertools
from collections.abc import Sequence
from typing import Final, get_args

import numpy as np
import tyro

from gplfd_experiments.speed.known_process import (
    Deviations,
    KnownProcess,
    mean_scores,
    score,
)
from gplfd_experiments.speed.report import Measurement, at_least, between, measure_all
from gplfd_policies.movements.skill import fit_skill

_CASES: Final = tuple(itertools.product(get_args(Deviations), (6, 20)))


def calibrate(
    draws: int, cases: Sequence[tuple[Deviations, int]] = _CASES
) -> Measurement:
    """Learn from demonstrations of a known distribution and score what was learned.

    Args:
        draws: Number of draws per case, averaged.
        cases: Kinds and numbers of demonstrations.
    """
    process = KnownProcess.on_grid(200)
    rows, targets = {}, []
    for kind, count in cases:
        scores = [_scores(process, kind, count, seed) for seed in range(draws)]
        name = f"{count} {kind}"
        rows[name] = own = mean_scores(scores)
        # Where the model is right, so is its standard deviation; elsewhere what it
        # states must hold.
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


def _scores(
    process: KnownProcess, kind: Deviations, count: int, seed: int
) -> dict[str, float]:
    rng = np.random.default_rng(seed)
    given = process.demonstrations(count, kind, rng)
    held_out = process.draw(100, kind, rng)
    ours = score(fit_skill(given).predict(given.times), held_out)
    truth = score(process.truth, held_out)
    return {"NLPD above the truth's": ours.pop("NLPD") - truth["NLPD"], **ours}


def main(draws: int = 5) -> None:
    """Score predictions of known distributions, in seconds.

    Args:
        draws: Draws of every known distribution.
    """
    measure_all({"calibration": calibrate}, draws)


if __name__ == "__main__":
    tyro.cli(main)
