"""Fig. 2, Section II-C: one noise level for the whole task against local noise."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure
from scipy.special import ndtr, stdtrit

from gplfd_experiments.analysis.figures import style
from gplfd_experiments.analysis.figures.material import Material
from gplfd_experiments.analysis.figures.pick_and_place import (
    HEIGHT,
    PHASES,
    constrained_set,
    deviations,
    true_height,
    true_spread,
)
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.gp.noise import NoiseModel, NoiseProfile
from gplfd_policies.movements.movement import GaussianTrajectory
from gplfd_policies.movements.skill import fit_skill

TITLE: Final = "One noise level against a local one"
DOORS: Final = ()
_DEMONSTRATIONS, _SETS, _FRESH = 20, 8, 1000


@dataclass(frozen=True, kw_only=True, slots=True)
class ConstantNoise:
    """One constant noise variance for the whole task, set instead of fitted."""

    quantile: float
    """The noise is this quantile over time of the demonstrations' variance, 0 to 1."""

    def fit(
        self, times: Float[np.ndarray, " M"], samples: Float[np.ndarray, "D M"]
    ) -> NoiseProfile:
        """Take the quantile of the sample variances of D curves at M times."""
        local = samples.var(axis=0, ddof=1)
        return NoiseProfile.constant(times, float(np.quantile(local, self.quantile)))


_NOISES: Final[Mapping[str, str | NoiseModel]] = {
    "low": ConstantNoise(quantile=0.1),
    "high": ConstantNoise(quantile=0.9),
    "likely": "homoscedastic",
    "local": "map",
}


@dataclass(frozen=True, kw_only=True, slots=True)
class LocalNoise:
    """Data of Fig. 2, for the height of the hand at M phases."""

    demonstrations: FloatArray
    """Heights in the first set of demonstrations [m], (D, M)."""
    policies: Mapping[str, GaussianTrajectory]
    """Distributions learned from the first set, by the name of the noise."""
    coverage: Mapping[str, FloatArray]
    """Share of new repetitions inside the 95 % band of each, mean over sets, (M,)."""
    expected: tuple[float, float]
    """95 % range of this mean if the spread is estimated at each phase
    independently."""


def measure(material: Material) -> LocalNoise:
    """Fit the models to several sets and test them on new repetitions."""
    rng = np.random.default_rng(material.seed)
    *set_rngs, fresh_rng, error_rng = rng.spawn(_SETS + 2)
    fresh = true_height(PHASES) + deviations(_FRESH, fresh_rng)
    poses = np.repeat(fresh[..., None], 6, axis=-1)
    sets = [constrained_set(_DEMONSTRATIONS, rng) for rng in set_rngs]
    policies = {
        name: [fit_skill(shown, noise=noise).predict(PHASES) for shown in sets]
        for name, noise in _NOISES.items()
    }
    coverage = {
        name: np.mean([p.inside(poses)[..., HEIGHT].mean(axis=0) for p in fits], axis=0)
        for name, fits in policies.items()
    }
    # 95 % range of the mean coverage of mean ± t s √(1 + 1/D), s² ~ σ² χ²/(D-1).
    free = _DEMONSTRATIONS - 1
    spread = np.sqrt(error_rng.chisquare(free, (10_000, _SETS)) / free)
    mean = np.sqrt(1.0 / _DEMONSTRATIONS) * error_rng.standard_normal(spread.shape)
    student = float(stdtrit(free, 0.975))
    half = student * np.sqrt(1.0 + 1.0 / _DEMONSTRATIONS) * spread
    estimated = (ndtr(mean + half) - ndtr(mean - half)).mean(axis=1)
    low, high = np.quantile(estimated, [0.025, 0.975])
    return LocalNoise(
        demonstrations=sets[0].poses[:, :, HEIGHT],
        policies={name: fits[0] for name, fits in policies.items()},
        coverage=coverage,
        expected=(float(low), float(high)),
    )


