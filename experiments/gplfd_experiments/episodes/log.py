"""Log of an episode: arrays over the control steps.

Metrics, figures and recordings read logs; none of them simulates.
"""

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, get_origin

import numpy as np
from jaxtyping import Bool, Float

from gplfd_env.doors.config import DoorConfig
from gplfd_policies.arrays.resolution import interpolated
from gplfd_policies.arrays.storage import Members, read_archive, settings, write_archive

Number = Float[np.ndarray, " T"]
Pose = Float[np.ndarray, "T 6"]
Flag = Bool[np.ndarray, " T"]

KIND: Final = "a gplfd episode log"
"""Kind of the file, stated in it."""

VERSION: Final = 4
"""Version of the layout of the file."""


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodeLog:
    """One episode of one policy on one door.

    Row t of every per-step array is the state at ``times[t]`` and the agent's decision
    in this state. The last row is the state in which the episode ended; its action was
    computed but not executed. Poses are in the task frame [m, rad], T is the number of
    rows, S of forecasts, M of phases in a forecast, nq of joint positions. Quantities
    that a policy does not compute (uncertainty, stiffness, prediction) are NaN.

    Raises:
        ValueError: An array has the wrong shape.
    """

    policy: str
    """Name of the policy in the registry."""
    door: str
    """Name of the door, or its radius as text."""
    door_config: Mapping[str, Any]
    """Fields of the door's configuration [SI]."""
    seed: int
    """Seed of the environment's reset."""
    dt: float
    """Control period [s]."""
    success: bool
    """Whether the task was solved."""
    failure: str
    """Failure: "" | "grasp_lost" | "base_blocked" | "stalled" | "latched" |
    "not_grasped" | "simulation_error" | "time_limit"."""
    reason: str
    """Cause of the failure: "" | "handle_lost" | "blocked" | "out_of_reach" |
    "too_heavy", or the same (`gplfd_env.task.stages`)."""

    times: Number
    """Simulated time since reset [s]."""
    ee_pose: Pose
    """Hand pose."""
    ee_twist: Pose
    """Hand velocity [m/s, rad/s]."""
    wrench: Pose
    """Force and torque of the door on the hand [N, N m]."""
    joint_pos: Float[np.ndarray, "T J"]
    """Arm joint positions [rad]."""
    joint_vel: Float[np.ndarray, "T J"]
    """Arm joint velocities [rad/s]."""
    qpos: Float[np.ndarray, "T nq"]
    """Generalised positions of the whole model."""

    door_angle: Number
    """Opening angle of the door [rad]."""
    handle_angle: Number
    """Rotation angle of a lever or knob [rad]."""
    capability: Number
    """The furthest stage so far, an index of `gplfd_env.task.stages.STAGES`."""
    handle_pose: Pose
    """True pose of the handle."""
    solved: Flag
    """Whether the task counts as solved at this step."""
    grasped: Flag
    """Whether the hand holds the handle."""
    slip: Number
    """Distance of the hand from where it grasped the handle [m]."""
    force_tangential: Number
    """Force of the hand on the handle along its motion [N]."""
    force_radial: Number
    """Force of the hand on the handle away from the hinge [N]."""
    force_vertical: Number
    """Force of the hand on the handle upwards [N]."""
    push_force: Number
    """External pushing force [N]."""
    person_force: Number
    """Greatest force between a person and hand or door since the last step [N]."""
    person_energy: Number
    """Work done on the person so far [J]."""
    stop_force: Number
    """Force of the door on a stop, converted to the handle [N]."""
    base_shift: Number
    """Displacement of the base [m]."""
    closer_torque: Number
    """Closing torque of closer, seal and stiction [N m]."""

    # The agent's decision, with the meanings of
    # `gplfd_policies.control.steps.AgentStep`.
    action: Pose
    desired: Pose
    frame: Float[np.ndarray, "T 3 3"]
    std: Pose
    std_rate: Pose
    stiffness: Pose
    stiffness_rate: Pose
    stability_margin: Pose
    contact_margin: Pose
    compensated_load: Number
    path_lag: Number
    phase: Number
    observed_phase: Number
    phase_misfit: Number
    path_size: Number
    path_size_std: Number
    heading: Number
    heading_std: Number
    predicted_mean: Pose
    predicted_std: Pose
    expected_force: Float[np.ndarray, "T 3"]
    expected_force_std: Float[np.ndarray, "T 3"]
    mode: Number
    mode_probability: Number
    via_point: Flag
    latency_s: Number
    """CPU time of the agent's decision [s]."""
    latency_wall_s: Number
    """Wall time of the agent's decision [s]; NaN in older files without it."""

    forecast_times: Float[np.ndarray, " S"]
    """Times of the agent's forecasts [s]; the first is before the door has moved. Empty
    for policies without forecasts."""
    forecast_phase: Float[np.ndarray, " M"]
    """Phases of every forecast."""
    forecast_mean: Float[np.ndarray, "S M 6"]
    """Forecast of the whole motion."""
    forecast_std: Float[np.ndarray, "S M 6"]
    """Its standard deviation [m, rad]."""

    def __post_init__(self) -> None:
        config = MappingProxyType(dict(self.door_config))
        object.__setattr__(self, "door_config", config)
        sizes = {
            "T": np.size(self.times),
            "nq": np.shape(self.qpos)[-1],
            "J": np.shape(self.joint_pos)[-1],
            "S": np.size(self.forecast_times),
            "M": np.size(self.forecast_phase),
        }
        for name, declared in ARRAYS.items():
            dtype = np.bool_ if declared is Flag else np.float64
            array: np.ndarray = np.array(getattr(self, name), dtype)
            axes = declared.dim_str.split()
            expected = tuple(int(sizes.get(axis, axis)) for axis in axes)
            if array.shape != expected:
                raise ValueError(
                    f"EpisodeLog.{name} has shape {array.shape}, expected {expected}"
                )
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    def __repr__(self) -> str:
        """Return the episode and its end in one line."""
        ended = "opened" if self.success else self.failure or "not opened"
        return (
            f"EpisodeLog({self.policy} on {self.door}, seed {self.seed}, "
            f"{len(self.times)} steps, {ended})"
        )

    @property
    def radius(self) -> float:
        """Distance from hinge to handle [m]."""
        return self.config.radius

    @property
    def config(self) -> DoorConfig:
        """The door."""
        return DoorConfig(**self.door_config)

    def first_forecast(
        self, phases: Number
    ) -> tuple[Float[np.ndarray, "T 6"], Float[np.ndarray, "T 6"]]:
        """Mean and standard deviation of the agent's first forecast at some phases.

        Raises:
            IndexError: The policy makes no forecasts.
        """
        mean, std = self.forecast_mean[0], self.forecast_std[0]
        return (
            interpolated(phases, self.forecast_phase, mean),
            interpolated(phases, self.forecast_phase, std),
        )

    def save(self, path: str | Path) -> None:
        """Write the log as .npz, complete or not at all."""
        arrays: dict[str, Any] = {name: getattr(self, name) for name in ARRAYS}
        header = {name: getattr(self, name) for name in _HEADER}
        header["door_config"] = dict(self.door_config)
        arrays["header"] = np.array(json.dumps(header))
        write_archive(path, kind=KIND, version=VERSION, arrays=arrays)

    @classmethod
    def load(cls, path: str | Path) -> "EpisodeLog":
        """Read what `save` wrote.

        Raises:
            FileNotFoundError: There is no such file.
            ValueError: The file is truncated, contains something else or has another
                version.
        """
        return read_archive(path, kind=KIND, version=VERSION, build=cls._of)

    @classmethod
    def _of(cls, members: Members) -> "EpisodeLog":
        arrays: dict[str, Any] = {}
        for name in ARRAYS:
            former = _FORMERLY.get(name, name)
            stored = former if former in members else name
            if stored in members or name not in _LATER:
                arrays[name] = members(stored)
        steps = np.shape(arrays["times"])
        for name, value in _LATER.items():
            arrays.setdefault(name, np.full((*steps, *np.shape(value)), value))
        header = settings(members("header"))
        for name, declared in _HEADER.items():
            if not isinstance(header.get(name), declared):
                raise ValueError(f"its {name} is {header.get(name)!r:.40}")
        return cls(**(header | arrays))


ARRAYS: Final[Mapping[str, Any]] = MappingProxyType(
    {
        field.name: field.type
        for field in dataclasses.fields(EpisodeLog)
        if hasattr(field.type, "dim_str")
    }
)
"""Every array with its declared shape, by name."""

PER_STEP: Final = tuple(
    name for name, declared in ARRAYS.items() if declared.dim_str.split()[0] == "T"
)
"""Arrays with a row per control step."""

_LATER: Final[Mapping[str, Any]] = {
    "latency_wall_s": np.nan,
    "frame": np.eye(3),
    **dict.fromkeys(("path_size", "path_size_std", "heading", "heading_std"), np.nan),
    **dict.fromkeys(("mode", "mode_probability"), np.nan),
    **dict.fromkeys(("expected_force", "expected_force_std"), np.full(3, np.nan)),
}
"""Arrays that older files of this version lack, with their values there."""

_FORMERLY: Final = {"compensated_load": "carried_load", "path_lag": "give"}
"""Names of arrays in older files of this version."""

_HEADER: Final[Mapping[str, Any]] = {
    field.name: get_origin(field.type) or field.type
    for field in dataclasses.fields(EpisodeLog)
    if field.name not in ARRAYS
}
"""Every other field with its type, by name."""
