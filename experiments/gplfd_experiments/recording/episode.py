"""Write one episode as a recording with its view."""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from statistics import geometric_mean
from typing import Any, Final

import mujoco
import numpy as np
from rerun.chunk import Chunk

from gplfd_experiments.data.preparation.frames import find_hinge
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.files.provenance import versions
from gplfd_experiments.recording.lanes import stage_lane, stiffness_lane
from gplfd_experiments.recording.layout import layout
from gplfd_experiments.recording.motion import (
    door_frame,
    hand_motion,
    hand_stiffness,
    policy_motion,
)
from gplfd_experiments.recording.panels import panels
from gplfd_experiments.recording.parts import (
    disturbance_chunks,
    kinds_of,
    mechanism,
    mechanism_of,
)
from gplfd_experiments.recording.scene import drawn_scene, moved_scene
from gplfd_experiments.recording.stream import page, write_recording
from gplfd_policies.demonstrations.demonstration import Demonstration

_FORCE_NOTE: Final = """\
- **panel 4**: outside the band of the expected force, the door differs from the \
demonstrations and the forces so far, or somebody is in the way
"""
_MODE_NOTE: Final = """\
- **modes** (tab *Unsmoothed, rates*, last panel): the demonstrations contain several \
kinds of motion; the active one is white, its probability violet
"""


def record_episode(
    path: str | Path,
    log: EpisodeLog,
    model: mujoco.MjModel,
    demonstrations: Sequence[Demonstration],
) -> None:
    """Write an .rrd with scene, policy, panels and layout, complete or not at all.

    The episode ran in the model. Raises ValueError for a log that does not fit it, and
    OSError if the file cannot be written.
    """
    check_model(log, model)
    parts = mechanism_of(model, log.config)
    curves = [*panels(log, mean_radius(demonstrations))]
    drawn = {chunk.entity_path for chunk in curves}
    views = layout(kinds_of(log), parts, log.config.hinge_side, drawn)
    chunks = itertools.chain(curves, episode_chunks(log, model, demonstrations))
    name = f"{log.door} door, {log.policy}, seed {log.seed}"
    write_recording(path, name, views, chunks)


def check_model(log: EpisodeLog, model: mujoco.MjModel) -> None:
    """Raise ValueError if an episode cannot have run in a model."""
    positions = log.motion.qpos.shape[1]
    if positions != model.nq:
        raise ValueError(
            f"the log of {log.policy} has {positions} generalised positions per step "
            f"and the model has {model.nq}; record with the model that the episode ran "
            "in"
        )


def episode_chunks(
    log: EpisodeLog,
    model: mujoco.MjModel,
    demonstrations: Sequence[Demonstration],
) -> Iterator[Chunk]:
    """Return all chunks but the time series: scene, policy, lanes and page."""
    yield from drawn_scene(model)
    yield from door_frame(model, log.config, demonstrations)
    yield from moved_scene(model, log)
    for chunks_of in (policy_motion, hand_motion, hand_stiffness, stiffness_lane):
        yield from chunks_of(log)
    yield from disturbance_chunks(log)
    yield from mechanism(log, model)
    yield from stage_lane(log)
    yield _page(log, len(demonstrations))


def mean_radius(demonstrations: Sequence[Demonstration]) -> float:
    """Return the geometric mean of the radii of demonstrated arcs [m]; NaN of none."""
    try:
        return geometric_mean(find_hinge(d.poses[:, :3]).radius for d in demonstrations)
    except ValueError:  # no circle, or no demonstration
        return math.nan


def _described(fields: Mapping[str, Any], part: str = "") -> Iterator[str]:
    """Return the name and value of each field of a door and its parts."""
    for name, value in fields.items():
        if isinstance(value, Mapping):
            yield from _described(value, f"{name} ")
        else:
            text = value if isinstance(value, str) else f"{value:g}"
            yield f"{part}{name.replace('_', ' ')} {text}"


def _page(log: EpisodeLog, n_demonstrations: int) -> Chunk:
    """Return the page beside the scene: the run and how to read the view."""
    opened = "**opened**" if log.success else f"**not opened** ({log.failure})"
    angle = math.degrees(log.opening.door_angle[-1])
    notes = _FORCE_NOTE * bool(np.isfinite(log.decisions.expected_force).any())
    notes += _MODE_NOTE * bool(np.isfinite(log.decisions.mode).any())
    if outside := ", ".join(kinds_of(log)):
        notes += f"- **from outside** (white, a ball above the hand): {outside}\n"
    axes = "and *across* the path"
    if np.all(log.decisions.frame == np.eye(3)):
        axes = "the pull (x) and *across* it (z)"
    text = files(__package__).joinpath("episode.md").read_text(encoding="utf-8")
    return page(
        text.format(
            door=log.door,
            policy=log.policy,
            end=f"{opened}, {angle:.1f}° in {log.times[-1]:.1f} s",
            parts=", ".join(_described(log.door_config)) or "standard",
            demonstrations=n_demonstrations,
            seed=log.seed,
            axes=axes,
            milliseconds=1e3 * log.dt,
            notes=notes,
            versions=", ".join(f"{name} {of}" for name, of in versions().items()),
        )
    )
