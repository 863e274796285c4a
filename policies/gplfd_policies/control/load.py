"""Compensation of the load along the path.

In Eq. (22) of Arduengo et al., arXiv:2002.09979, every external force displaces the
set-point. A force *across* the path shows that the path is wrong, and the hand should
yield. A force *along* the path may be the door's weight, under which a yielding hand
stalls, or a person. The past tells which: the door was as heavy a centimetre ago.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from gplfd_env.validation.fields import Quantities, check_quantities, quantity
from gplfd_policies.adaptation.gridded import LOOK_AHEAD, GriddedMovements
from gplfd_policies.arrays.rows import ALL_ROWS, PerRow, Rows
from gplfd_policies.arrays.shapes import Axes, Bool, Float, Vectors
from gplfd_policies.control.stiffness import StiffnessProfile, product
from gplfd_policies.movements.movement import ViaPoint

HandAxes = Float[np.ndarray, "... 3 3"]


@dataclass(frozen=True, kw_only=True, slots=True)
class ExpectedForce:
    """Expected force of some hands on what they hold."""

    mean: Vectors
    """Mean force, in the axes of the hand [N]."""
    std: Vectors
    """Standard deviation along each of these axes [N]."""
    axes: HandAxes
    """Axes of the hand, as columns in the task frame."""
    largest: PerRow | float = math.inf
    """Largest demonstrated force on the whole way [N]."""

    def along(
        self, directions: Float[np.ndarray, "... 3 D"]
    ) -> tuple[Float[np.ndarray, "... D"], Float[np.ndarray, "... D"]]:
        """Return mean and σ [N] along unit vectors, given as columns."""
        along = product(self.axes.swapaxes(-1, -2), directions)
        spread = along * self.std[..., None]
        variance = np.add.reduce(spread * spread, axis=-2)
        return np.add.reduce(along * self.mean[..., None], axis=-2), np.sqrt(variance)


class ForceForecast:
    """Predicts the forces of some hands, and learns from measured forces.

    The demonstrated force is a movement like that of the poses. The mean force since
    the last via-point is a via-point of it, one control step after that of the pose:
    two adaptations in one step would take too long.
    """

    def __init__(
        self, movements: GriddedMovements, measurement_std: tuple[float, float]
    ) -> None:
        """Start from movements of wrenches, and σ of measured wrenches [N], [N m]."""
        self._movements = movements
        self._noise = np.repeat(measurement_std, 3)
        shape = movements.numbers.shape
        squares = [wrenches[..., :3] ** 2 for wrenches in movements.demonstrated()]
        largest = [float(np.sqrt(square.sum(axis=-1).max())) for square in squares]
        self._largest = np.reshape(largest, shape)
        # Measured since the last via-point: sum and number.
        self._sum, self._count = np.zeros((*shape, 6)), np.zeros(shape)
        # Rows to be conditioned before the next prediction, and their phases.
        self._due, self._phases = np.zeros(shape, dtype=bool), np.zeros(shape)

    def reset(self, rows: Rows = ALL_ROWS) -> None:
        """Forget these rows' doors."""
        self._movements.reset(rows)
        self._sum[rows] = 0.0
        self._count[rows] = 0.0
        self._due[rows] = False

    def expect(
        self, phases: PerRow, axes: HandAxes, rows: Rows = ALL_ROWS
    ) -> tuple[ExpectedForce, ExpectedForce]:
        """Return the expected forces at phases, and at the end of the path ahead."""
        due = self._due[rows]
        if due.any():
            total, count = self._sum[rows], self._count[rows]
            means = total[due] / np.asarray(count)[due][:, None]
            seen = zip(np.asarray(self._phases[rows])[due].tolist(), means, strict=True)
            self._movements.observe(
                self._movements.numbers[rows][due].tolist(),
                [ViaPoint(phase=s, pose=mean, std=self._noise) for s, mean in seen],
            )
            self._sum[rows] = np.where(np.asarray(due)[..., None], 0.0, total)
            self._count[rows] = np.where(due, 0.0, count)
            self._due[rows] = False
        ends = np.minimum(np.array([phases, phases + LOOK_AHEAD]), 1.0)
        largest = self._largest[rows]
        here, ahead = (
            ExpectedForce(
                mean=force[..., :3], std=force[..., 6:9], axes=axes, largest=largest
            )
            for force in self._movements.at(ends, rows)
        )
        return here, ahead

    def measure(self, wrenches: Axes, axes: HandAxes, rows: Rows = ALL_ROWS) -> None:
        """Add measured wrenches on the hands, task frame [N, N m]."""
        apart = np.stack([wrenches[..., :3], wrenches[..., 3:]], axis=-1)
        # Wrench of the hand on what it holds, in the axes of the hand.
        forces = product(axes.swapaxes(-1, -2), -apart).swapaxes(-1, -2)
        self._sum[rows] += forces.reshape(wrenches.shape)
        self._count[rows] += 1.0

    def learn(
        self,
        due: Bool[np.ndarray | np.bool_, "*N"],
        phases: PerRow,
        rows: Rows = ALL_ROWS,
    ) -> None:
        """Schedule rows that learn the mean force before they predict again."""
        self._due[rows] = due
        self._phases[rows] = phases


