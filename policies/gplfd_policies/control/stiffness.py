"""Stiffness as a function of uncertainty, and the virtual dynamics that render it.

The hand is stiff where the policy is certain and compliant where it is not. The damping
keeps a rigidly held hand stable, whose servo closes a loop around the dynamics.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
import scipy

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.spatial.se3 import into_axes
from gplfd_env.validation.fields import check_quantities, quantity
from gplfd_policies.arrays.records import own_arrays, read_only, short_repr
from gplfd_policies.arrays.rows import ALL_ROWS, PerRow, Rows
from gplfd_policies.arrays.shapes import Axes, Float, Frames, Outputs, SixAxes, Vectors
from gplfd_policies.movements.movement import LearnedMovement, Movement


@dataclass(frozen=True, kw_only=True, slots=True)
class ContactLoop:
    """Admittance, delay, servo and a rigidly held hand, axis by axis.

    With M = m/h², D = d/h, the successive displacements e⁻, e, e' and e_q, the one
    q = τ/h periods before e, M (e' - 2e + e⁻) + D (e' - e) + k e' = -k_s e_q.
    """

    stiffness: SixAxes
    """k_s: force per displacement of the command [N/m, N m/rad]."""
    delay: float
    """τ: longest time from a command to the measured force, less one period [s]."""
    period: float = CONTROL_PERIOD
    """h: time between two commands [s]."""

    @property
    def sufficient_damping(self) -> SixAxes:
        """k_s τ: damping with which the loop is stable for every m > 0 and k > 0.

        Holds for whole periods τ > 0; no smaller damping is enough for every mass.
        """
        return np.asarray(self.stiffness * self.delay)

    def tolerated_delay(self, stiffness: Axes, damping: Axes, mass: SixAxes) -> Axes:
        """Return the delay up to which the loop is stable [s].

        If k < k_s, it is unstable at every longer delay. The gain of the loop is one at
        the frequency θ/h where p = sin²(θ/2) solves

            (k - A p)² + B² p (1 - p) = k_s²,    A = 4M + 2D + 2k,  B = 2(D + k),

        and its phase reaches -180° there with a delay of
        h/θ arctan2(B √(p(1 - p)), A p - k). The result is infinite if the gain is below
        one at every frequency, and zero if it is above one.
        """
        inertia = mass / (self.period * self.period)
        resistance = damping / self.period + stiffness
        total = inertia + resistance
        real, imaginary = 2.0 * (total + inertia), 2.0 * resistance
        square = 32.0 * inertia * total  # twice A² - B²
        linear = imaginary * imaginary - 2.0 * stiffness * real
        excess = (self.stiffness - stiffness) * (self.stiffness + stiffness)
        discriminant = linear * linear + 2.0 * square * excess
        root = np.sqrt(np.maximum(discriminant, 0.0)) - linear
        crosses = (discriminant >= 0.0) & (root > 0.0)
        share = np.where(crosses, np.minimum(root / square, 1.0), 0.5)
        height = imaginary * np.sqrt(share * (1.0 - share))
        lead = np.arctan2(height, real * share - stiffness)
        delay = self.period * lead / (2.0 * np.arcsin(np.sqrt(share)))
        return np.where(crosses, delay, np.inf)


SERVO_LAG: Final = 0.005
"""Delay of servo, contact and wrist sensor [s]: at most 4.6 ms were measured."""

HELD_HAND: Final = ContactLoop(
    stiffness=np.repeat([2000.0, 100.0], 3), delay=3.0 * CONTROL_PERIOD + SERVO_LAG
)
"""The servo of `gplfd_env.robot.model` with the longest delay of ``"hard"``."""


def path_frame(tangent: Vectors) -> Frames:
    """Return frames whose first columns are unit tangents (..., 3), or their opposites.

    They are the directions along the path, up and across it, in which stiffness is
    defined, by the least rotation of the task's axes from x to t or to -t, whichever is
    nearer: I + [u] + [u]²/(1 + x·t) with u = x × t. A push has the same frame as a
    pull. For a tangent in the horizontal plane, up is y.
    """
    tangent = np.where(tangent[..., :1] < 0.0, -tangent, tangent)
    x, y, z = tangent[..., 0], tangent[..., 1], tangent[..., 2]
    share = 1.0 / (1.0 + x)
    frame = np.empty((*tangent.shape, 3))
    frame[..., 0] = tangent
    frame[..., 0, 1:] = -tangent[..., 1:]
    frame[..., 1, 1] = 1.0 - y * y * share
    frame[..., 2, 2] = 1.0 - z * z * share
    frame[..., 1, 2] = frame[..., 2, 1] = -y * z * share
    return frame


def product(
    left: Float[np.ndarray, "*#N 3 3"], right: Float[np.ndarray, "*#N 3 J"]
) -> Float[np.ndarray, "*M 3 J"]:
    """Return the matrix products of stacks."""
    # Summed in the order of the rows; in BLAS it may depend on the other rows.
    return np.asarray(np.add.reduce(left[..., None] * right[..., None, :, :], axis=-2))


def directional_std(frame: Frames, std: Axes, level: PerRow | float = 0.0) -> Axes:
    """Return σ along the directions of frames, and about the axes [m, rad].

    σ_d² = Σ_i T_id² σ_i² + 2 T_xd T_zd σ_xz with the covariance σ_xz of x and z [m²];
    other positions are independent.
    """
    turned = np.array(std)
    variance = (std[..., :3] * std[..., :3])[..., None]
    along = product((frame * frame).swapaxes(-1, -2), variance)[..., 0]
    both = frame[..., 0, :] * frame[..., 2, :]
    along += 2.0 * both * np.asarray(level)[..., None]
    turned[..., :3] = np.sqrt(np.maximum(along, 0.0))
    return turned


@dataclass(frozen=True, kw_only=True, slots=True)
class StiffnessProfile:
    """The sigmoid from σ to stiffness, Eq. (24), one per axis; read-only."""

    k_max: SixAxes
    """Stiffness where the policy is certain [N/m, N m/rad]."""
    k_min: SixAxes
    """Stiffness where the policy is uncertain [N/m, N m/rad]."""
    alpha: Axes
    """Steepness of the transition [1/m, 1/rad]; for a batch, with a row per agent."""
    beta: Axes
    """Standard deviation at the middle of the transition [m, rad]; rows as `alpha`."""
    _laws: Float[np.ndarray, "*N 6 4"] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        rows = (*np.shape(self.alpha)[:-1], 6)
        _check_axes(self, k_max=(6,), k_min=(6,), alpha=rows, beta=rows)
        if np.any(self.k_min <= 0) or np.any(self.k_max < self.k_min):
            raise ValueError(
                "stiffness must satisfy 0 < k_min <= k_max on every axis, got "
                f"k_min={self.k_min}, k_max={self.k_max}"
            )
        if np.any(self.alpha <= 0) or np.any(self.beta < 0):
            raise ValueError(
                f"alpha must be positive and beta not negative, got {self.alpha} and "
                f"{self.beta}; for a constant stiffness set k_min = k_max"
            )
        parts = (self.k_max, self.k_min, 1.0 / self.alpha, self.beta)
        laws = np.stack(np.broadcast_arrays(*parts), axis=-1)
        object.__setattr__(self, "_laws", read_only(laws))

    @classmethod
    def stacked(cls, profiles: Sequence["StiffnessProfile"]) -> "StiffnessProfile":
        """Return the profile of a batch, whose rows share k_max and k_min."""
        return cls(
            k_max=profiles[0].k_max,
            k_min=profiles[0].k_min,
            alpha=np.stack([profile.alpha for profile in profiles]),
            beta=np.stack([profile.beta for profile in profiles]),
        )

    def stiffness(
        self, std: Axes, frame: Frames | None = None, rows: Rows = ALL_ROWS
    ) -> Axes:
        """Return k_p(σ) of these rows, Eq. (24) [N/m, N m/rad]; k_max where σ is NaN.

        NaN is the σ of a policy without uncertainty. With a frame, σ[:3] and k[:3] are
        along its directions. There k_max, k_min, β and 1/α are means over the axes with
        the weights T_id², which add up to one.
        """
        # One profile may be used for all rows.
        profile_rows = rows if self.alpha.ndim > 1 else ALL_ROWS
        if frame is None:
            k_max, k_min = self.k_max, self.k_min
            alpha, beta = self.alpha[profile_rows], self.beta[profile_rows]
            with np.errstate(over="ignore"):  # The sigmoid is flat at infinity.
                argument = np.asarray(alpha * (std - beta))
        else:
            law = np.empty((*std.shape, 4))
            weights = (frame * frame).swapaxes(-1, -2)
            laws = self._laws[profile_rows]
            law[..., :3, :] = product(weights, laws[..., :3, :])
            law[..., 3:, :] = laws[..., 3:, :]
            k_max, k_min = law[..., 0], law[..., 1]
            argument = (std - law[..., 3]) / law[..., 2]
        softening = (k_max - k_min) * scipy.special.expit(argument)
        # The smaller of the two; NaN is ignored.
        return np.asarray(np.fmin(k_max - softening, k_max))

    def rate(self, std: Axes, std_rate: Axes) -> Axes:
        """Return dk_p/dt = -α (k_max - k_p)(k_p - k_min)/(k_max - k_min) dσ/dt.

        The derivative of Eq. (24) [N/(m s), N m/(rad s)], largest half-way between
        k_min and k_max: α/4 (k_max - k_min) |dσ/dt|, the bound of Eq. (26). The printed
        Eq. (25), see `printed_rate`, has the opposite sign, and this size only if k_min
        is 0: `test_eq25_rate_is_the_derivative_of_eq24`.
        """
        with np.errstate(over="ignore"):  # The sigmoid is flat at infinity.
            argument = self.alpha * (std - self.beta)
        # (k_max - k)(k - k_min)/(k_max - k_min)², free of cancellation at both ends.
        slope = scipy.special.expit(argument) * scipy.special.expit(-argument)
        return np.asarray(-self.alpha * (self.k_max - self.k_min) * slope * std_rate)

    def printed_rate(self, std: Axes, std_rate: Axes) -> Axes:
        """Return α k_p (1 - k_p/(k_max - k_min)) dσ/dt, Eq. (25) as printed.

        It is wrong; compare it with `rate`. It divides by zero if k_max = k_min.
        """
        if np.any(self.k_max == self.k_min):
            raise ValueError("the printed Eq. (25) divides by k_max - k_min = 0")
        stiffness = self.stiffness(std)
        shortfall = 1.0 - stiffness / (self.k_max - self.k_min)
        return np.asarray(self.alpha * stiffness * shortfall * std_rate)


@dataclass(frozen=True, kw_only=True, slots=True)
class VirtualDynamics:
    """Mass and damping of the virtual spring-mass-damper, Eq. (22); read-only."""

    mass: SixAxes
    """Virtual mass [kg] and inertia [kg m²] per axis."""
    damping_ratio: float = quantity(1.0, above=0.0)
    """δ: 1 is critical damping at every stiffness."""
    least_damping: SixAxes = field(default_factory=lambda: np.zeros(6))
    """Lower bound of the damping d [N s/m, N m s/rad]; zero for none."""

    def __post_init__(self) -> None:
        check_quantities(self)
        _check_axes(self, mass=(6,), least_damping=(6,))
        if np.any(self.mass <= 0) or np.any(self.least_damping < 0):
            raise ValueError(
                "mass must be positive and least_damping not negative on every axis, "
                f"got {self.mass} and {self.least_damping}"
            )

    def damping(self, stiffness: Axes) -> Axes:
        """Return d = max(2δ√(m k), least) [N s/m, N m s/rad] at a stiffness k."""
        critical = 2.0 * np.sqrt(self.mass * stiffness)
        return np.asarray(np.maximum(self.damping_ratio * critical, self.least_damping))


def _check_axes(record: object, **shapes: tuple[int, ...]) -> None:
    """Make arrays read-only float64 copies; raise if shape or numbers are invalid."""
    for name, shape in shapes.items():
        array = read_only(getattr(record, name))
        object.__setattr__(record, name, array)
        if array.shape != shape or not np.isfinite(array).all():
            where = "" if shape == (6,) else f" in each of {shape[0]} rows"
            raise ValueError(
                f"{name} must be six finite numbers, x y z and rotations about "
                f"them{where}, got {array!r}"
            )


PAPER_PROFILE = StiffnessProfile(
    k_max=np.repeat([500.0, 500.0], 3),
    k_min=np.repeat([100.0, 100.0], 3),
    alpha=np.repeat([600.0, 600.0], 3),
    beta=np.repeat([0.01, 0.01], 3),
)
"""Section IV-B: the same numbers for all six axes, although units differ."""

PAPER_DYNAMICS = VirtualDynamics(mass=np.repeat([1.0, 1.0], 3), damping_ratio=1.0)
"""Section IV-B: m = 1 on all six axes, δ = 1."""

DEFAULT_PROFILE = StiffnessProfile(
    k_max=np.repeat([500.0, 50.0], 3),
    k_min=np.repeat([100.0, 10.0], 3),
    alpha=np.repeat([600.0, 120.0], 3),
    beta=np.repeat([0.01, 0.05], 3),
)
"""The published values in translation. In rotation the transition is at 0.05 rad, 1 cm
at a lever of 0.2 m, with the same αβ; an error of 0.05 rad causes 2.5 N m."""

DEFAULT_DYNAMICS = VirtualDynamics(
    mass=np.repeat([1.0, 0.1], 3),
    damping_ratio=1.0,
    least_damping=HELD_HAND.sufficient_damping,
)
"""1 kg in translation, 0.1 kg m² in rotation. The damping, 70 N s/m and 3.5 N m s/rad,
is what a held hand needs with the longest delay of ``"hard"``, at any stiffness."""


_PHASES: Final = np.linspace(0.0, 1.0, 101)
_FORCES: Final = (0.5, 5.0)  # forces between which `stiffness_from_force` falls [N]


@dataclass(frozen=True, kw_only=True, slots=True)
class PhaseStiffness:
    """Stiffness at M equally spaced phases from 0 to 1, and its share; read-only."""

    stiffness: Outputs
    """k_d along the frame's directions and about the task's axes [N/m, N m/rad]."""
    share: Outputs
    """w, from 0 (only `StiffnessProfile`) to 1 (only k_d)."""
    direction: Float[np.ndarray, "M 3"]
    """Unit vectors that replace the path's tangent in the frame; NaN for none."""

    __repr__ = short_repr

    def __post_init__(self) -> None:
        own_arrays(self, "stiffness", "share", "direction")

    def direction_at(self, phase: PerRow, tangent: Vectors) -> Vectors:
        """Return the first direction of the frame at a phase, or the tangent."""
        direction = self.direction[np.rint(phase * (len(self.share) - 1)).astype(int)]
        return np.where(np.isnan(direction), tangent, direction)

    def combined(self, stiffness: Axes, phase: PerRow) -> Axes:
        """Return k^(1 - w) k_d^w: means of logarithms with the weights 1 - w and w."""
        index = np.rint(phase * (len(self.share) - 1)).astype(int)
        # Not `**`: for arrays its last bit depends on the processor.
        gain = np.float_power(self.stiffness[index] / stiffness, self.share[index])
        return np.asarray(stiffness * gain)


