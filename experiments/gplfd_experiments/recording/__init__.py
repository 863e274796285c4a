"""One episode as a Rerun recording: the scene, the policy and why it was stiff."""

from gplfd_experiments.recording.episode import record_episode

__all__ = ["record_episode"]
