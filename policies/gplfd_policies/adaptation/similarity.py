"""Adaptation of the size, heading and deviation of the demonstrated path.

A repetition of the task is the demonstrated path m of mean size, scaled by c, rotated
by ψ, and with a smooth deviation f,

    p(s) = c exp(i (ψ + σ(s) f(s)/|m(s)|)) m(s)

in the horizontal plane (`gplfd_policies.demonstrations.path_similarity`). A filter
along the path so far estimates c, ψ and f; the forecast is the mixture over sizes.
Height and rotation do not depend on size: each deviates by σ_i(s) (√g b_i + √(1 - g)
f_i(s)), b_i constant and f_i smooth, and has its own filter over the phases.
"""

import math
from collections.abc import Sequence
from functools import partial
from typing import Final

import numpy as np

from gplfd_policies.arrays.shapes import Covariances, Float, Outputs, Times
from gplfd_policies.demonstrations.path_similarity import (
    SimilarityModel,
    advance,
    forecasts,
    gradient,
    posteriors,
    updated,
)
from gplfd_policies.demonstrations.turned_handle import turned_handle
from gplfd_policies.movements.movement import GaussianTrajectory, Movement, ViaPoint

_LEVEL: Final = [0, 2]  # indices of x and z, which depend on the size
_OTHERS: Final = [1, 3, 4, 5]  # of height and rotation, which do not
_LEAST_STD: Final = np.array([1e-3, 1e-2, 1e-2, 1e-2])
"""Least standard deviation of height and rotation [m, rad]."""
_CONSTANT: Final = 0.5
"""g: share of their variance that is constant during a repetition."""
_STRONGEST: Final = 1e-4  # least noise of a via-point, relative to the deviation
_NOISE: Final = 1e-3  # standard deviation in every direction that no path explains [m]


class SimilarityAdaptation:
    """Conditioning of size, heading and deviation of the path, and of other outputs.

    A via-point may contain an estimate of size and heading (`ViaPoint.sizes`);
    otherwise it is the next position of the path.
    """

    mean: Outputs
    std: Outputs
    """Current moments on the grid [m, rad]; they are replaced, not changed."""
    horizontal_covariance: Float[np.ndarray, " M"]
    """Covariance of x and z on the grid [m²]."""
    _level: Float[np.ndarray, "2 M L"]  # factors of the variances of x and z

    def __init__(self, movement: Movement, grid: Times) -> None:
        """Start from the demonstrations, on a grid of phases (M,)."""
        predicted, aligned = movement.predict(grid), movement.aligned
        self._handle, self._grid = turned_handle(aligned), grid
        self._apart = np.zeros((len(grid), 2))
        if self._handle is not None:
            # The hand's motion about the handle's axis does not scale with the size.
            aligned = self._handle.seen(aligned)
            axes = self._handle.axis_positions(predicted.mean)
            self._apart = (predicted.mean - axes)[:, _LEVEL]
        model = SimilarityModel.of(aligned)
        self._path = model.prior()
        self._lag = np.interp(grid, model.phases, model.lag)
        (self.sizes,) = posteriors([self._path])
        """Estimate of size, heading and deviation from the via-points so far."""
        self._rate = model.rate
        self._expected = predicted.mean[:, _OTHERS]
        self._spread = np.maximum(predicted.std[:, _OTHERS], _LEAST_STD)
        self._moments = np.hstack([self._expected, self._spread]).T.copy()
        self._phase, self._state = float(grid[0]), np.zeros((3, 4))
        self._covariance = np.zeros((3, 3, 4))
        self._covariance += np.diag([1.0, 1.0, self._rate**2])[:, :, None]
        forecast([self])

    def observe(self, via_point: ViaPoint) -> None:
        """Condition on one more via-point, in place."""
        self.filter(via_point)
        forecast([self])

    def filter(self, via_point: ViaPoint) -> None:
        """Condition the estimates; `forecast` has to follow."""
        phase, pose = float(via_point.phase), via_point.pose
        noise = via_point.noise_variance
        if via_point.sizes is not None:
            self.sizes = via_point.sizes
        elif np.isfinite(noise[_LEVEL]).all():
            x, _, z = pose[:3]
            if self._handle is not None:
                x, _, z = self._handle.axis_displacement(pose.tolist())
            if (distance := math.hypot(x, z)) >= self._path.due:
                place = distance, math.atan2(-z, x)
                (self._path,) = updated([self._path], [place])
            (self.sizes,) = posteriors([self._path])

        # Height and rotation: one scalar Kalman filter each.
        moments = [np.interp(phase, self._grid, curve) for curve in self._moments]
        expected, spread = np.reshape(moments, (2, 4))
        noise = np.maximum(noise[_OTHERS], (_STRONGEST * spread) ** 2)
        step = np.full(4, max(phase - self._phase, 0.0))
        self._phase = max(phase, self._phase)
        state, covariance = advance(self._state, self._covariance, step, self._rate)
        constant, smooth = spread * _CONSTANT**0.5, spread * (1.0 - _CONSTANT) ** 0.5
        gain = constant * covariance[0] + smooth * covariance[1]
        variance = constant * gain[0] + smooth * gain[1] + noise
        predicted = expected + constant * state[0] + smooth * state[1]
        innovation = np.where(np.isfinite(noise), pose[_OTHERS] - predicted, 0.0)
        self._state = state + gain * (innovation / variance)
        self._covariance = covariance - gain[:, None] * (gain / variance)

    def trajectory(self) -> GaussianTrajectory:
        """The current distribution on the grid, with smooth deviations."""
        std = self.std.copy()
        (x, z), others = self._level, [std[:, [output]] for output in _OTHERS]
        covariance = partial(_over_time, [x, others[0], z, *others[1:]], std)
        mean = self.mean.copy()
        return GaussianTrajectory.from_moments(self._grid, mean, std, covariance)


