"""The page beside the scene: what was run and how to read the view."""

import math

import rerun as rr
from rerun.chunk import Chunk

from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.files.provenance import versions
from gplfd_experiments.recording.layout import TEXT
from gplfd_experiments.recording.outside import causes_of
from gplfd_experiments.recording.stream import static


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

**Sure is stiff, unsure is soft.** Where the policy's σ is small, the hand is stiff \
(**yellow**, 500 N/m); where σ is large, it is soft (**violet**, 100 N/m) and lets the \
door lead. The ball above the hand, its trail, the tube and the lane *stiffness* have \
this colour: violet 100, pink 300, yellow 500 N/m, mean of x and z.

- **tube**: what the policy believes now, ±1.96 σ per axis (normal quantile; with few \
demonstrations less than 95 %); **grey-blue tube**: before it felt the door; **grey \
lines**: demonstrations; **green**: the handle's true arc
- **red arrow**: force of the door on the hand, 10 cm per 10 N
- σ, stiffness and colours are means of the last 0.25 s; the tab *Unsmoothed, rates* \
has what the controller used, which is stable below 100 % of the bound
- **door**: {door} (SI)
- **demonstrations**: {n_demonstrations}; **seed**: {log.seed}; **control period**: \
{1e3 * log.dt:g} ms
{outside}- {", ".join(f"{name} {version}" for name, version in versions().items())}
"""
    return static(TEXT, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))
