"""The file of a skill: its demonstrations and what was learned from them, no code."""

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any, Final

import numpy as np

from gplfd_policies.arrays.storage import Members, read_archive, write_archive
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.gp.deviations import DeviationProcess
from gplfd_policies.gp.heteroscedastic import HeteroscedasticGP
from gplfd_policies.gp.kernels import RBF
from gplfd_policies.gp.multi_output import MultiOutputGP
from gplfd_policies.gp.noise_profile import NoiseProfile
from gplfd_policies.gp.replicates import Replicates

KIND: Final = "a gplfd skill"
"""What the file says it holds."""
VERSION: Final = 3
"""Version of its layout."""

Parts = tuple[AlignedDemonstrations, MultiOutputGP, tuple[DeviationProcess, ...]]
"""Demonstrations, six processes, and how each output deviates; the latter is empty for
a single demonstration."""

_NO_CLOCKS: Final = np.zeros((0, 0))
"""In place of the clocks where they are not known."""
_DEVIATION: Final = tuple(field.name for field in fields(DeviationProcess))


def write_skill(
    path: str | Path,
    aligned: AlignedDemonstrations,
    processes: MultiOutputGP,
    deviations: Sequence[DeviationProcess],
) -> None:
    """Write the parts of a skill, complete or not at all.

    Raises:
        ValueError: Its noise r(t) is not on the basis that every noise model here uses.
        OSError: The file cannot be written.
    """
    outputs = processes.outputs
    basis = NoiseProfile.basis_over(aligned.times)
    if any(output.noise.basis != basis for output in outputs):
        raise ValueError(
            "this skill cannot be saved: its noise model must return profiles on "
            "NoiseProfile.basis_over(times)"
        )
    numbers: dict[str, Any] = {
        "times": aligned.times,
        "poses": aligned.poses,
        "duration": aligned.duration,
        "end": aligned.end,
        "drift": aligned.drift,
        "clocks": _NO_CLOCKS if aligned.clocks is None else aligned.clocks,
        "offset": [output.offset for output in outputs],
        "scale": [output.scale for output in outputs],
        "length_scale": [output.kernel.length_scale for output in outputs],
        "signal_std": [output.kernel.signal_std for output in outputs],
        "noise_level": [output.noise.level for output in outputs],
        "noise_floor": [output.noise.floor for output in outputs],
        "noise_coefficients": [output.noise.coefficients for output in outputs],
    }
    for name in _DEVIATION:
        numbers[name] = [getattr(deviation, name) for deviation in deviations]
    arrays = {name: np.array(each, dtype=np.float64) for name, each in numbers.items()}
    write_archive(path, kind=KIND, version=VERSION, arrays=arrays)


def read_skill(path: str | Path) -> Parts:
    """Read what `write_skill` wrote; raises as `read_archive`."""
    return read_archive(path, kind=KIND, version=VERSION, build=_parts)


def _parts(members: Members) -> Parts:
    clocks = _finite(members, "clocks")
    aligned = AlignedDemonstrations(
        times=_finite(members, "times"),
        poses=_finite(members, "poses"),
        duration=float(_finite(members, "duration", ())),
        end=float(_finite(members, "end", ())),
        drift=_finite(members, "drift", (6,)),
        clocks=None if clocks.shape == _NO_CLOCKS.shape else clocks,
    )
    processes = MultiOutputGP(outputs=_processes(members, aligned))
    deviating = 6 if len(aligned.poses) > 1 else 0
    columns = [_finite(members, name, (deviating,)) for name in _DEVIATION]
    deviations = tuple(_deviation(row) for row in np.transpose(columns).tolist())
    return aligned, processes, deviations


def _processes(
    members: Members, aligned: AlignedDemonstrations
) -> tuple[HeteroscedasticGP, ...]:
    basis = NoiseProfile.basis_over(aligned.times)
    coefficients = _finite(members, "noise_coefficients", (6, basis.size))
    names = (
        "offset",
        "scale",
        "length_scale",
        "signal_std",
        "noise_level",
        "noise_floor",
    )
    columns = [_finite(members, name, (6,)) for name in names]
    if not (columns[1] > 0.0).all():
        raise ValueError(f"'scale' must be positive, got {columns[1]}")
    if not (columns[5] >= 0.0).all():
        raise ValueError(f"'noise_floor' must not be negative, got {columns[5]}")
    return tuple(
        HeteroscedasticGP(
            offset=offset,
            scale=scale,
            replicates=Replicates.from_samples(
                aligned.times, (aligned.poses[:, :, number] - offset) / scale
            ),
            kernel=RBF(length_scale=length_scale, signal_std=signal_std),
            noise=NoiseProfile(
                level=level,
                basis=basis,
                coefficients=coefficients[number],
                floor=floor,
            ),
        )
        for number, (
            offset,
            scale,
            length_scale,
            signal_std,
            level,
            floor,
        ) in enumerate(np.transpose(columns).tolist())
    )


def _deviation(values: Sequence[float]) -> DeviationProcess:
    deviation = DeviationProcess(**dict(zip(_DEVIATION, values, strict=True)))
    scales = (deviation.wobble, deviation.long_scale, deviation.short_scale)
    shares = (deviation.varying, deviation.white)
    if not (min(scales) > 0.0 and min(shares) >= 0.0 and max(shares) <= 1.0):
        raise ValueError(f"no process of deviations has these parameters: {deviation}")
    return deviation


def _finite(
    members: Members, name: str, shape: tuple[int, ...] | None = None
) -> np.ndarray:
    """Return finite numbers, of a shape if one is given."""
    array = members(name)
    if array.dtype != np.float64 or not np.isfinite(array).all():
        raise ValueError(f"{name!r} must be finite numbers of type float64")
    if shape is not None and array.shape != shape:
        raise ValueError(f"{name!r} must have shape {shape}, got {array.shape}")
    return array