_NO_LIMIT: Final = "to carry nothing use YieldToAll"


@dataclass(frozen=True, kw_only=True, slots=True)
class ContactState:
    """Contact of some hands in one control step; task frame."""

    wrench: Axes
    """Force and moment on the hand [N, N m]."""
    direction: Vectors
    """Unit vector along which the policy moves the hand."""
    pose: Axes
    """Pose of the hand [m, rad]."""
    displacement: Vectors
    """Displacement of the hand: e of Eq. (22) [m]."""
    expected: ExpectedForce | None = None
    """Force expected from demonstrations and from this door so far, if any."""
    expected_ahead: ExpectedForce | None = None
    """The expected force at the end of the chord that defines `direction`."""
    hook_grasp: bool = False
    """Whether the fingers are behind a handle, and not only hold it by friction."""
    insistence: PerRow | float = 0.0
    """Resistance that is compensated although nothing moves, up to the limit [N]."""


@dataclass(frozen=True, slots=True)
class LoadResponse:
    """Response to a contact state."""

    compliant_wrench: Axes
    """Wrench that displaces the set-point: F of Eq. (22) [N, N m]."""
    compensated_load: PerRow
    """Resistance along the path that is compensated [N]."""
    pace: PerRow
    """Pace of the command phase: 1 is normal, 0 waits, -1 returns to the hand."""
    path_lag: PerRow
    """Lag of the hand behind the pose on the path, along it; adds to σ [m]."""


