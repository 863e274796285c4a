"""A short film of `gp` in every trial: MUJOCO_GL=egl python benchmarks/films.py.

An episode of the protocol's first seed, from its log, twice as fast as it was. Blue
lines are the demonstrations that it learned from, the red one is the hand's way, and a
ball at the hand is what acts from outside. Without a screen MUJOCO_GL must be set
before Python starts.
"""

import itertools
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import mujoco
import numpy as np
import tyro
from gallery import Picture, write_gif
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from gplfd_experiments.episodes.build import demonstrations_of
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.task import EpisodeTask
from gplfd_experiments.studies.jobs import episode_logs
from gplfd_experiments.studies.trials.plan import named_trials, trial_tasks
from gplfd_experiments.studies.trials.protocol import TRIALS
from gplfd_experiments.workflows.study_recordings import model_of
from gplfd_policies import Demonstration

Points = NDArray[np.float64]
Colour = tuple[float, float, float, float]
"""Red, green, blue, opacity."""

_KIND: Final = mujoco.mjtGeom


class Shot(NamedTuple):
    """What of a trial is shown.

    Attributes:
        door: Its name in the protocol.
        level: Of the trial.
        said: In the picture, above.
        curve: Of the log, the number that is shown below [N].
    """

    door: str
    level: str
    said: str
    curve: str = "force_radial"


SHOTS: Final = {
    "radius": Shot("0.3", "beyond", "0.30 m; shown: 0.42, 0.50, 0.58 m"),
    "further": Shot("medium", "nothing else", "shown to 45°, opened to 60°"),
    "few": Shot("medium", "one per door", "one demonstration per door"),
    "messy": Shot("large", "messy", "messy demonstrations"),
    "rests": Shot("small", "rests", "demonstrations with long rests"),
    "turned": Shot("medium", "± 5°", "the robot stands askew"),
    "person": Shot(
        "medium", "holds the hand", "somebody holds the hand", "person_force"
    ),
    "push": Shot(
        "medium", "where they differ", "the hand is pushed for 0.3 s", "push_force"
    ),
    "stop": Shot("medium", "stop", "blocked for 2.5 s, then freed", "stop_force"),
    "locked": Shot("medium", "locked", "the door is locked", "stop_force"),
    "heavy": Shot("heavy", "24 N", "24 N at the handle", "force_tangential"),
    "breakaway": Shot(
        "medium", "breakaway", "the hinge sticks at first", "force_tangential"
    ),
    "delay": Shot("medium", "30 ms", "commands 30 ms late"),
    "noise": Shot("medium", "× 4", "four-fold sensor noise"),
}
"""By the name of the trial."""

_NAMES: Final = {
    "force_radial": "across",
    "force_tangential": "along",
    "person_force": "on the person",
    "push_force": "push",
    "stop_force": "on the stop",
}
"""Of the curves, in a picture."""

_EVERY: Final = 0.2
"""Simulated time from one frame to the next [s]."""
_PERIOD: Final = 0.1
"""How long a frame is seen [s]."""
_LONGEST: Final = 9.4
"""Of an episode that is shown [s]."""
_COLOURS: Final = 128
_BAR: Final = 20
"""Height of a line of text [px]."""
_INK, _PAPER = (30, 32, 38), (244, 244, 240)

_SHOWN: Final = (0.15, 0.35, 0.85, 1.0)
_HAND: Final = (0.90, 0.10, 0.10, 1.0)
_OUTSIDE: Final = (0.98, 0.60, 0.05, 1.0)
_ABOVE: Final = np.array([0.0, 0.0, 1.6])
"""How far above the hand lines are drawn, so that nothing hides them [m]."""
_BALL: Final = 0.012
"""Its radius at 1 N, which grows with the root of the force [m]."""


def task_of(name: str) -> EpisodeTask:
    """Return the episode of `gp` that is shown of a trial."""
    shot = SHOTS[name]
    (task,) = (
        task
        for task in trial_tasks(named_trials((name,)), part="small")
        if (task.policy, task.seed) == ("gp", 0)
        and (task.door, task.level) == (shot.door, shot.level)
    )
    return task


def frames(
    log: EpisodeLog,
    model: mujoco.MjModel,
    demonstrations: Sequence[Demonstration],
    size: tuple[int, int],
) -> Iterator[tuple[int, Picture]]:
    """Yield rows of a log and the pictures (H, W, 3) of the scene in them."""
    data = mujoco.MjData(model)
    model.vis.global_.fovy = 1.0
    last = min(log.times.size - 1, round(_LONGEST / log.dt))
    rows = [*range(0, last, round(_EVERY / log.dt)), last]
    width, height = size
    with mujoco.Renderer(model, height, width) as renderer:
        for row in rows:
            data.qpos[:] = log.qpos[row]
            mujoco.mj_forward(model, data)
            site = data.site("task_frame")
            axes, origin = site.xmat.reshape(3, 3), site.xpos
            renderer.update_scene(data, _camera(axes, origin))
            # Shadows on upright walls are speckled.
            renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = False
            _annotate(renderer.scene, log, row, demonstrations, (axes, origin))
            yield row, renderer.render()