def draw(shown: LocalNoise) -> Figure:
    """Draw the models, the noise, and the coverage of the bands."""
    figure = style.new_figure(style.PAGE, 3.6)
    axes = figure.subplot_mosaic([["a", "b", "c"], ["d", "e", "e"]])
    for panel, name in {"a": "low", "b": "high", "c": "local"}.items():
        height, policy = axes[panel], shown.policies[name]
        curves = shown.demonstrations.T
        height.plot(PHASES, curves, color=style.DEMONSTRATION, linewidth=0.5)
        height.lines[0].set_label("demonstrations")
        labels = {"band_label": "95 %", "label": "mean"}
        style.mean_and_interval(height, policy, HEIGHT, style.ADAPTED, **labels)
        height.sharey(axes["a"])
    axes["a"].set_ylabel("height [m]")
    axes["a"].legend(loc="lower center")

    noise = axes["d"]
    noise.plot(PHASES, 1e3 * true_spread(PHASES), color=style.TRUTH, linestyle="--")
    local = 1e3 * shown.policies["local"].std[:, HEIGHT]
    noise.plot(PHASES, local, color=style.ADAPTED)
    noise.set(ylabel="standard deviation [mm]", ylim=(0.0, None))
    noise.legend(["true spread", "heteroscedastic GP"], loc="lower center")

    covered = axes["e"]
    low, high = (100.0 * bound for bound in shown.expected)
    covered.axhspan(low, high, color="0.92", linewidth=0.0, label="sampling error")
    covered.axhline(95.0, color="0.5", linewidth=0.6)
    for name, label, colour, line in (
        ("low", "ends (a)", style.BEFORE, ":"),
        ("high", "middle (b)", style.BEFORE, "--"),
        ("likely", "most likely", style.AXIS_X, "-"),
        ("local", "local (c)", style.ADAPTED, "-"),
    ):
        share = 100.0 * shown.coverage[name]
        covered.plot(PHASES, share, color=colour, linestyle=line, label=label)
    covered.set(ylabel="repetitions inside [%]", ylim=(0.0, 102.0))
    covered.legend(loc="center", bbox_to_anchor=(0.5, 0.55), ncols=2)

    for panel_axes in axes.values():
        panel_axes.set(xlabel="phase", xlim=(0.0, 1.0))
    standard = [f"standard GP, noise of the {part}" for part in ("ends", "middle")]
    coverage = f"coverage of the 95 % band, mean of {_SETS} sets"
    titles = [*standard, "heteroscedastic GP", "local noise", coverage]
    style.name_panels(axes.values(), titles)
    return figure


def caption(shown: LocalNoise) -> str:
    """Describe the figure and state its numbers."""
    ends, middle = abs(PHASES - 0.5) > 0.4, abs(PHASES - 0.5) < 0.1
    covered = ", ".join(
        f"{100.0 * share[ends].mean():.0f} % and {100.0 * share[middle].mean():.0f} "
        f"% ({name})"
        for name, share in shown.coverage.items()
    )
    local = 100.0 * shown.coverage["local"]
    low, high = (100.0 * bound for bound in shown.expected)
    return (
        f"Height of the hand in {len(shown.demonstrations)} synthetic pick-and-place "
        "motions with constrained ends and a free middle. (a, b) Gaussian processes "
        "with one noise level, that of the ends or of the middle; the paper does not "
        "say why its two differ. (c) Heteroscedastic process; (d) its standard "
        f"deviation. (e) Share of {_FRESH} new repetitions inside the 95 % band, mean "
        f"over {_SETS} sets; grey: range of this mean if the spread is estimated at "
        f"each phase ({low:.0f} to {high:.0f} %). Measured at the ends and in the "
        f"middle: {covered}. Local noise: {local.mean():.1f} % on average, "
        f"{local.min():.0f} to {local.max():.0f} % at its phases."
    )
