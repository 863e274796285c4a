"""MuJoCo's physics state, and hashes of its model: a step depends on nothing else."""

import hashlib
from collections.abc import Mapping
from typing import Any, Final

import mujoco
import numpy as np

from gplfd_experiments.files.arrays import FloatArray

STATE: Final = int(mujoco.mjtState.mjSTATE_INTEGRATION)
"""All that a step reads: with it, MuJoCo continues bit for bit."""

_HASHED_STRUCTS: Final = ("opt", "stat")
_DIGITS: Final = 16


def physics_state(model: mujoco.MjModel, data: mujoco.MjData) -> FloatArray:
    """Everything that the next step depends on besides the model, (S,) [SI]."""
    state = np.empty(mujoco.mj_stateSize(model, STATE))
    mujoco.mj_getState(model, data, state, STATE)
    return state


def state_layout(model: mujoco.MjModel) -> dict[str, int]:
    """How many numbers of the state each part has, in order; empty parts left out."""
    members = mujoco.mjtState.__members__.items()
    sizes = {
        name.removeprefix("mjSTATE_").lower(): mujoco.mj_stateSize(model, int(bit))
        for name, bit in sorted(members, key=lambda member: int(member[1]))
        if int(bit).bit_count() == 1 and int(bit) & STATE
    }
    return {name: size for name, size in sizes.items() if size}


def model_digests(model: mujoco.MjModel) -> dict[str, str]:
    """Hashes of the compiled model's parts, by what they describe ("geom", "opt", ...).

    Two models with equal hashes have equal numbers, bit for bit. How the model is drawn
    in general (``vis``) is left out; colours count.
    """
    contents: list[tuple[str, Any]] = []
    for name in sorted(dir(model)):
        value = None if name.startswith("_") else getattr(model, name)
        if name in _HASHED_STRUCTS:
            parts = {field: getattr(value, field) for field in sorted(dir(value))}
            contents += [
                (f"{name}_{field}", part)
                for field, part in parts.items()
                if not field.startswith("_") and not callable(part)
            ]
        elif isinstance(value, np.ndarray):
            contents.append((name, value))
    digests: dict[str, Any] = {}
    for name, value in contents:
        digest = digests.setdefault(name.split("_")[0], hashlib.sha256())
        array = np.ascontiguousarray(value)
        digest.update(f"{name} {array.dtype.str} {array.shape} ".encode())
        digest.update(array.tobytes())
    return {name: digests[name].hexdigest()[:_DIGITS] for name in sorted(digests)}


def model_hash(digests: Mapping[str, str]) -> str:
    """One hash of what `model_digests` returned."""
    text = " ".join(f"{name} {digests[name]}" for name in sorted(digests))
    return hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]