class Load:
    """State of a load rule; rules without state are used as their own state."""

    __slots__ = ()

    def begin(self, profile: StiffnessProfile, shape: tuple[int, ...] = ()) -> "Load":
        """Return a rule's state for one hand, shape (), or for N hands, (N,)."""
        return self

    def reset(self, rows: Rows = ALL_ROWS) -> None:
        """Forget these rows' doors."""

    def update(self, contact: ContactState, rows: Rows = ALL_ROWS) -> LoadResponse:
        """Update the state from the contact of these rows and return the response."""
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True, slots=True)
class LearnedLoad(Load):
    """Compensates the learned weight of a door, and yields to the rest.

    Of the resistance r along the path, the hand compensates at most the expected
    resistance r̂, and of what is not known to be the door's weight at most the force
    that the remaining stiffness has at `reach`:

        compensated = min(r, r̂, max(k(g) ℓ, w r̂)),        g = max(-uᵀe, 0),

    with the direction u of the path, the displacement e of Eq. (22), the lag g of the
    hand along the path, and the stiffness k(g) along u from Eq. (24) with σ = g. The
    rest, r - compensated, displaces the set-point. The lag counts as uncertainty: σ'² =
    σ² + (g u)² sets the stiffness. A held hand becomes soft; a released hand becomes
    stiff again, at the rate that the governor allows.

    r̂ is `limit` at first. Then it follows, over `stretch` metres of path, the force
    that was needed to move the hand: the maximum in each step of `step` metres, because
    of stick-slip friction. A person who holds the hand stops it, which does not count.
    Over the same distance the share w of r̂ that was measured rises from 0 to 1: a
    weight that was learned stays compensated, however far the hand lags. From w = 1/2
    on, r̂ falls more slowly, over `memory` metres: momentum helps only for a while.

    If forces were demonstrated, a resistance within the interval expected from them and
    from this door so far is always compensated, up to `shown_limit` and `shown_share`
    of the largest demonstrated force: a closer resists no matter how far the hand lags.
    While the door is unknown, the interval at the end of the path ahead counts as well.

    The clock slows down with the lag of the hand and waits at `lag`. As the door
    becomes known (from 0 to 1 over the same distance as r̂), the lag that the force
    will cause, (r - compensated)/k_min, counts as well. An object that holds the hand
    finally bears k_min (ℓ + `lag`), 13 N with the default profile
    (``test_what_holds_the_hand_bears_the_least_stiffness``). Behind a handle, where
    fingers do not slip, h `limit` and h ℓ replace `limit` and ℓ: 26 N, or at a closed
    door `ContactState.insistence`, up to h `limit`.
    """

    limit: float = quantity(25.0, above=0.0, unit="N", reason=_NO_LIMIT)
    """Resistance expected before the hand has moved, and greatest expected resistance
    [N]. A friction grasp of 16 N per finger slips at 37 N."""
    hook_grasp_gain: float = quantity(58.0 / 25.0, above=0.0)
    """h: load capacity of a hook grasp relative to a friction grasp: the arm's joints
    yield first, at 58 N along the path (assets/README.md, "What the arm can carry")."""
    shown_limit: float = quantity(33.0, above=0.0, unit="N")
    """Greatest resistance that is compensated because it was demonstrated [N]."""
    interval: float = quantity(2.0, low=0.0)
    """Upper end of the interval of the expected force, in standard deviations."""
    shown_share: float = quantity(1.5, low=0.0)
    """Greatest such resistance relative to the largest demonstrated force: a locked
    door would raise the expected force further and further."""
    least: float = quantity(1.0, above=0.0, unit="N")
    """Least expected resistance of a door [N]: variations of hinge and sensor."""
    stretch: float = quantity(0.03, above=0.0, unit="m")
    """Length of path over which r̂ follows the resistance [m]."""
    memory: float = quantity(0.06, above=0.0, unit="m")
    """Length of path over which the r̂ of a known door falls [m]. Tuned."""
    reach: float = quantity(0.1, above=0.0, unit="m")
    """ℓ: distance that limits the compensated load to the force k(g) ℓ [m]."""
    lag: float = quantity(0.03, above=0.0, unit="m")
    """Lag at which the clock waits [m]."""
    step: float = quantity(5e-3, above=0.0, unit="m")
    """Distance along the path after which the hand counts as moved [m]. Tuned."""

    def __post_init__(self) -> None:
        check_quantities(self)
        if self.least > self.limit:
            raise ValueError(
                f"LearnedLoad.least must not exceed limit, got {self.least} and "
                f"{self.limit} [N]"
            )

    def begin(self, profile: StiffnessProfile, shape: tuple[int, ...] = ()) -> Load:
        """Return the rule's state before the first step."""
        return _LoadLearner(self, profile, shape)


class _LoadLearner(Load):
    """State of `LearnedLoad`."""

    def __init__(
        self, rule: LearnedLoad, profile: StiffnessProfile, shape: tuple[int, ...]
    ) -> None:
        self._rule, self._profile = rule, profile
        self._expected = np.full(shape, np.nan)  # NaN: the limit
        self._learned = np.zeros(shape)
        self._mark = np.full((*shape, 3), np.nan)  # NaN: none yet
        self._most = np.zeros(shape)  # resistance since the mark

    def reset(self, rows: Rows = ALL_ROWS) -> None:
        """Forget these rows' doors; the limit is expected for the next."""
        self._expected[rows] = np.nan
        self._learned[rows] = 0.0
        self._mark[rows] = np.nan
        self._most[rows] = 0.0

    def update(self, contact: ContactState, rows: Rows = ALL_ROWS) -> LoadResponse:
        """Update the expected resistance of these rows, and return the response."""
        rule, direction = self._rule, contact.direction
        gain = rule.hook_grasp_gain if contact.hook_grasp else 1.0
        resistance = np.maximum(-_along(direction, contact.wrench), 0.0)

        # Expected resistance r̂: follows the maximum between two marks on the path.
        position = contact.pose[..., :3]
        mark = self._mark[rows]
        mark = np.where(np.isnan(mark), position, mark)
        moved = _along(direction, position - mark)
        limit = rule.limit * gain
        before = self._expected[rows]
        before = np.where(np.isnan(before), limit, before)
        most = np.maximum(self._most[rows], resistance)
        met = np.minimum(np.maximum(most, rule.least), limit)
        learned = self._learned[rows]
        falls = (met < before) & (learned > 0.5)
        went = np.where(moved >= rule.step, moved, 0.0)
        stretch = np.where(falls, rule.memory, rule.stretch)
        expected = before - np.expm1(-went / stretch) * (met - before)
        learned = learned - np.expm1(-went / rule.stretch) * (1.0 - learned)
        self._expected[rows], self._learned[rows] = expected, learned
        # After a motion backwards, the hand must first move forward again to learn.
        away = np.abs(moved) >= rule.step
        self._most[rows] = np.where(away, 0.0, most)
        self._mark[rows] = np.where(away[..., None], position, mark)

        # Compensated: at most r̂, and the force that the remaining stiffness can hold.
        lag = np.maximum(-_along(direction, contact.displacement), 0.0)
        std = np.repeat(np.asarray(lag)[..., None], 6, axis=-1)
        stiffness = self._profile.stiffness(std, rows=rows)[..., :3]
        reserve = gain * rule.reach * _along(direction, stiffness * direction)
        bound: PerRow = np.minimum(expected, np.maximum(reserve, learned * expected))
        bound = np.maximum(bound, np.minimum(contact.insistence, limit))
        if contact.expected is not None and contact.expected_ahead is not None:
            ends = []
            for force in (contact.expected, contact.expected_ahead):
                mean, std = force.along(direction[..., None])
                # For a method without standard deviations, use the mean.
                end = mean + rule.interval * np.where(np.isnan(std), 0.0, std)
                ends.append(end[..., 0])
            here, ahead = ends
            # Before the door moves, the phase at which it resists is uncertain.
            demonstrated = here + (1.0 - learned) * np.maximum(ahead - here, 0.0)
            largest = rule.shown_share * np.asarray(contact.expected.largest)
            demonstrated = np.minimum(
                demonstrated, np.minimum(largest, gain * rule.shown_limit)
            )
            bound = np.maximum(bound, demonstrated)
        compensated = np.asarray(np.minimum(resistance, bound))

        # Pace: from the lag, and from the lag that the force will cause at a known
        # door. A path without direction has no stiffness along it, and no resistance.
        softest = _along(direction, self._profile.k_min[:3] * direction)
        coming = learned * (resistance - compensated) / np.maximum(softest, 1e-9)
        share = np.maximum(lag, coming) / rule.lag
        return _response(contact.wrench, direction, compensated, share, lag)


