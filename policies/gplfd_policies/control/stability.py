"""How fast the stiffness may rise without making the virtual dynamics unstable.

Kronander & Billard, *Stability Considerations for Variable Impedance Control*, IEEE
T-RO 32(5), 2016: the system M ë + D(t) ė + K(t) e = 0 is globally asymptotically stable
if for some γ > 0 the matrices γM - D and K̇ + γḊ - 2γK are negative (semi-) definite.
With diagonal matrices and d = 2δ√(m k), this bounds the rate of every k while it rises,
that is, while the uncertainty *falls*. The constants of Arduengo et al.,
arXiv:2002.09979, are safe but larger than needed (``printed=True``).
"""

from typing import NamedTuple

import numpy as np

from gplfd_policies.arrays.rows import ALL_ROWS, Rows
from gplfd_policies.arrays.shapes import Axes, Frames, SixAxes
from gplfd_policies.control.stiffness import StiffnessProfile, VirtualDynamics, product

_USED_SHARE = 0.999  # the conditions are strict inequalities


def decay_rate(k_min: SixAxes, dynamics: VirtualDynamics) -> SixAxes:
    """Return γ = d(k_min)/m [1/s], the largest for which γM - D stays negative.

    Without least damping it is 2δ√(k_min/m).
    """
    return np.asarray(dynamics.damping(k_min) / dynamics.mass)


def rate_bound(
    stiffness: Axes, k_min: SixAxes, dynamics: VirtualDynamics, *, printed: bool = False
) -> Axes:
    """Return the tight bound on dk/dt at a stiffness: 2γ k^{3/2}/(√k + δγ√m).

    `test_eq23_tight_bound_follows_from_condition_2` derives it [N/(m s), N m/(rad s)].
    It rises with k, so the value at k_min, 4δ k_min^{3/2}/((1 + 2δ²)√m), holds at every
    k, Eq. (27). Where the least damping acts, which does not grow with k, the bound is
    sufficient but not tight. ``printed`` gives Eq. (23) as printed, with 2δ for δ, only
    sufficient; at k_min this is Eq. (27) as printed, with 1 + 4δ² for 1 + 2δ².
    """
    gamma = decay_rate(k_min, dynamics)
    share = 2.0 if printed else 1.0
    resistance = share * dynamics.damping_ratio * gamma * np.sqrt(dynamics.mass)
    root = np.sqrt(stiffness)
    return np.asarray(2.0 * gamma * stiffness * root / (root + resistance))


def uncertainty_fall_bound(
    profile: StiffnessProfile, dynamics: VirtualDynamics, *, printed: bool = False
) -> SixAxes:
    """Return the bound on -dσ/dt that keeps the profile stable at every σ, Eq. (28).

    16δ k_min^{3/2}/(α (k_max - k_min)(1 + 2δ²)√m) [m/s, rad/s]: the bound at k_min
    divided by the largest slope of the profile, Eq. (26). Infinite for a constant
    stiffness. ``printed`` gives the right side as printed, with 1 + 4δ² for 1 + 2δ².

    Eq. (28) is printed as a bound on +dσ/dt, as if falling uncertainty were always
    stable. In fact, rising uncertainty is: `test_eq28_bounds_falling_uncertainty`.
    """
    constant = rate_bound(profile.k_min, profile.k_min, dynamics, printed=printed)
    steepest = profile.alpha * (profile.k_max - profile.k_min) / 4.0
    unlimited = np.full(6, np.inf)
    return np.asarray(np.divide(constant, steepest, out=unlimited, where=steepest > 0))


class GovernedStiffness(NamedTuple):
    """Stiffness to render [N/m, N m/rad], its rate over the step, and the margin.

    The margin is a bound minus the rate [N/(m s), N m/(rad s)], above 0: the tight one,
    or if the frame turned, the rate to the highest safe stiffness over `_USED_SHARE`.
    """

    stiffness: Axes
    rate: Axes
    margin: Axes


