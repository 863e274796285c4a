"""Demonstrations of robomimic in HDF5, one motion each, without time stamps.

The hand is ``obs/NAME_pos`` and ``obs/NAME_quat``, whose scalar is last, or another
form of its orientation; forces are ``obs/NAME_wrench``.
"""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from gplfd_experiments.data.raw import RawRecording, chosen
from gplfd_experiments.data.readers.arrays import from_names
from gplfd_experiments.data.readers.tables import ORIENTED, array_columns
from gplfd_experiments.data.settings import ImportSettings
from gplfd_experiments.files.libraries import optional_libraries

with optional_libraries("robomimic's files need h5py", "robomimic"):
    import h5py

_DEFAULT_HAND: Final = "robot0_eef"


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
        motions = [
            _demonstration(data[name], f"{path.name}: {name}", settings)
            for name in names
        ]
    if rate is None:
        return motions
    return [replace(m, times=np.arange(len(m.positions)) / rate) for m in motions]


def _demonstration(group: Any, label: str, settings: ImportSettings) -> RawRecording:
    if not isinstance(group, h5py.Group) or "obs" not in group:
        raise ValueError(
            f"{group.name} has no group 'obs'; robosuite records states alone, of "
            "which robomimic's script dataset_states_to_obs makes observations"
        )
    obs = group["obs"]
    hands = {name.removesuffix("_pos"): name for name in obs if name.endswith("_pos")}
    wanted = settings.body or _DEFAULT_HAND
    hand, position = chosen(wanted, hands, "hand in obs", file=label)
    gripper = f"{hand.removesuffix('_eef')}_gripper_qpos"
    force = settings.wrench or f"{hand}_wrench"
    sources = {"positions": position}
    settings_of_arrays = ImportSettings(angles=settings.angles)
    for name in (f"{hand}_quat", *sorted(obs)):
        what = name.removeprefix(f"{hand}_")
        if name in obs and what != name:
            scalar_last = 4 in obs[name].shape and not what.endswith("wxyz")
            what = f"{what.removesuffix('_xyzw')}_xyzw" if scalar_last else what
            columns = array_columns(what, obs[name].shape, settings_of_arrays)
            if columns and ORIENTED.issuperset(columns):
                sources[what] = name
                break
    if force in obs or settings.wrench is not None:
        sources["wrench"] = force
    arrays = {
        what: np.asarray(obs[name][()], dtype=np.float64)
        for what, name in sources.items()
    }
    motion = from_names(label, arrays, settings_of_arrays)
    signals = {"gripper": obs[gripper][()]} if gripper in obs else {}
    return replace(motion, unit="m", signals=signals)