@dataclass(frozen=True, kw_only=True, slots=True)
class CarriedLoad(Load, Quantities):
    """Compensates resistance along the path up to a limit; yields to everything else.

    The pace of the clock is 1 without load, 0 at the limit, and -1 from 1.19 times the
    limit on, where the set-point returns to the hand.
    """

    limit: float = quantity(25.0, above=0.0, unit="N", reason=_NO_LIMIT)
    """Greatest compensated resistance [N]; a friction grasp slips at 37 N."""

    def update(self, contact: ContactState, rows: Rows = ALL_ROWS) -> LoadResponse:
        """Return the response to the contact, see `compensate`."""
        return self.compensate(contact.wrench, contact.direction)

    def compensate(self, wrench: Axes, direction: Vectors) -> LoadResponse:
        """Return the response to wrenches on hands that move along directions."""
        resistance = np.asarray(np.maximum(-_along(direction, wrench), 0.0))
        compensated = np.asarray(np.minimum(resistance, self.limit))
        share, lag = resistance / self.limit, np.zeros_like(compensated)
        return _response(wrench, direction, compensated, share, lag)


@dataclass(frozen=True, kw_only=True, slots=True)
class YieldToAll(Load):
    """Every force displaces the set-point; the clock never waits, as in Eq. (22)."""

    def update(self, contact: ContactState, rows: Rows = ALL_ROWS) -> LoadResponse:
        """Return the unchanged wrenches and the normal pace."""
        nothing = np.zeros(contact.wrench.shape[:-1])
        return LoadResponse(contact.wrench, nothing, nothing + 1.0, nothing)


def _along(direction: Vectors, vectors: Float[np.ndarray, "*N V"]) -> PerRow:
    """Return the component of the first three numbers along a direction."""
    # Not `vecdot`: see `gplfd_policies.control.compliance`.
    return np.asarray(np.add.reduce(direction * vectors[..., :3], axis=-1))


def _response(
    wrench: Axes,
    direction: Vectors,
    compensated: Float[np.ndarray, "*N"],
    share: PerRow,
    lag: PerRow,
) -> LoadResponse:
    """Return a response; pace 1 for a share of 0, 0 for a share of 1, -1 from 1.19."""
    compliant = wrench.copy()
    compliant[..., :3] += compensated[..., None] * direction
    # Not `**`: for arrays its last bit depends on the processor.
    pace = np.asarray(1.0 - np.minimum(np.float_power(share, 4.0), 2.0))
    return LoadResponse(compliant, compensated, pace, lag)
