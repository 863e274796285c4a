"""Episodes of the environment for other programs, with pictures on request."""

import contextlib
import io
from collections.abc import Sequence
from typing import Any, Final

import mujoco
import numpy as np
from PIL import Image

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.envs.camera import Camera
from gplfd_experiments.console.progress import progress_bar
from gplfd_experiments.data.minari import PHYSICS_STATE, STATE, Dataset
from gplfd_experiments.data.writers import Rows, states_of

_CONTROL_RATE: Final = round(1.0 / CONTROL_PERIOD)


def episode_rows(
    dataset: Dataset, rate: int, cameras: Sequence[str], size: tuple[int, int]
) -> list[Rows]:
    """Return the rows of every episode of a data set.

    A state is the observed pose of the hand, an action the last commanded pose before
    the next row. Pictures are drawn from the physics states.
    """
    if not 0 < rate <= _CONTROL_RATE or _CONTROL_RATE % rate:
        raise ValueError(
            f"--rate {rate} must divide the {_CONTROL_RATE} steps per second of an "
            "episode: 100, 50, 25, 20, 10, 5, ..."
        )
    rows = []
    with contextlib.closing(dataset.make_environment()) as env:
        numbers = range(dataset.n_episodes)
        for number in progress_bar(numbers, desc="exporting", unit="episode"):
            episode = dataset.episode(number)
            steps = np.arange(0, len(episode.rewards), _CONTROL_RATE // rate)
            following = np.append(steps[1:], len(episode.rewards)) - 1
            seen = episode.observations["ee_pose"][steps]
            commanded = episode.actions[following, :6]
            # In one sequence, so that the signs of a state and its action agree.
            poses = np.stack([seen, commanded], axis=1)
            both = states_of(poses.reshape(-1, 6)).reshape(len(steps), 2, 7)
            if cameras:
                env.reset(seed=episode.seed, options=dict(episode.options) or None)
            inner: Any = env.unwrapped
            pictures: dict[str, list[bytes]] = {}
            for name in cameras:
                # Drawn from the physics states, as PNG files.
                files = pictures[name] = []
                camera = Camera(inner.model, *size, name, effects=False)
                with contextlib.closing(camera):
                    for state in episode.infos[PHYSICS_STATE][steps]:
                        mujoco.mj_setState(inner.model, inner.data, state, STATE)
                        mujoco.mj_forward(inner.model, inner.data)
                        try:
                            picture = camera.picture("rgb_array", inner.data)
                        except RuntimeError as error:
                            raise OSError(f"--pictures: {error}") from error
                        file = io.BytesIO()
                        Image.fromarray(np.asarray(picture)).save(file, format="png")
                        files.append(file.getvalue())
            rows.append(
                Rows(
                    rate=float(rate),
                    states=both[:, 0],
                    actions=both[:, 1],
                    wrenches=episode.observations["wrench"][steps],
                    signals={},
                    pictures=pictures,
                    task="open the door",
                )
            )
    return rows
