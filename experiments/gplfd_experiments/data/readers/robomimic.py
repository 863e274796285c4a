"""Demonstrations of robomimic in HDF5: one motion per demonstration.

The hand is ``obs/NAME_pos`` and ``obs/NAME_quat``, whose scalar is last, or another
form of its orientation; forces are ``obs/NAME_wrench``. Files have no time stamps; the
rate is the control frequency of the environment, if the file states it.
"""

import json
import re
from pathlib import Path
from typing import Any, Final

import numpy as np

from gplfd_experiments.data.raw import RawRecording, chosen
from gplfd_experiments.data.readers.tables import orientation_form, quaternions_of
from gplfd_experiments.data.settings import ImportSettings, angles_of
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.files.libraries import optional_libraries

with optional_libraries("robomimic's files need h5py", "robomimic"):
    import h5py

DEFAULT_HAND: Final = "robot0_eef"


def read(path: Path, settings: ImportSettings) -> list[RawRecording]:
    """Read every demonstration, in the order of their numbers."""
    with h5py.File(path, "r") as file:
        if "data" not in file:
            raise ValueError(f"it has no group 'data' but {', '.join(file)!s:.200}")
        data = file["data"]
        # The control frequency of the environment, if the file states it.
        rate, about = settings.recorded_rate, data.attrs.get("env_args")
        match json.loads(about) if isinstance(about, str) else None:
            case {"env_kwargs": {"control_freq": int() | float() as control}}:
                rate = rate or (float(control) if 0.0 < control < 1e6 else None)
        names = sorted(data, key=lambda name: list(map(int, re.findall(r"\d+", name))))
        return [
            _demonstration(data[name], f"{path.name}: {name}", rate, settings)
            for name in names
        ]


def _demonstration(
    group: Any, label: str, rate: float | None, settings: ImportSettings
) -> RawRecording:
    if not isinstance(group, h5py.Group) or "obs" not in group:
        raise ValueError(
            f"{group.name} has no group 'obs'; robosuite records states alone, of "
            "which robomimic's script dataset_states_to_obs makes observations"
        )
    obs = group["obs"]

    def array(name: str, width: int | None = None) -> FloatArray:
        values = np.asarray(obs[name][()], dtype=np.float64)
        if values.ndim != 2 or width not in (None, values.shape[1]):
            raise ValueError(
                f"obs/{name} has shape {values.shape}, must be (N, {width})"
            )
        return values

    hands = {name.removesuffix("_pos"): name for name in obs if name.endswith("_pos")}
    hand, position = chosen(
        settings.body or DEFAULT_HAND, hands, "hand in obs", file=label
    )
    positions = array(position, 3)
    gripper = f"{hand.removesuffix('_eef')}_gripper_qpos"
    force = settings.wrench or f"{hand}_wrench"
    quaternions, wrenches, unit = None, None, angles_of(settings.angles)
    # The scalar of robosuite's quaternions is last.
    forms = {
        name: form
        for name in (f"{hand}_quat", *sorted(obs))
        if name in obs
        and name.startswith(f"{hand}_")
        and (
            form := orientation_form(
                name.removeprefix(f"{hand}_"), obs[name].shape, settings, "xyzw"
            )
        )
    }
    for name, form in list(forms.items())[:1]:
        values = np.asarray(obs[name][()], dtype=np.float64).reshape(len(positions), -1)
        quaternions = quaternions_of(form, values, unit[1] or "rad", unit[0] or "xyz")
    if force in obs or settings.wrench is not None:
        wrenches = array(force, 6)
    return RawRecording(
        name=label,
        times=None if rate is None else np.arange(len(positions)) / rate,
        positions=positions,
        unit="m",
        quaternions=quaternions,
        wrenches=wrenches,
        signals={"gripper": array(gripper)} if gripper in obs else {},
    )
