"""What only some episodes show: parts of the door, a mobile base, disturbances.

Handle, bolt and base are joints of the model, with their motion in the log. Of a
disturbance the log has the magnitude, not the direction: the area of a ball shows it.
"""

from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple

import mujoco
import numpy as np
import rerun as rr
from numpy.typing import NDArray
from rerun.chunk import Chunk

from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.parts import Closer
from gplfd_env.robot.mobile_base import BASE_JOINTS
from gplfd_env.scene.door import CLOSER_ARM
from gplfd_env.scene.handle import GAP
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.recording import colours, motion, panels, scene, stream
from gplfd_experiments.recording.panels import Line

LATCH: Final = f"{panels.STAGES}/latch"
"""Entity of the lane with the state of the bolt."""
ARM: Final = "/world/scene/closer_arm"  # Entity of a closer's arm, in the world's axes.
LOG, PANEL = "/outside/log", "outside"
"""Entities of the texts about disturbances, and of their time series below
`panels.ROOT`."""
TITLES: Final[Mapping[str, str]] = {
    "handle": "Handle [deg]",
    "latch": "Bolt, retracted by [mm]",
    "closer": "Closing torque [N m]: closer, seal, stiction",
    "base": "Base [m, rad]: x ahead orange, y left blue, turn violet",
}
"""Titles of panels by the entity below `panels.ROOT`."""

_BOLT_STATES: Final = {"bolt thrown": colours.MARK, "bolt held back": colours.HAND}
_BASE_LINES: Final = (
    Line("x, ahead [m]", colours.AXIS_X),
    Line("y, to the left [m]", colours.AXIS_Z),
    Line("turn [rad]", colours.ADAPTED),
)
# Joint, line and factor of the unit of the curves of each panel with joints.
_JOINTS: Final = {
    "handle": [("handle", Line("handle", colours.HAND), 180.0 / np.pi)],
    "latch": [("bolt", Line("bolt held back", colours.HAND), 1e3)],
    "base": [(*curve, 1.0) for curve in zip(BASE_JOINTS, _BASE_LINES, strict=True)],
}

# Quasi-static and transient force on a hand allowed by ISO/TS 15066 [N].
_LIMITS: Final = (140.0, 280.0)
# Position of the ball above the hand and the ball of the stiffness, task frame [m].
_ABOVE: Final = (0.0, 0.30, 0.0)
_BALL: Final = 0.008  # Radius at 1 N [m]; it grows with the root of the force.


class Kind(NamedTuple):
    """A kind of disturbance: its texts, and the unit of its strength."""

    begins: str
    ends: str
    unit: str = "N"


KINDS: Final[Mapping[str, Kind]] = {
    "push": Kind("a push begins", "the push ends"),
    "person": Kind("contact with a person", "the person lets go"),
    "stop": Kind("the door meets a stop", "the stop is gone"),
    "bump": Kind("the base moves", "the base stops", "mm"),
}
"""Disturbances in a log, by the names of `gplfd_env.doors.disturbance.Disturbance`."""


def mechanism_of(model: mujoco.MjModel, door: DoorConfig) -> tuple[str, ...]:
    """Return which panels of `TITLES` have data for a model and its door."""
    joints = {model.joint(index).name for index in range(model.njnt)}
    present = {
        name: all(joint in joints for joint, *_ in curves)
        for name, curves in _JOINTS.items()
    }
    closing = door.closer != Closer() or door.seal > 0.0 or door.stiction > 0.0
    return tuple(name for name in TITLES if present.get(name, closing))


