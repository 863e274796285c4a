"""Demonstrations in robomimic's HDF5 format.

https://robomimic.github.io/docs/datasets/overview.html describes the layout. Actions
are absolute poses in metres, not scaled to [-1, 1]: let robomimic normalise them.
"""

import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import h5py
import numpy as np

from gplfd_experiments.data.readers.robomimic import AS_OBSERVED, DEFAULT_HAND
from gplfd_experiments.data.writers import Rows
from gplfd_policies.arrays.storage import complete_or_absent

_GYM: Final = 2  # robomimic's number for environments of Gym.
_HAND: Final = DEFAULT_HAND.removesuffix("_eef")
_NAMES: Final = {"gripper": f"{_HAND}_gripper_qpos"}
"""robosuite's names of signals."""


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
            group = data.create_group(f"demo_{number}")
            samples = len(one.states)
            index = np.arange(samples)
            group.attrs["num_samples"] = samples
            group["actions"] = one.actions
            group["states"] = np.zeros((samples, 1))
            group["rewards"] = (index == samples - 1).astype(np.float64)
            group["dones"] = (index == samples - 1).astype(np.int64)
            seen = {
                f"{DEFAULT_HAND}_pos": one.states[:, :3],
                f"{DEFAULT_HAND}_quat": one.states[:, 3:],
                **{
                    _NAMES.get(name, name): array for name, array in one.signals.items()
                },
            }
            if one.wrenches is not None:
                seen[f"{DEFAULT_HAND}_wrench"] = one.wrenches
            for name, array in seen.items():
                group[f"obs/{name}"] = array
                group[f"next_obs/{name}"] = array[np.minimum(index + 1, samples - 1)]
            if one.wrenches is not None:
                attributes = group[f"obs/{DEFAULT_HAND}_wrench"].attrs
                attributes["wrench"] = AS_OBSERVED
    with complete_or_absent(path) as temporary:
        temporary.write_bytes(image.getvalue())
