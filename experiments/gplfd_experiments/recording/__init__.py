"""One episode as a Rerun recording: scene, policy, and reasons for the stiffness."""

from gplfd_experiments.recording.episode import record_episode

__all__ = ["record_episode"]
