"""What the hand does about the spring of a handle that it holds while the door opens.

The spring of a lever resists the hand as long as it is turned, and when the door opens
that is across the path. Yielding to it the hand would let the handle go back, and what
it sees then would tell the policy that the handle is to be let back. So the load of the
handle is met along the way about its axis, and the door's load, which is another, along
the path of the axis.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from gplfd.policies.controllers.stiffness import StiffnessProfile
from gplfd.policies.handle import TurnedHandle
from gplfd.policies.load import Encounter, LoadRule, Response
from gplfd.policies.members import EVERY_MEMBER, Members

Poses = Float[np.ndarray, "*N 6"]


class HandleAndDoor:
    """A load rule at work twice: for the handle first, and for the door.

    Args:
        rule: What is done about a load.
        profile: What uncertainty does to the stiffness.
        handles: What each member turns; None for a bar.
        shape: Leading axes of all arrays: () for one hand, (N,) for N hands.
    """

    def __init__(
        self,
        rule: LoadRule,
        profile: StiffnessProfile,
        handles: Sequence[TurnedHandle | None],
        shape: tuple[int, ...],
    ) -> None:
        self._door = rule.begin(profile, shape)
        self._handles = tuple(handles)
        self._numbers = np.arange(len(self._handles)).reshape(shape)
        turned = any(handle is not None for handle in self._handles)
        self._handle = rule.begin(profile, shape) if turned else None

    def reset(self, members: Members = EVERY_MEMBER) -> None:
        """Forget these members' doors."""
        self._door.reset(members)
        if self._handle is not None:
            self._handle.reset(members)

    def meet(
        self, encounter: Encounter, poses: Poses, members: Members = EVERY_MEMBER
    ) -> Response:
        """Return what these members do about what they meet.

        Args:
            encounter: What their hands meet, along the path.
            poses: Of their hands, task frame [m, rad].
            members: Whose they are.
        """
        if self._handle is None:
            return self._door.meet(encounter, members)
        places, ways = self._axes(poses, members)
        turning = replace(
            encounter, direction=ways, position=encounter.position - places
        )
        held = self._handle.meet(turning, members)
        hooked = np.array([handle is not None for handle in self._handles])
        opening = replace(
            encounter,
            wrench=held.wrench,
            position=places,
            hooked=hooked.reshape(self._numbers.shape)[members],
        )
        return self._door.meet(opening, members)

    def _axes(
        self, poses: Poses, members: Members
    ) -> tuple[Float[np.ndarray, "*N 3"], Float[np.ndarray, "*N 3"]]:
        """Return where handles' axes are, and the hands' ways about them."""
        places, ways = [], []
        numbers = np.ravel(self._numbers[members]).tolist()
        for number, pose in zip(numbers, poses.reshape(-1, 6).tolist(), strict=True):
            handle = self._handles[number]
            places.append(pose[:3] if handle is None else handle.place(pose))
            ways.append((0.0, 0.0, 0.0) if handle is None else handle.way(pose))
        shape = poses[..., :3].shape
        return np.array(places).reshape(shape), np.array(ways).reshape(shape)
