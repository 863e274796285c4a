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
from gplfd_policies.arrays.storage import DecodingBudget

with optional_libraries("robomimic's files need h5py", "robomimic"):
    import h5py

    from gplfd_experiments.data.hdf5 import member, numbers

DEFAULT_HAND: Final = "robot0_eef"
AS_OBSERVED: Final = "of the environment on the hand, in the frame of its poses"
"""Attribute ``wrench`` of wrenches that gplfd writes."""


def read(path: Path, selection: Selection) -> list[RawRecording]:
    """Read every demonstration, in the order of their numbers."""
    budget = DecodingBudget(path.stat().st_size)

    def array(obs: Any, name: str, width: int | None = None) -> FloatArray:
        found = numbers(member(obs, name), budget)
        if found.ndim != 2 or width not in (None, found.shape[1]):
            raise ValueError(
                f"obs/{name} has shape {found.shape}, must be (N, {width})"
            )
        return found

    with h5py.File(path, "r") as file:
        if "data" not in file:
            raise ValueError(f"it has no group 'data' but {', '.join(file)!s:.200}")
        data = member(file, "data")
        # The control frequency of the environment, if the file states it.
        rate, said = selection.recorded_rate, data.attrs.get("env_args")
        match json.loads(said) if isinstance(said, str) else None:
            case {"env_kwargs": {"control_freq": int() | float() as control}}:
                rate = rate or (float(control) if 0.0 < control < 1e6 else None)
        recordings = []
        for name in sorted(
            data, key=lambda n: list(map(int, re.findall(r"\d{1,9}", n)))
        ):
            group = member(data, name)
            if not isinstance(group, h5py.Group) or "obs" not in group:
                raise ValueError(
                    f"data/{name} has no group 'obs'; robosuite records states alone, "
                    "of which robomimic's script dataset_states_to_obs makes "
                    "observations"
                )
            obs, label = member(group, "obs"), f"{path.name}: {name}"
            hands = {
                one.removesuffix("_pos"): one for one in obs if one.endswith("_pos")
            }
            wanted = selection.body or DEFAULT_HAND
            hand, position = chosen(wanted, hands, "hand in obs", file=label)
            positions = array(obs, position, 3)
            quaternions, wrenches, sensor, signals = None, None, None, {}
            if f"{hand}_quat" in obs:
                quaternions = np.roll(array(obs, f"{hand}_quat", 4), 1, axis=1)
            gripper = f"{hand.removesuffix('_eef')}_gripper_qpos"
            if gripper in obs:
                signals["gripper"] = array(obs, gripper)
            force = selection.wrench or f"{hand}_wrench"
            if force in obs or selection.wrench is not None:
                wrenches = array(obs, force, 6)
                said = obs[force].attrs.get("wrench")
                sensor = OBSERVED if str(said) == AS_OBSERVED else None
            recordings.append(
                RawRecording(
                    name=label,
                    times=None if rate is None else np.arange(len(positions)) / rate,
                    positions=positions,
                    unit="m",
                    quaternions=quaternions,
                    wrenches=wrenches,
                    sensor=sensor,
                    signals=signals,
                )
            )
    return recordings
