"""Figs. 2 to 4: noise, alignment and via-points in synthetic pick-and-place motions.

The paper's data are not public. As the paper states, both ends are constrained and the
path between them is free, or the shelf is at one of two heights.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure
from scipy.special import ndtr, ndtri, stdtrit

from gplfd_experiments.analysis.figures import style
from gplfd_experiments.analysis.figures.style import Material
from gplfd_experiments.data.teacher.motion import (
    minimum_jerk,
    smooth_functions,
    uneven_timing,
)
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies import AlignedDemonstrations, Demonstration, align
from gplfd_policies.adaptation import adapt
from gplfd_policies.adaptation.process import ProcessAdaptation
from gplfd_policies.adaptation.product import ProductAdaptation
from gplfd_policies.demonstrations import alignment
from gplfd_policies.gp.heteroscedastic import NoiseModel, NoiseProfile
from gplfd_policies.movements.movement import GaussianTrajectory, ViaPoint
from gplfd_policies.movements.skill import fit_skill

HEIGHT: Final = 1  # Output in figures of one dimension: y, upwards.
PHASES: Final = np.linspace(0.0, 1.0, 201)  # Phases of `constrained_set`, (201,).
_CORRELATION: Final = 0.25  # Correlation length of a repetition's deviation, in phase.


def true_spread(phases: FloatArray) -> FloatArray:
    """Standard deviation of the height between repetitions [m]: 3 mm at both ends."""
    return 0.003 + 0.037 * np.sin(np.pi * phases) ** 2


def true_height(phases: FloatArray) -> FloatArray:
    """Mean height [m]: over an obstacle, onto something 0.1 m higher."""
    return 0.1 * minimum_jerk(phases) + 0.2 * np.sin(np.pi * phases) ** 2


def deviations(count: int, rng: np.random.Generator) -> FloatArray:
    """Draw deviations of repetitions from the mean [m or rad], (``count``, 201)."""
    return true_spread(PHASES) * smooth_functions(PHASES, _CORRELATION, count, rng).T


def constrained_set(count: int, rng: np.random.Generator) -> AlignedDemonstrations:
    """Draw repetitions at `PHASES` of a task whose ends are constrained."""
    poses = deviations(6 * count, rng).reshape(count, 6, PHASES.size).swapaxes(1, 2)
    poses[:, :, 0] += 0.5 * minimum_jerk(PHASES)
    poses[:, :, HEIGHT] += true_height(PHASES)
    return AlignedDemonstrations(times=PHASES, poses=poses)


# --- Fig. 2, Section II-C: one noise level for the whole task against local noise ---

_REPETITIONS, _SETS, _FRESH = 20, 8, 1000


@dataclass(frozen=True, kw_only=True, slots=True)
class ConstantNoise:
    """One constant noise variance for the whole task, set instead of fitted."""

    quantile: float
    """The noise is this quantile over time of the demonstrations' variance, 0 to 1."""

    def fit(self, times: FloatArray, samples: FloatArray) -> NoiseProfile:
        """Take the quantile over M times of the variances of curves (D, M)."""
        local = samples.var(axis=0, ddof=1)
        return NoiseProfile.constant(times, float(np.quantile(local, self.quantile)))


_NOISES: Final[Mapping[str, str | NoiseModel]] = {
    "low": ConstantNoise(quantile=0.1),
    "high": ConstantNoise(quantile=0.9),
    "likely": "homoscedastic",
    "local": "map",
}
_COVERAGES: Final = (
    ("low", "ends (a)", style.BEFORE, ":"),
    ("high", "middle (b)", style.BEFORE, "--"),
    ("likely", "most likely", style.AXIS_X, "-"),
    ("local", "local (c)", style.ADAPTED, "-"),
)
"""Noise, label, colour and line of a curve of coverage."""


