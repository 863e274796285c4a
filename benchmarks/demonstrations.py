"""Effect of recording conditions on alignment and learning.

python benchmarks/demonstrations.py {alignments,rests}

``alignments``: three tasks, an opening, a letter and wiping, are recorded with
deviations that are common in recordings of people: rests, pauses, other start poses,
repeated parts, and parts of other sizes. The true progress in the task is known at
every sample. The error of an alignment is the difference of the true progress between
recordings at equal phase. For sets made by ``gplfd demos import``, spread and left-out
likelihood are measured.

``rests``: six clean arcs, two of each of three doors, are recorded with rests, at a
sampling rate and with white noise. Each method learns from them and opens the three
doors. A set with rests is compared with the same motions without rests.
"""

import itertools
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Final, NamedTuple, get_args

import matplotlib.pyplot as plt
import numpy as np
import tyro
from harness import opened, report
from scipy.ndimage import gaussian_filter1d

from gplfd_env.doors.config import DOORS
from gplfd_env.spatial.arc import handle_pose_on_arc
from gplfd_env.task.opening import DEMONSTRATED_ANGLE
from gplfd_experiments.console.progress import LOG
from gplfd_experiments.data.teacher.random_motion import minimum_jerk
from gplfd_experiments.episodes.metrics import EpisodeMetrics, episode_metrics
from gplfd_experiments.episodes.task import episode_task
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.speed.known_process import mean_scores, score
from gplfd_experiments.speed.report import Measurement, Target, Value, at_least, at_most
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.demonstrations.alignment import AlignmentMethod, align
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.demonstrations.npz import (
    LabelledDemonstrations,
    load_demonstrations,
)
from gplfd_policies.movements.skill import fit_skill

Sets = Annotated[tuple[Path, ...], tyro.conf.Positional]

# --- Alignments --------------------------------------------------------------

FORMS: Final[tuple[AlignmentMethod, ...]] = get_args(AlignmentMethod)
_RATE: Final = 50.0
_RECORDINGS: Final = 6
_PHASES: Final = 200


@dataclass(frozen=True, kw_only=True, slots=True)
class Habit:
    """Deviations of a recording from a clean one."""

    rest: float = 0.0
    """Longest rest at both ends [s]."""
    pauses: int = 0
    """Number of pauses in the middle, 0.5 to 2 s each."""
    start: float = 0.0
    """Deviation of the start position (standard deviation) [m]."""
    again: bool = False
    """Every other recording goes back by a fifth of the task and repeats it."""
    sizes: float = 0.0
    """Relative deviation of the length of a third of the path (standard deviation)."""
    noise: float = 0.0
    """Position noise, low-passed as in motion capture (standard deviation) [m]."""


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
_TURNS: Final = np.linspace(0.0, 1.2, 13)[1:]
TASKS: Final[Mapping[str, FloatArray]] = {
    "opening": 0.5 * np.column_stack([np.cos(_TURNS), np.sin(_TURNS)]) * 0.1,
    # The letter N: up, diagonally down, and up.
    "letter": np.array([[0.0, 0.3], [0.2, -0.3], [0.0, 0.3]]),
    # Three times back and forth on a line.
    "wiping": np.tile([[0.4, 0.01], [-0.4, 0.01]], (3, 1)),
}
"""Steps from each corner of the path to the next, in thirds, (N, 2) [m]."""


class Recorded(NamedTuple):
    """A recording, and the true progress in the task at each sample, (N,).

    The progress decreases where the hand goes back.
    """

    demonstration: Demonstration
    done: FloatArray


def recordings(task: str, habit: Habit, seed: int) -> list[Recorded]:
    """Return recordings of one task by one person."""
    rng = np.random.default_rng(seed)
    steps = TASKS[task]
    return [recording(steps, habit, n % 2 == 1, rng) for n in range(_RECORDINGS)]


