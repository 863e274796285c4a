"""The page beside the scene: what was run and how to read the view."""

import math

import rerun as rr
from rerun.chunk import Chunk

from gplfd.experiments.episodes.log import EpisodeLog
from gplfd.experiments.files.provenance import versions
from gplfd.experiments.recording.layout import TEXT
from gplfd.experiments.recording.outside import causes_of
from gplfd.experiments.recording.stream import static


def page(log: EpisodeLog, n_demonstrations: int, *, ended: bool = True) -> Chunk:
    """Write the page.

    Args:
        log: Episode.
        n_demonstrations: How many demonstrations the policy learned from.
        ended: Whether the outcome is known.
    """
    opened = "**opened**" if log.success else f"**not opened** ({log.failure})"
    angle = math.degrees(log.door_angle[-1])
    end = f"{opened}, {angle:.1f}° in {log.times[-1]:.1f} s"
    door = ", ".join(
        f"{name.replace('_', ' ')} {value if isinstance(value, str) else f'{value:g}'}"
        for name, value in log.door_config.items()
    )
    outside = ", ".join(causes_of(log))
    if outside:
        outside = f"- **from outside** (white, a ball above the hand): {outside}\n"
    text = f"""\
### {log.door} door, policy `{log.policy}`: {end if ended else "being opened"}

**How to read it.** The grey-blue tube is where the demonstrations, carried on where \
they end, put the handle; the violet tube is what the policy believes now. An adaptive \
policy narrows onto the true arc (green) as the hand (yellow) feels the door. Tubes \
and bands are ±1.96 σ per axis (normal quantile; with few demonstrations less than 95 \
%). Where the policy is **sure** (σ small) the robot is **stiff**; where it is \
**unsure** it is **soft** and lets the door lead: compare *σ* with *Stiffness*. A hand \
that is held off its path (white) is unsure, too; violet among the forces is the \
weight of the door that it carries. Falling σ stiffens the robot, which is stable \
below 100 % of the bound. The red arrow is the door's force on the hand, 10 cm per 10 \
N.

- **door**: {door} (SI)
- **demonstrations**: {n_demonstrations}; **seed**: {log.seed}; **control period**: \
{1e3 * log.dt:g} ms
{outside}- {", ".join(f"{name} {version}" for name, version in versions().items())}
"""
    return static(TEXT, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))