def expected_coverage(rng: np.random.Generator) -> tuple[float, float]:
    """Return the 95 % range of the mean coverage of independent estimates.

    At each phase, and in each set: mean ± t s √(1 + 1/D), with s² ~ σ² χ²/(D-1).
    """
    free = _REPETITIONS - 1
    spread = np.sqrt(rng.chisquare(free, (10_000, _SETS)) / free)
    mean = np.sqrt(1.0 / _REPETITIONS) * rng.standard_normal(spread.shape)
    half = float(stdtrit(free, 0.975)) * np.sqrt(1.0 + 1.0 / _REPETITIONS) * spread
    estimated = (ndtr(mean + half) - ndtr(mean - half)).mean(axis=1)
    low, high = np.quantile(estimated, [0.025, 0.975])
    return float(low), float(high)


def fig02(material: Material) -> tuple[Figure, str]:
    """Fit the models to several sets and test them on new repetitions."""
    rng = np.random.default_rng(material.seed)
    *set_rngs, fresh_rng, error_rng = rng.spawn(_SETS + 2)
    fresh = true_height(PHASES) + deviations(_FRESH, fresh_rng)
    poses = np.repeat(fresh[..., None], 6, axis=-1)
    sets = [constrained_set(_REPETITIONS, rng) for rng in set_rngs]
    policies = {
        name: [fit_skill(aligned, noise=noise).predict(PHASES) for aligned in sets]
        for name, noise in _NOISES.items()
    }
    # Share of repetitions inside the 95 % band [%], mean over the sets, (201,).
    inside = {
        name: 100.0
        * np.mean([p.inside(poses)[..., HEIGHT].mean(axis=0) for p in fits], axis=0)
        for name, fits in policies.items()
    }
    low, high = (100.0 * bound for bound in expected_coverage(error_rng))

    figure = Figure(figsize=(style.PAGE, 3.6), layout="constrained")
    axes = figure.subplot_mosaic([["a", "b", "c"], ["d", "e", "e"]])
    for panel, name in {"a": "low", "b": "high", "c": "local"}.items():
        curves = sets[0].poses[:, :, HEIGHT].T
        axes[panel].plot(PHASES, curves, color=style.DEMONSTRATION, linewidth=0.5)
        axes[panel].lines[0].set_label("demonstrations")
        labels = {"band_label": "95 %", "label": "mean"}
        policy = policies[name][0]
        style.mean_and_interval(axes[panel], policy, HEIGHT, style.ADAPTED, **labels)
        axes[panel].sharey(axes["a"])
    axes["a"].set_ylabel("height [m]")
    axes["a"].legend(loc="lower center")
    spread = 1e3 * policies["local"][0].std[:, HEIGHT]
    axes["d"].plot(PHASES, 1e3 * true_spread(PHASES), color=style.TRUTH, linestyle="--")
    axes["d"].plot(PHASES, spread, color=style.ADAPTED)
    axes["d"].set(ylabel="standard deviation [mm]", ylim=(0.0, None))
    axes["d"].legend(["true spread", "heteroscedastic GP"], loc="lower center")
    axes["e"].axhspan(low, high, color="0.92", linewidth=0.0, label="sampling error")
    axes["e"].axhline(95.0, color="0.5", linewidth=0.6)
    for name, label, colour, line in _COVERAGES:
        share = inside[name]
        axes["e"].plot(PHASES, share, color=colour, linestyle=line, label=label)
    axes["e"].set(ylabel="repetitions inside [%]", ylim=(0.0, 102.0))
    axes["e"].legend(loc="center", bbox_to_anchor=(0.5, 0.55), ncols=2)
    for panel_axes in axes.values():
        panel_axes.set(xlabel="phase", xlim=(0.0, 1.0))
    standard = [f"standard GP, noise of the {part}" for part in ("ends", "middle")]
    coverage = f"coverage of the 95 % band, mean of {_SETS} sets"
    titles = [*standard, "heteroscedastic GP", "local noise", coverage]
    style.name_panels(axes.values(), titles)

    ends = (PHASES < 0.1) | (PHASES > 0.9)
    middle = (PHASES > 0.4) & (PHASES < 0.6)
    covered = ", ".join(
        f"{share[ends].mean():.0f} % and {share[middle].mean():.0f} % ({name})"
        for name, share in inside.items()
    )
    local = inside["local"]
    return figure, (
        f"Height of the hand in {_REPETITIONS} synthetic pick-and-place motions. "
        "(a, b) One noise level, that of the ends or of the middle; the paper does not "
        "say why its two differ. (c) Heteroscedastic process; (d) its standard "
        f"deviation. (e) Share of {_FRESH} new repetitions inside the 95 % band, mean "
        f"over {_SETS} sets; grey: range of this mean if the spread is estimated at "
        f"each phase ({low:.0f} to {high:.0f} %). Measured at the ends and in the "
        f"middle: {covered}. Local noise: {local.mean():.1f} % on average, "
        f"{local.min():.0f} to {local.max():.0f} % at its phases."
    )


