"""What figures are made from: demonstrations and episodes."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_policies.demonstrations.npz import LabelledDemonstrations

POLICY: Final = "gp"
"""Policy whose episodes figures show; others are shown the same observations."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Material:
    """Episodes by door, what their policy learned from, and the seed of everything."""

    seed: int
    demonstrations: LabelledDemonstrations
    episodes: Mapping[str, EpisodeLog]