def _annotate(
    scene: mujoco.MjvScene,
    log: EpisodeLog,
    row: int,
    demonstrations: Sequence[Demonstration],
    frame: tuple[Points, Points],
) -> None:
    """Add ways and forces to a scene, above everything in it.

    Args:
        scene: To add to.
        log: Of the episode.
        row: Of the log.
        demonstrations: What was learned from.
        frame: The task frame's axes (3, 3) and origin (3,) [m] in the world.
    """
    axes, origin = frame
    above = origin + _ABOVE
    for one in demonstrations:
        _line(scene, above + one.poses[::10, :3] @ axes.T, _SHOWN, 0.007)
    way = log.ee_pose[: row + 1, :3] @ axes.T
    _line(scene, above + way[::5], _HAND, 0.016)
    force = max(log.push_force[row], log.person_force[row], log.stop_force[row])
    _ball(scene, above + way[-1], _BALL * np.sqrt(force))


def _camera(axes: Points, origin: Points) -> mujoco.MjvCamera:
    """Return a plan: from above, without perspective, the robot below the door."""
    camera = mujoco.MjvCamera()
    camera.orthographic = 1
    into_door = -axes[:, 0]
    camera.azimuth = np.degrees(np.arctan2(into_door[1], into_door[0]))
    camera.elevation, camera.distance = -89.9, 3.0
    camera.lookat[:] = origin + axes @ np.array([0.36, 0.0, -0.22])
    return camera


def _line(scene: mujoco.MjvScene, points: Points, colour: Colour, width: float) -> None:
    """Draw a line of a width [m] through points of the world [m]."""
    for start, end in itertools.pairwise(points):
        geom = _next_geom(scene, _KIND.mjGEOM_CAPSULE, colour)
        mujoco.mjv_connector(geom, _KIND.mjGEOM_CAPSULE, 0.5 * width, start, end)


def _ball(scene: mujoco.MjvScene, centre: Points, radius: float) -> None:
    if radius > 0.0:
        geom = _next_geom(scene, _KIND.mjGEOM_SPHERE, _OUTSIDE)
        geom.size[:], geom.pos[:] = radius, centre


def _next_geom(
    scene: mujoco.MjvScene, kind: mujoco.mjtGeom, colour: Colour
) -> mujoco.MjvGeom:
    """Add a shape that shines by itself to a scene."""
    geom = scene.geoms[scene.ngeom]
    place, turn = np.zeros(3), np.eye(3).ravel()
    rgba = np.array(colour, dtype=np.float32)
    mujoco.mjv_initGeom(geom, kind, np.ones(3), place, turn, rgba)
    geom.emission = 0.3
    scene.ngeom += 1
    return geom


def subtitled(picture: Picture, above: str, below: str) -> Image.Image:
    """Return a picture with a line of text above and one below it."""
    height, width, _ = picture.shape
    page = Image.new("RGB", (width, height + 2 * _BAR), _PAPER)
    page.paste(Image.fromarray(picture), (0, _BAR))
    draw, font = ImageDraw.Draw(page), ImageFont.load_default(13)
    draw.text((6, 2), above, _INK, font)
    draw.text((6, height + _BAR + 2), below, _INK, font)
    return page


def film(path: Path, name: str, size: tuple[int, int]) -> None:
    """Write the film of a trial."""
    task, shot = task_of(name), SHOTS[name]
    (log,) = episode_logs([task])
    shown = demonstrations_of(task).demonstrations
    curve = np.abs(getattr(log, shot.curve))
    angle, force = np.degrees(log.door_angle), _NAMES[shot.curve]
    pages = [
        subtitled(
            picture,
            f"{name}: {shot.said}",
            f"{angle[row]:3.0f}°  {curve[row]:3.0f} N {force}, so far at most "
            f"{curve[: row + 1].max():.0f} N",
        )
        for row, picture in frames(log, model_of(task), shown, size)
    ]
    write_gif(path, pages, _PERIOD, _COLOURS)


def main(
    out: Path = Path("docs/images/films"),
    trials: tuple[str, ...] = tuple(TRIALS),
    size: tuple[int, int] = (320, 240),
) -> None:
    """Film the trials; a minute.

    Args:
        out: Folder of the films, one <trial>.gif each.
        trials: Which.
        size: Width and height of the scene in a picture [px].
    """
    out.mkdir(parents=True, exist_ok=True)
    for name in trials:
        film(out / f"{name}.gif", name, size)


if __name__ == "__main__":
    tyro.cli(main)