class StiffnessGovernor:
    """Follows a target stiffness as fast as stability allows, never below k_min.

    A rise is limited by the tight pointwise bound at the current stiffness; a fall is
    not limited. d(k) grows no faster than 2δ√(m k), which is concave, so a step h that
    satisfies (k' - k)/h < bound(k) also satisfies the condition in finite differences,
    (k' - k) + γ(d' - d) - 2γ h k < 0, for every h.
    Together with the implicit step of
    `gplfd_policies.control.rendering.Admittance` the function m(v + γe)²/2 + (k' +
    γd' - γ²m)e²/2 then never grows without external force, whatever the uncertainty
    does: `test_lyapunov_function_never_grows`. In a frame, the same holds for matrices
    K = T k Tᵀ and D, a function of K: `test_lyapunov_function_of_turning_frames`.
    """

    def __init__(
        self,
        profile: StiffnessProfile,
        dynamics: VirtualDynamics,
        shape: tuple[int, ...] = (),
    ) -> None:
        self._k_min, gamma = profile.k_min, decay_rate(profile.k_min, dynamics)
        # The constants of `rate_bound`, computed once: this runs at every control step.
        self._twice_gamma = 2.0 * gamma
        self._resistance = dynamics.damping_ratio * gamma * np.sqrt(dynamics.mass)
        self._half = self._resistance[:3]
        self._floor = gamma[:3] * dynamics.least_damping[:3]
        least = profile.k_min[:3]  # φ(k_min), as φ is computed in `step`:
        drag = np.maximum(2.0 * self._half * np.sqrt(least), self._floor)
        self._least = least + drag
        self._stiffness = np.full((*shape, 6), np.nan)  # NaN: none yet
        self._frame = np.full((*shape, 3, 3), np.nan)

    def reset(self, rows: Rows = ALL_ROWS) -> None:
        """Forget the stiffness; the next step starts at its target."""
        self._stiffness[rows] = np.nan
        self._frame[rows] = np.nan

    def step(
        self,
        target: Axes,
        dt: float,
        rows: Rows = ALL_ROWS,
        frame: Frames | None = None,
    ) -> GovernedStiffness:
        """Move these rows to their targets for a period [s]; at once after a reset.

        With a frame, the first three numbers are along its columns; then mass, least
        damping and k_min must be the same along x, y and z. With φ(K) = K + γD(K), F =
        φ(highest) in the old frame and any k ≥ k_min along the new frame, the condition
        requires φ(k) ≤ F. F - φ(k_min) has no negative eigenvalue. For such a matrix E,
        diag(E_ii (1 - Σ_j |E_ij|/√(E_ii E_jj))) is a lower bound (Gershgorin); so is 0.
        """
        wished = np.maximum(target, self._k_min)
        previous = self._stiffness[rows]
        previous = np.where(np.isnan(previous), wished, previous)
        root = np.sqrt(previous)
        bound = self._twice_gamma * previous * root / (root + self._resistance)
        highest = previous + dt * _USED_SHARE * bound
        if frame is not None:
            # A safe stiffness along the new frame, given the safe one along the old.
            turned = self._frame[rows]
            turned = np.where(np.isnan(turned), frame, turned)
            self._frame[rows] = frame
            turn = product(frame.swapaxes(-1, -2), turned)
            drag = np.maximum(2.0 * self._half * np.sqrt(highest[..., :3]), self._floor)
            excess = (highest[..., :3] + drag - self._least)[..., None, :]
            matrix = product(turn * excess, turn.swapaxes(-1, -2))
            diagonal = np.diagonal(matrix, axis1=-2, axis2=-1)
            scale = np.sqrt(diagonal)
            ratios = np.abs(matrix) / (scale[..., :, None] * scale[..., None, :])
            share = 2.0 - np.add.reduce(ratios, axis=-1)
            share *= share.min(axis=-1, keepdims=True) > 0.0
            sound = self._least + diagonal * share
            # Inverse of φ: the smaller of the inverses of its two branches.
            root = np.sqrt(sound + self._half * self._half) - self._half
            safe = np.minimum(sound - self._floor, root * root)
            highest[..., :3] = np.maximum(safe, self._k_min[:3])
            used = (highest - previous) / dt
            bound = used + np.abs(used) * (1.0 / _USED_SHARE - 1.0)
        allowed = np.minimum(wished, highest)
        rate = (allowed - previous) / dt
        self._stiffness[rows] = allowed
        return GovernedStiffness(allowed, rate, bound - rate)
