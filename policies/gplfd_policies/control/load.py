"""What the hand does about the force that a door puts up against being opened.

In Eq. (22) of Arduengo et al., *Gaussian-Process-based Robot Learning from
Demonstration*, arXiv:2002.09979, every external force displaces the set-point. A force
*across* the path tells that the path is wrong, and yielding is right. The force *along*
it may be the door's weight, to which yielding only stretches the virtual spring until a
heavy door stalls; or somebody who holds the hand, whom nothing but yielding helps.
What tells them apart is the past: a door was as heavy a centimetre ago.
"""

import math
from dataclasses import dataclass
from typing import Final, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float

from gplfd_policies.arrays.members import EVERY_MEMBER, Members, Numbers
from gplfd_policies.control.stiffness import StiffnessProfile

Wrench = Float[np.ndarray, "*N 6"]
Pose = Float[np.ndarray, "*N 6"]
Direction = Float[np.ndarray, "*N 3"]
Amount = Float[Numbers, "*N"]

_STEP: Final = 5e-3
"""A hand has moved when it has moved by this much along the path [m]: more than a pose
sensor's noise and what a grip gives."""


_NO_STIFFNESS: Final = 1e-9
"""Divides where there is none [N/m]."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Encounter:
    """What some hands meet in a control step; task frame."""

    wrench: Wrench
    """Force and moment on the hand [N, N m]."""
    direction: Direction
    """Unit vector along which the policy moves the hand."""
    pose: Pose
    """Pose of the hand [m, rad]."""
    displacement: Direction
    """How far it has been displaced: e of Eq. (22) [m]."""
    hooked: Bool[np.ndarray | np.bool_, "*N"] | bool = False
    """Whether its fingers stand behind a handle that it has turned, and do not hold it
    by friction alone."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Response:
    """What is done about it."""

    wrench: Wrench
    """What is left to yield to: F of Eq. (22) [N, N m]."""
    carried: Amount
    """Resistance along the path that is carried, and so not in `wrench` [N]."""
    pace: Amount
    """Pace of the command phase: 1 by the clock, 0 for waiting, down to -1 for going
    back to the hand."""
    give: Amount
    """How far the hand is held off along the path: a standard deviation along it,
    beside the policy's own [m]."""


@runtime_checkable
class Load(Protocol):
    """A load rule at work: what it knows of the doors of some members."""

    def reset(self, members: Members = EVERY_MEMBER) -> None:
        """Forget these members' doors."""

    def meet(self, encounter: Encounter, members: Members = EVERY_MEMBER) -> Response:
        """Return what these members do about what they meet."""


@runtime_checkable
class LoadRule(Protocol):
    """Decides which forces displace the set-point, and whether it waits.

    Agents use one rule for all members of a batch if the members' rules are equal.
    """

    def begin(self, profile: StiffnessProfile, shape: tuple[int, ...] = ()) -> Load:
        """Return the rule at work.

        Args:
            profile: What uncertainty does to the stiffness.
            shape: Leading axes of all arrays: () for one hand, (N,) for N hands.
        """


