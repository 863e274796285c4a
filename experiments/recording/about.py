"""The page beside the scene: what was run and how to read the view."""

import math
from collections.abc import Mapping

from experiments.episodes.log import EpisodeLog


def about(
    log: EpisodeLog,
    n_demonstrations: int,
    versions: Mapping[str, str],
    *,
    ended: bool = True,
) -> str:
    """Write the page as Markdown.

    Args:
        log: Episode.
        n_demonstrations: How many demonstrations the policy learned from.
        versions: Versions of the packages that took part, by name.
        ended: Whether the outcome is known.
    """
    outcome = _outcome(log) if ended else "being opened"
    door = ", ".join(
        f"{name.replace('_', ' ')} {value:g}" for name, value in log.door_config.items()
    )
    return f"""\
### {log.door} door, policy `{log.policy}`: {outcome}

**How to read it.** The grey-blue tube is where the demonstrations alone put the \
handle; the violet tube is what the policy believes now. An adaptive policy \
narrows onto the true arc (green) as the hand (yellow) feels the door. Tubes and bands \
are ±1.96 σ per axis (normal quantile; with few demonstrations less than 95 %). Where \
the policy is **sure** (σ small) the robot is **stiff**; where it is **unsure** it is \
**soft** and lets the door lead: compare *Uncertainty* with *Stiffness*. Falling σ \
stiffens the robot, which is stable below 100 % of the bound. The red arrow is the \
door's force on the hand, 10 cm per 10 N.

- **door**: {door} (SI)
- **demonstrations**: {n_demonstrations}; **seed**: {log.seed}; **control period**: \
{1e3 * log.dt:g} ms
- {", ".join(f"{name} {version}" for name, version in versions.items())}
"""


def _outcome(log: EpisodeLog) -> str:
    opened = "**opened**" if log.success else f"**not opened** ({log.failure})"
    angle = math.degrees(log.door_angle[-1])
    return f"{opened}, {angle:.1f}° in {log.times[-1]:.1f} s"
