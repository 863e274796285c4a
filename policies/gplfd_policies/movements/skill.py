"""A demonstrated skill: six Gaussian processes over the phase of the task.

Paper: Arduengo et al., *Gaussian-Process-based Robot Learning from Demonstration*,
arXiv:2002.09979, Section III-B: the policy of Eq. (12), six outputs independent a
priori, each with the kernel of Eq. (13) and its own noise r(t), Eq. (15).
"""

import warnings
from dataclasses import asdict, dataclass, fields
from functools import cached_property, partial
from operator import attrgetter
from pathlib import Path
from typing import Any, Final

import numpy as np

from gplfd_policies.arrays.shapes import Covariances, Outputs, Times
from gplfd_policies.arrays.storage import Members, read_archive, write_archive
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.demonstrations.demonstration import Correction, Demonstration
from gplfd_policies.gp.deviations import DeviationProcess, fit_deviations, wobbling
from gplfd_policies.gp.exact import Replicates
from gplfd_policies.gp.heteroscedastic import (
    HeteroscedasticGP,
    HomoscedasticNoise,
    KerstingNoise,
    MapNoise,
    MultiOutputGP,
    NoiseModel,
    NoiseProfile,
    OutputMoments,
)
from gplfd_policies.gp.kernels import RBF
from gplfd_policies.movements.movement import (
    GaussianTrajectory,
    LearnedMovement,
    checked_times,
)

NOISE_MODELS: dict[str, NoiseModel] = {
    "map": MapNoise(),
    "kersting": KerstingNoise(),
    "homoscedastic": HomoscedasticNoise(),
}
"""Noise models by name: "map" is the default, "kersting" the paper's."""

_FEW: Final = 3  # up to this many demonstrations, `fit_skill` warns
_WINDOW: Final = 0.1  # Share of the task over which the spread counts as constant.

SIZE_STD: Final = 0.25
"""γ: standard deviation of the size of the next repetition relative to a single
demonstration, as a share of the displacement from its start."""

