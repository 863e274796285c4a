"""Forecasts of doors that were not demonstrated: python benchmarks/door_forecasts.py.

Every radius in turn is left out of the demonstrations. The left-out opening is then
streamed as via-points, and after each the rest of it is predicted.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Final

import numpy as np
import tyro
from numpy.typing import NDArray

from gplfd_env.spatial.arc import handle_pose_on_arc
from gplfd_env.task.opening import DEMONSTRATED_ANGLE
from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.data.teacher.random_motion import minimum_jerk, smooth_functions
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.speed.report import (
    Measurement,
    Target,
    at_most,
    between,
    measure_all,
)
from gplfd_policies.adaptation import ADAPTATIONS
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.demonstrations.alignment import align
from gplfd_policies.movements.skill import fit_skill
from gplfd_policies.movements.trajectory import ViaPoint

Openings = tuple[AlignedDemonstrations, FloatArray]
"""Demonstrations on one clock, and the radius of the door of each [m]."""

_PER_RADIUS: Final = 2
_STD: Final = 1e-3
"""Noise of a via-point [m, rad]."""
_SOON: Final = 20
_PLANE: Final = [0, 2]
"""x and z, which a door moves [m]."""
_FEW: Final = (0.30, 0.42, 0.53, 0.65)
_MANY: Final = tuple(np.linspace(0.30, 0.65, 8).round(2))
_FORMS: Final = ("process", "product", "exact")
"""Those for phases that are certain, as these are."""
_SETS: Final[Mapping[str, Callable[[np.random.Generator], Openings]]] = {
    "3 of 4 radii": lambda rng: arcs(_FEW, rng),
    "7 of 8 radii": lambda rng: arcs(_MANY, rng),
    "3 of 4 radii, synthetic human": lambda rng: _by_teacher(_FEW, rng),
}
SOON_ERROR, SOON_HOLDS = f"next {_SOON}: rmse mm", f"next {_SOON}: stated 95 % holds"
REST_ERROR, REST_HOLDS = "rest: rmse mm", "rest: stated 95 % holds"


def forecast_doors(draws: int, every: int) -> Measurement:
    """Leave every radius out once, stream it as via-points and predict the rest.

    Args:
        draws: Number of draws of the demonstrations.
        every: Samples between via-points.
    """
    rows: dict[str, dict[str, float]] = {}
    targets: list[Target] = []
    for doors, draw in _SETS.items():
        openings = [draw(np.random.default_rng(seed)) for seed in range(draws)]
        found = {form: judge_form(form, openings, every) for form in _FORMS}
        rows |= {f"{doors}, {form}": scores for form, scores in found.items()}
        targets += door_targets(doors, found)
    return Measurement(
        title="accuracy: left-out door radii 0.30 to 0.65 m, x and z, via-points every "
        f"{every} of 200 samples",
        rows=rows,
        targets=tuple(targets),
    )


def door_targets(doors: str, found: Mapping[str, Mapping[str, float]]) -> list[Target]:
    """What is wanted of the default form on one set of doors."""
    process, product = found["process"], found["product"]
    name, ratio = f"accuracy, {doors}:", process[REST_ERROR] / product[REST_ERROR]
    return [
        at_most(f"{name} {SOON_ERROR}", process[SOON_ERROR], 5.0),
        at_most(f"{name} rmse of the rest / product's", ratio, 0.6),
        between(f"{name} {SOON_HOLDS}", process[SOON_HOLDS], 0.90, 0.98),
        between(f"{name} {REST_HOLDS}", process[REST_HOLDS], 0.90, 0.98),
    ]


def door_opening(
    radius: float,
    times: FloatArray,
    rng: np.random.Generator,
    wobble_std: float = 1.5e-3,
) -> FloatArray:
    """Open a door in minimum-jerk time while the hand wobbles smoothly.

    Args:
        radius: Distance from hinge to handle [m].
        times: Phases from 0 to 1, (M,).
        rng: Source of randomness.
        wobble_std: Standard deviation of the wobble [m; 4 times as much in rad],
            which is zero at the start.

    Returns:
        Poses, (M, 6) [m, rad].
    """
    arc = handle_pose_on_arc(radius, DEMONSTRATED_ANGLE * minimum_jerk(times))
    wobble = (
        smooth_functions(times, 0.2, 6, rng) * np.minimum(1.0, 10.0 * times)[:, None]
    )
    opening: FloatArray = arc + wobble_std * np.repeat([1.0, 4.0], 3) * wobble
    return opening


def arcs(radii: Sequence[float], rng: np.random.Generator) -> Openings:
    """Draw two openings of each door, on a common clock."""
    times = np.linspace(0.0, 1.0, 200)
    each = np.repeat(radii, _PER_RADIUS)
    poses = np.stack([door_opening(radius, times, rng) for radius in each])
    return AlignedDemonstrations(times=times, poses=poses), each


def _by_teacher(radii: Sequence[float], rng: np.random.Generator) -> Openings:
    recorded = Teacher().demonstrate_doors(radii, _PER_RADIUS, rng=rng)
    return align(recorded), np.repeat(radii, _PER_RADIUS)


def judge_form(form: str, draws: Sequence[Openings], every: int) -> dict[str, float]:
    """Leave every radius out of every draw and judge one form of adaptation.

    Averages are over stages of the openings, so that early ones, with a longer rest, do
    not dominate.

    Args:
        form: Name in `gplfd_policies.adaptation.ADAPTATIONS`.
        draws: Draws of demonstrations.
        every: Samples between via-points.
    """
    stages = [
        stage
        for seed, (aligned, radii) in enumerate(draws)
        for radius in np.unique(radii)
        for stage in _left_out(aligned, radii == radius, form, every, seed)
    ]
    soon, soon_holds, rest, rest_holds = np.mean(stages, axis=0)
    return {
        SOON_ERROR: 1e3 * soon**0.5,
        SOON_HOLDS: soon_holds,
        REST_ERROR: 1e3 * rest**0.5,
        REST_HOLDS: rest_holds,
    }


def _left_out(
    aligned: AlignedDemonstrations,
    held_out: NDArray[np.bool_],
    form: str,
    every: int,
    seed: int,
) -> Iterator[tuple[float, float, float, float]]:
    """Yield at every stage: squared error and share inside, of what is next and all."""
    times, poses = aligned.times, aligned.poses
    skill = fit_skill(AlignedDemonstrations(times=times, poses=poses[~held_out]))
    rng = np.random.default_rng(seed)
    for opening in poses[held_out]:
        adaptation = ADAPTATIONS[form](skill, times)
        # From the second via-point, as long as there are samples enough after it.
        for stage, place in enumerate(range(0, len(times) - _SOON - every, every)):
            seen = opening[place] + _STD * rng.standard_normal(6)
            adaptation.observe(ViaPoint(phase=float(times[place]), pose=seen, std=_STD))
            if stage > 0:
                predicted = adaptation.trajectory()
                error = ((opening - predicted.mean) ** 2)[place + every :, _PLANE]
                inside = predicted.inside(opening)[place + every :, _PLANE]
                soon = error[:_SOON].mean(), inside[:_SOON].mean()
                yield *soon, error.mean(), inside.mean()


def main(draws: int = 2, every: int = 4) -> None:
    """Forecast doors that were not demonstrated; about half a minute per draw.

    Args:
        draws: Draws of every set of doors.
        every: Samples between via-points.
    """
    measure_all({"doors": partial(forecast_doors, every=every)}, draws)


if __name__ == "__main__":
    tyro.cli(main)