# --- Fig. 3, Section III-C: time distortion, and alignment by two measures ------------

LEVELS: Final = (0.12, 0.45)  # Heights of the shelves [m].
_COLOURS: Final = {LEVELS[0]: style.DOORS[0], LEVELS[1]: style.DOORS[2]}
_PER_LEVEL, _RATE = 3, 60.0  # Motions per shelf, and their sampling rate [Hz].
_METHODS: Final[Mapping[str, alignment.AlignmentMethod]] = {
    "euclidean": "dtw-euclidean",
    "completion": "interpolation",
    "dtw": "dtw",
}


@dataclass(frozen=True, slots=True)
class ShelfMotion:
    """One placing of an object on a shelf."""

    level: float  # Height of the shelf [m].
    demonstration: Demonstration
    progress: FloatArray  # True progress in the task at each sample, (N,), 0 to 1.


def shelf_motions(rng: np.random.Generator) -> list[ShelfMotion]:
    """Place objects with uneven timing; the path to a high shelf passes lower ones."""
    motions = []
    for level, level_rng in zip(LEVELS, rng.spawn(len(LEVELS)), strict=True):
        for motion_rng in level_rng.spawn(_PER_LEVEL):
            duration = motion_rng.uniform(2.5, 5.0)
            times = np.arange(round(duration * _RATE) + 1) / _RATE
            progress = minimum_jerk(uneven_timing(times / times[-1], 0.6, motion_rng))
            poses = 0.002 * smooth_functions(times, 0.8, 6, motion_rng)
            poses[:, 0] += 0.15 * progress
            poses[:, HEIGHT] += level * progress + 0.02 * np.sin(np.pi * progress)
            demonstration = Demonstration(times=times, poses=poses)
            motions.append(ShelfMotion(level, demonstration, progress))
    return motions


def phase_errors(
    motions: list[ShelfMotion], aligned: Mapping[str, AlignedDemonstrations]
) -> dict[str, float]:
    """Return the rms difference of true progress by alignment; "clock" is without."""
    phases = np.linspace(0.0, 1.0, 200)
    # Motions scaled to the same duration, not aligned.
    progress: dict[str, list[FloatArray]] = {"clock": []}
    for motion in motions:
        times = motion.demonstration.times
        progress["clock"].append(np.interp(phases, times / times[-1], motion.progress))
    for name, demonstrations in aligned.items():
        progress[name] = []
        for motion, poses in zip(motions, demonstrations.poses, strict=True):
            # An aligned pose has the progress of the nearest recorded pose, because the
            # motions do not cross themselves.
            recorded = motion.demonstration.poses[:, :3]
            distance = np.linalg.norm(poses[:, None, :3] - recorded, axis=2)
            progress[name].append(motion.progress[distance.argmin(axis=1)])
    return {
        name: float(np.sqrt(np.var(values, axis=0).mean()))
        for name, values in progress.items()
    }


