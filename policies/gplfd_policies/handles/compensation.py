"""What the hands of some members do about the handles that they turn.

Three things keep handle and door apart, so that the rest of an agent sees a door with
a bar.

* A door's way is that of the handle's axis
  (`gplfd_policies.demonstrations.turned_handle`), not the hand's.
* How far a handle is turned is the policy's own doing, and the hand goes along the way
  about its axis as the handle's spring has it. Neither says anything of the door: what
  the policy learns of it is what is left.
* Whether the bolt is free a hand cannot see. It feels that the door does not give, and
  turns the handle on, as a person does, to its stop. The policy knows the turn that it
  was shown. Between that turn and the hand's stands a gear, 1 at first: what is seen of
  the hand is divided by it, what is asked of the hand multiplied. So the handle also
  goes back as was shown, from further away.

All is computed in single numbers, so that one hand and many give the same bits.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np
from jaxtyping import Float

from gplfd_policies.arrays.members import EVERY_MEMBER, Members, Numbers
from gplfd_policies.demonstrations.turned_handle import TurnedHandle, Vector

Poses = Float[np.ndarray, "*N 6"]
Vectors = Float[np.ndarray, "*N 3"]
Amount = Float[Numbers, "*N"]

_LATCHED: Final = 10.0
"""Force along the path from which a door that does not move may be latched [N]: less
than the gentlest limit of what a door may ask for, 22.2 N (ADA 404.2.9)."""

_CLOSED: Final = 0.01
"""A door whose handle's axis has come less far along its path is closed [m]."""

_FOLLOWS: Final = 0.8
"""Share of what is asked of it by which a handle turns that is not at its stop."""

_RATE: Final = 0.5
"""By how much the gear grows while the door does not give [1/s]: 0.4 rad/s where 0.8
rad was shown, half of the pace at which it was."""

_GREATEST: Final = 1.6
"""Greatest gear: no handle turns further than about 75°."""


class Handles:
    """The handles of some members.

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
        """Forget how far these members' handles turn."""
        for number in self._of(members):
            self._gears[number] = 1.0

    def hooked(self, members: Members = EVERY_MEMBER) -> np.ndarray:
        """Return which hands' fingers stand behind a handle, bool (*N)."""
        hooked = [self._handles[number] is not None for number in self._of(members)]
        return np.reshape(hooked, np.shape(self._numbers[members]))

    def shown(self, poses: Poses, members: Members = EVERY_MEMBER) -> Poses:
        """Return the poses that hands would have on handles as they were shown."""
        return self._through(poses, -1.0, members)

    def asked(self, poses: Poses, members: Members = EVERY_MEMBER) -> Poses:
        """Return the poses on these members' own handles of hands on those shown."""
        return self._through(poses, 1.0, members)

    def _through(self, poses: Poses, power: float, members: Members) -> Poses:
        through = poses.copy()
        for number, row in zip(self._of(members), through.reshape(-1, 6), strict=True):
            handle, gear = self._handles[number], self._gears[number]
            if handle is not None and gear != 1.0:
                pose = row.tolist()
                _, turn = handle.turns(pose[3:])
                row[:] = handle.held(pose, gear**power * turn)
        return through

    def told(
        self,
        pose: Float[np.ndarray, " 6"],
        mean: Float[np.ndarray, " 6"],
        number: int,
    ) -> Float[np.ndarray, " 6"]:
        """Return what a hand tells of its door: its handle as the policy has it.

        Args:
            pose: Of the hand [m, rad].
            mean: What the policy expects of it [m, rad].
            number: The member's.
        """
        handle = self._handles[number]
        if handle is None:
            return pose
        return np.array(handle.told(pose.tolist(), mean.tolist()))

    def opening(self, phases: Amount, members: Members = EVERY_MEMBER) -> Amount:
        """Return where along their paths these members open, or will first."""
        opens = [
            0.0 if handle is None else handle.opens
            for handle in (self._handles[number] for number in self._of(members))
        ]
        return np.maximum(phases, np.reshape(opens, np.shape(phases)))

    def places(
        self, poses: Float[np.ndarray, "*S 6"], members: Members = EVERY_MEMBER
    ) -> Float[np.ndarray, "*S 6"]:
        """Return poses (..., *N, 6) with the handles' axes' places for the hands'."""
        numbers, places = self._of(members), poses.copy()
        columns = places.reshape(-1, len(numbers), 6)
        for column, number in enumerate(numbers):
            handle = self._handles[number]
            if handle is not None:
                columns[:, column] = handle.places(columns[:, column])
        return places

    def ways(self, poses: Poses, members: Members = EVERY_MEMBER) -> Vectors:
        """Return the hands' ways about their handles' axes; zero for a bar."""
        ways: list[Vector] = []
        rows = poses.reshape(-1, 6).tolist()
        for number, pose in zip(self._of(members), rows, strict=True):
            handle = self._handles[number]
            ways.append((0.0, 0.0, 0.0) if handle is None else handle.way(pose))
        return np.reshape(ways, (*poses.shape[:-1], 3))

    def turned_on(
        self,
        poses: Poses,
        direction: Vectors,
        load: Amount,
        period: float,
        members: Members = EVERY_MEMBER,
    ) -> np.ndarray:
        """Turn handles on whose doors do not give; return which, bool (*N).

        A handle is turned on if the door holds the hand back, has not moved, and the
        handle has come as far as was asked.

        Args:
            poses: Of the hands [m, rad].
            direction: Of their doors' paths, unit vectors.
            load: What holds the hands back along them [N].
            period: Time since the last call [s].
            members: Whose they are.
        """
        turned = np.zeros(np.shape(load), dtype=np.bool_)
        rows = poses.reshape(-1, 6), direction.reshape(-1, 3), np.ravel(load)
        for index, (number, pose, path, force) in enumerate(
            zip(self._of(members), *(row.tolist() for row in rows), strict=True)
        ):
            handle, gear = self._handles[number], self._gears[number]
            if handle is None or force < _LATCHED or gear >= _GREATEST:
                continue
            along = sum(p * u for p, u in zip(handle.place(pose), path, strict=True))
            turn = handle.turned(pose)
            if along < _CLOSED and turn >= _FOLLOWS * gear * handle.travel:
                self._gears[number] = min(gear + _RATE * period, _GREATEST)
                turned.flat[index] = True
        return turned

    def _of(self, members: Members) -> list[int]:
        numbers: list[int] = np.ravel(self._numbers[members]).tolist()
        return numbers
