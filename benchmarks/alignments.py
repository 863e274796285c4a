"""Forms of alignment on messy recordings: python benchmarks/alignments.py [SETS...].

Three tasks, an opening, a letter and wiping, are recorded in ways that people record:
with rests, pauses, from other starts, with stretches done twice, with parts of other
sizes. How far each recording has come in the task is known at every sample; the error
of an alignment is by how much the recordings differ in it at one phase. Of SETS made by
``gplfd demos import`` spread and left-out likelihood are measured, too.
"""

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Final, get_args

import matplotlib.pyplot as plt
import numpy as np
import tyro
from scipy.ndimage import gaussian_filter1d

from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.speed.known_process import mean_scores, score
from gplfd_experiments.speed.report import Measurement, Value, at_most, measure_all
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.demonstrations.alignment import AlignmentMethod, align
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.demonstrations.npz import load_demonstrations
from gplfd_policies.demonstrations.rests import Rest
from gplfd_policies.movements.skill import fit_skill

FORMS: Final[tuple[AlignmentMethod, ...]] = get_args(AlignmentMethod)
_RATE: Final = 50.0
_RECORDINGS: Final = 6
_PHASES: Final = 200


@dataclass(frozen=True, kw_only=True, slots=True)
class Habit:
    """What a recording has that a clean one has not."""

    rest: float = 0.0
    """At both ends, at most [s]."""
    pauses: int = 0
    """In the middle, half a second to two each."""
    start: float = 0.0
    """How far from the others' it starts (standard deviation) [m]."""
    again: bool = False
    """A fifth of the task is gone back and done again, in every other recording."""
    sizes: float = 0.0
    """By how much each third of the path is longer or shorter (standard deviation)."""
    noise: float = 0.0
    """Of positions, low-passed as motion capture's is (standard deviation) [m]."""


HABITS: Final[Mapping[str, Habit]] = {
    "clean": Habit(),
    "rests at the ends": Habit(rest=2.0),
    "pauses": Habit(pauses=2),
    "other starts": Habit(start=0.1),
    "parts done again": Habit(again=True),
    "parts of other sizes": Habit(sizes=0.25),
    "all of these, noise": Habit(
        rest=1.0, pauses=1, start=0.05, again=True, sizes=0.15, noise=1e-3
    ),
}


def opening(sizes: FloatArray) -> FloatArray:
    """Return corners of the handle's way at a door, in thirds, (N, 2) [m]."""
    angles = np.linspace(0.0, 1.2, 13)
    steps = 0.5 * np.column_stack([np.cos(angles), np.sin(angles)])[1:] * 0.1
    return _path(steps, sizes)


def letter(sizes: FloatArray) -> FloatArray:
    """Return corners of an N: up, down across, and up, (N, 2) [m]."""
    strokes = np.array([[0.0, 0.3], [0.2, -0.3], [0.0, 0.3]])
    return _path(strokes, sizes)


def wiping(sizes: FloatArray) -> FloatArray:
    """Return corners of wiping: forth and back three times on one line, (N, 2) [m]."""
    strokes = np.tile([[0.4, 0.01], [-0.4, 0.01]], (3, 1))
    return _path(strokes, sizes)