def fig03(material: Material) -> tuple[Figure, str]:
    """Align one set of motions in each way."""
    motions = shelf_motions(np.random.default_rng(material.seed))
    demonstrations = [motion.demonstration for motion in motions]
    # As recorded: rests of the hand at a shelf are kept.
    aligned = {
        name: align(demonstrations, method=method, trim_rests=False)
        for name, method in _METHODS.items()
    }
    error = {n: 100.0 * value for n, value in phase_errors(motions, aligned).items()}

    figure = Figure(figsize=(style.COLUMN, 3.4), layout="constrained")
    (recorded, euclidean), (completed, index) = figure.subplots(2, 2)
    for motion in motions:
        colour, demo = _COLOURS[motion.level], motion.demonstration
        recorded.plot(demo.times, demo.poses[:, HEIGHT], color=colour)
        completion, _ = alignment.task_completion_index(demo)
        index.plot(demo.times, completion, color=colour)
    for panel, name in ((euclidean, "euclidean"), (completed, "completion")):
        for motion, poses in zip(motions, aligned[name].poses, strict=True):
            colour = _COLOURS[motion.level]
            panel.plot(aligned[name].times, poses[:, HEIGHT], color=colour)
        panel.set(xlabel="phase", xlim=(0.0, 1.0), xticks=[0.0, 0.5, 1.0])
        style.note(panel, 0.05, f"phase error {error[name]:.1f} %", fontsize=6.5)
    for panel in (recorded, index):
        panel.set(xlabel="time [s]", xlim=(0.0, None))
    for panel in (recorded, euclidean, completed):
        panel.set(ylabel="height [m]", ylim=(-0.03, 0.52))
    index.set_ylabel("completion ζ")
    shelves = {"high shelf": recorded.lines[-1], "low shelf": recorded.lines[0]}
    style.legend_above(figure, shelves)
    titles = "as recorded", "Euclidean DTW", "completion index", "the index itself"
    style.name_panels(figure.axes, titles)

    return figure, (
        f"{len(motions)} synthetic pick-and-place motions to shelves at "
        f"{LEVELS[0]:.2f} m and {LEVELS[1]:.2f} m. (a) As recorded. (b) Dynamic time "
        "warping on the distance of poses: the low motions arrive early and wait. (c) "
        "Matched at equal task completion index, Eq. (16), by interpolation, where the "
        "paper warps; (d) the index. Rms difference of true progress at equal phase: "
        f"{error['clock']:.1f} % when only scaled to one duration, "
        f"{error['euclidean']:.1f} % in (b), {error['completion']:.1f} % in (c), "
        f"{error['dtw']:.1f} % for warping on the index."
    )


# --- Fig. 4, Section III-D: a strong and a weak via-point -----------------------------

_GRID, _COARSE_GRID = PHASES[::2], PHASES[::20]
_STRONG, _WEAK = (0.3, 0.04, 0.001), (0.7, -0.04, 0.03)
"""Phase, shift from the demonstrations' mean [m], standard deviation [m]."""
_FAR: Final = 0.95
"""Beyond it, a via-point at phase 0.7 should change nothing: the end is fixed."""


def via_point_policies(
    demonstrations: AlignedDemonstrations,
) -> tuple[list[ViaPoint], dict[str, GaussianTrajectory]]:
    """Return both via-points, and the policy before and by each adaptation."""
    skill = fit_skill(demonstrations)
    via_points = []
    for phase, shift, std in (_STRONG, _WEAK):
        # For the height alone.
        pose = np.full(6, np.nan)
        pose[HEIGHT] = skill.predict(np.array([phase])).mean[0, HEIGHT] + shift
        via_points.append(ViaPoint(phase=phase, pose=pose, std=std))
    from_zero = partial(ProductAdaptation, prior_mean="zero")
    policies = {
        "demonstrated": skill.predict(_GRID),
        "process": adapt(skill, via_points, ProcessAdaptation).predict(_GRID),
        "product": adapt(skill, via_points, ProductAdaptation).predict(_GRID),
        "coarse": adapt(skill, via_points, ProductAdaptation).predict(_COARSE_GRID),
        "printed": adapt(skill, via_points, from_zero).predict(_GRID),
    }
    return via_points, policies