def stiffness_from_force(
    movement: Movement, profile: StiffnessProfile
) -> PhaseStiffness:
    """Return a stiffness along the learned force that falls with the force.

    The rule of Hou et al., *Adaptive Compliance Policy*, 2024, arXiv:2410.09309: it
    falls linearly from k_max at 0.5 N to k_min at 5 N; in other directions it is k_max.
    """
    learned = movement.forces if isinstance(movement, LearnedMovement) else None
    if learned is None:
        raise ValueError(
            "stiffness from force needs demonstrations with wrenches, got none; record "
            "forces (Demonstration(wrenches=...)), or choose another policy, such as gp"
        )
    poses = movement.predict(_PHASES).mean
    force = into_axes(-poses[:, 3:], learned.predict(_PHASES).mean[:, :3])
    size = np.linalg.norm(force, axis=1)
    highest = np.repeat(profile.k_max.reshape(2, 3).min(axis=1), 3)
    stiffness = np.tile(highest, (_PHASES.size, 1))
    stiffness[:, 0] = np.interp(size, _FORCES, (highest[0], profile.k_min[0]))
    felt = (size > _FORCES[0])[:, None]
    return PhaseStiffness(
        stiffness=stiffness,
        share=np.ones_like(stiffness),
        direction=np.where(felt, force / np.maximum(size, 1e-12)[:, None], np.nan),
    )