@dataclass(frozen=True, kw_only=True, slots=True)
class LearnedLoad:
    """Carries what the door has been found to weigh; yields, in doubt, to the rest.

    Of the resistance r along the path, the hand carries no more than it expects, r̂,
    and than it could hold with `reach` of the stiffness that is left:

        carried = min(r, r̂, k(g) ℓ),        g = max(-uᵀe, 0),

    with u the direction of the path, e the displacement of Eq. (22), g how far the hand
    has given way along the path, and k(g) the stiffness along u that Eq. (24) has for
    g. The rest, r - carried, displaces the set-point. The give is uncertainty: the hand
    is not where the policy has it, so σ'² = σ² + (g u)² sets the stiffness. Held fast
    the hand becomes soft; free again it becomes stiff, as fast as the governor lets it.

    r̂ is `limit` at first, for a door that nobody has moved yet, and then follows, over
    `stretch` metres of path, what it took to move the hand on: the most in a step of
    5 mm, for a leaf that sticks and slips resists less where it moves than where it is
    to be moved. Standing still teaches nothing: somebody who holds the hand is not the
    door's weight.

    The clock goes on while the hand gives way, slower and slower, and waits at `lag`:
    of the give itself and, as far as the door is known (from 0 to 1 over the same way
    as r̂), of that to which the force will lead, (r - carried)/k_min. What holds the
    hand bears k_min (ℓ + `lag`) in the end, 13 N with the default profile
    (``test_what_holds_the_hand_bears_the_least_stiffness``).

    All this is of a friction grasp. Fingers that stand behind a handle do not slip:
    h `limit` and h ℓ take the places of `limit` and ℓ, and what holds the hand bears
    26 N.
    """

    limit: float = 25.0
    """Resistance expected before the hand has moved, and the greatest ever carried [N].
    A friction grasp of 16 N per finger slips at 37 N."""
    hooked_gain: float = 58.0 / 25.0
    """h: how many times `limit` and `reach` are greater where fingers stand behind a
    handle. There the arm's joints give way first, at 58 N along the path
    (assets/README.md, "What the arm can carry")."""
    least: float = 1.0
    """Least resistance to be expected of a door [N]: what hinge and sensor add now and
    take away again."""
    stretch: float = 0.03
    """Path over which r̂ follows the resistance [m]."""
    reach: float = 0.1
    """ℓ: give at which as much is yielded to as is carried at most [m]."""
    lag: float = 0.03
    """Give at which the clock waits [m]."""

    def __post_init__(self) -> None:
        _check_positive(
            self, "limit", "hooked_gain", "least", "stretch", "reach", "lag"
        )
        if self.least > self.limit:
            raise ValueError(
                f"LearnedLoad.least must not exceed limit, got {self.least} and "
                f"{self.limit} [N]"
            )

    def begin(
        self, profile: StiffnessProfile, shape: tuple[int, ...] = ()
    ) -> "LoadLearner":
        """Return the rule at work."""
        return LoadLearner(self, profile, shape)


class LoadLearner:
    """`LearnedLoad` at work.

    Args:
        rule: What it goes by.
        profile: What uncertainty does to the stiffness.
        shape: Leading axes of all arrays.
    """

    def __init__(
        self, rule: LearnedLoad, profile: StiffnessProfile, shape: tuple[int, ...]
    ) -> None:
        self._rule, self._profile = rule, profile
        self._expected = np.full(shape, np.nan)  # NaN: the limit
        self._known = np.zeros(shape)
        self._mark = np.full((*shape, 3), np.nan)  # NaN: none yet
        self._most = np.zeros(shape)  # resistance since the mark

    def reset(self, members: Members = EVERY_MEMBER) -> None:
        """Expect nothing but the limit of these members' next doors."""
        self._expected[members] = np.nan
        self._known[members] = 0.0
        self._mark[members] = np.nan
        self._most[members] = 0.0

    def meet(self, encounter: Encounter, members: Members = EVERY_MEMBER) -> Response:
        """Return what these members do, and learn how heavy their doors are."""
        rule, direction = self._rule, encounter.direction
        resistance = _resistance(encounter.wrench, direction)
        give = np.maximum(-_along(direction, encounter.displacement), 0.0)
        expected = self._learn(resistance, encounter, members)
        gain = np.where(encounter.hooked, rule.hooked_gain, 1.0)
        reserve = gain * rule.reach * self._stiffness(give, direction)
        carried = np.minimum(np.minimum(resistance, expected), reserve)
        # A path without direction has no stiffness along it, and no resistance.
        softest = np.maximum(_stretched(self._profile.k_min, direction), _NO_STIFFNESS)
        coming = self._known[members] * (resistance - carried) / softest
        return Response(
            wrench=_without(encounter.wrench, carried, direction),
            carried=carried,
            pace=_pace(np.maximum(give, coming) / rule.lag),
            give=give,
        )

    def _stiffness(self, give: Amount, direction: Direction) -> Amount:
        """Return k(g): the stiffness along the path if the give were all the doubt."""
        std = np.repeat(np.asarray(give)[..., None], 6, axis=-1)
        return _stretched(self._profile.stiffness(std), direction)

    def _learn(
        self, resistance: Amount, encounter: Encounter, members: Members
    ) -> Amount:
        """Let r̂ follow what it took members to move on; return it."""
        rule, position = self._rule, encounter.pose[..., :3]
        mark = self._mark[members]
        mark = np.where(np.isnan(mark), position, mark)
        moved = _along(encounter.direction, position - mark)
        weight = np.where(moved >= _STEP, -np.expm1(-moved / rule.stretch), 0.0)
        limit = rule.limit * np.where(encounter.hooked, rule.hooked_gain, 1.0)
        before = self._expected[members]
        before = np.where(np.isnan(before), limit, before)
        most = np.maximum(self._most[members], resistance)
        met = np.minimum(np.maximum(most, rule.least), limit)
        expected = before + weight * (met - before)
        self._expected[members] = expected
        known = self._known[members]
        self._known[members] = known + weight * (1.0 - known)
        # A hand that is led back has to come forward again before it learns.
        away = np.abs(moved) >= _STEP
        self._most[members] = np.where(away, 0.0, most)
        self._mark[members] = np.where(away[..., None], position, mark)
        return np.asarray(expected)


