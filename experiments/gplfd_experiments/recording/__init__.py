"""Episodes as Rerun recordings: scene, policy, and reasons for the stiffness."""

from gplfd_experiments.recording.comparison import record_comparison
from gplfd_experiments.recording.episode import record_episode

__all__ = ["record_comparison", "record_episode"]
