"""Images and videos for the documents; what they show is in pictures.toml.

MUJOCO_GL=egl python benchmarks/pictures.py COMMAND, each of which draws some of them:
{gallery,films,recordings,readme,learners,insistence,figures}. What an image shows is in
docs/images/made-from.json, so that a test finds those that are older. Without a screen
MUJOCO_GL must be set before Python starts.
"""

import contextlib
import hashlib
import io
import itertools
import json
import shutil
import subprocess
import tempfile
import time
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import leaderboard
import matplotlib.pyplot as plt
import mujoco
import numpy as np
import tyro
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from rerun.experimental import ViewerClient

from gplfd_env.doors.config import door_config
from gplfd_experiments.analysis.figures import style
from gplfd_experiments.data.importing import PICTURE, import_recordings
from gplfd_experiments.data.settings import ImportSettings
from gplfd_experiments.episodes.build import demonstrations_of, model_of
from gplfd_experiments.episodes.task import EpisodeTask, episode_task
from gplfd_experiments.files.plain_data import read_json, write_json
from gplfd_experiments.files.provenance import content_hash
from gplfd_experiments.recording.episode import record_episode
from gplfd_experiments.recording.video import episode_images
from gplfd_experiments.recording.viewer import viewer
from gplfd_experiments.studies.jobs import episode_log
from gplfd_experiments.studies.trials.protocol import (
    FIRST_SEED,
    TRACKS,
    TRIALS,
    named_trials,
    trial_tasks,
)
from gplfd_experiments.workflows.figures import draw_figures
from gplfd_policies.arrays.storage import complete_or_absent

_SHOWN: Final = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))
_ROOT: Final = Path(__file__).parents[1]
_IMAGES: Final = _ROOT / "docs/images"
_MADE_FROM: Final = _IMAGES / "made-from.json"
_PAUSE: Final = 1000  # Duration of the last frame of an animation [ms].


def episode_of(scene: Mapping[str, Any]) -> EpisodeTask:
    """Return the episode that a scene of pictures.toml describes."""
    fields = {"policy": "oracle", "seed": 0} | dict(scene)
    title, door = fields.pop("title"), door_config(fields.pop("door"))
    drawn = ("angle", "curve")
    return episode_task(title, door, **{n: fields[n] for n in fields if n not in drawn})


def made_from() -> dict[str, str]:
    """Return a hash of what every image shows, by its path in docs/images.

    It is of episodes, of what their policies did in the protocol, of texts and of the
    files that pictures.toml names.
    """
    trials = read_json(leaderboard.STORED)["trials"]
    shown = {"learners-doors.svg": ((), [trials[t] for t in TRACKS["learner"].trials])}
    levels = [level for trial in trials.values() for level in trial.values()]
    for name, scenes in _SHOWN["scenes"].items():
        shown[name] = [*map(episode_of, scenes)], scenes
    for name, film in _SHOWN["films"].items():
        shown[f"films/{name}.gif"] = [task_of(name)], film
    hashes = {}
    for name in {*shown, *_SHOWN["files"]}:
        tasks, scenes = shown.get(name, ((), ()))
        did = [level.get(task.policy) for task in tasks for level in levels]
        read = [content_hash(_ROOT / file) for file in _SHOWN["files"].get(name, ())]
        text = json.dumps([[task.key for task in tasks], scenes, did, read])
        hashes[name] = hashlib.sha256(text.encode()).hexdigest()[:16]
    return hashes


@contextlib.contextmanager
def made(name: str) -> Iterator[Path]:
    """Give the path of an image that is written, and store what it was made from."""
    with complete_or_absent(_IMAGES / name) as temporary:
        yield temporary
    stored = read_json(_MADE_FROM) | {name: made_from()[name]}
    write_json(_MADE_FROM, dict(sorted(stored.items())))