def _path(steps: FloatArray, sizes: FloatArray) -> FloatArray:
    thirds = np.repeat(sizes, len(steps) // len(sizes))[:, None]
    return np.vstack([np.zeros(2), np.cumsum(thirds * steps, axis=0)])


TASKS: Final[Mapping[str, Callable[[FloatArray], FloatArray]]] = {
    "opening": opening,
    "letter": letter,
    "wiping": wiping,
}


@dataclass(frozen=True, kw_only=True, slots=True)
class Recorded:
    """A recording of which it is known how far the task was at each sample."""

    demonstration: Demonstration
    done: FloatArray
    """Share of the task, which falls where a part is gone back, (N,)."""


def recordings(task: str, habit: Habit, seed: int) -> tuple[Recorded, ...]:
    """Return recordings of one task by one person."""
    rng = np.random.default_rng(seed)
    return tuple(
        _recording(TASKS[task], habit, number % 2 == 1, rng)
        for number in range(_RECORDINGS)
    )


def _recording(
    task: Callable[[FloatArray], FloatArray],
    habit: Habit,
    again: bool,
    rng: np.random.Generator,
) -> Recorded:
    duration = rng.uniform(3.0, 6.0)
    moving = np.arange(round(duration * _RATE)) / (duration * _RATE)
    # Nobody keeps one pace: slower and faster parts, and gentle ends.
    pace = np.sin(np.pi * moving) ** 0.5 * np.exp(
        0.5 * gaussian_filter1d(rng.standard_normal(moving.size), 20) * 20**0.5
    )
    done = np.cumsum(pace) / np.sum(pace)
    if habit.again and again:
        done = _done_again(done, rng.uniform(0.35, 0.75))
    for _ in range(habit.pauses):
        place = rng.integers(done.size // 5, 4 * done.size // 5)
        held = round(rng.uniform(0.5, 2.0) * _RATE)
        done = np.insert(done, place, np.full(held, done[place]))
    ends = (rng.uniform(0.0, habit.rest, 2) * _RATE).astype(int)
    done = np.pad(done, ends, mode="edge")
    sizes = np.exp(habit.sizes * rng.standard_normal(3))
    corners = task(sizes)
    shares = np.linspace(0.0, 1.0, len(corners))
    fine = np.linspace(0.0, 1.0, 1001)
    # Corners are rounded: a hand does not stop there.
    way = gaussian_filter1d(
        np.column_stack([np.interp(fine, shares, column) for column in corners.T]),
        15.0,
        axis=0,
        mode="nearest",
    )
    positions = np.zeros((done.size, 3))
    for axis in range(2):
        positions[:, axis] = np.interp(done, fine, way[:, axis])
    # From another start the usual way is reached after a quarter of the task.
    positions += (
        habit.start
        * rng.standard_normal(3)
        * np.clip(1.0 - 4.0 * done, 0.0, 1.0)[:, None] ** 2
    )
    shaken = gaussian_filter1d(rng.standard_normal(positions.shape), 2.0, axis=0)
    positions += habit.noise * shaken / max(shaken.std(), 1e-12)
    times = np.arange(done.size) / _RATE
    return Recorded(
        demonstration=Demonstration.from_positions(times, positions), done=done
    )


def _done_again(done: FloatArray, turn: float) -> FloatArray:
    """Go back by a fifth of the task at a place, and on again."""
    place = int(np.searchsorted(done, turn))
    count = int(np.searchsorted(done, turn) - np.searchsorted(done, turn - 0.2))
    back = np.interp(
        np.linspace(0.0, 1.0, count), [0.0, 0.5, 1.0], [turn, turn - 0.2, turn]
    )
    return np.insert(done, place, back)


def phase_error(recorded: Sequence[Recorded], form: AlignmentMethod) -> float:
    """Return by how much recordings differ in the task at one phase (rms), a share.

    Stretches that are gone back are no error of whoever goes on.
    """
    aligned = align([one.demonstration for one in recorded], method=form)
    assert aligned.clocks is not None
    done = np.stack(
        [
            np.interp(_times(one, clock, rests), one.demonstration.times, _ahead(one))
            for one, clock, rests in zip(
                recorded, aligned.clocks, aligned.rests, strict=True
            )
        ]
    )
    return float(np.sqrt(np.mean((done - done.mean(axis=0)) ** 2)))


def _ahead(one: Recorded) -> FloatArray:
    """Return the farthest that the task was so far."""
    return np.maximum.accumulate(one.done)


def _times(one: Recorded, clock: FloatArray, rests: Sequence[Rest]) -> FloatArray:
    """Return when a recording was at its own clock, which rests do not count."""
    times = one.demonstration.times
    left_out = sum(rest.end - rest.start for rest in rests)
    found = times[0] + clock * (times[-1] - times[0] - left_out)
    for rest in rests:
        found = np.where(found >= rest.start, found + rest.end - rest.start, found)
    return np.asarray(found)


def compare(habits: Sequence[str], seeds: int) -> Measurement:
    """Measure every form's phase error on some habits, over all tasks."""
    rows: dict[str, dict[str, Value]] = {}
    for name in habits:
        sets = [
            recordings(task, HABITS[name], seed)
            for task in TASKS
            for seed in range(seeds)
        ]
        rows[name] = {
            form: 100.0 * float(np.mean([phase_error(one, form) for one in sets]))
            for form in FORMS
        }
    ratios = [
        _number(row["directions"]) / _number(row["interpolation"])
        for row in rows.values()
    ]
    return Measurement(
        title=f"phase error [%], rms: {len(TASKS)} tasks, {seeds} sets of each",
        rows=rows,
        targets=(at_most("directions / interpolation, worst habit", max(ratios), 1.0),),
    )


def _number(value: Value) -> float:
    assert isinstance(value, float)
    return value


def compare_sets(sets: Sequence[Path]) -> Measurement:
    """Measure spread and left-out likelihood of real recordings.

    Every alignment sees the recording that is left out: a form that bends clocks more
    gains by it.
    """
    rows: dict[str, dict[str, Value]] = {}
    for path in sets:
        shown = load_demonstrations(path).demonstrations
        for form in FORMS:
            aligned = align(shown, method=form, n_samples=_PHASES)
            apart = aligned.poses - aligned.poses.mean(axis=0)
            rows[f"{path.name}: {form}"] = {
                "spread of positions [mm]": 1e3
                * float(np.sqrt(np.mean(np.sum(apart[..., :3] ** 2, axis=-1)))),
                **_left_out(aligned),
            }
    return Measurement(title="real recordings, each left out once", rows=rows)


def _left_out(aligned: AlignedDemonstrations) -> dict[str, float]:
    scores = []
    for number, poses in enumerate(aligned.poses):
        given = np.delete(aligned.poses, number, axis=0)
        skill = fit_skill(AlignedDemonstrations(times=aligned.times, poses=given))
        scores.append(score(skill.predict(aligned.times), poses))
    return mean_scores(scores)


def draw(file: Path) -> None:
    """Draw one letter after every form, for the habits that tell forms apart."""
    habits = ("other starts", "parts done again", "parts of other sizes")
    figure, grid = plt.subplots(
        len(habits), len(FORMS), figsize=(9, 5), sharex=True, layout="constrained"
    )
    for row, habit in zip(grid, habits, strict=True):
        shown = [one.demonstration for one in recordings("letter", HABITS[habit], 1)]
        row[0].set_ylabel(f"{habit}\ny [m]", fontsize=8)
        for axes, form in zip(row, FORMS, strict=True):
            aligned = align(shown, method=form)
            axes.plot(aligned.times, aligned.poses[:, :, 1].T, linewidth=0.8)
            axes.tick_params(labelsize=7)
    for axes, form in zip(grid[0], FORMS, strict=True):
        axes.set_title(form, fontsize=9)
    figure.supxlabel("phase", fontsize=8)
    figure.savefig(file, dpi=110)
    plt.close(figure)


def main(
    sets: Annotated[tuple[Path, ...], tyro.conf.Positional] = (),
    seeds: int = 5,
    habits: tuple[str, ...] = tuple(HABITS),
    figure: Path | None = None,
) -> None:
    """Measure every form of alignment; some minutes.

    Args:
        sets: Folders made by ``gplfd demos import``.
        seeds: Sets of recordings of each kind.
        habits: Of people who record.
        figure: Where to draw how a letter is aligned.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # of noise and rests
        measures = {"messy": partial(compare, habits)}
        if sets:
            measures["real"] = lambda _: compare_sets(sets)
        measure_all(measures, seeds)
        if figure is not None:
            draw(figure)


if __name__ == "__main__":
    tyro.cli(main)