FRAMES: Final = ("door", "first pose", "given")  # Frames that a skill may have.
_KIND, _VERSION = "a gplfd skill", 4
"""Content of the file of a skill, and version of its layout."""
_FORCES: Final = "forces_"  # prefix of the names of arrays learned from forces
_ALIGNED: Final = ("times", "poses", "duration", "end", "drift")
_NO_CLOCKS: Final = np.zeros((0, 0))  # stored instead of unknown clocks
_DEVIATION: Final = tuple(field.name for field in fields(DeviationProcess))
_PARAMETERS: Final = {
    "offset": attrgetter("offset"),
    "scale": attrgetter("scale"),
    "length_scale": attrgetter("kernel.length_scale"),
    "signal_std": attrgetter("kernel.signal_std"),
    "noise_level": attrgetter("noise.level"),
    "noise_floor": attrgetter("noise.floor"),
    "noise_coefficients": attrgetter("noise.coefficients"),
}
"""Parameters of each process by the name of their array."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Skill(LearnedMovement):
    """The learned policy π(t); made by `fit_skill`, immutable."""

    processes: MultiOutputGP
    corrections: tuple[Correction, ...] = ()
    """Corrections in order; completed, they are the last demonstrations."""
    frame: str = "door"
    """Frame of the poses, one of `FRAMES`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.frame not in FRAMES:
            raise ValueError(f"frame is {self.frame!r:.40}, must be one of {FRAMES}")

    @property
    def count(self) -> int:
        """Number of demonstrations D."""
        return len(self.aligned.poses)

    @cached_property
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
        """Degrees of freedom of the spread; None for a single demonstration.

        Demonstrations that deviate smoothly leave D − 1. If they deviate independently,
        every sample within `_WINDOW` counts; in between, W (1 − ρ²)/(1 + ρ²) of W
        samples (``test_degrees_of_freedom_count_independent_looks``).
        """
        if self.count < 2:
            return None
        squared = self.smoothness**2
        looks = _WINDOW * len(self.aligned.times) * (1.0 - squared) / (1.0 + squared)
        return (self.count - 1) * max(looks, 1.0)

    @cached_property
    def deviations(self) -> tuple[DeviationProcess, ...]:
        """Model of the deviations from the mean, per output; computed on first use."""
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

    def predict(self, times: Times) -> GaussianTrajectory:
        """The distribution of the pose at phases ``times``, Eqs. (10)–(11).

        The variance is r(t) plus the variance of the mean; for a single demonstration
        plus the variance of its size, (γ (m(t) - m(0)))². The variance of the mean is
        at least ρ r/D, because the demonstrations are smooth
        (``test_uncertainty_of_the_mean_is_at_least_its_share_of_the_spread``). Outside
        the demonstrated range the mean returns to the prior mean, and σ grows.
        """
        times = checked_times(times)
        moments = self.processes.moments(times)
        share = self.smoothness / self.count * moments.noise
        share_rate = self.smoothness / self.count * moments.noise_rate
        smooth = moments.latent >= share
        variance = np.where(smooth, moments.latent, share) + moments.noise
        rate = moments.noise_rate + np.where(smooth, moments.latent_rate, share_rate)
        displacement = None
        if self.count == 1:
            # γ (m(t) - m(0)), by the unknown size of a single demonstration.
            start = self.processes.moments(self.aligned.times[:1]).mean
            displacement = SIZE_STD * (moments.mean - start)
            variance = variance + displacement**2
            rate += 2.0 * SIZE_STD * displacement * moments.mean_rate
        std = np.sqrt(variance)
        return GaussianTrajectory(
            times=times,
            mean=moments.mean,
            std=std,
            mean_rate=moments.mean_rate,
            std_rate=rate / (2.0 * std),
            covariance_function=partial(self._covariance, times, moments, displacement),
            degrees_of_freedom=self.degrees_of_freedom,
        )

    def _covariance(
        self, times: Times, moments: OutputMoments, displacement: Outputs | None
    ) -> Covariances:
        """Eq. (11), the posterior of f scaled to the variance of `predict`."""
        covariance = self.processes.latent_covariance(times)
        floor = self.smoothness / self.count * moments.noise
        latent = np.maximum(moments.latent, np.finfo(np.float64).tiny)
        stretch = np.sqrt(np.maximum(floor / latent, 1.0)).T
        covariance *= stretch[:, :, None] * stretch[:, None, :]
        variance = np.maximum(moments.latent, floor) + moments.noise
        np.einsum("imm->im", covariance)[:] = variance.T
        if displacement is not None:
            covariance += np.einsum("mi,ni->imn", displacement, displacement)
        return covariance

    def check_plausible(self) -> None:
        """Raise a ValueError if no hand moves or pulls like this."""
        expected = self.predict(np.linspace(0.0, 1.0, 401))
        steps = np.diff(expected.mean, axis=0).reshape(-1, 2, 3)
        clock = self.duration * np.diff(expected.times)
        speed, turn = (np.linalg.norm(steps, axis=2) / clock[:, None]).max(axis=0)
        force = self.forces.predict(expected.times).std.max() if self.forces else 0.0
        for quantity, value, most in (
            ("duration [s]", self.duration, 3600.0),
            ("speed [m/s]", speed, 10.0),
            ("speed [rad/s]", turn, 60.0),
            ("standard deviation [m, rad]", expected.std.max(), 10.0),
            ("standard deviation [N, N m]", force, 1e4),
        ):
            if not value <= most:
                raise ValueError(
                    f"its {quantity} is {value:.3g}; at most {most:g} is allowed; are "
                    "demonstrations in m, rad, s, N and N m?"
                )

    def save(self, path: str | Path) -> None:
        """Save the skill to a file, complete or absent; `load_skill` reads it.

        The file is an archive of arrays (.npz): the aligned demonstrations and the
        parameters of processes and deviations; the same for forces, if there are any.

        Raises:
            ValueError: if the skill is not plausible, or its noise model does not build
                on `gplfd_policies.gp.heteroscedastic.NoiseProfile.basis_over`.
        """
        self.check_plausible()
        arrays = self._arrays("") | {"frame": np.array(self.frame)}
        if isinstance(self.forces, Skill):
            arrays |= self.forces._arrays(_FORCES)
            arrays["wrenches"] = np.asarray(self.aligned.wrenches)
        for number, correction in enumerate(self.corrections):
            stored = asdict(correction)
            for name, value in (stored.pop("motion") | stored).items():
                if value is not None:
                    arrays[f"correction_{number}_{name}"] = np.array(value)
        write_archive(path, kind=_KIND, version=_VERSION, arrays=arrays)

    def _arrays(self, prefix: str) -> dict[str, np.ndarray]:
        """Return arrays by prefixed name, without those of forces and corrections."""
        aligned, outputs = self.aligned, self.processes.outputs
        basis = NoiseProfile.basis_over(aligned.times)
        if any(output.noise.basis != basis for output in outputs):
            raise ValueError(
                "this skill cannot be saved: its noise model must return profiles on "
                "NoiseProfile.basis_over(times)"
            )
        numbers = {name: getattr(aligned, name) for name in _ALIGNED}
        numbers["clocks"] = _NO_CLOCKS if aligned.clocks is None else aligned.clocks
        for name, parameter in _PARAMETERS.items():
            numbers[name] = [parameter(output) for output in outputs]
        deviations = self.deviations if self.count > 1 else ()
        for name in _DEVIATION:
            numbers[name] = [getattr(deviation, name) for deviation in deviations]
        return {
            f"{prefix}{name}": np.array(values, dtype=np.float64)
            for name, values in numbers.items()
        }


