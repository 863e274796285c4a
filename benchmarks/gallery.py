"""Doors side by side, and one that opens: MUJOCO_GL=egl python benchmarks/gallery.py.

Each is opened by the oracle, which is told the door, and pictured on the way; the
moving picture is of `gp`, which was shown three other doors of that kind. Without a
screen MUJOCO_GL must be set before Python starts.
"""

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import gymnasium as gym
import numpy as np
import tyro
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from gplfd_env import ENVIRONMENT_IDS
from gplfd_env.conventions.constants import Base
from gplfd_env.doors.config import DOORS, DoorSpec
from gplfd_env.envs.camera import Camera
from gplfd_experiments.data.teacher import Teacher
from gplfd_policies import make_agent
from gplfd_policies.agents.agent import Agent, as_agent
from gplfd_policies.agents.model_based.oracle import OracleAgent
from gplfd_policies.arrays.storage import complete_or_absent

Picture = NDArray[np.uint8]


class Scene(NamedTuple):
    """A door and when it is pictured.

    Attributes:
        title: Below the picture.
        door: As `gym.make` takes it.
        base: Whether the robot drives.
        angle: At which opening angle [deg].
    """

    title: str
    door: DoorSpec
    base: Base
    angle: float


SCENES: Final = (
    Scene("cabinet", "cabinet", "fixed", 22.0),
    Scene("wardrobe", "wardrobe", "fixed", 22.0),
    Scene("room-834, lever: pull", "room-834", "mobile", 62.0),
    Scene("room-834, push", {"preset": "room-834", "swing": "push"}, "mobile", 40.0),
    Scene("heavy-fire, closer EN 4", "heavy-fire", "mobile", 22.0),
    Scene(
        "room-709, knob, just free",
        {"preset": "room-709", "handle": "knob"},
        "mobile",
        4.0,
    ),
)
_COLUMNS: Final = 3
_SHOWN: Final = "room-834"
"""The door of the moving picture."""
_EVERY: Final = 12
"""Control periods from one frame of it to the next."""
_COLOURS: Final = 256
_PAUSE: Final = 1000
"""How long its end is seen [ms]."""


def pictured(scene: Scene, width: int) -> Picture:
    """Open a door and return a 4:3 picture (H, W, 3) at the scene's angle.

    Raises:
        RuntimeError: The door was not opened so far, or there is no OpenGL.
    """
    env = gym.make(ENVIRONMENT_IDS["pose"], door=scene.door, base=scene.base)
    for info in opening(env, as_agent(OracleAgent())):
        if np.degrees(info["door_angle"]) >= scene.angle:
            with _camera(env, width) as camera:
                return _drawn(env, camera)
    raise RuntimeError(f"{scene.title}: {info['failure'] or 'not opened'}")


def opening(env: gym.Env[Any, Any], agent: Agent) -> Iterator[dict[str, Any]]:
    """Let an agent open a door and yield what is known after every control period."""
    inner: Any = env.unwrapped
    observation, info = env.reset(seed=0)
    agent.inform(inner.door_geometry)
    agent.reset(observation)
    ended = False
    while not ended:
        yield info
        step = agent.act(observation)
        observation, _, terminated, truncated, info = env.step(step.action)
        ended = terminated or truncated
    yield info


def film(path: Path, width: int) -> None:
    """Let `gp` open a door that it was not shown, and write a GIF of it.

    Raises:
        RuntimeError: It was not opened, or there is no OpenGL.
    """
    shown = Teacher().standard_demonstrations(seed=0, like=DOORS[_SHOWN])
    env = gym.make(ENVIRONMENT_IDS["pose"], door=_SHOWN, base="mobile")
    inner: Any = env.unwrapped
    frames = []
    with _camera(env, width) as camera:
        for number, info in enumerate(opening(env, make_agent("gp", shown))):
            if number % _EVERY == 0 or info["success"]:
                frames.append(Image.fromarray(_drawn(env, camera)))
    if not info["success"]:
        raise RuntimeError(f"{_SHOWN}: {info['failure'] or 'not opened'}")
    write_gif(path, frames, _EVERY * inner.dt, _COLOURS)


def write_gif(
    path: Path, frames: Sequence[Image.Image], period: float, colours: int
) -> None:
    """Write frames of one size as a moving picture that lasts at its end.

    Args:
        path: File.
        frames: In order.
        period: How long each is seen [s].
        colours: How many, the same for all frames.
    """
    # The last, too: light falls on an open door as on none before.
    chosen = [*frames[:: max(1, len(frames) // 4)], frames[-1]]
    several = np.hstack([np.asarray(one) for one in chosen])
    # Median cut alone gives large areas of nearly one colour, as walls, few shades,
    # which are seen as blotches.
    palette = Image.fromarray(several).quantize(colours, kmeans=4)
    pictures = [
        frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames
    ]
    lasting = [round(1000.0 * period)] * len(pictures)
    lasting[-1] = _PAUSE
    with complete_or_absent(path) as temporary:
        pictures[0].save(
            temporary,
            format="GIF",
            save_all=True,
            append_images=pictures[1:],
            duration=lasting,
            loop=0,
        )


def _camera(env: gym.Env[Any, Any], width: int) -> contextlib.closing[Camera]:
    """Return the camera "overview" for pictures (3/4 width, width), closed at the end.

    It draws twice as many pixels in each direction, which smooths edges.
    """
    model = env.unwrapped.model  # type: ignore[attr-defined]
    camera = Camera(model, 2 * width, 3 * width // 2, "overview", effects=True)
    return contextlib.closing(camera)


def _drawn(env: gym.Env[Any, Any], camera: Camera) -> Picture:
    data = env.unwrapped.data  # type: ignore[attr-defined]
    return np.asarray(Image.fromarray(camera.picture("rgb_array", data)).reduce(2))


def side_by_side(pictures: Mapping[str, Picture], columns: int) -> Figure:
    """Return a figure of pictures of one size, a pixel each, with their titles."""
    height, width, _ = next(iter(pictures.values())).shape
    title = 26
    rows = -(-len(pictures) // columns)
    size = columns * width, rows * (height + title)
    figure = Figure(figsize=(size[0] / 100.0, size[1] / 100.0), dpi=100)
    FigureCanvasAgg(figure)
    for number, (name, picture) in enumerate(pictures.items()):
        row, column = divmod(number, columns)
        top = 1.0 - row * (height + title) / size[1]
        high = height / size[1]
        box = (column / columns, top - high, 1.0 / columns, high)
        panel = figure.add_axes(box)
        panel.imshow(picture, interpolation="none")
        panel.axis("off")
        middle = box[0] + box[2] / 2.0
        below = top - high - 0.5 * title / size[1]
        figure.text(middle, below, name, ha="center", va="center", fontsize=10)
    return figure


def draw(path: Path, scenes: Sequence[Scene], width: int) -> None:
    """Picture scenes and write them, complete or not at all."""
    pictures = {scene.title: pictured(scene, width) for scene in scenes}
    figure = side_by_side(pictures, min(_COLUMNS, len(scenes)))
    with complete_or_absent(path) as temporary:
        figure.savefig(temporary, format="png", metadata={"Software": None})


def main(
    out: Path = Path("docs/images/gallery.png"),
    moving: Path = Path("docs/images/opening.gif"),
    width: int = 400,
) -> None:
    """Draw the gallery and the moving picture; a minute.

    Args:
        out: File of the gallery.
        moving: File of the moving picture.
        width: Of a picture [px].
    """
    draw(out, SCENES, width)
    film(moving, width)


if __name__ == "__main__":
    tyro.cli(main)