@dataclass(frozen=True, kw_only=True, slots=True)
class CarriedLoad:
    """Carries resistance along the path up to a limit; yields to everything else."""

    limit: float = 25.0
    """Resistance that the hand carries without yielding [N]. A friction grasp of 16 N
    per finger slips at 37 N."""

    def __post_init__(self) -> None:
        _check_positive(self, "limit")

    def begin(
        self, profile: StiffnessProfile, shape: tuple[int, ...] = ()
    ) -> "CarriedLoad":
        """Return itself: the rule keeps no memory."""
        return self

    def reset(self, members: Members = EVERY_MEMBER) -> None:
        """Have nothing to forget."""

    def share(self, wrench: Wrench, direction: Direction) -> tuple[Wrench, Amount]:
        """Take the carried load out of wrenches.

        Args:
            wrench: Force and moment on each hand, task frame [N, N m].
            direction: Unit vector along which the policy moves the hand.

        Returns:
            What is left to yield to, and the pace of the command phase: 1 (by the
            clock) without load, 0 at the limit, and down to -1 from 1.19 times the
            limit on, where the set-point comes back to the hand.
        """
        resistance = _resistance(wrench, direction)
        carried = np.minimum(resistance, self.limit)
        return _without(wrench, carried, direction), _pace(resistance / self.limit)

    def meet(self, encounter: Encounter, members: Members = EVERY_MEMBER) -> Response:
        """Return what `share` says."""
        wrench, direction = encounter.wrench, encounter.direction
        left, pace = self.share(wrench, direction)
        carried = np.minimum(_resistance(wrench, direction), self.limit)
        give = np.zeros_like(carried)
        return Response(wrench=left, carried=carried, pace=pace, give=give)


@dataclass(frozen=True, kw_only=True, slots=True)
class YieldToAll:
    """Every force displaces the set-point, which never waits: Eq. (22) as printed."""

    def begin(
        self, profile: StiffnessProfile, shape: tuple[int, ...] = ()
    ) -> "YieldToAll":
        """Return itself: the rule keeps no memory."""
        return self

    def reset(self, members: Members = EVERY_MEMBER) -> None:
        """Have nothing to forget."""

    def meet(self, encounter: Encounter, members: Members = EVERY_MEMBER) -> Response:
        """Return the wrenches as they are, and the clock's pace."""
        nothing = np.zeros(encounter.wrench.shape[:-1])
        return Response(
            wrench=encounter.wrench,
            carried=nothing,
            pace=nothing + 1.0,
            give=nothing,
        )


def _along(direction: Direction, vectors: Float[np.ndarray, "*N V"]) -> Amount:
    """Return the component of the first three numbers along a direction."""
    # Not `vecdot`: see `gplfd_policies.control.compliance`.
    return np.asarray(np.add.reduce(direction * vectors[..., :3], axis=-1))


def _stretched(stiffness: Float[np.ndarray, "*#N 6"], direction: Direction) -> Amount:
    """Return the stiffness against being displaced along a direction [N/m]."""
    return _along(direction, stiffness[..., :3] * direction)


def _resistance(wrench: Wrench, direction: Direction) -> Amount:
    """Return the force along the path that holds the hands back [N]."""
    return np.asarray(np.maximum(-_along(direction, wrench), 0.0))


def _without(wrench: Wrench, carried: Amount, direction: Direction) -> Wrench:
    """Return the wrenches without what is carried."""
    left = wrench.copy()
    left[..., :3] += np.asarray(carried)[..., None] * direction
    return left


def _pace(share: Amount) -> Amount:
    """Return 1 for nothing, 0 for a share of 1, -1 from 1.19 on."""
    # Not `**`: for arrays its last bit depends on the processor.
    return np.asarray(1.0 - np.minimum(np.float_power(share, 4.0), 2.0))


def _check_positive(rule: object, *names: str) -> None:
    for name in names:
        value = getattr(rule, name)
        if not 0.0 < value < math.inf:
            raise ValueError(
                f"{type(rule).__name__}.{name} must be positive and finite, got "
                f"{value}; to carry nothing use YieldToAll"
            )
