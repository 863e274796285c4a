"""``gplfd list``: what there is to run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gplfd_env.config import DoorConfig


@dataclass(frozen=True, kw_only=True, slots=True)
class Catalogue:
    """List doors, policies, environments and randomisations, a line about each."""

    def execute(self) -> int:
        """Run the command and return the exit status."""
        from gplfd_env import ENVIRONMENT_ID, IMPEDANCE_ENVIRONMENT_ID
        from gplfd_env.config import DOORS, RADIUS_RANGE
        from policies.registry import POLICIES

        low, high = RADIUS_RANGE
        sections = {
            f"doors (or any radius from {low:g} to {high:g} m)": {
                name: _door(config) for name, config in DOORS.items()
            },
            "policies": {name: POLICIES[name].summary for name in sorted(POLICIES)},
            "environments": {
                ENVIRONMENT_ID: "command the hand's pose in the task frame",
                IMPEDANCE_ENVIRONMENT_ID: "command its pose and its stiffness",
            },
            "randomizations (of doors, placement, grasp, sensors and delay)": {
                "none": "every episode the same door",
                "mild": "what a careful laboratory leaves over",
                "hard": "another door every time, also of another radius",
            },
        }
        print("\n\n".join(_section(*section) for section in sections.items()))
        return 0


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
