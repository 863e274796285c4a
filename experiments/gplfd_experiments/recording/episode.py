"""Write one episode as a recording that opens on the right view."""

import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path

import mujoco
from rerun.chunk import Chunk

from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.recording.about import page
from gplfd_experiments.recording.layout import layout_chunks
from gplfd_experiments.recording.mechanism import mechanism, mechanism_of
from gplfd_experiments.recording.motion import (
    door_frame,
    hand_motion,
    hand_stiffness,
    policy_motion,
)
from gplfd_experiments.recording.outside import causes_of, from_outside
from gplfd_experiments.recording.panels import panels
from gplfd_experiments.recording.part import Part
from gplfd_experiments.recording.scene import drawn_scene, moved_scene
from gplfd_experiments.recording.stages import stage_lane
from gplfd_experiments.recording.stiffness import stiffness_lane
from gplfd_experiments.recording.stream import recording_file
from gplfd_experiments.recording.tiago_meshes import TiagoLooks
from gplfd_policies.demonstrations.demonstration import Demonstration


def record_episode(
    path: str | Path,
    log: EpisodeLog,
    model: mujoco.MjModel,
    demonstrations: Sequence[Demonstration],
    looks: TiagoLooks | None = None,
) -> None:
    """Write an .rrd with scene, policy, panels and layout, complete or not at all.

    Args:
        path: File to write; an existing one is replaced.
        log: Episode to show.
        model: Model that the episode ran in.
        demonstrations: What the policy learned from, poses in the task frame.
        looks: Meshes to draw in place of the robot's own shapes.

    Raises:
        ValueError: The log does not fit the model.
        OSError: The file cannot be written.
    """
    check_model(log, model)
    there = mechanism_of(model, log.door_config)
    arrangement = layout_chunks(causes_of(log), there, log.config.hinge_side)
    with recording_file(path, arrangement) as stream:
        stream.send_recording_name(recording_name(log))
        # One by one: while one is written the next is made.
        chunks = itertools.chain(
            stage_setting(log, model, demonstrations, looks),
            happening(Part(log=log), model),
            stage_lane(log),
            [page(log, len(demonstrations))],
        )
        stream.send_chunks(chunks)


def check_model(log: EpisodeLog, model: mujoco.MjModel) -> None:
    """Raise ValueError unless an episode can have run in a model."""
    if log.qpos.shape[1] != model.nq:
        raise ValueError(
            f"the log of {log.policy} has {log.qpos.shape[1]} generalised positions "
            f"per step and the model has {model.nq}; record with the model that the "
            "episode ran in"
        )


def stage_setting(
    log: EpisodeLog,
    model: mujoco.MjModel,
    demonstrations: Sequence[Demonstration],
    looks: TiagoLooks | None = None,
) -> Iterator[Chunk]:
    """What is there before anything moves: robot, door, demonstrations."""
    yield from drawn_scene(model, looks)
    yield from door_frame(model, log.config, demonstrations)


def happening(part: Part, model: mujoco.MjModel) -> Iterator[Chunk]:
    """What happens in a part of an episode: motion, forecasts and time series."""
    yield from moved_scene(model, part)
    yield from policy_motion(part)
    yield from hand_motion(part)
    yield from hand_stiffness(part)
    yield from stiffness_lane(part)
    yield from panels(part)
    yield from from_outside(part)
    yield from mechanism(part, model)


def recording_name(log: EpisodeLog) -> str:
    """Return what the viewer calls the episode."""
    return f"{log.door} door, {log.policy}, seed {log.seed}"
