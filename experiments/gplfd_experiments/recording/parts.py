"""What only some episodes show: parts of the door, a mobile base, disturbances.

Handle, bolt and base are joints of the model, so their motion is in the log's
generalised positions. The existing parts follow from model and door alone, before the
episode. Of a disturbance the log has the magnitude of the force, but not its direction:
a ball above the hand, with an area proportional to the force, and its label show it.
"""

from collections.abc import Callable, Iterator, Mapping
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
from gplfd_experiments.recording import colours, motion, panels
from gplfd_experiments.recording.panels import Line
from gplfd_experiments.recording.scene import kinematics
from gplfd_experiments.recording.stream import frames, moving, static

LATCH: Final = f"{panels.STAGES}/latch"
"""Entity of the lane with the state of the bolt."""
ARM: Final = "/world/scene/closer_arm"
"""Entity of a closer's arm, in the world's axes."""
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
    """A kind of disturbance: texts, its strength (T,), and its unit."""

    begins: str
    ends: str
    curve: Callable[[EpisodeLog], FloatArray]
    unit: str = "N"

    def acts(self, log: EpisodeLog) -> NDArray[np.bool_]:
        """Whether it acts, (T,): a non-zero force, or an increasing displacement."""
        curve = self.curve(log)
        growth = np.diff(curve, prepend=0.0)
        acts: NDArray[np.bool_] = (growth if self.unit == "mm" else curve) > 0.0
        return acts


KINDS: Final[Mapping[str, Kind]] = {
    "push": Kind("a push begins", "the push ends", lambda log: log.forces.push_force),
    "person": Kind(
        *("contact with a person", "the person lets go"),
        lambda log: log.forces.person_force,
    ),
    "stop": Kind(
        *("the door meets a stop", "the stop is gone"),
        lambda log: log.forces.stop_force,
    ),
    "bump": Kind(
        *("the base moves", "the base stops"),
        lambda log: 1e3 * log.motion.base_shift,
        "mm",
    ),
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
            line: scale * _positions(log, model, joint)
            for joint, line, scale in _JOINTS.get(name, ())
        } or {Line("closing torque", colours.FORCE): log.forces.closer_torque}
        yield from panels.series(f"{panels.ROOT}/{name}/motion", log.times, curves)
    if "latch" in parts:
        states = [
            (float(log.times[row]), name) for row, name in bolt_states(log, model)
        ]
        yield from panels.lane(LATCH, _BOLT_STATES, states)
    # The tendon of a closer's arm, if it has a colour.
    arms = [i for i in range(model.ntendon) if model.tendon(i).name == CLOSER_ARM]
    for arm in (i for i in arms if model.tendon_rgba[i, 3] > 0.0):
        sites = [model.site(f"closer_{end}").id for end in ("spindle", "foot")]
        strips = [data.site_xpos[sites] for data in kinematics(model, log)]
        tint = (255.0 * model.tendon_rgba[arm]).round().astype(np.uint8)
        look = rr.LineStrips3D.from_fields(colors=tint, radii=model.tendon_width[arm])
        columns = rr.LineStrips3D.columns(strips=np.array(strips, np.float32))
        ones = np.ones(len(strips), int)
        yield static(ARM, look)
        yield moving(ARM, log.times[frames(log)], columns.partition(ones))


def bolt_states(log: EpisodeLog, model: mujoco.MjModel) -> list[tuple[int, str]]:
    """Return rows in which the state of the bolt changes, and the state.

    It is held back if it is retracted so far that the door can open.
    """
    throw = model.jnt_range[model.joint("bolt").id, 1]
    back = _positions(log, model, "bolt") >= throw - GAP
    rows = np.flatnonzero(np.diff(back, prepend=~back[:1])).tolist()
    names = [*_BOLT_STATES]
    return [(row, names[int(back[row])]) for row in rows]


def _positions(log: EpisodeLog, model: mujoco.MjModel, joint: str) -> FloatArray:
    """Positions of a joint, (T,) [m or rad]."""
    positions: FloatArray = log.motion.qpos[:, model.joint(joint).qposadr[0]]
    return positions


def kinds_of(log: EpisodeLog) -> tuple[str, ...]:
    """Return the names of the disturbances in an episode."""
    return tuple(name for name, kind in KINDS.items() if kind.acts(log).any())


def disturbance_chunks(log: EpisodeLog) -> Iterator[Chunk]:
    """Return balls, curves, limits and texts of the disturbances in an episode."""
    yield from balls(log)
    root = f"{panels.ROOT}/{PANEL}"
    for name in kinds_of(log):
        curve = {Line(name, colours.OUTSIDE): KINDS[name].curve(log)}
        yield from panels.series(f"{root}/{name}", log.times, curve)
        rows, texts = zip(*events(log, name), strict=True)
        columns = rr.TextLog.columns(text=texts)
        yield moving(f"{LOG}/{name}", log.times[list(rows)], columns)
    for limit in _LIMITS:
        if (log.forces.person_force >= 0.5 * limit).any():
            path = f"{root}/allowed_{limit:g}"
            yield from panels.levels(log, path, (limit,), colours.LIMIT)


def balls(log: EpisodeLog) -> Iterator[Chunk]:
    """Return a ball above the hand during a disturbance, with its name and strength."""
    for name in kinds_of(log):
        kind, path = KINDS[name], f"{motion.ROOT}/outside/{name}"
        acts, rows = kind.acts(log), frames(log)
        values = kind.curve(log)[rows][acts[rows]]
        labels = [f"{name} {value:.0f} {kind.unit}" for value in values]
        radii = _BALL * np.sqrt(values)
        look = rr.Points3D.from_fields(colors=colours.OUTSIDE, show_labels=True)
        yield static(path, look)
        yield motion.ball(path, log, acts, _ABOVE, radii=radii, labels=labels)


def events(log: EpisodeLog, name: str) -> list[tuple[int, str]]:
    """Rows in which a disturbance begins or ends, and the text."""
    kind = KINDS[name]
    edges = np.diff(kind.acts(log), prepend=False, append=False).nonzero()[0]
    texts = []
    for first, end in edges.reshape(-1, 2).tolist():
        texts.append((first, kind.begins))
        if end < log.times.size:
            most = kind.curve(log)[first:end].max()
            texts.append((end, f"{kind.ends}: {most:.0f} {kind.unit} at most"))
    return texts
