"""Demonstrations as robomimic's HDF5 has them.

https://robomimic.github.io/docs/datasets/overview.html describes the layout. Actions
are absolute poses in metres, not scaled to [-1, 1]: let robomimic normalise them.
"""

import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import h5py
import numpy as np

from gplfd_experiments.data.readers.robomimic import DEFAULT_HAND
from gplfd_experiments.data.writers.rows import Rows
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.arrays.storage import complete_or_absent

_GYM: Final = 2
"""robomimic's number for environments of Gym."""


def write(path: Path, demonstrations: Sequence[Rows]) -> None:
    """Write one HDF5 file.

    Raises:
        OSError: It cannot be written.
    """
    environment = {
        "env_name": "recorded",
        "env_type": _GYM,
        "env_kwargs": {"control_freq": demonstrations[0].rate},
    }
    image = io.BytesIO()
    with h5py.File(image, "w") as file:
        data = file.create_group("data")
        data.attrs["total"] = sum(len(one.states) for one in demonstrations)
        data.attrs["env_args"] = json.dumps(environment)
        for number, one in enumerate(demonstrations):
            _add(data.create_group(f"demo_{number}"), one)
    with complete_or_absent(path) as temporary:
        temporary.write_bytes(image.getvalue())


def _add(group: Any, one: Rows) -> None:
    number = len(one.states)
    last = np.arange(number) == number - 1
    group.attrs["num_samples"] = number
    group["actions"] = one.actions
    group["states"] = np.zeros((number, 1))
    group["rewards"] = last.astype(np.float64)
    group["dones"] = last.astype(np.int64)
    following = np.minimum(np.arange(number) + 1, number - 1)
    for name, array in _observations(one).items():
        group[f"obs/{name}"] = array
        group[f"next_obs/{name}"] = array[following]


def _observations(one: Rows) -> dict[str, FloatArray]:
    """Return what is seen, by robosuite's names."""
    seen = {
        f"{DEFAULT_HAND}_pos": one.states[:, :3],
        f"{DEFAULT_HAND}_quat": one.states[:, 3:],
    }
    hand = DEFAULT_HAND.removesuffix("_eef")
    names = {"gripper": f"{hand}_gripper_qpos", "force": f"{DEFAULT_HAND}_wrench"}
    return seen | {names[name]: array for name, array in one.signals.items()}
