"""What the model of deviations is worth beside the demonstrations' own covariance.

python benchmarks/model_worth.py

Forecasts of `unseen_doors.py` after one, two, four and eight demonstrations of each of
three doors, with a model that is worth fewer and more independent deviations than
`gplfd_policies.gp.deviations.MODEL_WORTH`, and with the share that forecasts left-out
demonstrations best (`gplfd_policies.gp.deviations.forecast_score`).
"""

from collections.abc import Mapping
from functools import partial
from typing import Final

import numpy as np
import tyro
from unseen_doors import arc, doors, judge

from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.speed.report import Measurement, measure_all
from gplfd_policies.adaptation import ProcessAdaptation
from gplfd_policies.gp.deviations import MODEL_WORTH, forecast_score
from gplfd_policies.movements.movement import AdaptationForm
from gplfd_policies.movements.skill import Skill

_WORTHS: Final = (6.0, float(MODEL_WORTH), 20.0)
_SHARES: Final = np.linspace(0.0, 0.9, 10)
_EVERY: Final = 7
"""Samples of the common times from one that leaving out looks at to the next."""


def worth(deviations: float, skill: Skill, grid: FloatArray) -> ProcessAdaptation:
    """Adapt with a model that is worth so many independent deviations."""
    free = skill.count - 1
    share = free / (deviations + free)
    return ProcessAdaptation(skill, grid, empirical_share=share)


def left_out(skill: Skill, grid: FloatArray) -> ProcessAdaptation:
    """Adapt with the share that forecasts left-out demonstrations best."""
    share = max(_SHARES.tolist(), key=partial(_score, skill))
    return ProcessAdaptation(skill, grid, empirical_share=share)


def _score(skill: Skill, share: float) -> float:
    times = skill.aligned.times[::_EVERY]
    poses = skill.aligned.poses[:, ::_EVERY]
    noise = skill.processes.moments(times).noise
    return sum(
        forecast_score(
            process.smooth_covariance(times, noise[:, output]),
            process.white_variance(noise[:, output]),
            (poses - poses.mean(axis=0))[:, :, output],
            share,
        )
        for output, process in enumerate(skill.deviations)
    )


FORMS: Final[Mapping[str, AdaptationForm]] = {
    **{f"worth {worth_of:.3g}": partial(worth, worth_of) for worth_of in _WORTHS},
    "left out": left_out,
}


def measure(draws: int, per_radius: int) -> Measurement:
    """Forecast after some demonstrations of every learned door.

    Args:
        draws: Draws of every generator.
        per_radius: Demonstrations of every door.
    """
    generators = {"clean arcs": arc, "synthetic human": Teacher().demonstrate}
    return Measurement(
        title=f"{per_radius} of each door",
        rows={
            f"{name}, {form}": scores
            for name, generator in generators.items()
            for form, scores in judge(
                FORMS, [doors(generator, seed, per_radius) for seed in range(draws)]
            ).items()
        },
        targets=(),
    )


def main(draws: int = 12, per_radius: tuple[int, ...] = (1, 2, 4, 8)) -> None:
    """Compare what the model may be worth.

    Args:
        draws: Draws of every generator.
        per_radius: Demonstrations of every door.
    """
    measure_all(
        {
            f"{count} of each": partial(measure, per_radius=count)
            for count in per_radius
        },
        draws,
    )


if __name__ == "__main__":
    tyro.cli(main)
