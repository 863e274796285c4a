"""Disturbances: strength, beginning and end.

The log has the magnitude of a force, but not its direction. A ball above the hand, with
an area proportional to the force, and its label show the disturbance. Undisturbed
episodes have neither.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Final, NamedTuple

import numpy as np
import rerun as rr
from numpy.typing import NDArray
from rerun.chunk import Chunk

from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.recording import colours, motion, panels
from gplfd_experiments.recording.stream import frames, moving, static

LOG: Final = "/outside/log"
"""Entity of the text about beginnings and ends."""
PANEL: Final = "outside"
"""Entity of the time series, below `gplfd_experiments.recording.panels.ROOT`."""

# Quasi-static and transient force on a hand allowed by ISO/TS 15066 [N].
_LIMITS: Final = (140.0, 280.0)
# Position of the ball above the hand and the ball of the stiffness, task frame [m].
_ABOVE: Final = (0.0, 0.30, 0.0)
# Radius of the ball at 1 N [m]; it grows with the square root of the force.
_BALL: Final = 0.008


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


def kinds_of(log: EpisodeLog) -> tuple[str, ...]:
    """Return the names of the disturbances in an episode."""
    return tuple(name for name, kind in KINDS.items() if kind.acts(log).any())


def disturbance_chunks(log: EpisodeLog) -> Iterator[Chunk]:
    """Return balls, curves, limits and texts of the disturbances in an episode."""
    yield from balls(log)
    root = f"{panels.ROOT}/{PANEL}"
    for name in kinds_of(log):
        curve = {panels.Line(name, colours.OUTSIDE): KINDS[name].curve(log)}
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
    rows = frames(log)
    for name in kinds_of(log):
        kind, path = KINDS[name], f"{motion.ROOT}/outside/{name}"
        acts, values = kind.acts(log)[rows], kind.curve(log)[rows]
        columns = rr.Points3D.columns(
            positions=log.motion.ee_pose[rows[acts], :3] + _ABOVE,
            radii=_BALL * np.sqrt(values[acts]),
            labels=[f"{name} {value:.0f} {kind.unit}" for value in values[acts]],
        )
        look = rr.Points3D.from_fields(colors=colours.OUTSIDE, show_labels=True)
        yield static(path, look)
        yield moving(path, log.times[rows], columns.partition(acts.astype(int)))


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
