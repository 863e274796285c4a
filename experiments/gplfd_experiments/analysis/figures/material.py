"""Input of the figures."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_policies.demonstrations.npz import LabelledDemonstrations

POLICY: Final = "gp"
"""Policy whose episodes figures show; other policies get the same observations."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Material:
    """Episodes by door, the demonstrations of their policy, and the common seed."""

    seed: int
    demonstrations: LabelledDemonstrations
    episodes: Mapping[str, EpisodeLog]
