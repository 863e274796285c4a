"""A demonstrated skill: six Gaussian processes over the phase of the task.

Paper: Arduengo et al., *Gaussian-Process-based Robot Learning from Demonstration*,
arXiv:2002.09979, Section III-B: the policy of Eq. (12), six outputs independent a
priori, each with the kernel of Eq. (13) and its own noise r(t), Eq. (15).
"""

import warnings
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

import numpy as np
from jaxtyping import Float

from gplfd_policies.arrays.one_thread import one_thread
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.gp.deviations import DeviationProcess, fit_deviations
from gplfd_policies.gp.kersting import KerstingNoise
from gplfd_policies.gp.left_out import wobbling
from gplfd_policies.gp.multi_output import MultiOutputGP, OutputMoments
from gplfd_policies.gp.noise import HomoscedasticNoise, MapNoise
from gplfd_policies.gp.noise_profile import NoiseModel
from gplfd_policies.movements.movement import LearnedMovement
from gplfd_policies.movements.skill_archive import read_skill, write_skill
from gplfd_policies.movements.trajectory import GaussianTrajectory, checked_times

NOISE_MODELS: dict[str, NoiseModel] = {
    "map": MapNoise(),
    "kersting": KerstingNoise(),
    "homoscedastic": HomoscedasticNoise(),
}
"""Noise models by name: "map" is the default, "kersting" the paper's."""