def write_gif(
    path: Path, frames: Sequence[Image.Image], period: float, colours: int
) -> None:
    """Write frames of a period [s] as an animation with few colours."""
    # The last frame is included, because an open door is lit differently.
    chosen = [*frames[:: max(1, len(frames) // 4)], frames[-1]]
    # Median cut alone gives large areas of similar colour, such as walls, few shades,
    # which is visible as blotches.
    palette = Image.fromarray(np.hstack(chosen)).quantize(colours, kmeans=4)
    images = [
        frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames
    ]
    lasting = [round(1000.0 * period)] * (len(images) - 1) + [_PAUSE]
    look: dict[str, Any] = {"format": "GIF", "duration": lasting, "loop": 0}
    images[0].save(path, save_all=True, append_images=images[1:], **look)


# --- Gallery -----------------------------------------------------------------

_COLUMNS, _FRAME, _SHADES = 3, 12, 256
"""Columns of the gallery; control periods per frame and colours of an animation."""
_BAR: Final = 20  # Height of a line of text [px].
_INK, _PAPER = (30, 32, 38), (244, 244, 240)


def pictured(scene: Mapping[str, Any], width: int) -> Image.Image:
    """Open a door and return an image of it at the scene's angle."""
    log = episode_log(task := episode_of(scene))
    reached = np.degrees(log.opening.door_angle) >= scene["angle"]
    row = int(reached.argmax())
    return next(episode_images(log, model_of(task), [row], width, effects=True))


def lettered(image: Image.Image, above: str, below: str = "") -> Image.Image:
    """Return an image with a line of text above and one below."""
    page = Image.new("RGB", (image.width, image.height + 2 * _BAR), _PAPER)
    page.paste(image, (0, _BAR))
    draw, font = ImageDraw.Draw(page), ImageFont.load_default(13)
    draw.text((6, 2), above, _INK, font)
    draw.text((6, image.height + _BAR + 2), below, _INK, font)
    return page


def gallery() -> None:
    """Draw doors that the oracle opens, and animations of `gp`; takes two minutes.

    `gp` learned from three other doors of that kind.
    """
    width, shown = 400, _SHOWN["scenes"]
    images = [lettered(pictured(s, width), s["title"]) for s in shown["gallery.png"]]
    firsts = range(0, len(images), _COLUMNS)
    rows = [np.hstack(images[n : n + _COLUMNS]) for n in firsts]
    with made("gallery.png") as path:
        Image.fromarray(np.vstack(rows)).save(path, format="PNG")
    with made("scene.png") as path:
        pictured(*shown["scene.png"], 640).save(path, format="PNG")
    for name in ("opening.gif", "folding.gif"):
        log = episode_log(task := episode_of(*shown[name]))
        last = log.times.size - 1
        rows = [*range(0, last, _FRAME), last]
        frames = episode_images(log, model_of(task), rows, width, effects=True)
        with made(name) as path:
            write_gif(path, [*frames], _FRAME * log.dt, _SHADES)


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
_BLUE, _RED = (0.15, 0.35, 0.85, 1.0), (0.90, 0.10, 0.10, 1.0)
_OUTSIDE: Final = (0.98, 0.60, 0.05, 1.0)
# Height of lines above the hand, so that nothing hides them [m].
_ABOVE: Final = np.array([0.0, 0.0, 1.6])
_BALL: Final = 0.012  # Radius at 1 N [m]; it grows with the root of the force.


def task_of(name: str) -> EpisodeTask:
    """Return the episode of `gp` that is shown for a trial."""
    film = _SHOWN["films"][name]
    wanted = "gp", FIRST_SEED, film["door"], film["level"]
    for task in trial_tasks(named_trials((name,)), part="small"):
        if (task.policy, task.seed, task.door, task.level) == wanted:
            return task
    raise ValueError(f"{name} has no such episode of gp: {wanted}")


def film_trial(path: Path, name: str, size: tuple[int, int]) -> None:
    """Write the film of a trial, with a line of text above and one below.

    Blue lines are the demonstrations, the red line is the path of the hand, and a ball
    at the hand marks an external force.
    """
    task, film = task_of(name), _SHOWN["films"][name]
    log, demonstrations = episode_log(task), demonstrations_of(task).demonstrations
    curve = np.abs(getattr(log.forces, film["curve"]))
    model, angle = model_of(task), np.degrees(log.opening.door_angle)
    data = mujoco.MjData(model)
    model.vis.global_.fovy = 1.0
    last = min(log.times.size - 1, round(_LONGEST / log.dt))
    rows = [*range(0, last, round(_EVERY / log.dt)), last]
    pages, (width, height) = [], size
    with mujoco.Renderer(model, height, width) as renderer:
        scene, capsule = renderer.scene, mujoco.mjtGeom.mjGEOM_CAPSULE

        def added(kind: mujoco.mjtGeom, colour: tuple[float, ...]) -> mujoco.MjvGeom:
            """Add a self-luminous shape to the scene."""
            geom = scene.geoms[scene.ngeom]
            place, turn = np.zeros(3), np.eye(3).ravel()
            rgba = np.array(colour, dtype=np.float32)
            mujoco.mjv_initGeom(geom, kind, np.ones(3), place, turn, rgba)
            geom.emission = 0.3
            scene.ngeom += 1
            return geom

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
            # Shadows on vertical walls would be speckled.
            scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = False
            # Paths and forces, above everything in the scene.
            above = origin + _ABOVE
            path_so_far = above + log.motion.ee_pose[: row + 1, :3] @ axes.T
            lines = [
                (above + demonstration.poses[::10, :3] @ axes.T, _BLUE, 0.007)
                for demonstration in demonstrations
            ]
            for points, colour, thickness in [*lines, (path_so_far[::5], _RED, 0.016)]:
                for ends in itertools.pairwise(points):
                    shape = added(capsule, colour)
                    mujoco.mjv_connector(shape, capsule, 0.5 * thickness, *ends)
            kinds = ("push_force", "person_force", "stop_force")
            force = max(getattr(log.forces, kind)[row] for kind in kinds)
            if force > 0.0:
                ball = added(mujoco.mjtGeom.mjGEOM_SPHERE, _OUTSIDE)
                ball.size[:], ball.pos[:] = _BALL * np.sqrt(force), path_so_far[-1]
            below = (
                f"{angle[row]:3.0f}°  {curve[row]:3.0f} N {_NAMES[film['curve']]}, so "
                f"far at most {curve[: row + 1].max():.0f} N"
            )
            image = Image.fromarray(renderer.render())
            pages.append(lettered(image, f"{name}: {film['text']}", below))
    write_gif(path, pages, _PERIOD, colours=128)


def films(trials: tuple[str, ...] = tuple(TRIALS)) -> None:
    """Film some trials, or all; takes a minute."""
    for name in trials:
        with made(f"films/{name}.gif") as path:
            film_trial(path, name, (320, 240))


# --- Recordings ---------------------------------------------------------------


def recordings() -> None:
    """Draw recordings of `gp` at the medium door in Rerun, which needs Vulkan."""
    options = ["--headless", "--bind", "127.0.0.1", "--port", "9871", "--window-size"]
    options += ["1400x864", "--hide-welcome-screen"]
    for name, left in (("recording.png", 0), ("expected_force.png", 764)):
        task = episode_of(*_SHOWN["scenes"][name])
        demonstrations = demonstrations_of(task).demonstrations
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "recording.rrd")
            record_episode(path, episode_log(task), model_of(task), demonstrations)
            command = [viewer(), *options, str(path)]
            with subprocess.Popen(command, stderr=subprocess.DEVNULL) as process:
                try:
                    time.sleep(10.0)  # It starts and loads; its messages fade out.
                    client = ViewerClient.connect("rerun+http://127.0.0.1:9871/proxy")
                    client.set_time("sim_time", duration=3.3, play_state="paused")
                    client.take_screenshot()  # still of the time before
                    image = Image.open(io.BytesIO(client.take_screenshot()))
                finally:
                    process.terminate()
        with made(name) as path:
            image = image.crop((left, 0, *image.size)).convert("RGB").quantize(256)
            image.save(path, format="PNG")


def figures() -> None:
    """Draw figures of the method, and recordings of a person before and after."""
    files = [_ROOT / file for file in _SHOWN["files"]["recordings.png"]]
    drawn = {"recordings.png": f"set/{PICTURE}"}
    drawn |= {f"{name}.png": f"{name}.png" for name in ("fig09", "fig10")}
    with tempfile.TemporaryDirectory() as folder:
        settings = ImportSettings(recorded_rate=20.0)
        import_recordings(files, Path(folder, "set"), settings)
        draw_figures(Path(folder), ("fig09", "fig10"), seed=0, options={})
        for name, file in drawn.items():
            with made(name) as path:
                shutil.copyfile(Path(folder, file), path)


# --- README --------------------------------------------------------------------

_PART, _CURVE = 400, 100  # Width of a part, and height of 100 N below it [px].
_CURVED: Final = (180, 40, 30)


def part(scene: Mapping[str, Any], times: NDArray[np.float64]) -> list[Image.Image]:
    """Return images of an episode at some times, with its force so far below each."""
    log = episode_log(task := episode_of(scene))
    force = np.abs(getattr(log.forces, scene["curve"]))
    rows = np.clip(np.searchsorted(log.times, times), 0, log.times.size - 1)
    scale = [_PART / times[-1], -_CURVE / 100.0]
    height, pages = 3 * _PART // 4, []
    points = np.column_stack([log.times, force]) * scale + [0.0, height + _CURVE - 4]
    images = episode_images(log, model_of(task), rows, _PART, effects=True)
    for row, image in zip(rows, images, strict=True):
        page = Image.new("RGB", (_PART, height + _CURVE), _PAPER)
        page.paste(image, (0, 0))
        draw, font = ImageDraw.Draw(page), ImageFont.load_default(17)
        draw.text((6, height + 4), scene["title"], _INK, font)
        below = f"{force[row]:.0f} N {_NAMES[scene['curve']]}"
        draw.text((6, height + 26), below, _CURVED, font)
        draw.line([*map(tuple, points[: row + 1 : 5])], _CURVED, 3)
        pages.append(page)
    return pages


def readme() -> None:
    """Draw quartet.gif, four episodes side by side; takes two minutes."""
    times = np.arange(0.0, _LONGEST, 1.5 * _EVERY)
    parts = [part(scene, times) for scene in _SHOWN["scenes"]["quartet.gif"]]
    frames = [
        Image.fromarray(np.vstack([np.hstack(images[:2]), np.hstack(images[2:])]))
        for images in zip(*parts, strict=True)
    ]
    with made("quartet.gif") as path:
        write_gif(path, frames, 1.5 * _PERIOD, colours=128)


def learners() -> None:
    """Draw learners-doors.svg: the track of learners, with 95 % intervals."""
    plt.rcParams["svg.hashsalt"] = "gplfd"  # the same names in every drawing
    figure, axes = plt.subplots(1, 2, figsize=(8.0, 3.6), sharey=True)
    trials = TRACKS["learner"].trials
    answers = leaderboard.answers_of([leaderboard.STORED])
    policies = leaderboard.ranked(answers, trials)[::-1]
    titles = {"success": "doors opened [%]", "force_radial_20ms": "force across [N]"}
    for axis, (measure, title) in zip(axes, titles.items(), strict=True):
        values = [leaderboard.by_seed(answers, trials, p, measure) for p in policies]
        shifts = [leaderboard.typical(of, measure) for of in values]
        means = np.array([shift.estimate for shift in shifts])
        ends = np.array([[s.low for s in shifts], [s.high for s in shifts]])
        axis.barh(policies, means, xerr=np.abs(ends - means), ecolor="black")
        axis.set_xlabel(title)
    with made("learners-doors.svg") as path:
        figure.savefig(path, format="svg", bbox_inches="tight", metadata={"Date": None})


@style.paper_style()
def insistence() -> None:
    """Draw insistence.svg: what pulling harder or longer at closed doors trades."""
    rows = read_json(_ROOT / "docs/results/insistence.json")["rows"]
    shown, of_gp = _SHOWN["insistence"], _SHOWN["insistence"]["gp"]
    figure, axes = plt.subplots(4, 2, sharex="col", sharey="row", layout="constrained")
    figure.set_size_inches(style.PAGE, 5.0)
    for column, varied, other in zip(axes.T, of_gp, reversed(of_gp), strict=True):
        for axis, measure in zip(column, shown["measured"], strict=True):
            axis.axvline(of_gp[varied], color=style.LIMIT, linestyle="--")
            for row in (row for row in rows if row[other] == of_gp[other]):
                dots = [np.mean(row[measure])] if measure == "opened" else row[measure]
                look = {"color": style.ADAPTED, "clip_on": False, "alpha": 0.6}
                axis.plot([row[varied]] * len(dots), dots, ".", **look)
            axis.set(xlabel=shown["varied"][varied], ylabel=shown["measured"][measure])
            axis.label_outer()
    for axis in axes[:, 0]:
        axis.set_ylim(0.0)
    with made("insistence.svg") as path:
        figure.savefig(path, format="svg", metadata={"Date": None})


if __name__ == "__main__":
    commands = (gallery, films, recordings, readme, learners, insistence, figures)
    tyro.extras.subcommand_cli_from_dict({made.__name__: made for made in commands})
