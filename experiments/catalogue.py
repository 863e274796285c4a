"""What there is to run."""

import re
from collections.abc import Mapping

from gplfd.policies.registry import POLICIES
from gplfd.policies.user_policies import packaged_policies
from gplfd_env import (
    ENVIRONMENT_ID,
    GRIPPER_ENVIRONMENT_ID,
    IMPEDANCE_ENVIRONMENT_ID,
    MOBILE_ENVIRONMENT_ID,
    RL_ENVIRONMENT_ID,
)
from gplfd_env.config import DOORS, DoorConfig
from gplfd_env.fields import allowed_range
from gplfd_env.stance import stance_of


def catalogue() -> str:
    """Return doors, policies, environments, and what can happen, a line about each."""
    return "\n\n".join(_section(*one) for one in _sections().items() if one[1])


def catalogue_json() -> dict[str, dict[str, str]]:
    """Return the same as names and lines; a section goes by its title's first word."""
    return {
        re.split(r"\W", title, maxsplit=1)[0]: dict(lines)
        for title, lines in _sections().items()
    }


def _sections() -> Mapping[str, Mapping[str, str]]:
    """Return a line about each name, by the titles of the sections."""
    low, high = (
        allowed_range(DoorConfig, "radius").low,
        stance_of(DoorConfig(), "fixed").radius,
    )
    return {
        f"doors (or any radius from {low:g} to {high:g} m)": {
            name: _door(config) for name, config in DOORS.items()
        },
        "methods (or a policy of your own: module:function)": _policies("method"),
        "ablations: a method without one idea, or with another one": _policies(
            "ablation"
        ),
        "references, which learn nothing": _policies("reference"),
        "policies of installed packages": {
            one.name: f"{one.policy.summary if one.policy else one.problem} "
            f"({one.package})"
            for one in packaged_policies(POLICIES)
        },
        "environments": {
            ENVIRONMENT_ID: "command the hand's pose in the task frame",
            IMPEDANCE_ENVIRONMENT_ID: "command its pose and its stiffness",
            MOBILE_ENVIRONMENT_ID: "command its pose and the twist of the base",
            GRIPPER_ENVIRONMENT_ID: "command its pose and the width of the gripper",
            RL_ENVIRONMENT_ID: "for learners: flat, within ±1, and gentleness pays",
        },
        "randomizations (of doors, placement, grasp, sensors and delay)": {
            "none": "every episode the same door",
            "mild": "what a careful laboratory leaves over",
            "hard": "another door every time, also of another radius",
            "standard": "a door of a building every time: handle, way, side, closer",
        },
        "disturbances (what happens from outside while the door is opened)": {
            "none": "nothing",
            "push": "the hand is pushed for 0.3 s by up to 15 N along and across",
            "person": "somebody holds the hand for 2.5 s",
            "person-behind": "somebody's hand is in the door's way for 2.5 s",
            "stop": "the door is blocked for 2.5 s",
            "locked": "the door does not open at all",
            "bump": "the robot's base is moved by up to 10 mm ahead and to the side",
            "breakaway": "the hinge sticks at the start, and a seal holds the leaf",
        },
    }


def _policies(kind: str) -> dict[str, str]:
    return {
        name: POLICIES[name].summary
        for name in sorted(POLICIES)
        if POLICIES[name].kind == kind
    }


def _door(config: DoorConfig) -> str:
    closer = config.closer_preload
    return (
        f"radius {config.radius:.2f} m, hinge friction {config.hinge_friction:g} N m"
        + (f", closer {closer:g} N m" if closer else "")
    )


def _section(title: str, lines: Mapping[str, str]) -> str:
    width = max(map(len, lines))
    return "\n".join(
        [title, *(f"  {name:<{width}}  {text}" for name, text in lines.items())]
    )
