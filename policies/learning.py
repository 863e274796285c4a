"""What each method learns from demonstrations: a movement."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
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
from policies.skill import fit_skill

__all__ = ["Learner", "TrainingInput", "aligned_demonstrations"]


@dataclass(frozen=True, kw_only=True, slots=True)
class TrainingInput:
    """What a policy may learn from.

    Attributes:
        demonstrations: At least one.
        seed: Seeds whatever is random in the policy's learning.
        radius: The true radius of the door to open [m], or None; privileged, only the
            oracle reads it.
    """

    demonstrations: tuple[Demonstration, ...]
    seed: int = 0
    radius: float | None = None


Learner = Callable[[TrainingInput], Movement]
"""Learns a movement."""

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


def learn_gp(training: TrainingInput) -> Movement:
    """The heteroscedastic GP."""
    return fit_skill(aligned_demonstrations(training))


def learn_homoscedastic_gp(training: TrainingInput) -> Movement:
    """One noise level for the whole task."""
    return fit_skill(aligned_demonstrations(training), noise="homoscedastic")


def learn_euclidean_gp(training: TrainingInput) -> Movement:
    """Aligned by the distance of poses."""
    return fit_skill(aligned_demonstrations(training, method="dtw-euclidean"))


def learn_paper_gp(training: TrainingInput) -> Movement:
    """DTW on the raw completion index, Kersting's noise: as the paper states."""
    aligned = aligned_demonstrations(training, method="dtw", denoise=False)
    return fit_skill(aligned, noise="kersting")


def learn_dmp(training: TrainingInput) -> Movement:
    """A dynamic movement primitive of the demonstrations' mean."""
    return fit_dmp(aligned_demonstrations(training))


def learn_promp(training: TrainingInput) -> Movement:
    """A probabilistic movement primitive."""
    return fit_promp(aligned_demonstrations(training))


def learn_gmr(training: TrainingInput) -> Movement:
    """Gaussian-mixture regression."""
    return fit_gmr(aligned_demonstrations(training))


def learn_local_gp(training: TrainingInput) -> Movement:
    """Local Gaussian processes."""
    return fit_local_gp(aligned_demonstrations(training), LocalGPConfig())


def learn_wishart_gp(training: TrainingInput) -> Movement:
    """A GP mean with a Wishart process of the deviations."""
    aligned = aligned_demonstrations(training)
    return fit_wishart_gp(aligned, WishartGPConfig(), training.seed)


def learn_kmp(training: TrainingInput) -> Movement:
    """A kernelised movement primitive, calibrated for doors."""
    return fit_kmp(aligned_demonstrations(training), DOOR_KMP)


def learn_published_kmp(training: TrainingInput) -> Movement:
    """A kernelised movement primitive with the published regularisation."""
    return fit_kmp(aligned_demonstrations(training))


def learn_gmm_gp(training: TrainingInput) -> Movement:
    """A Gaussian process whose prior is a Gaussian mixture."""
    return fit_gmm_gp(aligned_demonstrations(training))


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
