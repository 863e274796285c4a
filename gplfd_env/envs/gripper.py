"""Environments in which the gripper is commanded, too: single and vector."""

from gplfd_env.envs.door_opening import DoorOpeningEnv
from gplfd_env.envs.vector import DoorOpeningVectorEnv
from gplfd_env.simulation.command import GRIPPING


class DoorOpeningGripperEnv(DoorOpeningEnv):
    """The same door, opened by commanding the hand's pose and its gripper.

    Action, (7,): commanded position [m] and rotation vector [rad] of the hand in the
    task frame, then the width between the fingers, from 0 (closed with full force) to
    0.09 m. A width larger than the handle releases it; the fingers may grasp it again.
    The observation also contains ``gripper_width`` (1,) [m] and ``grasped`` (1,): 1 if
    both fingers touch the handle, else 0. Everything else is as in `DoorOpeningEnv`.
    """

    command = GRIPPING


class DoorOpeningGripperVectorEnv(DoorOpeningVectorEnv):
    """n simulations of `DoorOpeningGripperEnv`."""

    command = GRIPPING