def forecast(adaptations: Sequence[SimilarityAdaptation]) -> None:
    """Compute the moments of R adaptations on one grid, as of each alone."""
    grid, rate = adaptations[0]._grid, adaptations[0]._rate
    lag, apart, centre, spread, state, left = (
        np.array([getattr(adaptation, name) for adaptation in adaptations])
        for name in ("_lag", "_apart", "_expected", "_spread", "_state", "_covariance")
    )
    sizes = [adaptation.sizes for adaptation in adaptations]
    paths, angles = forecasts(sizes, grid)
    weights = np.array([size.weights for size in sizes])[:, None]
    path = np.array([x @ size.weights for x, size in zip(paths, sizes, strict=True)])
    mean, variance = np.empty((2, *path.shape, 6))
    mean[..., 0] = path.real + apart[..., 0]
    mean[..., 2] = -path.imag + apart[..., 1]
    # x and z of the deviations in size, and in angle: i times the path.
    deviation, turn = paths - path[..., None], -np.sqrt(angles)
    dx, dz = deviation.real, -deviation.imag
    ax, az = paths.imag * turn, paths.real * turn
    tangent = gradient(path)
    along = lag * tangent / np.maximum(np.abs(tangent), _NOISE**2)
    tx, tz = along.real, -along.imag
    # Deviations are independent of each other; each is the same at all phases.
    share, count = np.sqrt(weights), weights.shape[-1]
    level = x, z = np.empty((2, *path.shape, 2 * count + 1))
    for roots, between, aside, behind in ((x, dx, ax, tx), (z, dz, az, tz)):
        np.multiply(share, between, out=roots[..., :count])
        np.multiply(share, aside, out=roots[..., count:-1])
        roots[..., -1] = behind
    for output, roots in zip(_LEVEL, level, strict=True):
        variance[..., output] = np.add.reduce(roots * roots, axis=-1) + _NOISE**2
    horizontal = np.add.reduce(x * z, axis=-1)

    last = np.array([adaptation._phase for adaptation in adaptations])
    state, left = state[..., None, :], left[..., None, :]
    step = (grid - last[:, None])[..., None]
    decay = np.exp(-rate * np.abs(step))
    a, b = decay * (1.0 + rate * np.abs(step)), decay * step
    constant, smooth = _CONSTANT**0.5, (1.0 - _CONSTANT) ** 0.5
    deviation = constant * state[:, 0] + smooth * (a * state[:, 1] + b * state[:, 2])
    mean[..., _OTHERS] = centre + spread * deviation
    smooth_noise = 1.0 - a * a - (rate * b) ** 2 + a * a * left[:, 1, 1]
    smooth_noise = smooth_noise + 2.0 * a * b * left[:, 1, 2] + b * b * left[:, 2, 2]
    both = a * left[:, 0, 1] + b * left[:, 0, 2]
    smooth_part = smooth * (2.0 * constant * both + smooth * smooth_noise)
    shares = _CONSTANT * left[:, 0, 0] + smooth_part
    variance[..., _OTHERS] = spread**2 * np.maximum(shares, 0.0)
    std = np.sqrt(variance)
    for row, adaptation in enumerate(adaptations):
        # Copies, because views would keep the arrays of all rows.
        adaptation.mean, adaptation.std = mean[row].copy(), std[row].copy()
        adaptation.horizontal_covariance = horizontal[row].copy()
        adaptation._level = level[:, row].copy()


def _over_time(roots: list[Float[np.ndarray, "M _"]], std: Outputs) -> Covariances:
    """Return the covariance over time of deviations that are equal at all phases."""
    covariance = np.stack([root @ root.T for root in roots])
    np.einsum("imm->im", covariance)[:] = std.T**2
    return covariance
