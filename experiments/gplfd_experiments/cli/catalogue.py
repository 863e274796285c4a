"""Doors, policies, environments, randomizations and disturbances by name."""

from collections.abc import Mapping

from gplfd_env import (
    ENVIRONMENT_ID,
    GRIPPER_ENVIRONMENT_ID,
    IMPEDANCE_ENVIRONMENT_ID,
    MOBILE_ENVIRONMENT_ID,
    RL_ENVIRONMENT_ID,
)
from gplfd_env.doors.config import DOORS, DoorConfig
from gplfd_env.robot.tiago import TIAGO_LIKE
from gplfd_env.validation.fields import allowed_range
from gplfd_policies.registry.catalogue import POLICIES, packaged_summaries


def catalogue() -> dict[str, Mapping[str, str]]:
    """Return a description of each name, by the titles of the sections."""
    radius = allowed_range(DoorConfig, "radius")
    standing = TIAGO_LIKE.stance(DoorConfig()).radius
    return {
        f"doors (or any radius from {radius.low:g} to {radius.high:g} m, beyond "
        f"{standing:g} m with a mobile base; or a .json file)": {
            name: ("" if door.motion == "hinged" else f"{door.motion}, ")
            + f"radius {door.radius:.2f} m, "
            + f"hinge friction {door.hinge_friction:.2g} N m"
            + (f", closer {door.closer.preload:.3g} N m" if door.closer.preload else "")
            + (f", {door.handle}" if door.handle != "bar" else "")
            + (" with latch" if door.latch != "none" else "")
            for name, door in DOORS.items()
        },
        "methods that learn (or a policy of your own: module:function)": _policies(
            "method"
        ),
        "ablations (a method with one part removed or replaced)": _policies("ablation"),
        "references (policies that do not learn)": _policies("reference"),
        "policies of installed packages": packaged_summaries(POLICIES),
        "environments": {
            ENVIRONMENT_ID: "action: pose of the hand in the task frame",
            IMPEDANCE_ENVIRONMENT_ID: "action: pose and stiffness of the hand",
            MOBILE_ENVIRONMENT_ID: "action: pose of the hand and velocity of the base",
            GRIPPER_ENVIRONMENT_ID: "action: pose of the hand and width of the gripper",
            RL_ENVIRONMENT_ID: "for reinforcement learning: flat observations, actions "
            "within ±1, reward for low forces",
        },
        "randomizations (drawn at every reset)": {
            "none": "nothing: every episode has the given door",
            "mild": "small errors of placement, grasp, sensors; delay, friction, mass",
            "hard": "larger errors and delays; radius, friction, closer, mass, height",
            "standard": "a door of a building: handle, swing, hinge side, closer",
            "detector": "error of the detected handle pose; with --start approach",
        },
        "disturbances (during the opening)": {
            "none": "no disturbance",
            "push": "a force of up to 15 N pushes the hand for 0.3 s",
            "person": "a person holds the hand for 2.5 s",
            "person-behind": "a person's hand blocks the door for 2.5 s",
            "stop": "a fixed stop blocks the door for 2.5 s",
            "locked": "the door is locked for the whole episode",
            "bump": "the robot's base is displaced by up to 10 mm",
            "breakaway": "stiction and a seal hold the closed door",
        },
    }


def _policies(kind: str) -> dict[str, str]:
    kept = {name: POLICIES[name] for name in sorted(POLICIES)}
    return {
        name: policy.summary for name, policy in kept.items() if policy.kind == kind
    }
