"""Doors that are opened by commanding a gripper, too: one, and many at once."""

from gplfd_env.envs.door_opening import DoorOpeningEnv
from gplfd_env.envs.vector import DoorOpeningVectorEnv
from gplfd_env.simulation.command import GRIPPING


class DoorOpeningGripperEnv(DoorOpeningEnv):
    """The same door, opened by commanding the hand's pose and its gripper.

    Action, (7,): commanded position [m] and rotation vector [rad] of the hand in the
    task frame, then the width between the fingers, from 0 (closed with all the force
    that they have) to 0.09 m. Fingers that are told to be wider than the handle let it
    go, and may take it again. The observation tells ``gripper_width`` (1,) [m] and
    ``grasped`` (1,): 1 if both fingers touch the handle, else 0. Everything else is as
    in `DoorOpeningEnv`.
    """

    command = GRIPPING


class DoorOpeningGripperVectorEnv(DoorOpeningVectorEnv):
    """n simulations of `DoorOpeningGripperEnv`."""

    command = GRIPPING
