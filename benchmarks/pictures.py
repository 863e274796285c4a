"""Pictures and films for the documents; what they show is in pictures.toml.

MUJOCO_GL=egl python benchmarks/pictures.py {gallery,films,doors}

``gallery`` opens doors with the oracle, which knows the door, and draws them during the
opening, side by side. The animation shows `gp`, which learned from three other doors of
that kind.

``films`` shows `gp` in every trial: an episode of the protocol's first seed, from its
log, at twice the speed. Blue lines are the demonstrations, the red line is the path of
the hand, and a ball at the hand marks an external force.

``doors`` films two policies at every door of ``gplfd list``, and writes the table of
these episodes into the gallery page.

Without a screen MUJOCO_GL must be set before Python starts.
"""

import contextlib
import itertools
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import gymnasium as gym
import mujoco
import numpy as np
import tyro
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from gplfd_env import ENVIRONMENT_IDS
from gplfd_env.doors.config import DOORS
from gplfd_env.envs.camera import Camera
from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.episodes.build import demonstrations_of, make_environment
from gplfd_experiments.episodes.failures import why_closed
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.task import EpisodeTask, episode_task, named_doors
from gplfd_experiments.recording.video import VideoFormat, write_video
from gplfd_experiments.studies.jobs import episode_log
from gplfd_experiments.studies.trials.plan import named_trials, trial_tasks
from gplfd_experiments.studies.trials.protocol import TRIALS
from gplfd_policies import Demonstration, make_agent
from gplfd_policies.agents.agent import Agent, as_agent
from gplfd_policies.agents.model_based.oracle import OracleAgent
from gplfd_policies.arrays.storage import complete_or_absent

Picture = NDArray[np.uint8]
Points = NDArray[np.float64]

_SHOWN: Final = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
_PAUSE: Final = 1000
"""Duration of the last frame of an animation [ms]."""


