"""Speed of policies: learning, predicting, adaptation and alignment.

Learning is compared in time and accuracy with hetGP and scikit-learn, alignment in time
with dtw-python.
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Final, get_args

import numpy as np

from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.speed.known_process import Deviations, KnownProcess, score
from gplfd_experiments.speed.peers import (
    NOT_INSTALLED,
    dtw_python,
    hetgpy_fit,
    installed,
    sklearn_fit,
)
from gplfd_experiments.speed.report import Measurement, Target, Value, at_least, at_most
from gplfd_experiments.speed.timing import Action, Timed, measure, repeated
from gplfd_policies.adaptation import ADAPTATIONS, AdaptationForm
from gplfd_policies.arrays.resolution import interpolated
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.demonstrations.alignment import align
from gplfd_policies.demonstrations.completion import measure_completion
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.demonstrations.dynamic_time_warping import dynamic_time_warping
from gplfd_policies.movements.skill import fit_skill
from gplfd_policies.movements.trajectory import GaussianTrajectory, ViaPoint

# --- Learning ----------------------------------------------------------------

OURS, HETGPY, SKLEARN = "gplfd", "hetgpy hetGP", "scikit-learn, collapsed"
_DEMONSTRATIONS, _SAMPLES, _HELD_OUT = 6, 200, 100
_LIBRARIES: Final[
    Mapping[str, tuple[str, Callable[[AlignedDemonstrations], GaussianTrajectory]]]
] = {
    OURS: ("gplfd_policies", lambda given: fit_skill(given).predict(given.times)),
    HETGPY: ("hetgpy", hetgpy_fit),
    SKLEARN: ("sklearn", sklearn_fit),
}
"""Name for import, and the function that learns and predicts."""


def compare_fits(repeats: int) -> Measurement:
    """Time and score every library that is installed."""
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
            ours, theirs = scores[OURS], scores[HETGPY]
            ratio = times[HETGPY].cpu_over(times[OURS])
            worse = ours["NLPD"] - theirs["NLPD"]
            off, off_theirs = (
                abs(one["within 1.96 std"] - 0.95) for one in (ours, theirs)
            )
            further = f"fit, {kind}: coverage further from 0.95 than hetGP's"
            targets += [
                at_least(f"fit, {kind}: hetGP's time / ours", ratio, 30.0),
                at_most(f"fit, {kind}: NLPD above hetGP's", worse, 0.0),
                at_most(further, off - off_theirs, 0.0),
            ]
    return Measurement(
        title=f"fit: learn {_DEMONSTRATIONS} demonstrations x {_SAMPLES} samples x 6 "
        f"outputs and predict, scored on {_HELD_OUT} others",
        rows=rows,
        targets=tuple(targets),
    )


# --- Adaptation --------------------------------------------------------------

_GRID: Final = np.linspace(0.0, 1.0, 200)
_VIA_POINTS: Final = 10
_PREDICTIONS: Final = 50


def measure_adaptation(repeats: int) -> Measurement:
    """Time predictions, and via-points under every form of adaptation."""
    rng = np.random.default_rng(0)
    process = KnownProcess.on_grid(len(_GRID))
    hurry = np.multiply.outer(np.linspace(-0.2, 0.2, 6), _GRID * (1.0 - _GRID))
    given = replace(process.demonstrations(6, "smooth", rng), clocks=_GRID + hurry)
    skill = fit_skill(given)
    skill.deviations  # noqa: B018  (computed on first use; belongs to learning)
    path = process.draw(1, "smooth", rng)[0]
    points = [
        ViaPoint(phase=float(_GRID[place]), pose=path[place])
        for place in range(0, 4 * _VIA_POINTS, 4)
    ]

    def updating(build: AdaptationForm) -> Action:
        adaptation = build(skill, _GRID)

        def update() -> None:
            for point in points:
                adaptation.observe(point)
                _ = adaptation.mean, adaptation.std

        return update

    one_phase = _GRID[100:101]
    actions = {
        "predict, 200 phases": repeated(partial(skill.predict, _GRID), _PREDICTIONS),
        "predict, 1 phase": repeated(partial(skill.predict, one_phase), _PREDICTIONS),
        "predict, 200 phases, first time": Timed(
            prepare=lambda: partial(fit_skill(given).predict, _GRID)
        ),
    }
    for form, build in ADAPTATIONS.items():
        actions[f"{form}: begin"] = repeated(partial(build, skill, _GRID))
        actions[f"{form}: one via-point"] = Timed(
            prepare=partial(updating, build), operations=_VIA_POINTS
        )
    times = measure(actions, repeats)
    predict, via_point = times["predict, 200 phases"], times["process: one via-point"]
    product = times["product: one via-point"]
    return Measurement(
        title=f"adapt: six outputs, {len(_GRID)} phases; via-points {_VIA_POINTS} in a "
        "row, mean and standard deviation read after each",
        rows={name: {"CPU ms [quartiles]": time} for name, time in times.items()},
        targets=(
            at_most("adapt: predict, 200 phases [ms]", 1e3 * predict.cpu_median, 0.5),
            at_most("adapt: one via-point [ms]", 1e3 * via_point.cpu_median, 0.2),
            at_least(
                "adapt: product's time / process's", product.cpu_over(via_point), 15.0
            ),
        ),
    )


# --- Alignment ---------------------------------------------------------------

_SIZES: Final = (200, 1000, 5000)
_MATCH, _MATCH_PEER = "matching: interpolation", "matching: dtw-python"
_ALIGN: Final = "align(), interpolation"


def measure_alignment(repeats: int) -> Measurement:
    """Time alignment at 200, 1000 and 5000 samples, compared with dtw-python."""
    rng = np.random.default_rng(0)
    recorded = Teacher().demonstrate_doors((0.35, 0.65), 1, rng=rng)
    with warnings.catch_warnings():
        # The demonstrations have sensor noise, about which `align` warns.
        warnings.simplefilter("ignore", UserWarning)
        times = {size: measure(_alignments(recorded, size), repeats) for size in _SIZES}
    at_1000 = times[1000]
    targets = tuple(
        at_least(
            f"align: dtw-python's matching / {ours}, 1000 samples",
            at_1000[_MATCH_PEER].cpu_over(at_1000[line]),
            100.0,
        )
        for ours, line in (("ours", _MATCH), ("whole align()", _ALIGN))
        if _MATCH_PEER in at_1000
    )
    return Measurement(
        title="align: two demonstrations, CPU ms [quartiles]; matching alone starts "
        "from completion indices",
        rows={
            line: {
                f"{size} samples": times[size].get(line, NOT_INSTALLED)
                for size in _SIZES
            }
            for line in (*at_1000, _MATCH_PEER)
        },
        targets=targets,
    )


def resampled(recorded: Demonstration, size: int) -> Demonstration:
    """Return a demonstration at equal steps of its own time."""
    times = np.linspace(recorded.times[0], recorded.times[-1], size)
    poses = interpolated(times, recorded.times, recorded.poses)
    return Demonstration(times=times, poses=poses)


def _alignments(recorded: Sequence[Demonstration], size: int) -> dict[str, Timed]:
    """Return the timed actions with two demonstrations, resampled to a size."""
    two = [resampled(demo, size) for demo in recorded]

    def completions() -> list[FloatArray]:
        return [measure_completion(demo, 0.5, denoise=True).index for demo in two]

    first, second = completions()
    many = max(1, 5000 // size)
    candidates = {
        "completion indices of both": repeated(completions, many),
        # ζ increases, so each sample of one matches where the other has the same ζ.
        _MATCH: repeated(partial(np.interp, first, second, np.arange(size)), many),
        "matching: our exact DTW": repeated(
            lambda: dynamic_time_warping(lambda row: np.abs(second - first[row]), size)
        ),
        _ALIGN: repeated(partial(align, two), many),
        "align(), dtw": repeated(partial(align, two, method="dtw")),
    }
    if installed("dtw"):
        candidates[_MATCH_PEER] = repeated(partial(dtw_python, first, second))
    return candidates
