"""Write one episode as a recording that opens on the right view."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import mujoco
import rerun as rr

from experiments.episode_log import EpisodeLog
from experiments.provenance import versions
from experiments.recording.about import about
from experiments.recording.layout import TEXT, layout
from experiments.recording.motion import log_motion, task_frame
from experiments.recording.panels import log_panels
from experiments.recording.scene import log_scene
from experiments.recording.stages import log_stages
from experiments.recording.stream import recording_file
from policies.demonstrations import Demonstration


def record_episode(
    path: str | Path,
    log: EpisodeLog,
    model: mujoco.MjModel,
    demonstrations: Sequence[Demonstration],
) -> None:
    """Write an .rrd with scene, policy, panels and layout, complete or not at all.

    Args:
        path: File to write; an existing one is replaced.
        log: Episode to show.
        model: Model that the episode ran in.
        demonstrations: What the policy learned from, poses in the task frame.

    Raises:
        ValueError: The log does not fit the model.
        OSError: The file cannot be written.
    """
    if log.qpos.shape[1] != model.nq:
        raise ValueError(
            f"the log has {log.qpos.shape[1]} generalised positions per step and the "
            f"model has {model.nq}; record with the model that the episode ran in"
        )
    origin, rotation = task_frame(model, log.qpos[0])
    blueprint = layout(log, origin, rotation)
    with recording_file(path, blueprint) as stream:
        stream.send_recording_name(f"{log.door} door, {log.policy}, seed {log.seed}")
        log_scene(stream, log, model)
        log_motion(stream, log, model, demonstrations)
        log_panels(stream, log)
        log_stages(stream, log)
        page = about(log, len(demonstrations), versions())
        document = rr.TextDocument(page, media_type=rr.MediaType.MARKDOWN)
        stream.log(TEXT, document, static=True)
