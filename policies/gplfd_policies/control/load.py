"""Load compensation along the path: what the hand does about the door's resistance.

In Eq. (22) of Arduengo et al., arXiv:2002.09979, every external force displaces the
set-point. A force *across* the path shows that the path is wrong, and yielding is
right. The force *along* it may be the door's weight, under which a hand that yields
stalls, or a person who holds the hand. The past distinguishes them: a door was as heavy
a centimetre ago.
"""

from dataclasses import dataclass
from typing import Final, Protocol, runtime_checkable

import numpy as np

from gplfd_env.validation.fields import check_quantities, quantity
from gplfd_policies.arrays.records import Settings
from gplfd_policies.arrays.rows import ALL_ROWS, Numbers, Rows
from gplfd_policies.arrays.shapes import Axes, Float, Vectors
from gplfd_policies.control.expected_force import ExpectedForce
from gplfd_policies.control.stiffness import StiffnessProfile

Amount = Float[Numbers, "*N"]

_NO_STIFFNESS: Final = 1e-9
"""Divides where there is none [N/m]."""

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
    """How far it has been displaced: e of Eq. (22) [m]."""
    expected: ExpectedForce | None = None
    """What the demonstrations, and this door so far, say of the force; None without
    demonstrated forces."""
    expected_ahead: ExpectedForce | None = None
    """The same at the end of the chord that `direction` is of."""
    hook_grasp: bool = False
    """Whether the fingers stand behind a handle that they have turned, and do not hold
    it by friction alone."""


@dataclass(frozen=True, kw_only=True, slots=True)
class LoadResponse:
    """Response to a contact state."""

    compliant_wrench: Axes
    """Wrench that displaces the set-point: F of Eq. (22) [N, N m]."""
    compensated_load: Amount
    """Resistance along the path that is compensated, not part of `compliant_wrench`
    [N]."""
    pace: Amount
    """Pace of the command phase: 1 by the clock, 0 for waiting, down to -1 for going
    back to the hand."""
    path_lag: Amount
    """Lag of the hand behind the set-point along the path: a standard deviation along
    it, in addition to the policy's own [m]."""


@runtime_checkable
class Load(Protocol):
    """State of a load rule: what is known of the doors of some rows."""

    def reset(self, rows: Rows = ALL_ROWS) -> None:
        """Forget these rows' doors."""

    def update(self, contact: ContactState, rows: Rows = ALL_ROWS) -> LoadResponse:
        """Update the state by the contact of these rows and return the response."""


@runtime_checkable
class LoadRule(Protocol):
    """Decides which forces displace the set-point, and whether it waits.

    Agents use one rule for all rows of a batch if the rows' rules are equal.
    """

    def begin(self, profile: StiffnessProfile, shape: tuple[int, ...] = ()) -> Load:
        """Return the rule's state for one hand, shape (), or for N hands, (N,)."""


