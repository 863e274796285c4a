"""Learning six outputs: time and accuracy beside hetGP and scikit-learn."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Final, get_args

import numpy as np

from gplfd_experiments.speed.known_process import Deviations, KnownProcess
from gplfd_experiments.speed.peers import (
    NOT_INSTALLED,
    hetgpy_fit,
    installed,
    sklearn_fit,
)
from gplfd_experiments.speed.report import Measurement, Target, Value, at_least, at_most
from gplfd_experiments.speed.scores import score
from gplfd_experiments.speed.timing import Timing, measure, repeated
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.movements.skill import fit_skill
from gplfd_policies.movements.trajectory import GaussianTrajectory

OURS, HETGPY, SKLEARN = "gplfd", "hetgpy hetGP", "scikit-learn, collapsed"
_DEMONSTRATIONS, _SAMPLES, _HELD_OUT = 6, 200, 100


def _fit_ours(given: AlignedDemonstrations) -> GaussianTrajectory:
    return fit_skill(given).predict(given.times)


_LIBRARIES: Final[
    Mapping[str, tuple[str, Callable[[AlignedDemonstrations], GaussianTrajectory]]]
] = {
    OURS: ("gplfd_policies", _fit_ours),
    HETGPY: ("hetgpy", hetgpy_fit),
    SKLEARN: ("sklearn", sklearn_fit),
}
"""Name for import, and what learns and predicts."""


def compare_fits(repeats: int) -> Measurement:
    """Time and score every library that is installed.

    Args:
        repeats: Measurements of each.
    """
    process = KnownProcess.on_grid(_SAMPLES)
    rows: dict[str, Mapping[str, Value]] = {}
    targets: list[Target] = []
    for place, kind in enumerate(get_args(Deviations)):
        rng = np.random.default_rng((0, place))
        given = process.demonstrations(_DEMONSTRATIONS, kind, rng)
        held_out = process.draw(_HELD_OUT, kind, rng)
        fits = {
            name: partial(fit, given)
            for name, (module, fit) in _LIBRARIES.items()
            if installed(module)
        }
        times = measure({name: repeated(fit) for name, fit in fits.items()}, repeats)
        scores = {name: score(fit(), held_out) for name, fit in fits.items()}
        for name in _LIBRARIES:
            rows[f"{name}, {kind}"] = {"CPU ms [quartiles]": NOT_INSTALLED}
            if name in fits:
                rows[f"{name}, {kind}"] = {
                    "CPU ms [quartiles]": times[name],
                    "ratio": times[name].cpu_over(times[OURS]),
                    **scores[name],
                }
        rows[f"the true model, {kind}"] = dict(score(process.truth, held_out))
        if HETGPY in fits:
            targets += _targets(kind, times, scores)
    return Measurement(
        title=f"fit: learn {_DEMONSTRATIONS} demonstrations x {_SAMPLES} samples x 6 "
        f"outputs and predict, scored on {_HELD_OUT} others",
        rows=rows,
        targets=tuple(targets),
    )


def _targets(
    kind: str, times: Mapping[str, Timing], scores: Mapping[str, Mapping[str, float]]
) -> list[Target]:
    """Speed and accuracy relative to hetGP."""
    ours, theirs = scores[OURS], scores[HETGPY]
    off, off_theirs = (abs(one["within 1.96 std"] - 0.95) for one in (ours, theirs))
    further = f"fit, {kind}: coverage further from 0.95 than hetGP's"
    ratio = times[HETGPY].cpu_over(times[OURS])
    return [
        at_least(f"fit, {kind}: hetGP's time / ours", ratio, 30.0),
        at_most(f"fit, {kind}: NLPD above hetGP's", ours["NLPD"] - theirs["NLPD"], 0.0),
        at_most(further, off - off_theirs, 0.0),
    ]
