"""Episodes of the environment as other programs see them, with pictures on request."""

import contextlib
import io
from collections.abc import Iterator, Sequence
from typing import Any, Final

import gymnasium as gym
import mujoco
import numpy as np
from PIL import Image

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.envs.camera import Camera
from gplfd_experiments.console.progress import progress_bar
from gplfd_experiments.data.minari import Dataset, RecordedEpisode
from gplfd_experiments.data.minari.physics import STATE
from gplfd_experiments.data.writers.rows import Rows, states_of
from gplfd_experiments.files.arrays import FloatArray

TASK: Final = "open the door"
_CONTROL_RATE: Final = round(1.0 / CONTROL_PERIOD)


def episode_rows(
    dataset: Dataset, rate: int, cameras: Sequence[str], size: tuple[int, int]
) -> list[Rows]:
    """Return the rows of every episode of a data set.

    A state is the hand's pose as observed, an action the last pose that was commanded
    before the next row.

    Args:
        dataset: Of ``gplfd demos record``.
        rate: Rows per second; a divisor of the control rate.
        cameras: Cameras of the scene whose pictures are drawn, from the physics states.
        size: Width and height of the pictures [px].

    Raises:
        ValueError: The rate is no divisor, an episode is damaged, or a camera unknown.
        OSError: Pictures cannot be drawn on this machine.
    """
    if not 0 < rate <= _CONTROL_RATE or _CONTROL_RATE % rate:
        raise ValueError(
            f"--rate {rate} must divide the {_CONTROL_RATE} steps per second of an "
            "episode: 100, 50, 25, 20, 10, 5, ..."
        )
    stride = _CONTROL_RATE // rate
    rows = []
    with contextlib.closing(dataset.make_environment()) as env:
        for number in progress_bar(
            range(dataset.n_episodes), desc="exporting", unit="episode"
        ):
            episode = dataset.episode(number)
            steps = np.arange(0, len(episode), stride)
            pictures = dict(_pictures(env, episode, steps, cameras, size))
            rows.append(_rows(episode, steps, rate, pictures))
    return rows


def _rows(
    episode: RecordedEpisode,
    steps: np.ndarray,
    rate: int,
    pictures: dict[str, tuple[bytes, ...]],
) -> Rows:
    following = np.append(steps[1:], len(episode)) - 1
    poses = np.stack(
        [episode.observations["ee_pose"][steps], episode.actions[following, :6]], axis=1
    )
    # One after the other, so that the signs of a state and its action agree.
    both = states_of(poses.reshape(-1, 6)).reshape(len(steps), 2, 7)
    return Rows(
        rate=float(rate),
        states=both[:, 0],
        actions=both[:, 1],
        signals={"force": episode.observations["wrench"][steps]},
        pictures=pictures,
        task=TASK,
    )


def _pictures(
    env: gym.Env[Any, Any],
    episode: RecordedEpisode,
    steps: np.ndarray,
    cameras: Sequence[str],
    size: tuple[int, int],
) -> Iterator[tuple[str, tuple[bytes, ...]]]:
    """Yield the name of every camera and its pictures, as PNG files."""
    if not cameras:
        return
    inner: Any = env.unwrapped
    env.reset(seed=episode.seed, options=dict(episode.options) or None)
    for name in cameras:
        camera = Camera(inner.model, *size, name, effects=False)
        with contextlib.closing(camera):
            yield (
                name,
                tuple(
                    _png(_drawn(camera, inner, state))
                    for state in episode.states[steps]
                ),
            )


def _drawn(camera: Camera, inner: Any, state: FloatArray) -> np.ndarray:
    mujoco.mj_setState(inner.model, inner.data, state, STATE)
    mujoco.mj_forward(inner.model, inner.data)
    try:
        return np.asarray(camera.picture("rgb_array", inner.data))
    except RuntimeError as error:
        raise OSError(f"--pictures: {error}") from error


def _png(picture: np.ndarray) -> bytes:
    file = io.BytesIO()
    Image.fromarray(picture).save(file, format="png")
    return file.getvalue()
