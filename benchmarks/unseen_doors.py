"""Forecasts of motions by generators that nothing was tuned to, and their limit.

python benchmarks/unseen_doors.py [--recording FILE.npz]

A motion that was not demonstrated is streamed as via-points until 20, 35 and 50 % of it
are seen; then what follows is predicted. In its own time the phase of an observation is
its share of the motion's duration, and so are these cuts; told from the path the phase
is what `PathPhase` finds, the cuts are shares of the path, and the error is the
distance of the true path from the predicted one. A circle fitted to
the same observations is the limit for somebody who knows that the path is one.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
import tyro

from gplfd_env.spatial.arc import handle_pose_on_arc
from gplfd_env.task.opening import DEMONSTRATED_ANGLE
from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.data.teacher.random_motion import minimum_jerk, smooth_functions
from gplfd_experiments.episodes.forecast_error import squared_distances
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.speed.policies import resampled
from gplfd_experiments.speed.report import (
    Measurement,
    Target,
    at_most,
    between,
    measure_all,
)
from gplfd_policies.adaptation import (
    IndependentPhaseAdaptation,
    OwnClockAdaptation,
    ProcessAdaptation,
    begin_adaptation,
)
from gplfd_policies.agents.model_based.circle import fit_circle
from gplfd_policies.demonstrations.alignment import align
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.demonstrations.npz import load_demonstrations
from gplfd_policies.movements.movement import AdaptationForm
from gplfd_policies.movements.skill import Skill, fit_skill
from gplfd_policies.movements.trajectory import ViaPoint
from gplfd_policies.phase.path_phase import PathPhase

_SAMPLES: Final = 200
_EVERY: Final = 4
_SOON: Final = 20
_CUTS: Final = (0.20, 0.35, 0.50)
_STD: Final = 1e-3
_LEARNED: Final = (0.35, 0.50, 0.65)
_UNSEEN: Final = (0.30, 0.42, 0.58)
SOON, REST, HOLDS, ALL_HOLD = (
    f"own time: next {_SOON} mm",
    "own time: rest mm",
    "own time: 95 % holds",
    "own time: 95 % of six holds",
)
_ERRORS: Final = {"clean arcs": (4.0, 25.0), "synthetic human": (6.5, 42.0)}
"""At most so much of what comes next and of the rest [mm]."""
RADIAL, CIRCLE = "path phase: rest mm", "circle: rest mm"


@dataclass(frozen=True, kw_only=True, slots=True)
class Task:
    """What is learned, and what is predicted."""

    given: tuple[Demonstration, ...]
    """To learn from."""
    unseen: tuple[Demonstration, ...]
    """To be predicted."""
    moving: tuple[int, ...]
    """Positions that the task moves."""


def arc(radius: float, rng: np.random.Generator) -> Demonstration:
    """Open a door on a clean arc, with 3 mm of wobble, at a pace of one parameter."""
    clock = np.linspace(0.0, 1.0, 241)
    hurry = float(np.clip(rng.normal(0.0, 0.25), -0.6, 0.6))
    paced = clock + hurry * clock * (1.0 - clock)
    pose = handle_pose_on_arc(radius, DEMONSTRATED_ANGLE * minimum_jerk(paced))
    rising = np.minimum(1.0, 10.0 * clock)[:, None]
    wobble = rising * smooth_functions(clock, 0.2, 6, rng)
    pose += np.repeat([3e-3, 1.2e-2], 3) * wobble
    return Demonstration(times=6.0 * clock, poses=pose)


def doors(
    open_door: Callable[[float, np.random.Generator], Demonstration],
    seed: int,
    per_radius: int = 2,
    unseen_radii: Sequence[float] = _UNSEEN,
) -> Task:
    """Draw doors of three radii to learn from, and of others to predict."""
    rng = np.random.default_rng(seed)
    given = [open_door(radius, rng) for radius in _LEARNED for _ in range(per_radius)]
    unseen = [open_door(radius, rng) for radius in unseen_radii]
    return Task(given=tuple(given), unseen=tuple(unseen), moving=(0, 2))


def _left_out(demonstrations: Sequence[Demonstration], place: int) -> Task:
    """Leave one recorded demonstration out."""
    rest = (*demonstrations[:place], *demonstrations[place + 1 :])
    return Task(given=rest, unseen=(demonstrations[place],), moving=(0, 1, 2))


def forecasts(
    skill: Skill, form: AdaptationForm, task: Task, seed: int
) -> Iterator[dict[str, float]]:
    """Predict every unseen motion of a task in its own time.

    Yields:
        At every cut: mean squared errors [m²] and shares inside.
    """
    grid, rng = np.linspace(0.0, 1.0, _SAMPLES), np.random.default_rng(seed)
    moving = list(task.moving)
    for one in task.unseen:
        truth = resampled(one, _SAMPLES).poses
        adaptation = begin_adaptation(skill, form, grid)
        begun = 0
        for cut in _CUTS:
            end = round(cut * _SAMPLES)
            for place in range(begun, end, _EVERY):
                pose = truth[place] + _STD * rng.standard_normal(6)
                point = ViaPoint(phase=float(grid[place]), pose=pose, std=_STD)
                adaptation.observe(point)
            begun = end
            predicted = adaptation.trajectory()
            error = np.sum((truth - predicted.mean)[end:, moving] ** 2, axis=1)
            inside = predicted.inside(truth)[end:]
            yield {
                SOON: float(error[:_SOON].mean()) / len(moving),
                REST: float(error.mean()) / len(moving),
                HOLDS: float(inside[:, moving].mean()),
                ALL_HOLD: float(inside.mean()),
            }


def paths(
    skill: Skill, form: AdaptationForm, task: Task, seed: int
) -> Iterator[dict[str, float]]:
    """Predict where every unseen motion goes, its phase told from the path.

    Yields:
        At every cut the mean squared distance of the true path [m²].
    """
    grid, rng = np.linspace(0.0, 1.0, _SAMPLES), np.random.default_rng(seed)
    for one in task.unseen:
        truth = resampled(one, _SAMPLES).poses
        rule, phase = PathPhase(skill, skill.aligned), np.zeros(())
        adaptation = begin_adaptation(skill, form, grid)
        seen: list[FloatArray] = []
        last = -1.0
        ends = _shares_of_the_path(truth[:, :3])
        for place in range(max(ends) + 1):
            pose = truth[place] + _STD * rng.standard_normal(6)
            estimate = rule.update(pose, phase, phase)
            phase, std = estimate.phase, estimate.std
            seen.append(pose[:3])
            if phase >= last + 0.01:
                last = float(phase)
                along = rule.rate(phase) * float(std)
                noise = np.repeat([_STD, 3e-2], 3)
                adaptation.observe(
                    ViaPoint(phase=last, pose=pose, std=noise, along=along)
                )
            if place in ends:
                rest = truth[place + 1 :, :3]
                ahead = adaptation.mean[grid > last - 0.03, :3]
                yield {
                    RADIAL: float(squared_distances(rest, ahead).mean()),
                    CIRCLE: float(np.mean(_from_circle(rest, np.array(seen)))),
                }


def _shares_of_the_path(path: FloatArray) -> set[int]:
    """Return where the cuts are, as shares of a path (N, 3): its numbers of samples."""
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    covered = np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()
    return {int(np.searchsorted(covered, cut)) for cut in _CUTS}


def _from_circle(points: FloatArray, seen: FloatArray) -> FloatArray:
    """Squared distances of points from the circle through what was seen, (N,)."""
    circle = fit_circle(seen)
    pull, across, away = (points @ circle.axes).T
    radius = 1.0 / circle.curvature
    gap = (np.hypot(pull, away + radius) - radius) ** 2 + across**2
    return np.asarray(gap)


def judge(
    forms: Mapping[str, AdaptationForm], tasks: Sequence[Task]
) -> dict[str, dict[str, float]]:
    """Root mean squares and shares by form, averaged over all cuts of all tasks."""
    found: dict[str, list[dict[str, float]]] = {name: [] for name in forms}
    for seed, task in enumerate(tasks):
        skill = fit_skill(align(task.given))
        for name, form in forms.items():
            own = forecasts(skill, form, task, seed)
            told = paths(skill, form, task, seed)
            found[name] += [a | b for a, b in zip(own, told, strict=True)]
    return {name: _summary(stages) for name, stages in found.items()}


def _summary(stages: Sequence[Mapping[str, float]]) -> dict[str, float]:
    columns = {name: np.array([s[name] for s in stages]) for name in stages[0]}
    shares = (HOLDS, ALL_HOLD)
    return {
        name: float(np.mean(each if name in shares else 1e3 * np.sqrt(each)))
        for name, each in columns.items()
    }


FORMS: Final[Mapping[str, AdaptationForm]] = {
    "process": ProcessAdaptation,
    "own-clock": OwnClockAdaptation,
    "independent": IndependentPhaseAdaptation,
}


def measure(
    draws: int,
    recording: Path | None,
    forms: Mapping[str, AdaptationForm],
    unseen: Sequence[float] = _UNSEEN,
) -> Measurement:
    """Predict motions of every generator, and of a recording if there is one.

    Args:
        draws: Draws of every generator.
        recording: File of demonstrations, as of `gplfd demos import`.
        forms: What is compared.
        unseen: Radii of the doors that are predicted [m].
    """
    generators = {"clean arcs": arc, "synthetic human": Teacher().demonstrate}
    sets = {
        name: [doors(opening, seed, unseen_radii=unseen) for seed in range(draws)]
        for name, opening in generators.items()
    }
    if recording is not None:
        recorded = load_demonstrations(recording).demonstrations
        sets["recorded"] = [_left_out(recorded, one) for one in range(len(recorded))]
    found = {name: judge(forms, tasks) for name, tasks in sets.items()}
    return Measurement(
        title=f"unseen: radii {_LEARNED} learned, {tuple(unseen)} forecast",
        rows={
            f"{name}, {form}": scores
            for name, by_form in found.items()
            for form, scores in by_form.items()
        },
        targets=tuple(
            target
            for name, by_form in found.items()
            for target in _targets(name, by_form["own-clock"])
        ),
    )


def _targets(name: str, scores: Mapping[str, float]) -> list[Target]:
    """What is wanted of forecasts in a motion's own time."""
    wanted = [between(f"{name}: {ALL_HOLD}", scores[ALL_HOLD], 0.90, 0.98)]
    if name in _ERRORS:
        soon, rest = _ERRORS[name]
        wanted.append(at_most(f"{name}: {SOON}", scores[SOON], soon))
        wanted.append(at_most(f"{name}: {REST}", scores[REST], rest))
    return wanted


def main(
    draws: int = 4,
    recording: Path | None = None,
    unseen: tuple[float, ...] = _UNSEEN,
) -> None:
    """Forecast motions that were not demonstrated.

    Args:
        draws: Draws of every generator.
        recording: Also recordings, a file of `gplfd demos import`.
        unseen: Radii of the doors that are predicted [m].
    """
    measured = partial(measure, recording=recording, forms=FORMS, unseen=unseen)
    measure_all({"unseen": measured}, draws)


if __name__ == "__main__":
    tyro.cli(main)
