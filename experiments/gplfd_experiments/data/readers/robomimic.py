"""Demonstrations of robomimic in HDF5: one motion per demonstration.

The hand is ``obs/NAME_pos`` and ``obs/NAME_quat``, whose scalar is last, and forces are
``obs/NAME_wrench``. Files have no time stamps; the rate is the control frequency of the
environment, if the file states it.
"""

import json
import re
from pathlib import Path
from typing import Any, Final

import numpy as np

from gplfd_experiments.data.raw import OBSERVED, RawRecording, Selection, chosen
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.files.libraries import optional_libraries

with optional_libraries("robomimic's files need h5py", "robomimic"):
    import h5py

DEFAULT_HAND: Final = "robot0_eef"
AS_OBSERVED: Final = "of the environment on the hand, in the frame of its poses"
"""Attribute ``wrench`` of wrenches that gplfd writes."""


def read(path: Path, selection: Selection) -> list[RawRecording]:
    """Read every demonstration, in the order of their numbers."""
    with h5py.File(path, "r") as file:
        if "data" not in file:
            raise ValueError(f"it has no group 'data' but {', '.join(file)!s:.200}")
        data = file["data"]
        # The control frequency of the environment, if the file states it.
        rate, settings = selection.recorded_rate, data.attrs.get("env_args")
        match json.loads(settings) if isinstance(settings, str) else None:
            case {"env_kwargs": {"control_freq": int() | float() as control}}:
                rate = rate or (float(control) if 0.0 < control < 1e6 else None)
        names = sorted(data, key=lambda name: list(map(int, re.findall(r"\d+", name))))
        return [
            _demonstration(data[name], f"{path.name}: {name}", rate, selection)
            for name in names
        ]


def _demonstration(
    group: Any, label: str, rate: float | None, selection: Selection
) -> RawRecording:
    if not isinstance(group, h5py.Group) or "obs" not in group:
        raise ValueError(
            f"{group.name} has no group 'obs'; robosuite records states alone, of "
            "which robomimic's script dataset_states_to_obs makes observations"
        )
    obs = group["obs"]
    hands = {name.removesuffix("_pos"): name for name in obs if name.endswith("_pos")}
    hand, position = chosen(
        selection.body or DEFAULT_HAND, hands, "hand in obs", file=label
    )
    positions = _array(obs, position, 3)
    quaternions, wrenches, sensor, signals = None, None, None, {}
    if f"{hand}_quat" in obs:
        quaternions = np.roll(_array(obs, f"{hand}_quat", 4), 1, axis=1)
    gripper = f"{hand.removesuffix('_eef')}_gripper_qpos"
    if gripper in obs:
        signals["gripper"] = _array(obs, gripper)
    force = selection.wrench or f"{hand}_wrench"
    if force in obs or selection.wrench is not None:
        wrenches = _array(obs, force, 6)
        stated = str(obs[force].attrs.get("wrench"))
        sensor = OBSERVED if stated == AS_OBSERVED else None
    return RawRecording(
        name=label,
        times=None if rate is None else np.arange(len(positions)) / rate,
        positions=positions,
        unit="m",
        quaternions=quaternions,
        wrenches=wrenches,
        sensor=sensor,
        signals=signals,
    )


def _array(obs: Any, name: str, width: int | None = None) -> FloatArray:
    """Return an observation, (N, width)."""
    array = np.asarray(obs[name][()], dtype=np.float64)
    if array.ndim != 2 or width not in (None, array.shape[1]):
        raise ValueError(f"obs/{name} has shape {array.shape}, must be (N, {width})")
    return array