def load_skill(path: str | Path) -> Skill:
    """Read a skill that `Skill.save` wrote; it predicts and adapts with the same bits.

    Raises:
        FileNotFoundError: if there is no such file.
        ValueError: if the file is damaged, or not of this kind or version.
    """

    def build(members: Members) -> Skill:
        forces = None
        if "wrenches" in members:
            forces = _part_of(members, _FORCES)
        corrections = list[Correction]()
        while f"{(prefix := f'correction_{len(corrections)}_')}led" in members:
            stored: dict[str, Any] = {
                name.removeprefix(prefix): array if array.ndim else array.item()
                for name, array in members.items()
                if name.startswith(prefix)
            }
            names = ("times", "poses", "wrenches")
            motion = Demonstration(**{name: stored.pop(name, None) for name in names})
            corrections.append(Correction(motion=motion, **stored))
        skill = _part_of(
            members,
            "",
            forces=forces,
            corrections=tuple(corrections),
            frame=str(members["frame"]),
        )
        skill.check_plausible()
        return skill

    with np.errstate(all="ignore"):  # of numbers that are refused
        return read_archive(path, kind=_KIND, version=_VERSION, build=build)


def _part_of(members: Members, prefix: str, **others: Any) -> Skill:
    """Build the skill of the motion or of the forces, given the prefix of names."""

    def finite(name: str) -> np.ndarray:
        array = members[prefix + name]
        if array.dtype != np.float64 or not np.isfinite(array).all():
            raise ValueError(f"{name!r} must be finite numbers of type float64")
        return array

    clocks = finite("clocks")
    aligned = AlignedDemonstrations(
        times=finite("times"),
        poses=finite("poses"),
        duration=float(finite("duration")),
        end=float(finite("end")),
        drift=finite("drift"),
        clocks=None if clocks.shape == _NO_CLOCKS.shape else clocks,
        wrenches=None if prefix else members.get("wrenches"),
    )
    basis = NoiseProfile.basis_over(aligned.times)
    columns = [finite(name).tolist() for name in _PARAMETERS]
    outputs = tuple(
        HeteroscedasticGP(
            offset=offset,
            scale=scale,
            replicates=Replicates.from_samples(aligned.times, (poses - offset) / scale),
            kernel=RBF(length_scale=length, signal_std=signal),
            noise=NoiseProfile(
                level=level, basis=basis, coefficients=np.array(varying), floor=floor
            ),
        )
        for poses, offset, scale, length, signal, level, floor, varying in zip(
            np.moveaxis(aligned.poses, 2, 0), *columns, strict=True
        )
    )
    processes = MultiOutputGP(outputs=outputs)
    skill = Skill(aligned=aligned, processes=processes, **others)
    table = np.transpose([finite(name) for name in _DEVIATION])
    if table.size:  # learned on first use otherwise
        vars(skill)["deviations"] = tuple(
            DeviationProcess(**dict(zip(_DEVIATION, values, strict=True)))
            for values in table.tolist()
        )
    return skill


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
            model. For a single demonstration, "map" is replaced by "homoscedastic".
        centred: whether the prior mean is the demonstrations' average, or zero; for
            any other see `gplfd_policies.movements.prior_mean.fit_residual`.

    Raises:
        TypeError: if the argument is not aligned demonstrations.
        ValueError: for an unknown name, or too few demonstrations for the noise model.

    Warns: UserWarning: for three demonstrations or fewer.
    """
    if not isinstance(aligned, AlignedDemonstrations):
        raise TypeError(
            "fit_skill learns from gplfd_policies.AlignedDemonstrations, got a "
            f"{type(aligned).__name__}; call fit_skill(align(demonstrations))"
        )
    times, poses = aligned.times, aligned.poses
    if isinstance(noise, str):
        if noise not in NOISE_MODELS:
            raise ValueError(
                f"Unknown noise model {noise!r}; choose from {sorted(NOISE_MODELS)} "
                f"or pass a noise model object."
            )
        # A single demonstration has no spread from which a noise model could learn.
        alone = noise == "map" and len(poses) == 1
        noise = NOISE_MODELS["homoscedastic" if alone else noise]
    processes = MultiOutputGP.fit(times, poses, noise, centred=centred)
    if len(poses) <= _FEW:
        reason = (
            f"{len(poses)} demonstrations leave {len(poses) - 1} degree(s) of freedom "
            "for the spread: where they cross by chance, the uncertainty is far too "
            "small and the robot is stiff"
        )
        if len(poses) == 1:
            reason = (
                "One demonstration does not show how repetitions differ: they are "
                f"assumed to be larger or smaller by {SIZE_STD:.0%}"
            )
        warnings.warn(f"{reason}. Give 4 or more.", UserWarning, stacklevel=2)
    return Skill(aligned=aligned, processes=processes)