@dataclass(frozen=True, kw_only=True, slots=True)
class LearnedLoad:
    """Compensates the weight that a door was found to have, and yields to the rest.

    Of the resistance r along the path, the hand compensates no more than it expects,
    r̂, and than it could hold with `reach` of the stiffness that is left:

        compensated = min(r, r̂, k(g) ℓ),        g = max(-uᵀe, 0),

    with u the direction of the path, e the displacement of Eq. (22), g the lag of the
    hand along the path, and k(g) the stiffness along u that Eq. (24) has for g. The
    rest, r - compensated, displaces the set-point. The lag is uncertainty: the hand is
    not where the policy has it, so σ'² = σ² + (g u)² sets the stiffness. A hand that is
    held becomes soft; a free one becomes stiff again, as fast as the governor lets it.

    r̂ is `limit` at first, and then follows, over `stretch` metres of path, what it
    took to move the hand on: the maximum in a step of `step` metres, for a leaf that
    sticks and slips resists less where it moves than where it has to be started. A
    person who holds the hand, which then stands still, is not the door's weight.

    Where forces were demonstrated, a resistance within the interval of what they, and
    this door so far, say is compensated in any case, up to `shown_limit` and
    `shown_share` of the largest that was demonstrated: a closer holds a hand back as
    hard as it was expected to, however far the hand lags. While the door is unknown,
    the interval may also be that at the end of the path ahead, because the phase at
    which a closer begins to resist is uncertain.

    The clock slows down as the hand lags, and waits at `lag`: of the lag itself and, as
    far as the door is known (from 0 to 1 over the same way as r̂), of that to which the
    force will lead, (r - compensated)/k_min. What holds the hand finally bears
    k_min (ℓ + `lag`), 13 N with the default profile
    (``test_what_holds_the_hand_bears_the_least_stiffness``). Behind a handle, where
    fingers do not slip, h `limit` and h ℓ take the places of `limit` and ℓ: 26 N.
    """

    limit: float = quantity(25.0, above=0.0, unit="N", reason=_NO_LIMIT)
    """Resistance expected before the hand has moved, and the greatest ever compensated
    [N]. A friction grasp of 16 N per finger slips at 37 N."""
    hook_grasp_gain: float = quantity(58.0 / 25.0, above=0.0)
    """h: load capacity of a hook grasp relative to a friction grasp; factor of `limit`
    and `reach` where fingers stand behind a handle. There the arm's joints give way
    first, at 58 N along the path (assets/README.md, "What the arm can carry")."""
    shown_limit: float = quantity(33.0, above=0.0, unit="N")
    """Greatest resistance that is compensated because it was demonstrated [N]: nine
    tenths of the force at which a friction grasp slips."""
    interval: float = quantity(2.0, low=0.0)
    """Standard deviations of the expected force up to which it is compensated."""
    shown_share: float = quantity(1.5, low=0.0)
    """The same relative to the largest force that was demonstrated: a hand that pulls
    at a locked door expects more force by its own pull."""
    least: float = quantity(1.0, above=0.0, unit="N")
    """Least resistance to be expected of a door [N]: what hinge and sensor add now and
    take away again."""
    stretch: float = quantity(0.03, above=0.0, unit="m")
    """Path over which r̂ follows the resistance [m]."""
    reach: float = quantity(0.1, above=0.0, unit="m")
    """ℓ: lag at which as much is yielded to as is compensated at most [m]."""
    lag: float = quantity(0.03, above=0.0, unit="m")
    """Lag at which the clock waits [m]."""
    step: float = quantity(5e-3, above=0.0, unit="m")
    """Distance along the path from which the hand counts as moved [m]. Tuned: above a
    pose sensor's noise and the slack of a grip."""

    def __post_init__(self) -> None:
        check_quantities(self)
        if self.least > self.limit:
            raise ValueError(
                f"LearnedLoad.least must not exceed limit, got {self.least} and "
                f"{self.limit} [N]"
            )

    def begin(
        self, profile: StiffnessProfile, shape: tuple[int, ...] = ()
    ) -> "LoadLearner":
        """Return the rule's state before the first step."""
        return LoadLearner(self, profile, shape)


class LoadLearner:
    """State of `LearnedLoad`."""

    def __init__(
        self, rule: LearnedLoad, profile: StiffnessProfile, shape: tuple[int, ...]
    ) -> None:
        self._rule, self._profile = rule, profile
        self._expected = np.full(shape, np.nan)  # NaN: the limit
        self._known = np.zeros(shape)
        self._mark = np.full((*shape, 3), np.nan)  # NaN: none yet
        self._most = np.zeros(shape)  # resistance since the mark

    def reset(self, rows: Rows = ALL_ROWS) -> None:
        """Expect nothing but the limit of these rows' next doors."""
        self._expected[rows] = np.nan
        self._known[rows] = 0.0
        self._mark[rows] = np.nan
        self._most[rows] = 0.0

    def update(self, contact: ContactState, rows: Rows = ALL_ROWS) -> LoadResponse:
        """Learn how heavy the doors of these rows are, and return the response."""
        rule, direction = self._rule, contact.direction
        gain = rule.hook_grasp_gain if contact.hook_grasp else 1.0
        resistance = _resistance(contact.wrench, direction)

        # Expected resistance r̂: follows the maximum between two marks on the path.
        position = contact.pose[..., :3]
        mark = self._mark[rows]
        mark = np.where(np.isnan(mark), position, mark)
        moved = _along(direction, position - mark)
        weight = np.where(moved >= rule.step, -np.expm1(-moved / rule.stretch), 0.0)
        limit = rule.limit * gain
        before = self._expected[rows]
        before = np.where(np.isnan(before), limit, before)
        most = np.maximum(self._most[rows], resistance)
        met = np.minimum(np.maximum(most, rule.least), limit)
        expected = self._expected[rows] = before + weight * (met - before)
        known = self._known[rows]
        known = self._known[rows] = known + weight * (1.0 - known)
        # A hand that is led back has to come forward again before it learns.
        away = np.abs(moved) >= rule.step
        self._most[rows] = np.where(away, 0.0, most)
        self._mark[rows] = np.where(away[..., None], position, mark)

        # Compensated: at most r̂, and what the stiffness left by the lag can hold.
        lag = np.maximum(-_along(direction, contact.displacement), 0.0)
        std = np.repeat(np.asarray(lag)[..., None], 6, axis=-1)
        stiffness = _stretched(self._profile.stiffness(std, rows=rows), direction)
        reserve = gain * rule.reach * stiffness
        bound: Amount = np.minimum(expected, reserve)
        if contact.expected is not None and contact.expected_ahead is not None:
            here, ahead = (
                _upper(one, direction, rule.interval)
                for one in (contact.expected, contact.expected_ahead)
            )
            # Where a door that has not moved yet begins to resist is uncertain.
            shown = here + (1.0 - known) * np.maximum(ahead - here, 0.0)
            largest = rule.shown_share * np.asarray(contact.expected.largest)
            shown = np.minimum(shown, np.minimum(largest, gain * rule.shown_limit))
            bound = np.maximum(bound, shown)
        compensated = np.asarray(np.minimum(resistance, bound))

        # Pace: by the lag, and by the lag to which the force leads on a known door. A
        # path without direction has no stiffness along it, and no resistance.
        softest = np.maximum(_stretched(self._profile.k_min, direction), _NO_STIFFNESS)
        coming = known * (resistance - compensated) / softest
        return LoadResponse(
            compliant_wrench=_without(contact.wrench, compensated, direction),
            compensated_load=compensated,
            pace=_pace(np.maximum(lag, coming) / rule.lag),
            path_lag=lag,
        )


