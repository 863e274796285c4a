"""Write one episode as a recording with its view: scene, policy, and reasons."""

import itertools
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from statistics import geometric_mean
from typing import Any, Final

import mujoco
import numpy as np
import rerun.blueprint as rrb
from rerun.chunk import Chunk

from gplfd_env.doors.config import HingeSide
from gplfd_experiments.data.preparation.frames import find_hinge
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.files.provenance import versions
from gplfd_experiments.recording import motion, panels, parts, stream
from gplfd_experiments.recording.scene import drawn_scene, moved_scene, view_3d
from gplfd_policies.demonstrations.demonstration import Demonstration

_FORCE_NOTE: Final = """\
- **panel 4**: outside the band of the expected force, the door differs from the \
demonstrations and the forces so far, or somebody is in the way
"""
_MODE_NOTE: Final = """\
- **modes** (tab *Unsmoothed, rates*, last panel): the demonstrations contain several \
kinds of motion; the active one is white, its probability violet
"""
# Position, target and up direction for a fixed and for a mobile robot, which needs
# space and has higher doors. From the hinge side, the hand is in front of the leaf.
_SCENE_EYES: Final = (
    ((-0.62, -1.95, 0.85), (-0.46, -0.2, -0.07), (0.0, 0.0, 1.0)),
    ((-0.8, -3.2, 1.3), (-0.7, -0.3, -0.15), (0.0, 0.0, 1.0)),
)
_PLAN_EYES: Final = (
    ((-0.3, -0.3, 1.0), (-0.3, -0.3, 0.0), (1.0, 0.0, 0.0)),
    ((-0.45, -0.4, 1.5), (-0.45, -0.4, 0.0), (1.0, 0.0, 0.0)),
)


def record_episode(
    path: str | Path,
    log: EpisodeLog,
    model: mujoco.MjModel,
    demonstrations: Sequence[Demonstration],
) -> None:
    """Write an .rrd with scene, policy, panels and layout, complete or not at all.

    The episode ran in the model; ValueError for a log that does not fit it.
    """
    check_model(log, model)
    mechanisms = parts.mechanism_of(model, log.config)
    curves = [*panels.all_series(log, mean_radius(demonstrations))]
    drawn = {chunk.entity_path for chunk in curves}
    views = layout([*parts.disturbances(log)], mechanisms, log.config.hinge_side, drawn)
    chunks = itertools.chain(curves, episode_chunks(log, model, demonstrations))
    name = f"{log.door} door, {log.policy}, seed {log.seed}"
    stream.write_recording(path, name, views, chunks)


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
    log: EpisodeLog, model: mujoco.MjModel, demonstrations: Sequence[Demonstration]
) -> Iterator[Chunk]:
    """Return all chunks but the time series: scene, policy, lanes and page."""
    yield from drawn_scene(model)
    yield from motion.door_frame(model, log.config, demonstrations)
    yield from moved_scene(model, log)
    yield from motion.policy_motion(log)
    yield from motion.hand_motion(log)
    yield from motion.hand_stiffness(log)
    yield from panels.stiffness_lane(log)
    yield from parts.disturbance_chunks(log)
    yield from parts.mechanism(log, model)
    yield from panels.stage_lane(log)
    # The page beside the scene: the run and how to read the view.
    opened = "**opened**" if log.success else f"**not opened** ({log.failure})"
    angle = math.degrees(log.opening.door_angle[-1])
    notes = _FORCE_NOTE * bool(np.isfinite(log.decisions.expected_force).any())
    notes += _MODE_NOTE * bool(np.isfinite(log.decisions.mode).any())
    if outside := ", ".join(parts.disturbances(log)):
        notes += f"- **from outside** (white, a ball above the hand): {outside}\n"
    axes = "and *across* the path"
    if np.all(log.decisions.frame == np.eye(3)):
        axes = "the pull (x) and *across* it (z)"
    text = files(__package__).joinpath("episode.md").read_text(encoding="utf-8")
    yield stream.page(
        text.format(
            door=log.door,
            policy=log.policy,
            end=f"{opened}, {angle:.1f}° in {log.times[-1]:.1f} s",
            parts=", ".join(_described(log.door_config)) or "standard",
            demonstrations=len(demonstrations),
            seed=log.seed,
            axes=axes,
            milliseconds=1e3 * log.dt,
            notes=notes,
            versions=", ".join(f"{name} {of}" for name, of in versions().items()),
        )
    )


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


def layout(
    kinds: Sequence[str] = (),
    mechanisms: Sequence[str] = (),
    hinge: HingeSide = "right",
    drawn: Collection[str] = (),
) -> rrb.Container:
    """Return the layout in the task frame, mirrored for a hinge on the left.

    ``kinds`` are names of disturbances, ``mechanisms`` those of `parts.TITLES`, and
    ``drawn`` the entities of the time series; panels without any are left out.
    """
    mobile = "base" in mechanisms
    mirror = np.array([1.0, -1.0 if hinge == "left" else 1.0, 1.0])

    def view(name: str, contents: list[str], eyes: Any) -> rrb.Spatial3DView:
        place, target, up = eyes[mobile]
        eye = (mirror * place, mirror * target, up)
        return view_3d(name, motion.VIEW, contents, eye)

    scene = view("Scene", ["/world/**", f"- {motion.PLAN}/**"], _SCENE_EYES)
    # From above, the number of the stiffness would overlap that of a disturbance.
    hidden = [f"- {motion.STIFFNESS}"] if kinds else []
    contents = [f"{motion.ROOT}/**", *hidden]
    plan = view(f"From above, hinge {hinge}", contents, _PLAN_EYES)
    tabs = {
        name: [
            plot
            for plot in plots
            if any(path.startswith(f"{panels.ROOT}/{plot.entity}/") for path in drawn)
        ]
        for name, plots in panels.TABS.items()
    }
    stages: rrb.Container | rrb.View
    stages = rrb.StateTimelineView(origin=panels.STAGES, name="Stage and stiffness")
    about = rrb.TextDocumentView(origin=stream.TEXT, name="How to read it")
    if kinds:
        columns = rrb.archetypes.TextLogColumns(text_log_columns=["Body"])
        name = "From outside"
        events = rrb.TextLogView(origin=parts.LOG, name=name, columns=columns)
        stages = rrb.Horizontal(stages, events, column_shares=[2, 1])
        units = ", ".join(f"{kind} [{parts.KINDS[kind].unit}]" for kind in kinds)
        outside = panels.Panel(parts.PANEL, f"From outside: {units}", from_zero=True)
        tabs[next(iter(tabs))].append(outside)
    if mechanisms:
        tabs["Handle, latch, closer, base"] = [
            panels.Panel(name, parts.TITLES[name]) for name in mechanisms
        ]
    left = rrb.Vertical(
        scene,
        stages,
        rrb.Horizontal(plan, about, column_shares=[3, 4]),
        row_shares=[4.5, 2.4 if "latch" in mechanisms else 1.7, 4.5],
    )
    right = []
    for name, plots in tabs.items():
        # Panels of a quantity are side by side.
        groups = itertools.groupby(plots, lambda plot: plot.entity.split("/")[0])
        rows = [rrb.Horizontal(*(plot.view() for plot in row)) for _, row in groups]
        if rows:
            right.append(rrb.Vertical(*rows, name=name))
    return rrb.Horizontal(left, rrb.Tabs(*right, active_tab=0), column_shares=[6, 5])
