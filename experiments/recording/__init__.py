"""One episode as a Rerun recording: the scene, the policy and why it was stiff."""

from gplfd.experiments.recording.episode import record_episode

__all__ = ["record_episode"]