def mechanism(log: EpisodeLog, model: mujoco.MjModel) -> Iterator[Chunk]:
    """Return curves, the latch's lane and the closer's arm in an episode."""
    parts = mechanism_of(model, log.config)
    for name in parts:
        curves = {
            line: scale * log.motion.qpos[:, model.joint(joint).qposadr[0]]
            for joint, line, scale in _JOINTS.get(name, ())
        } or {Line("closing torque", colours.FORCE): log.forces.closer_torque}
        yield from panels.series(f"{panels.ROOT}/{name}/motion", log.times, curves)
    if "latch" in parts:
        changes = bolt_states(log, model)
        states = [(float(log.times[row]), name) for row, name in changes]
        yield from panels.lane(LATCH, _BOLT_STATES, states)
    # The tendon of a closer's arm, if it has a colour.
    arms = [i for i in range(model.ntendon) if model.tendon(i).name == CLOSER_ARM]
    for arm in (i for i in arms if model.tendon_rgba[i, 3] > 0.0):
        sites = [model.site(f"closer_{end}").id for end in ("spindle", "foot")]
        strips = [data.site_xpos[sites] for data in scene.kinematics(model, log)]
        tint = (255.0 * model.tendon_rgba[arm]).round().astype(np.uint8)
        look = rr.LineStrips3D.from_fields(colors=tint, radii=model.tendon_width[arm])
        columns = rr.LineStrips3D.columns(strips=np.array(strips, np.float32))
        ones = np.ones(len(strips), int)
        yield stream.static(ARM, look)
        yield stream.moving(ARM, log.times[stream.frames(log)], columns.partition(ones))


def bolt_states(log: EpisodeLog, model: mujoco.MjModel) -> list[tuple[int, str]]:
    """Return the rows in which the bolt is thrown or held back, and its state."""
    bolt = model.joint("bolt")
    back = log.motion.qpos[:, bolt.qposadr[0]] >= bolt.range[1] - GAP
    rows = np.flatnonzero(np.diff(back, prepend=~back[:1])).tolist()
    names = [*_BOLT_STATES]
    return [(row, names[int(back[row])]) for row in rows]


Disturbances = dict[str, tuple[FloatArray, NDArray[np.bool_]]]
"""Strength, and whether it acts, (T,) each, by the name of the disturbance."""


def disturbances(log: EpisodeLog) -> Disturbances:
    """Return the disturbances in an episode, in the order of `KINDS`."""
    present: Disturbances = {}
    for name, kind in KINDS.items():
        if kind.unit == "mm":  # The base stays where a bump has moved it.
            curve = 1e3 * log.motion.base_shift
            acts = np.diff(curve, prepend=0.0) > 0.0
        else:
            curve = getattr(log.forces, f"{name}_force")
            acts = curve > 0.0
        if acts.any():
            present[name] = curve, acts
    return present


def disturbance_chunks(log: EpisodeLog) -> Iterator[Chunk]:
    """Return balls, curves, limits and texts of the disturbances in an episode."""
    yield from balls(log)
    root = f"{panels.ROOT}/{PANEL}"
    for name, (strength, acts) in disturbances(log).items():
        curve = {Line(name, colours.OUTSIDE): strength}
        yield from panels.series(f"{root}/{name}", log.times, curve)
        kind, rows, texts = KINDS[name], [], []
        edges = np.diff(acts, prepend=False, append=False).nonzero()[0]
        for first, end in edges.reshape(-1, 2).tolist():
            rows.append(first)
            texts.append(kind.begins)
            if end < log.times.size:
                most = strength[first:end].max()
                rows.append(end)
                texts.append(f"{kind.ends}: {most:.0f} {kind.unit} at most")
        columns = rr.TextLog.columns(text=texts)
        yield stream.moving(f"{LOG}/{name}", log.times[rows], columns)
    for limit in _LIMITS:
        if (log.forces.person_force >= 0.5 * limit).any():
            path = f"{root}/allowed_{limit:g}"
            yield from panels.levels(log, path, (limit,), colours.LIMIT)


def balls(log: EpisodeLog) -> Iterator[Chunk]:
    """Return a ball above the hand during a disturbance, with its name and strength."""
    rows = stream.frames(log)
    for name, (strength, acts) in disturbances(log).items():
        path = f"{motion.ROOT}/outside/{name}"
        values = strength[rows][acts[rows]]
        labels = [f"{name} {value:.0f} {KINDS[name].unit}" for value in values]
        radii = _BALL * np.sqrt(values)
        look = rr.Points3D.from_fields(colors=colours.OUTSIDE, show_labels=True)
        yield stream.static(path, look)
        yield motion.ball(path, log, acts, _ABOVE, radii=radii, labels=labels)