def recording(
    steps: FloatArray, habit: Habit, again: bool, rng: np.random.Generator
) -> Recorded:
    """Record a task; ``again`` repeats a part if the habit includes repetitions."""
    duration = rng.uniform(3.0, 6.0)
    moving = np.arange(round(duration * _RATE)) / (duration * _RATE)
    # The pace varies, and the ends are gentle.
    pace = np.sin(np.pi * moving) ** 0.5 * np.exp(
        0.5 * gaussian_filter1d(rng.standard_normal(moving.size), 20) * 20**0.5
    )
    done = np.cumsum(pace) / np.sum(pace)
    if habit.again and again:
        # Go back by a fifth of the task at one point, and forward again.
        turn = rng.uniform(0.35, 0.75)
        place = int(np.searchsorted(done, turn))
        count = place - int(np.searchsorted(done, turn - 0.2))
        back = np.interp(
            np.linspace(0.0, 1.0, count), [0.0, 0.5, 1.0], [turn, turn - 0.2, turn]
        )
        done = np.insert(done, place, back)
    for _ in range(habit.pauses):
        place = rng.integers(done.size // 5, 4 * done.size // 5)
        held = round(rng.uniform(0.5, 2.0) * _RATE)
        done = np.insert(done, place, np.full(held, done[place]))
    ends = (rng.uniform(0.0, habit.rest, 2) * _RATE).astype(int)
    done = np.pad(done, ends, mode="edge")
    sizes = np.exp(habit.sizes * rng.standard_normal(3))
    thirds = np.repeat(sizes, len(steps) // len(sizes))[:, None]
    corners = np.vstack([np.zeros(2), np.cumsum(thirds * steps, axis=0)])
    shares = np.linspace(0.0, 1.0, len(corners))
    fine = np.linspace(0.0, 1.0, 1001)
    # Corners are rounded because a hand does not stop there.
    way = gaussian_filter1d(
        np.column_stack([np.interp(fine, shares, column) for column in corners.T]),
        15.0,
        axis=0,
        mode="nearest",
    )
    positions = np.zeros((done.size, 3))
    for axis in range(2):
        positions[:, axis] = np.interp(done, fine, way[:, axis])
    # From another start, the usual path is reached after a quarter of the task.
    positions += (
        habit.start
        * rng.standard_normal(3)
        * np.clip(1.0 - 4.0 * done, 0.0, 1.0)[:, None] ** 2
    )
    shaken = gaussian_filter1d(rng.standard_normal(positions.shape), 2.0, axis=0)
    positions += habit.noise * shaken / max(shaken.std(), 1e-12)
    times = np.arange(done.size) / _RATE
    return Recorded(Demonstration.from_positions(times, positions), done)


def phase_error(recorded: Sequence[Recorded], form: AlignmentMethod) -> float:
    """Return the rms difference of true progress at equal phase, as a share.

    The progress at a sample is the largest so far, so that going back adds no error.
    """
    aligned = align([one.demonstration for one in recorded], method=form)
    assert aligned.clocks is not None
    each = []
    for one, clock, rests in zip(recorded, aligned.clocks, aligned.rests, strict=True):
        # Times of the recording at which its clock, which excludes rests, had this
        # value.
        times = one.demonstration.times
        left_out = sum(rest.end - rest.start for rest in rests)
        found = times[0] + clock * (times[-1] - times[0] - left_out)
        for rest in rests:
            found = np.where(found >= rest.start, found + rest.end - rest.start, found)
        each.append(np.interp(found, times, np.maximum.accumulate(one.done)))
    done = np.stack(each)
    return float(np.sqrt(np.mean((done - done.mean(axis=0)) ** 2)))


def compare_forms(habits: Sequence[str], seeds: int) -> Measurement:
    """Measure the phase error of every form of alignment, by habit, over all tasks."""
    rows: dict[str, dict[str, float]] = {}
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
    worst = max(row["directions"] / row["interpolation"] for row in rows.values())
    return Measurement(
        title=f"phase error [%], rms: {len(TASKS)} tasks, {seeds} sets of each",
        rows=rows,
        targets=(at_most("directions / interpolation, worst habit", worst, 1.0),),
    )


def compare_sets(sets: Sequence[Path]) -> Measurement:
    """Measure spread and left-out likelihood of real recordings.

    Every alignment includes the left-out recording, which favours forms that warp time
    more.
    """
    rows: dict[str, dict[str, Value]] = {}
    for path in sets:
        shown = load_demonstrations(path).demonstrations
        for form in FORMS:
            aligned = align(shown, method=form, n_samples=_PHASES)
            times, poses = aligned.times, aligned.poses
            apart = poses - poses.mean(axis=0)
            spread = np.sqrt(np.mean(np.sum(apart[..., :3] ** 2, axis=-1)))
            scores = []
            for number, left_out in enumerate(poses):
                given = np.delete(poses, number, axis=0)
                skill = fit_skill(AlignedDemonstrations(times=times, poses=given))
                scores.append(score(skill.predict(times), left_out))
            rows[f"{path.name}: {form}"] = {
                "spread of positions [mm]": 1e3 * float(spread),
                **mean_scores(scores),
            }
    return Measurement(title="real recordings, each left out once", rows=rows)


def draw_letter(file: Path) -> None:
    """Draw a letter aligned by every form, for the habits that differ most."""
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


# --- Rests -------------------------------------------------------------------

METHODS: Final = ("gp", "kmp", "promp")
RESTS: Final = (0.0, 1.0, 2.0)
"""Rests at both ends [s]."""
_DOORS: Final = ("small", "medium", "large")
_WORST_RATIO: Final = 1.5
"""Largest accepted ratio of the radial forces with and without rests."""
_WITHIN: Final = f"sets within {_WORST_RATIO:g} x the same without rests"


class Case(NamedTuple):
    """Properties of a set of recordings, and the policy that learns from it."""

    method: str
    rest: float
    rate: float
    noise: float
    seed: int


def opened_after(case: Case) -> list[EpisodeMetrics]:
    """Learn from two recordings of each door, and open the three doors.

    Recordings of a seed differ by the rests only.
    """
    paces = np.random.default_rng(case.seed).uniform(4.0, 7.0, 2 * len(_DOORS))
    rng = np.random.default_rng((case.seed, 1))
    spread = case.noise * np.repeat([1.0, 4.0], 3)
    given = []
    for door, duration in zip(np.repeat(_DOORS, 2), paces.tolist(), strict=True):
        samples = round((duration + 2.0 * case.rest) * case.rate) + 1
        times = np.arange(samples) / case.rate
        progress = minimum_jerk((times - case.rest) / duration)
        poses = handle_pose_on_arc(DOORS[door].radius, DEMONSTRATED_ANGLE * progress)
        noisy = poses + spread * rng.standard_normal(poses.shape)
        given.append(Demonstration(times=times, poses=noisy))
    shown = LabelledDemonstrations(
        demonstrations=tuple(given), radii=tuple(None for _ in given)
    )
    tasks = [
        episode_task(door, DOORS[door], policy=case.method, seed=case.seed)
        for door in _DOORS
    ]
    return [episode_metrics(log) for log in opened(tasks, shown)]


def compare_rests(
    rates: Sequence[float], noises: Sequence[float], sets: int
) -> Measurement:
    """Open doors after learning from every kind of recording."""
    found: dict[Case, list[EpisodeMetrics]] = {}
    kinds = itertools.product(range(sets), METHODS, rates, noises, RESTS)
    for seed, method, rate, noise, rest in kinds:
        case = Case(method, rest, rate, noise, seed)
        found[case] = opened_after(case)
        if len(found) % 27 == 0:
            LOG.info("%d sets of recordings", len(found))
    # Peak radial force of a set, mean over its doors [N].
    radial = {
        case: float(np.mean([one.force_radial_peak for one in metrics]))
        for case, metrics in found.items()
    }
    rows: dict[str, dict[str, Value]] = {}
    targets: list[Target] = []
    for method, rest in itertools.product(METHODS, RESTS):
        here = [case for case in found if (case.method, case.rest) == (method, rest)]
        ratios = [radial[case] / radial[case._replace(rest=0.0)] for case in here]
        solved = [one.success for case in here for one in found[case]]
        share = float(np.mean(solved))
        within = float(np.mean([ratio <= _WORST_RATIO for ratio in ratios]))
        name = f"{method}, {rest:g} s"
        rows[name] = {
            "opened": f"{sum(solved)}/{len(solved)}",
            "share": share,
            "radial, median of sets [N]": float(np.median([radial[c] for c in here])),
            "over that without rests: median": float(np.median(ratios)),
            "largest": max(ratios),
            _WITHIN: within,
        }
        targets.append(at_least(f"{name}: opened and held, share", share, 1.0))
        targets.append(at_least(f"{name}: {_WITHIN}, share", within, 1.0))
    return Measurement(
        title=f"{sets} sets of each of {len(rates)} rates and {len(noises)} noises",
        rows=rows,
        targets=tuple(targets),
    )


# --- Commands ----------------------------------------------------------------


def alignments(
    sets: Sets = (),
    seeds: int = 5,
    habits: tuple[str, ...] = tuple(HABITS),
    figure: Path | None = None,
) -> None:
    """Measure every form of alignment; takes some minutes.

    Args:
        sets: Folders made by ``gplfd demos import``.
        seeds: Sets of recordings of each kind.
        habits: Deviations of the recordings from clean ones.
        figure: File for a picture of an aligned letter.
    """
    measures: dict[str, Callable[[], Measurement]] = {
        "messy": partial(compare_forms, habits, seeds)
    }
    if sets:
        measures["real"] = partial(compare_sets, sets)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # about noise and rests
        report(measures)
        if figure is not None:
            draw_letter(figure)


def rests(
    sets: int = 5,
    rates: tuple[float, ...] = (60.0, 120.0, 240.0),
    noises: tuple[float, ...] = (0.0, 3e-4, 1e-3),
) -> None:
    """Measure the effect of rests; takes a quarter of an hour.

    Args:
        sets: Sets of recordings of each kind.
        rates: Samples per second.
        noises: Position noise [m]; rotation noise is four times this number [rad].
    """
    report({"rests": partial(compare_rests, rates, noises, sets)})


COMMANDS: Final = {"alignments": alignments, "rests": rests}

if __name__ == "__main__":
    tyro.extras.subcommand_cli_from_dict(COMMANDS)
