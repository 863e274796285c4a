"""Write one episode as a recording with its view."""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from statistics import geometric_mean
from typing import Any

import mujoco
import numpy as np
import rerun as rr
from rerun.chunk import Chunk

from gplfd_experiments.data.preparation.frames import find_hinge
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.files.provenance import versions
from gplfd_experiments.recording.disturbances import disturbance_chunks, kinds_of
from gplfd_experiments.recording.lanes import stage_lane, stiffness_lane
from gplfd_experiments.recording.layout import TEXT, layout
from gplfd_experiments.recording.mechanism import mechanism, mechanism_of
from gplfd_experiments.recording.motion import (
    door_frame,
    hand_motion,
    hand_stiffness,
    policy_motion,
)
from gplfd_experiments.recording.panels import panels
from gplfd_experiments.recording.scene import drawn_scene, moved_scene
from gplfd_experiments.recording.stream import recording_file, static
from gplfd_experiments.recording.tiago_meshes import (
    BodyMeshes,
    mesh_chunks,
    without_geoms,
)
from gplfd_policies.demonstrations.demonstration import Demonstration


def record_episode(
    path: str | Path,
    log: EpisodeLog,
    model: mujoco.MjModel,
    demonstrations: Sequence[Demonstration],
    looks: BodyMeshes | None = None,
) -> None:
    """Write an .rrd with scene, policy, panels and layout, complete or not at all.

    The episode ran in the model; ``looks`` replace the robot's shapes. Raises
    ValueError for a log that does not fit the model, and OSError if the file cannot be
    written.
    """
    check_model(log, model)
    parts = mechanism_of(model, log.config)
    forces = bool(np.isfinite(log.decisions.expected_force).any())
    arrangement = layout(kinds_of(log), parts, log.config.hinge_side, forces=forces)
    with recording_file(path, arrangement) as stream:
        name = f"{log.door} door, {log.policy}, seed {log.seed}"
        stream.send_recording_name(name)
        # Chunks are made one by one while the previous one is written.
        stream.send_chunks(static_chunks(log, model, demonstrations, looks))
        stream.send_chunks(episode_chunks(log, model, mean_radius(demonstrations)))
        stream.send_chunks(stage_lane(log))
        stream.send_chunks(page(log, len(demonstrations)))


def check_model(log: EpisodeLog, model: mujoco.MjModel) -> None:
    """Raise ValueError if an episode cannot have run in a model."""
    positions = log.motion.qpos.shape[1]
    if positions != model.nq:
        raise ValueError(
            f"the log of {log.policy} has {positions} generalised positions per step "
            f"and the model has {model.nq}; record with the model that the episode ran "
            "in"
        )


def mean_radius(demonstrations: Sequence[Demonstration]) -> float:
    """Return the geometric mean of the radii of demonstrated arcs [m]; NaN of none."""
    try:
        return geometric_mean(find_hinge(d.poses[:, :3]).radius for d in demonstrations)
    except ValueError:  # no circle, or no demonstration
        return math.nan


def static_chunks(
    log: EpisodeLog,
    model: mujoco.MjModel,
    demonstrations: Sequence[Demonstration],
    looks: BodyMeshes | None = None,
) -> Iterator[Chunk]:
    """Return the static chunks: robot, door, demonstrations."""
    yield from drawn_scene(without_geoms(model, looks) if looks else model)
    yield from mesh_chunks(model, looks or {})
    yield from door_frame(model, log.config, demonstrations)


def episode_chunks(
    log: EpisodeLog, model: mujoco.MjModel, demonstrated_radius: float = math.nan
) -> Iterator[Chunk]:
    """Return the chunks that move: scene, forecasts and time series.

    ``demonstrated_radius`` is the mean radius of the demonstrated paths [m].
    """
    yield from moved_scene(model, log)
    for chunks_of in (policy_motion, hand_motion, hand_stiffness, stiffness_lane):
        yield from chunks_of(log)
    yield from panels(log, demonstrated_radius)
    yield from disturbance_chunks(log)
    yield from mechanism(log, model)


def _described(fields: Mapping[str, Any], part: str = "") -> Iterator[str]:
    """Return the name and value of each field of a door and its parts."""
    for name, value in fields.items():
        if isinstance(value, Mapping):
            yield from _described(value, f"{name} ")
        else:
            text = value if isinstance(value, str) else f"{value:g}"
            yield f"{part}{name.replace('_', ' ')} {text}"


def page(log: EpisodeLog, n_demonstrations: int) -> Chunk:
    """Return the page beside the scene: the run and how to read the view."""
    opened = "**opened**" if log.success else f"**not opened** ({log.failure})"
    angle = math.degrees(log.opening.door_angle[-1])
    end = f"{opened}, {angle:.1f}° in {log.times[-1]:.1f} s"
    door = ", ".join(_described(log.door_config))
    notes = ""
    if np.isfinite(log.decisions.expected_force).any():
        notes += (
            "- **panel 4**: force that the policy expected before it measured the "
            "force; outside the band the door differs from the demonstrations and the "
            "forces so far, or somebody is in the way\n"
        )
    if np.isfinite(log.decisions.mode).any():
        notes += (
            "- **modes** (tab *Unsmoothed, rates*, last panel): the demonstrations "
            "contain several kinds of motion; shows the active one and its "
            "probability\n"
        )
    if outside := ", ".join(kinds_of(log)):
        notes += f"- **from outside** (white, a ball above the hand): {outside}\n"
    text = f"""\
### {log.door} door, policy `{log.policy}`: {end}

**Small σ means stiff, large σ means soft.** Where the policy's σ is small, the hand \
is stiff (**yellow**, 500 N/m); where σ is large, it is soft (**violet**, 100 N/m) and \
follows the door. The ball above the hand, its trail, the tube and the lane \
*stiffness* have this colour: violet 100, pink 300, yellow 500 N/m, mean of along and \
across the path.

- **tube**: the policy's present forecast, ±1.96 σ per axis (normal quantile; with few \
demonstrations less than 95 %); **grey-blue tube**: forecast before the door moved; \
**grey lines**: demonstrations; **green**: true arc of the handle
- **red arrow**: force of the door on the hand, 10 cm per 10 N
- σ, stiffness and colours are means of the last 0.25 s; the tab *Unsmoothed, rates* \
has the controller's values; it is stable below 100 % of the bound
- **door**: {door} (SI)
- **demonstrations**: {n_demonstrations}; **seed**: {log.seed}; **control period**: \
{1e3 * log.dt:g} ms
{notes}- {", ".join(f"{name} {version}" for name, version in versions().items())}
"""
    return static(TEXT, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))
