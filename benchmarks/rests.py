"""Recordings that rest at both ends, at any rate and noise: python benchmarks/rests.py.

Six clean arcs, two of each of three doors, are recorded with rests, at a sampling rate
and with white noise; each method learns from them and opens the three doors. A set with
rests is compared with the same motions recorded without.
"""

import itertools
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np
import tyro

from gplfd_env.doors.config import DOORS
from gplfd_env.spatial.arc import handle_pose_on_arc
from gplfd_env.task.opening import DEMONSTRATED_ANGLE
from gplfd_experiments.console.progress import LOG
from gplfd_experiments.data.teacher.random_motion import minimum_jerk
from gplfd_experiments.episodes.build import learned_agents, open_together
from gplfd_experiments.episodes.metrics import EpisodeMetrics, episode_metrics
from gplfd_experiments.episodes.task import episode_task
from gplfd_experiments.speed.report import (
    Measurement,
    Value,
    at_least,
    measure_all,
)
from gplfd_policies import POLICIES
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.demonstrations.npz import LabelledDemonstrations

METHODS: Final = ("gp", "kmp", "promp")
RESTS: Final = (0.0, 1.0, 2.0)
"""At both ends [s]."""
RATES: Final = (60.0, 120.0, 240.0)
"""Samples per second."""
NOISES: Final = (0.0, 3e-4, 1e-3)
"""Of positions [m]; rotations have four times the number [rad]."""
_DOORS: Final = ("small", "medium", "large")
_WORST_RATIO: Final = 1.5
"""Of the radial force with rests to that without."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Case:
    """What one set of recordings is like, and who learns from it."""

    method: str
    rest: float
    rate: float
    noise: float
    seed: int


def recordings(case: Case) -> tuple[Demonstration, ...]:
    """Return two recordings of each door; rests change nothing else of a seed's."""
    paces = np.random.default_rng(case.seed).uniform(4.0, 7.0, 2 * len(_DOORS))
    noise = np.random.default_rng((case.seed, 1))
    radii = [DOORS[door].radius for door in _DOORS for _ in range(2)]
    return tuple(
        _recording(case, radius, pace, noise)
        for radius, pace in zip(radii, paces.tolist(), strict=True)
    )


def _recording(
    case: Case, radius: float, duration: float, rng: np.random.Generator
) -> Demonstration:
    times = np.arange(round((duration + 2.0 * case.rest) * case.rate) + 1) / case.rate
    progress = minimum_jerk((times - case.rest) / duration)
    poses = handle_pose_on_arc(radius, DEMONSTRATED_ANGLE * progress)
    spread = case.noise * np.repeat([1.0, 4.0], 3)
    return Demonstration(
        times=times, poses=poses + spread * rng.standard_normal(poses.shape)
    )


def opened(case: Case) -> tuple[EpisodeMetrics, ...]:
    """Learn from the recordings and open the three doors."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what is left out, and what is too noisy
        given = recordings(case)
        shown = LabelledDemonstrations(
            demonstrations=given, radii=tuple(None for _ in given)
        )
        tasks = [
            episode_task(door, DOORS[door], policy=case.method, seed=case.seed)
            for door in _DOORS
        ]
        make = learned_agents(tasks[0], POLICIES[case.method], shown)
        logs = open_together(tasks, [make() for _ in tasks])
    return tuple(episode_metrics(log) for log in logs)


def compare(rates: Sequence[float], noises: Sequence[float], sets: int) -> Measurement:
    """Open doors after every kind of recording.

    Args:
        rates: Samples per second.
        noises: Of positions [m].
        sets: Seeds of each.
    """
    cases = [
        Case(method=method, rest=rest, rate=rate, noise=noise, seed=seed)
        for seed, method, rate, noise, rest in itertools.product(
            range(sets), METHODS, rates, noises, RESTS
        )
    ]
    found: dict[Case, tuple[EpisodeMetrics, ...]] = {}
    for number, case in enumerate(cases, 1):
        found[case] = opened(case)
        if number % 27 == 0:
            LOG.info("%d of %d sets", number, len(cases))
    rows: dict[str, dict[str, Value]] = {
        f"{method}, {rest:g} s": _row(method, rest, found)
        for method, rest in itertools.product(METHODS, RESTS)
    }
    return Measurement(
        title=f"{sets} sets of each of {len(rates)} rates and {len(noises)} noises",
        rows=rows,
        targets=tuple(
            target
            for name, row in rows.items()
            for target in (
                at_least(f"{name}: opened and held, share", _number(row["share"]), 1.0),
                at_least(f"{name}: {_WITHIN}, share", _number(row[_WITHIN]), 1.0),
            )
        ),
    )


_WITHIN: Final = f"sets within {_WORST_RATIO:g} x the same without rests"


def _row(
    method: str, rest: float, found: dict[Case, tuple[EpisodeMetrics, ...]]
) -> dict[str, Value]:
    here = {
        case: metrics
        for case, metrics in found.items()
        if (case.method, case.rest) == (method, rest)
    }
    ratios = [
        _radial(metrics) / _radial(found[replace(case, rest=0.0)])
        for case, metrics in here.items()
    ]
    episodes = [one for metrics in here.values() for one in metrics]
    solved = [one.success for one in episodes]
    return {
        "opened": f"{sum(solved)}/{len(solved)}",
        "share": float(np.mean(solved)),
        "radial, median of sets [N]": float(np.median([*map(_radial, here.values())])),
        "over that without rests: median": float(np.median(ratios)),
        "largest": max(ratios),
        _WITHIN: float(np.mean([ratio <= _WORST_RATIO for ratio in ratios])),
    }


def _radial(metrics: Sequence[EpisodeMetrics]) -> float:
    """Return the radial peak of a set, the mean of its doors [N]."""
    return float(np.mean([one.force_radial_peak for one in metrics]))


def _number(value: Value) -> float:
    assert isinstance(value, float)
    return value


def main(
    sets: int = 5,
    rates: tuple[float, ...] = RATES,
    noises: tuple[float, ...] = NOISES,
) -> None:
    """Measure what rests do; a quarter of an hour.

    Args:
        sets: Sets of recordings of each kind.
        rates: Samples per second.
        noises: Of positions [m]; rotations have four times the number [rad].
    """
    measure_all({"rests": partial(compare, rates, noises)}, sets)


if __name__ == "__main__":
    tyro.cli(main)