class _Stateless(Load):
    """Base of rules that are their own state, because they have none."""

    def begin(self, profile: StiffnessProfile, shape: tuple[int, ...] = ()) -> Load:
        """Return itself."""
        return self

    def reset(self, rows: Rows = ALL_ROWS) -> None:
        """Do nothing."""


@dataclass(frozen=True, kw_only=True, slots=True)
class CarriedLoad(_Stateless, Settings):
    """Compensates resistance along the path up to a limit; yields to everything else.

    The clock's pace is 1 without load, 0 at the limit, and down to -1 from 1.19 times
    the limit on, where the set-point comes back to the hand.
    """

    limit: float = quantity(25.0, above=0.0, unit="N", reason=_NO_LIMIT)
    """Greatest resistance that is compensated [N]. A friction grasp of 16 N per finger
    slips at 37 N."""

    def update(self, contact: ContactState, rows: Rows = ALL_ROWS) -> LoadResponse:
        """Return the response to the contact, see `compensate`."""
        return self.compensate(contact.wrench, contact.direction)

    def compensate(self, wrench: Axes, direction: Vectors) -> LoadResponse:
        """Return the response to wrenches on hands that move along directions."""
        resistance = _resistance(wrench, direction)
        compensated = np.minimum(resistance, self.limit)
        return LoadResponse(
            compliant_wrench=_without(wrench, compensated, direction),
            compensated_load=compensated,
            pace=_pace(resistance / self.limit),
            path_lag=np.zeros_like(compensated),
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class YieldToAll(_Stateless):
    """Every force displaces the set-point, which never waits: Eq. (22) as printed."""

    def update(self, contact: ContactState, rows: Rows = ALL_ROWS) -> LoadResponse:
        """Return the wrenches as they are, and the clock's pace."""
        nothing = np.zeros(contact.wrench.shape[:-1])
        return LoadResponse(
            compliant_wrench=contact.wrench,
            compensated_load=nothing,
            pace=nothing + 1.0,
            path_lag=nothing,
        )


def _upper(expected: ExpectedForce, direction: Vectors, interval: float) -> Amount:
    """Return the upper end of the interval of the resistance along the path [N]."""
    mean, std = expected.along(direction[..., None])
    # Of a method without standard deviations the mean.
    return np.asarray(mean + interval * np.where(np.isnan(std), 0.0, std))[..., 0]


def _along(direction: Vectors, vectors: Float[np.ndarray, "*N V"]) -> Amount:
    """Return the component of the first three numbers along a direction."""
    # Not `vecdot`: see `gplfd_policies.control.compliance`.
    return np.asarray(np.add.reduce(direction * vectors[..., :3], axis=-1))


def _stretched(stiffness: Float[np.ndarray, "*#N 6"], direction: Vectors) -> Amount:
    """Return the stiffness against a displacement along a direction [N/m]."""
    return _along(direction, stiffness[..., :3] * direction)


def _resistance(wrench: Axes, direction: Vectors) -> Amount:
    """Return the force along the path that holds the hands back [N]."""
    return np.asarray(np.maximum(-_along(direction, wrench), 0.0))


def _without(wrench: Axes, load: Amount, direction: Vectors) -> Axes:
    """Return the wrenches without the load that is compensated."""
    left = wrench.copy()
    left[..., :3] += np.asarray(load)[..., None] * direction
    return left


def _pace(share: Amount) -> Amount:
    """Return 1 for nothing, 0 for a share of 1, -1 from 1.19 on."""
    # Not `**`: for arrays its last bit depends on the processor.
    return np.asarray(1.0 - np.minimum(np.float_power(share, 4.0), 2.0))
