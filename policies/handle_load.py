"""What the hand does about the spring of a handle that it holds while the door opens.

The spring of a lever resists the hand as long as it is turned, and when the door opens
that is across the path. Yielding to it the hand would let the handle go back, and what
it sees then would tell the policy that the handle is to be let back. So the load of the
handle is met along the way about its axis, and the door's load, which is another, along
the path of the axis.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from gplfd.policies.controllers.stiffness import StiffnessProfile
from gplfd.policies.handles import Handles
from gplfd.policies.load import Encounter, LoadRule, Response
from gplfd.policies.members import EVERY_MEMBER, Members

Poses = Float[np.ndarray, "*N 6"]


class HandleAndDoor:
    """A load rule at work twice: for the handle first, and for the door.

    Args:
        rule: What is done about a load.
        profile: What uncertainty does to the stiffness.
        handles: What the members turn.
        shape: Leading axes of all arrays: () for one hand, (N,) for N hands.
    """

    def __init__(
        self,
        rule: LoadRule,
        profile: StiffnessProfile,
        handles: Handles,
        shape: tuple[int, ...],
    ) -> None:
        self._handles = handles
        self._door = rule.begin(profile, shape)
        self._handle = rule.begin(profile, shape) if handles.turn else None

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
            encounter: What their hands meet, along the path of the door.
            poses: Of their hands, task frame [m, rad].
            members: Whose they are.
        """
        if self._handle is None:
            return self._door.meet(encounter, members)
        places = self._handles.places(poses, members)[..., :3]
        turning = replace(
            encounter,
            direction=self._handles.ways(poses, members),
            position=encounter.position - places,
        )
        held = self._handle.meet(turning, members)
        opening = replace(
            encounter,
            wrench=held.wrench,
            position=places,
            hooked=self._handles.hooked(members),
        )
        return self._door.meet(opening, members)
