"""What each method learns from demonstrations: a movement."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np

from policies.aligned import AlignedDemonstrations
from policies.alignment import align
from policies.baselines.dmp import fit_dmp
from policies.baselines.gmm_gp import fit_gmm_gp
from policies.baselines.gmr import fit_gmr
from policies.baselines.kmp import KMPConfig, fit_kmp
from policies.baselines.local_gp import LocalGPConfig, fit_local_gp
from policies.baselines.promp import fit_promp
from policies.baselines.wishart_gp import WishartGPConfig, fit_wishart_gp
from policies.demonstrations import Demonstration
from policies.movement import Movement
from policies.prior_mean import PriorMean
from policies.residual import fit_residual
from policies.skill import fit_skill

__all__ = [
    "NO_PRIOR_MEAN",
    "Learner",
    "TrainingInput",
    "aligned_demonstrations",
    "refuse_prior_mean",
]


@dataclass(frozen=True, kw_only=True, slots=True)
class TrainingInput:
    """What a policy may learn from.

    Attributes:
        demonstrations: At least one.
        seed: Seeds whatever is random in the policy's learning.
        radius: The true radius of the door to open [m], or None; privileged, only the
            oracle reads it.
        prior_mean: What is expected where nothing was demonstrated, or None; only
            some methods can be given one.
    """

    demonstrations: tuple[Demonstration, ...]
    seed: int = 0
    radius: float | None = None
    prior_mean: PriorMean | None = None


Learner = Callable[[TrainingInput], Movement]
"""Learns a movement."""

NO_PRIOR_MEAN: Final = "has no prior mean"
"""What a method says that cannot be given one."""

_START_TOLERANCE: Final = (0.05, 0.2)
"""How far from the closed handle a demonstration may start [m, rad]."""
_LARGEST_REACH: Final = 3.0
"""How far from it a demonstration may ever be [m]."""

DOOR_KMP: Final = KMPConfig(mean_regularisation=1.0, covariance_regularisation=400.0)
"""λ as published, and λ_c = N, which makes the prior variance the demonstrations' own.
The published λ_c of 60 belongs to letters in centimetres; translated to standardised
outputs both published values under-cover here and pull the mean 5 cm inwards."""


def aligned_demonstrations(
    training: TrainingInput, **alignment: Any
) -> AlignedDemonstrations:
    """Check the demonstrations and bring them onto common phases.

    Args:
        training: What was given.
        alignment: Options of `policies.alignment.align`.

    Raises:
        ValueError: There are none, or one is not in the task frame and in metres.
    """
    if not training.demonstrations:
        raise ValueError("no demonstrations were given; a policy needs at least one")
    for number, demonstration in enumerate(training.demonstrations):
        _check_start(number, demonstration)
    return align(training.demonstrations, **alignment)


def refuse_prior_mean(training: TrainingInput, method: str) -> None:
    """Refuse a prior mean on behalf of a method.

    Raises:
        ValueError: One was given.
    """
    if training.prior_mean is not None:
        raise ValueError(
            f"{method} {NO_PRIOR_MEAN} that could be given; leave it out, or choose "
            "gp, gp-paper, local-gp or wishart-gp"
        )


def learn_gp(training: TrainingInput) -> Movement:
    """The heteroscedastic GP."""
    return _around_prior_mean(training, aligned_demonstrations(training), fit_skill)


def learn_homoscedastic_gp(training: TrainingInput) -> Movement:
    """One noise level for the whole task."""
    fit = partial(fit_skill, noise="homoscedastic")
    return _around_prior_mean(training, aligned_demonstrations(training), fit)


def learn_euclidean_gp(training: TrainingInput) -> Movement:
    """Aligned by the distance of poses."""
    aligned = aligned_demonstrations(training, method="dtw-euclidean")
    return _around_prior_mean(training, aligned, fit_skill)


def learn_paper_gp(training: TrainingInput) -> Movement:
    """DTW on the raw completion index, Kersting's noise: as the paper states."""
    aligned = aligned_demonstrations(training, method="dtw", denoise=False)
    return _around_prior_mean(training, aligned, partial(fit_skill, noise="kersting"))


def learn_dmp(training: TrainingInput) -> Movement:
    """A dynamic movement primitive of the demonstrations' mean."""
    refuse_prior_mean(training, "dmp")
    return fit_dmp(aligned_demonstrations(training))


def learn_promp(training: TrainingInput) -> Movement:
    """A probabilistic movement primitive."""
    refuse_prior_mean(training, "promp")
    return fit_promp(aligned_demonstrations(training))


def learn_gmr(training: TrainingInput) -> Movement:
    """Gaussian-mixture regression."""
    refuse_prior_mean(training, "gmr")
    return fit_gmr(aligned_demonstrations(training))


def learn_local_gp(training: TrainingInput) -> Movement:
    """Local Gaussian processes."""
    fit = partial(fit_local_gp, config=LocalGPConfig())
    return _around_prior_mean(training, aligned_demonstrations(training), fit)


def learn_wishart_gp(training: TrainingInput) -> Movement:
    """A GP mean with a Wishart process of the deviations."""
    aligned = aligned_demonstrations(training)
    fit = partial(fit_wishart_gp, config=WishartGPConfig(), seed=training.seed)
    return _around_prior_mean(training, aligned, fit)


def learn_kmp(training: TrainingInput) -> Movement:
    """A kernelised movement primitive, calibrated for doors."""
    refuse_prior_mean(training, "kmp")
    return fit_kmp(aligned_demonstrations(training), DOOR_KMP)


def learn_published_kmp(training: TrainingInput) -> Movement:
    """A kernelised movement primitive with the published regularisation."""
    refuse_prior_mean(training, "kmp-published")
    return fit_kmp(aligned_demonstrations(training))


def learn_gmm_gp(training: TrainingInput) -> Movement:
    """A Gaussian process whose prior is a Gaussian mixture."""
    refuse_prior_mean(training, "gmm-gp")
    return fit_gmm_gp(aligned_demonstrations(training))


def _around_prior_mean(
    training: TrainingInput,
    aligned: AlignedDemonstrations,
    fit: Callable[..., Movement],
) -> Movement:
    """Fit, around the prior mean if one was given."""
    if training.prior_mean is None:
        return fit(aligned)
    return fit_residual(aligned, training.prior_mean, partial(fit, centred=False))


def _check_start(number: int, demonstration: Demonstration) -> None:
    start, reach = demonstration.poses[0], np.abs(demonstration.poses[:, :3]).max()
    if reach > _LARGEST_REACH:
        raise ValueError(
            f"demonstration {number} reaches {reach:.3g} m from the closed handle; are "
            "its positions in metres, in the task frame?"
        )
    distance, turn = np.linalg.norm(start[:3]), np.linalg.norm(start[3:])
    if distance > _START_TOLERANCE[0] or turn > _START_TOLERANCE[1]:
        raise ValueError(
            f"demonstration {number} starts {distance:.3g} m and {turn:.3g} rad away "
            "from the closed handle, which is the origin of the task frame (x pull, y "
            "up); subtract its first pose, in task axes, from all its poses"
        )
