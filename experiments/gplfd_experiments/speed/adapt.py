"""Asking a skill, and taking in via-points."""

from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from gplfd_experiments.speed.known_process import KnownProcess
from gplfd_experiments.speed.report import Measurement, at_least, at_most
from gplfd_experiments.speed.timing import Action, Timed, measure, repeated
from gplfd_policies.adaptation import ADAPTATIONS, AdaptationForm
from gplfd_policies.movements.skill import Skill, fit_skill
from gplfd_policies.movements.trajectory import ViaPoint

_GRID: Final = np.linspace(0.0, 1.0, 200)
_VIA_POINTS: Final = 10
_PREDICTIONS: Final = 50


def measure_adaptation(repeats: int) -> Measurement:
    """Time predictions, and via-points under every form of adaptation.

    Args:
        repeats: Measurements of each.
    """
    times = measure(_actions(np.random.default_rng(0)), repeats)
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


def _actions(rng: np.random.Generator) -> dict[str, Timed]:
    """Everything that is timed."""
    process = KnownProcess.on_grid(len(_GRID))
    hurry = np.multiply.outer(np.linspace(-0.2, 0.2, 6), _GRID * (1.0 - _GRID))
    given = replace(process.demonstrations(6, "smooth", rng), clocks=_GRID + hurry)
    skill = fit_skill(given)
    skill.deviations  # noqa: B018  (made on first use; belongs to learning)
    path = process.draw(1, "smooth", rng)[0]
    points = [
        ViaPoint(phase=float(_GRID[place]), pose=path[place])
        for place in range(0, 4 * _VIA_POINTS, 4)
    ]
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
            prepare=partial(_updating, build, skill, points), operations=_VIA_POINTS
        )
    return actions


def _updating(build: AdaptationForm, skill: Skill, points: list[ViaPoint]) -> Action:
    adaptation = build(skill, _GRID)

    def update() -> None:
        for point in points:
            adaptation.observe(point)
            _ = adaptation.mean, adaptation.std

    return update
