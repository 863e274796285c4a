"""Stiffness and damping of the demonstrating hands, from their forces.

At a phase s, repetitions of a task deviate from their mean by e(s), and their forces f
deviate from the mean force. A hand with the same intended motion in each repetition, a
stiffness K and a damping D pushes back:

    f - f̄(s) = -(K(s) e + D(s) ė) + noise.

K and D are symmetric 3x3 matrices, for translation and for rotation, in the axes of the
hand, which turn during the task. They are posterior means in a window of phases: linear
regression with a Gaussian prior, on deviations corrected for the noise of the pose
sensor. docs/method.md, "Stiffness from demonstrated forces", has the derivation.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from gplfd_env.spatial.se3 import into_axes
from gplfd_policies.arrays.records import freeze, short_repr
from gplfd_policies.arrays.shapes import Float, Times
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations

LEAST_DEMONSTRATIONS: Final = 3
"""Least number of demonstrations with wrenches: fewer give no usable deviations."""
PRIOR: Final = np.array([[300.0, 30.0], [30.0, 3.0]])
"""Prior mean of K [N/m, N m/rad] (column 0) and D [N s/m, N m s/rad] (column 1), times
the unit matrix: translation, then rotation. The prior standard deviation of every
entry, in a basis of unit norm, is the same number."""
_WINDOW: Final = 0.1
"""Standard deviation of the window, in phase."""
_FILTER: Final = 2.0
"""Standard deviation of the low-pass filter of deviations and forces, in samples."""
_SEEN: Final = 2.0
"""A deviation counts if its variance is at least this many times that of the noise."""
_SHARE_LEFT: Final = 1e-6
"""Least noise of deviations and forces, relative to their size, used as a divisor."""

_UNITS: Final = np.eye(9).reshape(3, 3, 3, 3)
BASIS: Final = np.stack(
    [
        (_UNITS[i, j] + _UNITS[j, i]) / (2.0 if i == j else np.sqrt(2.0))
        for i, j in ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
    ]
)
"""Orthonormal basis of symmetric matrices, in which the prior does not depend on
axes."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Impedance:
    """Stiffness and damping along the task, in the axes of the hand; read-only.

    The first axis of all matrices is translation, then rotation.
    """

    times: Times
    """Phases."""
    stiffness: Float[np.ndarray, "2 M 3 3"]
    """K, positive semi-definite [N/m, N m/rad]."""
    damping: Float[np.ndarray, "2 M 3 3"]
    """D, positive semi-definite [N s/m, N m s/rad]."""
    covariance: Float[np.ndarray, "2 M 6 6"]
    """Posterior covariance of K in `BASIS`; that of the prior is `PRIOR`² times 1."""

    __repr__ = short_repr

    def __post_init__(self) -> None:
        freeze(self, "times", "stiffness", "damping", "covariance")

    def along(
        self, directions: Float[np.ndarray, "M 3 J"]
    ) -> tuple[Float[np.ndarray, "2 M J"], Float[np.ndarray, "2 M J"]]:
        """Return uᵀ K u and its standard deviation for unit columns u [N/m, N m/rad].

        The directions are in the axes of the hand.
        """
        found = np.einsum("maj,kmab,mbj->kmj", directions, self.stiffness, directions)
        weights = np.einsum("maj,iab,mbj->mji", directions, BASIS, directions)
        variance = np.einsum("mji,kmil,mjl->kmj", weights, self.covariance, weights)
        return found, np.sqrt(variance)


def estimate_impedance(aligned: AlignedDemonstrations) -> Impedance:
    """Estimate the stiffness of the hands from demonstrations with wrenches.

    Raises:
        ValueError: Fewer than three demonstrations have wrenches.
    """
    aligned = aligned.demonstrated
    wrenches = aligned.wrenches
    felt = np.zeros(0, bool) if wrenches is None else np.isfinite(wrenches[:, 0, 0])
    if wrenches is None or felt.sum() < LEAST_DEMONSTRATIONS:
        raise ValueError(
            f"stiffness is learned from at least {LEAST_DEMONSTRATIONS} demonstrations "
            f"with wrenches, got {felt.sum()}; record forces "
            "(Demonstration(wrenches=...)), or choose a policy that needs none"
        )
    poses, wrenches = aligned.poses[felt], wrenches[felt]
    rotation = scipy.spatial.transform.Rotation
    shape = (*poses.shape[:2], 3)
    mean = np.broadcast_to(poses.mean(axis=0), poses.shape)
    shift = into_axes(poses[..., 3:], poses[..., :3] - mean[..., :3])
    before, after = (
        rotation.from_rotvec(each[..., 3:].reshape(-1, 3)) for each in (mean, poses)
    )
    turn = (before.inv() * after).as_rotvec().reshape(shape)
    push = wrenches - wrenches.mean(axis=0)
    seconds = aligned.times * aligned.duration
    found = [
        _regress(seconds, deviation, force, prior)
        for deviation, force, prior in (
            (shift, push[..., :3], PRIOR[0]),
            (turn, push[..., 3:], PRIOR[1]),
        )
    ]
    stiffness, damping, covariance = map(np.stack, zip(*found, strict=True))
    return Impedance(
        times=aligned.times, stiffness=stiffness, damping=damping, covariance=covariance
    )