def missed(policy: GaussianTrajectory, via_point: ViaPoint) -> float:
    """Return the distance of a policy's mean from a via-point [m]."""
    reached = np.interp(via_point.phase, policy.times, policy.mean[:, HEIGHT])
    return abs(float(reached) - float(via_point.pose[HEIGHT]))


def fig04(material: Material) -> tuple[Figure, str]:
    """Adapt one skill to the two via-points in each form."""
    demonstrations = constrained_set(10, np.random.default_rng(material.seed))
    via_points, policies = via_point_policies(demonstrations)
    before = policies["demonstrated"]
    figure = Figure(figsize=(style.PAGE, 2.1), layout="constrained")
    panels = figure.subplots(1, 4, sharex=True, sharey=True)
    titles = {
        "demonstrated": "demonstrated",
        "process": "process",
        "product": f"product, {_GRID.size} phases",
        "coarse": f"product, {_COARSE_GRID.size} phases",
    }
    for panel, name in zip(panels, titles, strict=True):
        panel.set_xlabel("phase")
        if name == "demonstrated":
            curves = demonstrations.poses[:, :, HEIGHT].T
            panel.plot(PHASES, curves, color=style.DEMONSTRATION, linewidth=0.5)
            style.mean_and_interval(panel, before, HEIGHT, style.BEFORE)
            continue
        panel.plot(_GRID, before.mean[:, HEIGHT], color=style.BEFORE, linestyle="--")
        dot = "." if name == "coarse" else None
        look: dict[str, Any] = {"marker": dot, "markersize": 4.0}
        style.mean_and_interval(panel, policies[name], HEIGHT, style.ADAPTED, **look)
        for via_point in via_points:
            half = float(ndtri(0.975)) * float(np.asarray(via_point.std)[HEIGHT])
            pose = via_point.pose[HEIGHT]
            bar: dict[str, Any] = {"marker": "o", "ms": 3.0, "elinewidth": 0.9}
            bar |= {"capsize": 2.0, "color": style.TRUTH, "zorder": 5}
            panel.errorbar(via_point.phase, pose, half, **bar)
    style.name_panels(panels, titles.values())
    panels[0].set(xlim=(0.0, 1.0), ylabel="height [m]")

    def std(name: str, phase: float) -> str:
        policy = policies[name]
        return f"{1e3 * np.interp(phase, policy.times, policy.std[:, HEIGHT]):.0f} mm"

    letters = {"process": "(b)", "product": "(c)", "printed": "prior mean zero"}
    spreads = f"{std('process', 0.5)} (b), {std('product', 0.5)} (c)"
    misses, changes = [], []
    for name, letter in letters.items():
        strong, weak = (1e3 * missed(policies[name], point) for point in via_points)
        misses.append(f"{strong:.1f} mm and {weak:.0f} mm {letter}")
        change = (policies[name].mean - before.mean)[_GRID >= _FAR, HEIGHT]
        changes.append(f"{1e3 * np.abs(change).max():.1f} mm {letter}")
    return figure, (
        "Height of the hand in the pick-and-place task of Fig. 2, learned from "
        f"{len(demonstrations.poses)} demonstrations (a) and adapted to a strong "
        f"via-point ({1e3 * _STRONG[2]:.0f} mm) at phase {_STRONG[0]} and a weak one "
        f"({1e3 * _WEAK[2]:.0f} mm) at phase {_WEAK[0]}, {1e3 * abs(_STRONG[1]):.0f} "
        "mm off the mean (green, with 95 %). (b) Conditioning of the demonstrated "
        "process, the default; (c) the paper's product of Gaussians, Eqs. (20)–(21), "
        f"with the demonstrations' mean as prior mean; (d) at {_COARSE_GRID.size} "
        f"phases. σ at phase 0.5, without a via-point: {std('demonstrated', 0.5)} "
        f"before, {spreads}, {std('coarse', 0.5)} (d). Distance from the strong and "
        f"from the weak via-point: {', '.join(misses)}. Largest change of the mean in "
        "the last twentieth, where the end is fixed (σ = "
        f"{1e3 * before.std[-1, HEIGHT]:.1f} mm): {', '.join(changes)}."
    )
