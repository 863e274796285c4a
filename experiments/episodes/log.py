"""Everything that happened in one episode, as arrays over the control steps.

Metrics, figures and recordings read logs; none of them simulates again.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from policies.storage import Members, read_archive, settings, write_archive

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

KIND: Final = "a gplfd episode log"
"""What the file says it holds."""

VERSION: Final = 1
"""Version of the layout of the file."""


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodeLog:
    """One episode of one policy on one door.

    Row t of every per-step array is the state at ``times[t]`` and what the agent
    decided in it. The last row is the state in which the episode ended; its action
    was computed and not executed. Poses are in the task frame [m, rad], T is the
    number of rows, S of forecasts, M of phases in a forecast, nq of joint positions.
    What a policy has no notion of (uncertainty, stiffness, prediction) is NaN.

    Raises:
        ValueError: An array has the wrong shape.
    """

    policy: str
    """Name of the policy in the registry."""
    door: str
    """Name of the door, or its radius as text."""
    door_config: Mapping[str, float]
    """Fields of the door's configuration [SI]."""
    seed: int
    """Seed of the environment's reset."""
    dt: float
    """Control period [s]."""
    success: bool
    """Whether the task was solved."""
    failure: str
    """Why not: "" | "grasp_lost" | "stalled" | "simulation_error" | "time_limit"."""

    times: FloatArray
    """Simulated time since reset [s], (T,)."""
    ee_pose: FloatArray
    """Hand pose, (T, 6)."""
    ee_twist: FloatArray
    """Hand velocity [m/s, rad/s], (T, 6)."""
    wrench: FloatArray
    """Force and torque of the door on the hand [N, N m], (T, 6)."""
    joint_pos: FloatArray
    """Arm joint positions [rad], (T, 7)."""
    joint_vel: FloatArray
    """Arm joint velocities [rad/s], (T, 7)."""
    qpos: FloatArray
    """Generalised positions of the whole model, (T, nq)."""

    door_angle: FloatArray
    """Opening angle of the door [rad], (T,)."""
    handle_pose: FloatArray
    """True pose of the handle, (T, 6)."""
    solved: BoolArray
    """Whether the task counts as solved at this step, (T,)."""
    grasped: BoolArray
    """Whether the hand holds the handle, (T,)."""
    slip: FloatArray
    """Distance of the hand from where it grasped the handle [m], (T,)."""
    force_tangential: FloatArray
    """Force of the hand on the handle along its motion [N], (T,)."""
    force_radial: FloatArray
    """Force of the hand on the handle away from the hinge [N], (T,)."""
    force_vertical: FloatArray
    """Force of the hand on the handle upwards [N], (T,)."""

    action: FloatArray
    """Commanded hand pose, (T, 6)."""
    desired: FloatArray
    """Policy mean at the command's phase, (T, 6)."""
    std: FloatArray
    """Standard deviation that the controller uses [m, rad], (T, 6)."""
    std_rate: FloatArray
    """Its rate [m/s, rad/s], (T, 6)."""
    stiffness: FloatArray
    """Stiffness of the virtual dynamics [N/m, N m/rad], (T, 6)."""
    stiffness_rate: FloatArray
    """Its rate [N/(m s), N m/(rad s)], (T, 6)."""
    stability_margin: FloatArray
    """Bound on the stiffness rate minus the rate [N/(m s), N m/(rad s)], (T, 6)."""
    phase: FloatArray
    """Phase of the command, (T,)."""
    observed_phase: FloatArray
    """Phase that the agent gives to the observed pose, (T,)."""
    predicted_mean: FloatArray
    """Pose predicted at the observed phase before the observation was used, (T, 6)."""
    predicted_std: FloatArray
    """Its standard deviation [m, rad], (T, 6)."""
    via_point: BoolArray
    """Whether the observation became a via-point, (T,)."""
    latency_s: FloatArray
    """CPU time of the agent's decision [s], (T,)."""

    forecast_times: FloatArray
    """When the agent was asked for its forecast [s], (S,); the first was asked before
    the agent had seen the door move. Empty in policies without forecasts."""
    forecast_phase: FloatArray
    """Phases of every forecast, (M,)."""
    forecast_mean: FloatArray
    """Forecast of the whole motion, (S, M, 6)."""
    forecast_std: FloatArray
    """Its standard deviation [m, rad], (S, M, 6)."""

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "door_config", MappingProxyType(dict(self.door_config))
        )
        sizes = {
            "T": np.size(self.times),
            "nq": np.shape(self.qpos)[-1],
            "S": np.size(self.forecast_times),
            "M": np.size(self.forecast_phase),
        }
        for name, shape in _SHAPES.items():
            array = np.array(
                getattr(self, name), dtype=bool if name in _BOOLEANS else np.float64
            )
            expected = tuple(sizes.get(str(size), size) for size in shape)
            if array.shape != expected:
                raise ValueError(
                    f"EpisodeLog.{name} has shape {array.shape}, expected {expected}"
                )
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @property
    def radius(self) -> float:
        """Distance from hinge to handle [m]."""
        return float(self.door_config["radius"])

    def save(self, path: str | Path) -> None:
        """Write the log as .npz, complete or not at all.

        Raises:
            OSError: The file cannot be written.
        """
        arrays: dict[str, Any] = {name: getattr(self, name) for name in _SHAPES}
        header = {name: getattr(self, name) for name in _HEADER}
        header["door_config"] = dict(self.door_config)
        arrays["header"] = np.array(json.dumps(header))
        write_archive(path, kind=KIND, version=VERSION, arrays=arrays)

    @classmethod
    def load(cls, path: str | Path) -> EpisodeLog:
        """Read what `save` wrote.

        Raises:
            FileNotFoundError: There is no such file.
            ValueError: The file is cut, holds something else or another version.
        """
        return read_archive(path, kind=KIND, version=VERSION, build=cls._of)

    @classmethod
    def _of(cls, members: Members) -> EpisodeLog:
        arrays: dict[str, Any] = {name: members(name) for name in _SHAPES}
        return cls(**(settings(members("header")) | arrays))


_SHAPES: Final[Mapping[str, tuple[str | int, ...]]] = MappingProxyType(
    {
        **dict.fromkeys(
            (
                *("times", "door_angle", "solved", "grasped", "slip"),
                *("force_tangential", "force_radial", "force_vertical"),
                *("phase", "observed_phase", "via_point", "latency_s"),
            ),
            ("T",),
        ),
        **dict.fromkeys(
            (
                *("ee_pose", "ee_twist", "wrench", "handle_pose", "action", "desired"),
                *("std", "std_rate", "stiffness", "stiffness_rate"),
                *("stability_margin", "predicted_mean", "predicted_std"),
            ),
            ("T", 6),
        ),
        "joint_pos": ("T", 7),
        "joint_vel": ("T", 7),
        "qpos": ("T", "nq"),
        "forecast_times": ("S",),
        "forecast_phase": ("M",),
        "forecast_mean": ("S", "M", 6),
        "forecast_std": ("S", "M", 6),
    }
)
"""Every array with its shape, by name."""

_BOOLEANS: Final = frozenset({"solved", "grasped", "via_point"})
_HEADER: Final = tuple(
    field.name for field in dataclasses.fields(EpisodeLog) if field.name not in _SHAPES
)
