"""Log of an episode: arrays over the control steps.

Metrics, figures and recordings read logs; none of them simulates.
"""

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, Self, get_origin

import numpy as np
from jaxtyping import Bool, Float

from gplfd_env.doors.config import DoorConfig
from gplfd_policies.arrays.records import interpolated
from gplfd_policies.arrays.storage import Members, read_archive, settings, write_archive

NumberSeries = Float[np.ndarray, " T"]
PoseSeries = Float[np.ndarray, "T 6"]
FlagSeries = Bool[np.ndarray, " T"]

# Kind of the file, stated in it, and version of its layout.
KIND, VERSION = "a gplfd episode log", 1


class _Arrays:
    """A record whose fields are arrays; it owns them."""

    __slots__ = ()

    def __post_init__(self) -> None:
        for name, declared in arrays_of(type(self)).items():
            dtype = np.bool_ if declared is FlagSeries else np.float64
            array: np.ndarray = np.array(getattr(self, name), dtype)
            object.__setattr__(self, name, array)

    @classmethod
    def of(cls, arrays: Mapping[str, Any]) -> Self:
        """Take the record's arrays out of a mapping by their names."""
        return cls(**{name: arrays[name] for name in arrays_of(cls)})


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodeMotion(_Arrays):
    """Motion of the robot, and the state of the whole model."""

    ee_pose: PoseSeries
    """Hand pose."""
    ee_twist: PoseSeries
    """Hand velocity [m/s, rad/s]."""
    joint_pos: Float[np.ndarray, "T J"]
    """Arm joint positions [rad]."""
    joint_vel: Float[np.ndarray, "T J"]
    """Arm joint velocities [rad/s]."""
    base_shift: NumberSeries
    """Displacement of the base [m]."""
    qpos: Float[np.ndarray, "T nq"]
    """Generalised positions of the whole model."""


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodeOpening(_Arrays):
    """State of the door and of the grasp."""

    door_angle: NumberSeries
    """Opening angle of the door [rad]."""
    handle_angle: NumberSeries
    """Rotation angle of a lever or knob [rad]."""
    handle_pose: PoseSeries
    """True pose of the handle."""
    capability: NumberSeries
    """The furthest stage so far, an index of `gplfd_env.task.opening.STAGES`."""
    solved: FlagSeries
    """Whether the task counts as solved at this step."""
    grasped: FlagSeries
    """Whether the hand holds the handle."""
    slip: NumberSeries
    """Distance of the hand from where it grasped the handle [m]."""


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodeForces(_Arrays):
    """Forces at the handle and from outside."""

    wrench: PoseSeries
    """Force and torque of the door on the hand [N, N m]."""
    force_tangential: NumberSeries
    """Force of the hand on the handle along its motion [N]."""
    force_radial: NumberSeries
    """Force of the hand on the handle away from the hinge [N]."""
    force_vertical: NumberSeries
    """Force of the hand on the handle upwards [N]."""
    push_force: NumberSeries
    """External pushing force [N]."""
    person_force: NumberSeries
    """Greatest force between a person and hand or door since the last step [N]."""
    person_energy: NumberSeries
    """Work done on the person so far [J]."""
    stop_force: NumberSeries
    """Force of the door on a stop, converted to the handle [N]."""
    closer_torque: NumberSeries
    """Closing torque of closer, seal and stiction [N m]."""


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodeDecisions(_Arrays):
    """Decisions of the agent, as in `gplfd_policies.control.steps.AgentStep`."""

    action: PoseSeries
    desired: PoseSeries
    frame: Float[np.ndarray, "T 3 3"]
    std: PoseSeries
    std_rate: PoseSeries
    stiffness: PoseSeries
    stiffness_rate: PoseSeries
    stability_margin: PoseSeries
    compensated_load: NumberSeries
    path_lag: NumberSeries
    phase: NumberSeries
    observed_phase: NumberSeries
    phase_misfit: NumberSeries
    path_size: NumberSeries
    path_size_std: NumberSeries
    heading: NumberSeries
    heading_std: NumberSeries
    predicted_mean: PoseSeries
    predicted_std: PoseSeries
    expected_force: Float[np.ndarray, "T 3"]
    expected_force_std: Float[np.ndarray, "T 3"]
    mode: NumberSeries
    mode_probability: NumberSeries
    via_point: FlagSeries
    latency_s: NumberSeries
    """CPU time of the agent's decision [s]; NaN where it was not measured."""
    latency_wall_s: NumberSeries
    """Wall time of the agent's decision [s]."""


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodeForecasts(_Arrays):
    """Forecasts of the whole motion; none of a policy without forecasts."""

    times: Float[np.ndarray, " S"]
    """When they were made [s]; the first is before the door has moved."""
    phases: Float[np.ndarray, " M"]
    """Phases of every forecast."""
    mean: Float[np.ndarray, "S M 6"]
    """Forecast pose."""
    std: Float[np.ndarray, "S M 6"]
    """Its standard deviation [m, rad]."""

    def first(self, phases: NumberSeries) -> tuple[PoseSeries, PoseSeries]:
        """Mean and standard deviation of the first forecast at some phases.

        Raises an IndexError if the policy makes no forecasts.
        """
        return (
            interpolated(phases, self.phases, self.mean[0]),
            interpolated(phases, self.phases, self.std[0]),
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodeLog:
    """One episode of one policy on one door.

    Row t of every per-step array is the state at ``times[t]`` and the agent's decision
    in this state. The last row is the state in which the episode ended; its action was
    computed but not executed. Poses are in the task frame [m, rad], T is the number of
    rows, J of joints of the arm, S of forecasts, M of phases in a forecast, nq of joint
    positions. Quantities that a policy does not compute (uncertainty, stiffness,
    prediction) are NaN. An array of another shape raises a ValueError.
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
    """Failure of `gplfd_env.task.opening`, or "time_limit"; "" for none."""
    reason: str
    """Cause of the failure, as there: such as "out_of_reach", or the failure."""

    times: NumberSeries
    """Simulated time since reset [s]."""
    motion: EpisodeMotion
    opening: EpisodeOpening
    forces: EpisodeForces
    decisions: EpisodeDecisions
    forecasts: EpisodeForecasts

    def __post_init__(self) -> None:
        times = np.array(self.times, np.float64)
        config = MappingProxyType(dict(self.door_config))
        for name, value in (("times", times), ("door_config", config)):
            object.__setattr__(self, name, value)
        sizes = {
            "T": times.size,
            "nq": self.motion.qpos.shape[-1],
            "J": self.motion.joint_pos.shape[-1],
            "S": self.forecasts.times.size,
            "M": self.forecasts.phases.size,
        }
        for part, record in PARTS.items():
            for name, declared in arrays_of(record).items():
                shape = getattr(getattr(self, part), name).shape
                axes = declared.dim_str.split()
                expected = tuple(int(sizes.get(axis, axis)) for axis in axes)
                if shape != expected:
                    array = f"EpisodeLog.{part}.{name}"
                    raise ValueError(f"{array} has shape {shape}, expected {expected}")

    def __repr__(self) -> str:
        """Return the episode and its end in one line."""
        ended = "opened" if self.success else self.failure or "not opened"
        episode = f"{self.policy} on {self.door}, seed {self.seed}"
        return f"EpisodeLog({episode}, {len(self.times)} steps, {ended})"

    @property
    def radius(self) -> float:
        """Distance from hinge to handle [m]."""
        return self.config.radius

    @property
    def config(self) -> DoorConfig:
        """The door."""
        return DoorConfig(**self.door_config)

    def save(self, path: str | Path) -> None:
        """Write the log as .npz, complete or not at all."""
        header = {name: getattr(self, name) for name in _HEADER}
        header["door_config"] = dict(self.door_config)
        arrays = {"header": np.array(json.dumps(header)), "times": self.times}
        for part, record in PARTS.items():
            for name in arrays_of(record):
                arrays[f"{part}.{name}"] = getattr(getattr(self, part), name)
        write_archive(path, kind=KIND, version=VERSION, arrays=arrays)

    @classmethod
    def load(cls, path: str | Path) -> "EpisodeLog":
        """Read what `save` wrote; raises a ValueError for any other file."""
        return read_archive(path, kind=KIND, version=VERSION, build=cls._of)

    @classmethod
    def _of(cls, members: Members) -> "EpisodeLog":
        header = settings(members["header"])
        for name, declared in _HEADER.items():
            if not isinstance(header.get(name), declared):
                raise ValueError(f"its {name} is {header.get(name)!r:.40}")
        parts: dict[str, Any] = {
            part: record(**{n: members[f"{part}.{n}"] for n in arrays_of(record)})
            for part, record in PARTS.items()
        }
        return cls(**header, times=members["times"], **parts)


def arrays_of(record: type[Any]) -> dict[str, Any]:
    """Return the declared shape of every array of a record, by name."""
    return {field.name: field.type for field in dataclasses.fields(record)}


PARTS: Final[Mapping[str, type[_Arrays]]] = {
    "motion": EpisodeMotion,
    "opening": EpisodeOpening,
    "forces": EpisodeForces,
    "decisions": EpisodeDecisions,
    "forecasts": EpisodeForecasts,
}
"""Records of arrays in a log, by field."""

PER_STEP: Final = tuple(
    name
    for part, record in PARTS.items()
    for name in arrays_of(record)
    if part != "forecasts"
)
"""Arrays with a row per control step, beside the times."""

_HEADER: Final[Mapping[str, Any]] = {
    field.name: get_origin(field.type) or field.type
    for field in dataclasses.fields(EpisodeLog)
    if field.name not in (*PARTS, "times")
}
"""Every other field with its type, by name."""