def _regress(
    seconds: Times,
    deviation: Float[np.ndarray, "K M 3"],
    force: Float[np.ndarray, "K M 3"],
    prior: Float[np.ndarray, "2"],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return K, D (M, 3, 3) and the covariance of K (M, 6, 6)."""
    count, samples, _ = deviation.shape

    # The same linear filter for e, ė and f keeps their relation and removes noise.
    smooth = scipy.ndimage.gaussian_filter1d(np.eye(samples), _FILTER, axis=0)
    rate = smooth @ np.gradient(np.eye(samples), seconds, axis=0)
    x = np.concatenate([smooth @ deviation, rate @ deviation], axis=-1)
    y = smooth @ force

    # Noise of the filtered deviations: their white part after the filter.
    white = np.mean(np.diff(deviation, 3, axis=1) ** 2) / 20.0
    white = max(white, _SHARE_LEFT**2 * np.mean(deviation**2), np.finfo(float).tiny)
    passed = np.stack([smooth, rate])
    noise = white * np.einsum("amn,bmn->mab", passed, passed)

    # Moments in a window around every phase.
    phases = (seconds - seconds[0]) / (seconds[-1] - seconds[0])
    apart = (phases[:, None] - phases) / _WINDOW
    window = np.exp(-0.5 * apart * apart)
    window /= window.sum(axis=1, keepdims=True)

    def within(values: np.ndarray) -> np.ndarray:
        return np.asarray(np.einsum("mn,nab->mab", window, values))

    xx = within(np.einsum("kna,knb->nab", x, x) / count)
    yx = within(np.einsum("kna,knb->nab", y, x) / count)
    yy = window @ np.mean(np.sum(y * y, axis=-1), axis=0)

    # Errors in variables: deviations are replaced by their estimates without noise,
    # x̂ = Λ x with Λ = (xx - noise) xx⁻¹, and by zero if noise explains them.
    factor = np.linalg.cholesky(np.kron(within(noise), np.eye(3)))
    inverse = np.linalg.inv(factor)
    share, axes = np.linalg.eigh(inverse @ xx @ inverse.swapaxes(1, 2))
    kept = np.where(share > _SEEN, 1.0 - 1.0 / np.maximum(share, _SEEN), 0.0)
    reliable = factor @ (axes * kept[:, None]) @ axes.swapaxes(1, 2) @ inverse
    xx = reliable @ xx @ reliable.swapaxes(1, 2)
    yx = yx @ reliable.swapaxes(1, 2)

    # Posterior of the coefficients of [K D] in the basis. The noise of the force is the
    # residual of a fit with a very weak prior: with the full prior, the residual of a
    # stiff hand's force is not only noise.
    design = np.zeros((12, 3, 6))
    design[:6, :, :3] = design[6:, :, 3:] = BASIS
    gram = np.einsum("iab,mbc,jac->mij", design, xx, design)
    moment = -np.einsum("iab,mab->mi", design, yx)
    entries = np.trace(BASIS, axis1=1, axis2=2)
    expected = np.concatenate([each * entries for each in prior])
    precision = np.repeat(prior**-2.0, 6)
    number = (count - 1) / np.sum(window * window, axis=1)
    variance = _SHARE_LEFT**2 * yy + np.finfo(float).tiny
    for _ in range(2):
        weight = (number / variance)[:, None]
        posterior = np.linalg.inv(weight[..., None] * gram + np.diag(precision))
        found = weight * moment + precision * expected
        found = np.einsum("mij,mj->mi", posterior, found)
        matrices = np.einsum("mi,iab->mab", found, design)
        residual = y + np.einsum("nab,nbc,knc->kna", matrices, reliable, x)
        left = window @ np.mean(np.sum(residual * residual, axis=-1), axis=0)
        variance = left / 3.0 * _correlation(residual) + np.finfo(float).tiny
    stiffness, damping = matrices[..., :3], matrices[..., 3:]
    return _positive(stiffness), _positive(damping), posterior[:, :6, :6]


def _correlation(residual: Float[np.ndarray, "K M 3"]) -> float:
    """Return the number of residuals per independent one: 1 + 2 Σ ρ_l while ρ_l > 0."""
    samples = residual.shape[1]
    power = np.abs(np.fft.rfft(residual, 2 * samples, axis=1)) ** 2
    total = np.fft.irfft(power.sum(axis=(0, 2)))[:samples]
    last = int(np.argmax(total <= 0.0)) or samples
    return float(1.0 + 2.0 * total[1:last].sum() / max(total[0], np.finfo(float).tiny))


def _positive(matrices: Float[np.ndarray, "M 3 3"]) -> Float[np.ndarray, "M 3 3"]:
    """Return the nearest positive semi-definite matrices."""
    values, vectors = np.linalg.eigh(matrices)
    return np.asarray(
        (vectors * np.maximum(values, 0.0)[:, None]) @ vectors.swapaxes(1, 2)
    )
