"""How much further a handle turns than those that were shown.

Whether a bolt is free a hand cannot see: it feels that the door does not give. A person
then turns the handle on, to its stop. The policy, which knows the turn that it was
shown, does the same by a gear between that turn and the hand's: what is seen of the
hand is divided by it, what is asked of the hand multiplied. So the demonstrations stay
the demonstrations, and the handle goes back as they say, from further away.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from gplfd.policies.handle import TurnedHandle
from gplfd.policies.members import EVERY_MEMBER, Members, Numbers

Poses = Float[np.ndarray, "*N 6"]
Amount = Float[Numbers, "*N"]

_HELD: Final = 10.0
"""Force along the path with which a door that does not move may be latched [N]."""

_CLOSED: Final = 0.01
"""A door has not moved whose handle's axis has come less far [m]."""

_FOLLOWS: Final = 0.9
"""Share of what is asked of it by which a handle turns that is not at its stop."""

_RATE: Final = 0.5
"""How fast a handle is turned on, in turns that were shown [1/s]."""

_FURTHEST: Final = 1.6
"""Greatest gear: 1.25 rad where 0.8 was shown."""


class HandleGears:
    """The gears of some members' handles, 1 at first.

    Args:
        handles: What each member turns; None for a bar.
        shape: Leading axes of all arrays: () for one hand, (N,) for N hands.
    """

    def __init__(
        self, handles: Sequence[TurnedHandle | None], shape: tuple[int, ...]
    ) -> None:
        self._handles = tuple(handles)
        self._numbers = np.arange(len(self._handles)).reshape(shape)
        self._gears = [1.0] * len(self._handles)

    def reset(self, members: Members = EVERY_MEMBER) -> None:
        """Forget these members' handles."""
        for number in np.ravel(self._numbers[members]).tolist():
            self._gears[number] = 1.0

    @property
    def turn(self) -> bool:
        """Whether any handle turns."""
        return any(handle is not None for handle in self._handles)

    def opening(self, phases: Amount, members: Members = EVERY_MEMBER) -> Amount:
        """Return where along their paths these members open, or are about to."""
        numbers = np.ravel(self._numbers[members]).tolist()
        handles = [self._handles[number] for number in numbers]
        opens = [0.0 if handle is None else handle.opens for handle in handles]
        return np.maximum(phases, np.reshape(opens, np.shape(phases)))

    def places(
        self, poses: Float[np.ndarray, "*S 6"], members: Members = EVERY_MEMBER
    ) -> Float[np.ndarray, "*S 6"]:
        """Return poses, (..., N, 6), with their handles' axes instead of the hands."""
        numbers = np.ravel(self._numbers[members]).tolist()
        places = poses.copy()
        rows = places.reshape(-1, len(numbers), 6)
        for column, number in enumerate(numbers):
            handle = self._handles[number]
            if handle is not None:
                rows[:, column] = handle.places(rows[:, column])
        return places

    def shown(self, poses: Poses, members: Members = EVERY_MEMBER) -> Poses:
        """Return the poses that hands would have on a handle as it was shown."""
        return self._through(poses, -1.0, members)

    def asked(self, poses: Poses, members: Members = EVERY_MEMBER) -> Poses:
        """Return what the policy asks of hands on these members' own handles."""
        return self._through(poses, 1.0, members)

    def leading(
        self, poses: Poses, means: Poses, members: Members = EVERY_MEMBER
    ) -> Poses:
        """Return what hands tell of their doors: their handles as the policy has them.

        How far a handle is turned is the policy's own doing. A door is told by where
        the handle's axis is and how the leaf is turned.

        Args:
            poses: Of the hands [m, rad].
            means: What the policy expects of them.
            members: Whose they are.
        """
        numbers = np.ravel(self._numbers[members]).tolist()
        if all(self._handles[number] is None for number in numbers):
            return poses
        leading = poses.copy()
        rows = leading.reshape(-1, 6), means.reshape(-1, 6)
        for number, row, mean in zip(numbers, *rows, strict=True):
            handle = self._handles[number]
            if handle is not None:
                row[:] = handle.led(row.tolist(), mean.tolist())
        return leading

    def _through(self, poses: Poses, power: float, members: Members) -> Poses:
        numbers = np.ravel(self._numbers[members]).tolist()
        if all(self._gears[number] == 1.0 for number in numbers):
            return poses
        through = poses.copy()
        for number, row in zip(numbers, through.reshape(-1, 6), strict=True):
            handle, gear = self._handles[number], self._gears[number]
            if handle is not None and gear != 1.0:
                pose = row.tolist()
                _, turn = handle.turns(pose[3:])
                row[:] = handle.held(pose, gear**power * turn)
        return through

    def feel(
        self,
        poses: Poses,
        load: Amount,
        period: float,
        members: Members = EVERY_MEMBER,
    ) -> Bool[np.ndarray, "*N"]:
        """Turn on the handles of doors that do not give; return which.

        Args:
            poses: Of the hands [m, rad].
            load: What holds them back along the path [N].
            period: Since the last time [s].
            members: Whose they are.
        """
        numbers = np.ravel(self._numbers[members]).tolist()
        turns = []
        for number, pose, force in zip(
            numbers,
            poses.reshape(-1, 6).tolist(),
            np.ravel(load).tolist(),
            strict=True,
        ):
            handle = self._handles[number]
            on = handle is not None and self._turns_on(handle, number, pose, force)
            turns.append(on)
            if on:
                gear = self._gears[number] + _RATE * period
                self._gears[number] = min(gear, _FURTHEST)
        return np.array(turns).reshape(np.shape(load))

    def _turns_on(
        self, handle: TurnedHandle, number: int, pose: list[float], force: float
    ) -> bool:
        gear = self._gears[number]
        if force < _HELD or gear >= _FURTHEST:
            return False
        x, y, z = handle.place(pose)
        if x * x + y * y + z * z > _CLOSED**2:
            return False
        _, turn = handle.turns(pose[3:])
        return turn >= _FOLLOWS * gear * handle.travel