_FEW = 3
"""Up to this many demonstrations, `fit_skill` warns."""
_WINDOW = 0.1
"""Stretch of the task, as a share of it, over which the spread is taken as one number:
the shortest length-scale that the noise models allow."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Skill(LearnedMovement):
    """The learned policy π(t); made by `fit_skill`, immutable."""

    processes: MultiOutputGP
    """The six processes (x, y, z, θu_x, θu_y, θu_z)."""

    @property
    def count(self) -> int:
        """Number of demonstrations D."""
        return len(self.aligned.poses)

    @cached_property
    @one_thread
    def smoothness(self) -> float:
        """Correlation ρ of neighbouring samples of a deviation: 0 white, 1 smooth."""
        times, poses = self.aligned.times, self.aligned.poses
        spread = self.processes.moments(times).noise
        deviations = (poses - poses.mean(axis=0)) / np.sqrt(spread)
        energy = float(np.sum(deviations**2))
        if energy < np.finfo(np.float64).tiny:
            return 1.0
        neighbours = float(np.sum(deviations[:, 1:] * deviations[:, :-1]))
        return min(max(neighbours / energy, 0.0), 1.0)

    @cached_property
    def degrees_of_freedom(self) -> float | None:
        """Degrees of freedom behind the spread; None for a single demonstration.

        Real demonstrations deviate smoothly: M samples of a deviation are not M
        independent looks at the spread, and D − 1 is all there is. If they deviate
        independently, every sample within `_WINDOW` is a look of its own. In between,
        W samples of an autoregressive process count as W (1 − ρ²)/(1 + ρ²)
        (``test_degrees_of_freedom_count_independent_looks``).
        """
        if self.count < 2:
            return None
        squared = self.smoothness**2
        looks = _WINDOW * len(self.aligned.times) * (1.0 - squared) / (1.0 + squared)
        return (self.count - 1) * max(looks, 1.0)

    @cached_property
    @one_thread
    def deviations(self) -> tuple[DeviationProcess, ...]:
        """How the demonstrations deviate from their mean, per output; on first use.

        Raises:
            ValueError: for a single demonstration.
        """
        if self.count < 2:
            raise ValueError(
                "How repetitions deviate needs at least 2 demonstrations, got 1. Give "
                'more, or adapt with form="exact" or form="product".'
            )
        times = self.aligned.times
        deviations = self.aligned.poses - self.aligned.poses.mean(axis=0)
        noise = self.processes.moments(times).noise
        likely = [
            fit_deviations(times, deviations[:, :, output], noise[:, output])
            for output in range(6)
        ]
        return wobbling(likely, times, deviations, noise)

    @one_thread
    def predict(self, times: Float[np.ndarray, " M"]) -> GaussianTrajectory:
        """The distribution of the pose at ``times``, Eqs. (10)–(11).

        The variance is r(t) plus that of the mean. For the latter the model's own
        value assumes that samples of one demonstration deviate independently; it is
        never taken below ρ r/D, which is what demonstrations as smooth as these allow
        (``test_uncertainty_of_the_mean_is_at_least_its_share_of_the_spread``).

        Args:
            times: phases, shape (M,). Outside the demonstrated range the mean returns
                to the prior mean, the demonstrations' average or zero (see
                `fit_skill`), and the uncertainty grows.

        Raises:
            ValueError: if there are no times, or one is not finite.
        """
        times = checked_times(times)
        moments = self.processes.moments(times)
        share = self.smoothness / self.count * moments.noise
        smooth = moments.latent >= share
        variance = np.where(smooth, moments.latent, share) + moments.noise
        variance_rate = moments.noise_rate + np.where(
            smooth,
            moments.latent_rate,
            self.smoothness / self.count * moments.noise_rate,
        )
        std = np.sqrt(variance)
        return GaussianTrajectory(
            times=times,
            mean=moments.mean,
            std=std,
            mean_rate=moments.mean_rate,
            std_rate=variance_rate / (2.0 * std),
            covariance_function=partial(self._covariance, times, moments),
            degrees_of_freedom=self.degrees_of_freedom,
        )

    def _covariance(
        self, times: Float[np.ndarray, " M"], moments: OutputMoments
    ) -> Float[np.ndarray, "6 M M"]:
        """Eq. (11), the posterior of f stretched to the variance of `predict`."""
        covariance = self.processes.latent_covariance(times)
        floor = self.smoothness / self.count * moments.noise
        latent = np.maximum(moments.latent, np.finfo(np.float64).tiny)
        stretch = np.sqrt(np.maximum(floor / latent, 1.0)).T
        covariance *= stretch[:, :, None] * stretch[:, None, :]
        diagonal = np.arange(len(times))
        variance = np.maximum(moments.latent, floor) + moments.noise
        covariance[:, diagonal, diagonal] = variance.T
        return covariance

    @one_thread
    def save(self, path: str | Path) -> None:
        """Keep the skill in a file, complete or not at all; `load_skill` reads it.

        An archive of arrays (.npz): the aligned demonstrations, the parameters of the
        six processes, and those of the deviations. Nothing in it is code.

        Args:
            path: file to write; an existing one is replaced.

        Raises:
            ValueError: if a user's own noise model does not build on
                `gplfd_policies.gp.noise_profile.NoiseProfile.basis_over`.
            OSError: if the file cannot be written.
        """
        deviations = self.deviations if self.count > 1 else ()
        write_skill(path, self.aligned, self.processes, deviations)


@one_thread
def load_skill(path: str | Path) -> Skill:
    """Read a skill that `Skill.save` wrote.

    It predicts and adapts as the one that was saved, bit for bit on the same machine
    (``test_a_loaded_skill_is_the_saved_one_bit_for_bit``).

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if the file is damaged, holds something else, or has the layout of
            another version.
    """
    aligned, processes, deviations = read_skill(path)
    skill = Skill(aligned=aligned, processes=processes)
    if deviations:
        # Learned when first asked for; of this skill they were learned before.
        vars(skill)["deviations"] = deviations
    return skill


@one_thread
def fit_skill(
    aligned: AlignedDemonstrations,
    noise: str | NoiseModel = "map",
    *,
    centred: bool = True,
) -> Skill:
    """Learn a skill from aligned demonstrations.

    Args:
        aligned: D demonstrations on common phases.
        noise: how the spread r(t) is estimated: a name in `NOISE_MODELS` or a noise
            model object, such as ``KerstingNoise(n_iterations=30)``.
        centred: whether the prior mean is the demonstrations' average, or zero; for
            any other see `gplfd_policies.movements.residual.fit_residual`.

    Raises:
        TypeError: for anything else than aligned demonstrations.
        ValueError: for an unknown name, poses or times that are not finite, or too few
            demonstrations for the noise model.

    Warns:
        UserWarning: for three demonstrations or fewer.
    """
    if not isinstance(aligned, AlignedDemonstrations):
        raise TypeError(
            "fit_skill learns from gplfd_policies.AlignedDemonstrations, got a "
            f"{type(aligned).__name__}; call fit_skill(align(demonstrations)) with a "
            "sequence of gplfd_policies.Demonstration"
        )
    if isinstance(noise, str):
        if noise not in NOISE_MODELS:
            raise ValueError(
                f"Unknown noise model {noise!r}; choose from {sorted(NOISE_MODELS)} "
                f"or pass a noise model object."
            )
        noise = NOISE_MODELS[noise]
    times, poses = aligned.times, aligned.poses
    if not (np.isfinite(times).all() and np.isfinite(poses).all()):
        raise ValueError("Aligned demonstrations must be finite; found NaN or inf.")
    processes = MultiOutputGP.fit(times, poses, noise, centred=centred)
    if len(poses) <= _FEW:
        # Level 2 is the decorator.
        warnings.warn(_few_demonstrations(len(poses)), UserWarning, stacklevel=3)
    return Skill(aligned=aligned, processes=processes)


def _few_demonstrations(count: int) -> str:
    if count == 1:
        return (
            "One demonstration says nothing about how repetitions differ: the "
            "uncertainty is only the scatter of its samples around a smooth curve, "
            "and adaptation has no spread to work with. Give 4 or more."
        )
    return (
        f"{count} demonstrations leave {count - 1} degree(s) of freedom for the "
        f"spread: where they happen to cross, the uncertainty is far too small, and "
        f"the robot stiff there. Intervals use Student-t quantiles; the standard "
        f"deviation itself stays uncertain. Give 4 or more."
    )
