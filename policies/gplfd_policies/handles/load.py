"""What the hand does about the spring of a handle that it holds while the door opens.

The spring of a lever resists the hand as long as it is turned, and when the door opens
that is across the path. Yielding to it the hand would let the handle go back, and what
it sees then would tell the policy that the handle is to be let back. So the load of the
handle is met along the way about its axis, and the door's load, which is another, along
the path of the axis.
"""

from dataclasses import replace

import numpy as np

from gplfd_policies.arrays.members import EVERY_MEMBER, Members
from gplfd_policies.control.load import Encounter, LoadRule, Response
from gplfd_policies.control.stiffness import StiffnessProfile
from gplfd_policies.handles.compensation import Handles


class HandleAndDoor:
    """A load rule at work twice: for the handle first, and for the door.

    Args:
        rule: What is done about a load.
        profile: What uncertainty does to the stiffness.
        handles: What the members turn.
        shape: Leading axes of all arrays: () for one hand, (N,) for N hands.
        period: Time between two control steps [s].
    """

    def __init__(
        self,
        rule: LoadRule,
        profile: StiffnessProfile,
        handles: Handles,
        shape: tuple[int, ...],
        period: float,
    ) -> None:
        self._handles, self._period = handles, period
        self._door = rule.begin(profile, shape)
        self._handle = rule.begin(profile, shape)

    def reset(self, members: Members = EVERY_MEMBER) -> None:
        """Forget these members' doors."""
        self._door.reset(members)
        self._handle.reset(members)

    def meet(self, encounter: Encounter, members: Members = EVERY_MEMBER) -> Response:
        """Return what these members do about what they meet.

        A handle whose door does not give is turned on meanwhile.

        Args:
            encounter: What their hands meet, along the path of the door.
            members: Whose they are.
        """
        poses = encounter.pose
        places = self._handles.places(poses, members)
        turning = replace(
            encounter,
            direction=self._handles.ways(poses, members),
            pose=poses - places,
        )
        held = self._handle.meet(turning, members)
        opening = replace(
            encounter,
            wrench=held.wrench,
            pose=places,
            hooked=self._handles.hooked(members),
        )
        response = self._door.meet(opening, members)
        on = self._handles.turned_on(
            poses, encounter.direction, response.carried, self._period, members
        )
        # A hand that turns the handle on does not pull harder at the same time.
        pace = np.where(on, np.minimum(response.pace, 0.0), response.pace)
        return replace(response, pace=pace)