def write_gif(
    path: Path, frames: Sequence[Image.Image], period: float, colours: int
) -> None:
    """Write frames of a period [s] as an animation with few colours."""
    # The last frame is included, because an open door is lit differently.
    chosen = [*frames[:: max(1, len(frames) // 4)], frames[-1]]
    several = np.hstack([np.asarray(frame) for frame in chosen])
    # Median cut alone gives large areas of similar colour, such as walls, few shades,
    # which is visible as blotches.
    palette = Image.fromarray(several).quantize(colours, kmeans=4)
    images = [
        frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames
    ]
    lasting = [round(1000.0 * period)] * (len(images) - 1) + [_PAUSE]
    look: dict[str, Any] = {"format": "GIF", "duration": lasting, "loop": 0}
    with complete_or_absent(path) as temporary:
        images[0].save(temporary, save_all=True, append_images=images[1:], **look)


# --- Gallery -----------------------------------------------------------------

_COLUMNS, _FRAME, _SHADES = 3, 12, 256
"""Columns of the gallery; control periods per frame and colours of an animation."""
_MOVING: Final = {"opening.gif": "room-834", "folding.gif": "bifold-closet"}
"""The doors of the animations."""


def opening(
    env: gym.Env[Any, Any], agent: Agent, width: int
) -> Iterator[tuple[dict[str, Any], Camera]]:
    """Let an agent open a door; yield the state after every period, and a camera.

    The camera "overview" draws twice as many pixels in each direction, see `drawn`.
    Raises RuntimeError if the door was not opened.
    """
    inner: Any = env.unwrapped
    observation, info = env.reset(seed=0)
    agent.inform(inner.door_geometry)
    agent.reset(observation)
    size = 2 * width, 3 * width // 2
    with contextlib.closing(
        Camera(inner.model, *size, "overview", effects=True)
    ) as camera:
        ended = False
        while not ended:
            yield info, camera
            step = agent.act(observation)
            observation, _, terminated, truncated, info = env.step(step.action)
            ended = terminated or truncated
        yield info, camera
    if not info["success"]:
        raise RuntimeError(f"{inner.door}: {info['failure'] or 'not opened'}")


def drawn(env: gym.Env[Any, Any], camera: Camera) -> Picture:
    """Return the picture of a camera of `opening` for pictures (3/4 width, width)."""
    data = env.unwrapped.data  # type: ignore[attr-defined]
    return np.asarray(Image.fromarray(camera.picture("rgb_array", data)).reduce(2))


def pictured(scene: Mapping[str, Any], width: int) -> Picture:
    """Open a door and return a 4:3 picture (H, W, 3) at the scene's angle."""
    env = gym.make(ENVIRONMENT_IDS["pose"], door=scene["door"], base=scene["base"])
    with contextlib.closing(opening(env, as_agent(OracleAgent()), width)) as states:
        for info, camera in states:
            if np.degrees(info["door_angle"]) >= scene["angle"]:
                return drawn(env, camera)
    raise RuntimeError(f"{scene['title']}: not opened so far")


def film_opening(path: Path, door: str, width: int) -> None:
    """Let `gp` open a door that was not demonstrated, and write a GIF of it."""
    shown = Teacher().standard_demonstrations(seed=0, like=DOORS[door])
    env = gym.make(ENVIRONMENT_IDS["pose"], door=door, base="mobile")
    states = enumerate(opening(env, make_agent("gp", shown), width))
    frames = [
        Image.fromarray(drawn(env, camera))
        for number, (info, camera) in states
        if number % _FRAME == 0 or info["success"]
    ]
    inner: Any = env.unwrapped
    write_gif(path, frames, _FRAME * inner.dt, _SHADES)


def side_by_side(pictures: Mapping[str, Picture], columns: int) -> Figure:
    """Return a figure of pictures of equal size, unscaled, with their titles."""
    height, width, _ = next(iter(pictures.values())).shape
    title, rows = 26, -(-len(pictures) // columns)
    whole = rows * (height + title)
    figure = Figure(figsize=(columns * width / 100.0, whole / 100.0), dpi=100)
    for number, (name, picture) in enumerate(pictures.items()):
        row, column = divmod(number, columns)
        bottom = 1.0 - (row * (height + title) + height) / whole
        panel = figure.add_axes((column / columns, bottom, 1 / columns, height / whole))
        panel.imshow(picture, interpolation="none")
        panel.axis("off")
        place = (column + 0.5) / columns, bottom - 0.5 * title / whole
        figure.text(*place, name, ha="center", va="center", fontsize=10)
    return figure


def gallery(out: Path = Path("docs/images/gallery.png"), width: int = 400) -> None:
    """Draw the gallery, and the animations in the same folder; takes two minutes.

    Args:
        out: File of the gallery.
        width: Width of a picture [px].
    """
    pictures = {scene["title"]: pictured(scene, width) for scene in _SHOWN["gallery"]}
    figure = side_by_side(pictures, _COLUMNS)
    with complete_or_absent(out) as temporary:
        figure.savefig(temporary, format="png", metadata={"Software": None})
    for name, door in _MOVING.items():
        film_opening(out.parent / name, door, width)


# --- Films of the trials -----------------------------------------------------

_NAMES: Final = {
    "force_radial": "across",
    "force_tangential": "along",
    "person_force": "on the person",
    "push_force": "push",
    "stop_force": "on the stop",
}
"""Names of the arrays of a log that films show."""
_EVERY, _PERIOD, _LONGEST = 0.2, 0.1, 9.4
"""Simulated and displayed time of a frame, and the longest simulated time [s]."""
_COLOURS: Final = 128
_BAR: Final = 20
"""Height of a line of text [px]."""
_INK, _PAPER = (30, 32, 38), (244, 244, 240)
_BLUE, _RED = (0.15, 0.35, 0.85, 1.0), (0.90, 0.10, 0.10, 1.0)
_OUTSIDE: Final = (0.98, 0.60, 0.05, 1.0)
_ABOVE: Final = np.array([0.0, 0.0, 1.6])
"""Height of lines above the hand, so that nothing hides them [m]."""
_BALL: Final = 0.012
"""Radius of the ball at 1 N; it grows with the root of the force [m]."""


def task_of(name: str) -> EpisodeTask:
    """Return the episode of `gp` that is shown for a trial."""
    film = _SHOWN["films"][name]
    (task,) = (
        task
        for task in trial_tasks(named_trials((name,)), part="small")
        if (task.policy, task.seed) == ("gp", 0)
        and (task.door, task.level) == (film["door"], film["level"])
    )
    return task


def model_of(task: EpisodeTask) -> mujoco.MjModel:
    """Return the model of the scene of a task's episode."""
    with contextlib.closing(make_environment(task, "pose")) as env:
        env.reset(seed=task.reset_seed)
        return env.unwrapped.model  # type: ignore[attr-defined]


def film_frames(
    log: EpisodeLog,
    model: mujoco.MjModel,
    demonstrations: Sequence[Demonstration],
    size: tuple[int, int],
) -> Iterator[tuple[int, Picture]]:
    """Yield rows of a log and pictures (H, W, 3) of the scene at these rows."""
    data = mujoco.MjData(model)
    model.vis.global_.fovy = 1.0
    last = min(log.times.size - 1, round(_LONGEST / log.dt))
    rows = [*range(0, last, round(_EVERY / log.dt)), last]
    width, height = size
    with mujoco.Renderer(model, height, width) as renderer:
        for row in rows:
            data.qpos[:] = log.motion.qpos[row]
            mujoco.mj_forward(model, data)
            site = data.site("task_frame")
            axes, origin = site.xmat.reshape(3, 3), site.xpos
            # A top view without perspective, the robot below the door.
            camera = mujoco.MjvCamera()
            camera.orthographic = 1
            camera.azimuth = np.degrees(np.arctan2(-axes[1, 0], -axes[0, 0]))
            camera.elevation, camera.distance = -89.9, 3.0
            camera.lookat[:] = origin + axes @ np.array([0.36, 0.0, -0.22])
            renderer.update_scene(data, camera)
            scene = renderer.scene
            # Shadows on vertical walls would be speckled.
            scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = False
            # Paths and forces, above everything in the scene.
            above = origin + _ABOVE
            for shown in demonstrations:
                _line(scene, above + shown.poses[::10, :3] @ axes.T, _BLUE, 0.007)
            path = log.motion.ee_pose[: row + 1, :3] @ axes.T
            _line(scene, above + path[::5], _RED, 0.016)
            names = ("push_force", "person_force", "stop_force")
            force = max(getattr(log.forces, name)[row] for name in names)
            if force > 0.0:
                ball = _next_geom(scene, mujoco.mjtGeom.mjGEOM_SPHERE, _OUTSIDE)
                ball.size[:], ball.pos[:] = _BALL * np.sqrt(force), above + path[-1]
            yield row, renderer.render()


def _line(
    scene: mujoco.MjvScene, points: Points, colour: tuple[float, ...], width: float
) -> None:
    """Draw a line of a width [m] through points in world coordinates [m]."""
    kind = mujoco.mjtGeom.mjGEOM_CAPSULE
    for start, end in itertools.pairwise(points):
        geom = _next_geom(scene, kind, colour)
        mujoco.mjv_connector(geom, kind, 0.5 * width, start, end)


def _next_geom(
    scene: mujoco.MjvScene, kind: mujoco.mjtGeom, colour: tuple[float, ...]
) -> mujoco.MjvGeom:
    """Add a self-luminous shape to a scene."""
    geom = scene.geoms[scene.ngeom]
    place, turn = np.zeros(3), np.eye(3).ravel()
    rgba = np.array(colour, dtype=np.float32)
    mujoco.mjv_initGeom(geom, kind, np.ones(3), place, turn, rgba)
    geom.emission = 0.3
    scene.ngeom += 1
    return geom


def film_trial(path: Path, name: str, size: tuple[int, int]) -> None:
    """Write the film of a trial, with a line of text above and one below."""
    task, film = task_of(name), _SHOWN["films"][name]
    log, demonstrations = episode_log(task), demonstrations_of(task).demonstrations
    curve = np.abs(getattr(log.forces, film["curve"]))
    angle, force = np.degrees(log.opening.door_angle), _NAMES[film["curve"]]
    width, height = size
    pages = []
    for row, picture in film_frames(log, model_of(task), demonstrations, size):
        page = Image.new("RGB", (width, height + 2 * _BAR), _PAPER)
        page.paste(Image.fromarray(picture), (0, _BAR))
        draw, font = ImageDraw.Draw(page), ImageFont.load_default(13)
        draw.text((6, 2), f"{name}: {film['text']}", _INK, font)
        below = (
            f"{angle[row]:3.0f}°  {curve[row]:3.0f} N {force}, so far at most "
            f"{curve[: row + 1].max():.0f} N"
        )
        draw.text((6, height + _BAR + 2), below, _INK, font)
        pages.append(page)
    write_gif(path, pages, _PERIOD, _COLOURS)


def films(
    out: Path = Path("docs/images/films"),
    trials: tuple[str, ...] = tuple(TRIALS),
    size: tuple[int, int] = (320, 240),
) -> None:
    """Film the trials; takes a minute.

    Args:
        out: Folder of the films, one <trial>.gif each.
        trials: Trials to film.
        size: Width and height of the scene in a picture [px].
    """
    out.mkdir(parents=True, exist_ok=True)
    for name in trials:
        film_trial(out / f"{name}.gif", name, size)


# --- Every door --------------------------------------------------------------

_COMPARED: Final = ("gp", "gp-paper")
_FORMAT: Final = VideoFormat(
    size=(256, 192),
    rate=10,
    last=0.0,
    encoding=("-crf", "31", "-preset", "veryslow", "-movflags", "+faststart"),
)
"""Format of the videos: about 10 kB each."""
_MARKS: Final = "<!-- every door: begin -->\n", "<!-- every door: end -->\n"
"""Lines of the page around the table."""


def doors(page: Path = Path("docs/gallery.md")) -> None:
    """Film every door and write the table of a page; takes some minutes.

    Args:
        page: Page with the table; the videos are in ``episodes`` beside it.
    """
    folder = page.parent / "episodes"
    folder.mkdir(exist_ok=True)
    rows = [f"| door | {' | '.join(f'`{name}`' for name in _COMPARED)} |"]
    rows.append("|---" * (len(_COMPARED) + 1) + "|")
    for door, config in named_doors(tuple(DOORS)).items():
        cells = [door]
        for policy in _COMPARED:
            task = episode_task(door, config, policy=policy, seed=0)
            log = episode_log(task)
            name = f"{door}-{policy}.mp4"
            write_video(folder / name, log, model_of(task), _FORMAT)
            outcome = why_closed(log.failure, log.reason) or "opened"
            peak = np.abs(log.forces.force_radial).max()
            angle = round(np.degrees(log.opening.door_angle[-1]))
            text = f"{outcome}, {angle}° in {log.times[-1]:.1f} s, {peak:.0f} N"
            cells.append(f"[{text}](episodes/{name})")
        rows.append(f"| {' | '.join(cells)} |")
    before, _, rest = page.read_text().partition(_MARKS[0])
    _, end, after = rest.partition(_MARKS[1])
    table = "\n".join(["", *rows, "", ""])
    page.write_text(f"{before}{_MARKS[0]}{table}{end}{after}")


if __name__ == "__main__":
    tyro.extras.subcommand_cli_from_dict(
        {"gallery": gallery, "films": films, "doors": doors}
    )
