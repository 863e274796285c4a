"""Episodes that a person leads, alone or while a policy acts, and what is kept of them.

A set of demonstrations is a folder with `demonstrations.npz`, like every set, and the
folder `taught` with the complete recordings. Demonstrations that are missing in the
file are added when the set is next opened, so that no kept demonstration is lost.
"""

import json
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Final, Self

import mujoco
import numpy as np
from jaxtyping import UInt8

from gplfd_env.conventions.constants import CONTROL_PERIOD, Control
from gplfd_env.doors import config, geometry
from gplfd_env.robot.model import SERVO_STIFFNESS
from gplfd_env.spatial import rotation_paths, se3
from gplfd_experiments.console.arguments import check_folder
from gplfd_experiments.data.teacher.motion import minimum_jerk
from gplfd_experiments.episodes.build import make_environment
from gplfd_experiments.episodes.leading import BLEND_TIME, LOST, PULLS, LedAgent
from gplfd_experiments.episodes.task import EpisodeTask, episode_task
from gplfd_experiments.files.provenance import provenance
from gplfd_policies.arrays.shapes import Float, Pose, Vectors
from gplfd_policies.arrays.storage import Members, read_archive, settings, write_archive
from gplfd_policies.control.steps import AgentStep, Observation
from gplfd_policies.demonstrations import alignment, npz
from gplfd_policies.demonstrations.demonstration import Correction, Demonstration, Who
from gplfd_policies.movements.movement import Movement
from gplfd_policies.movements.skill import Skill
from gplfd_policies.registry.method import Method

_FOLDER: Final = "taught"  # Folder of a set with a file per demonstration.
_KIND: Final = "a gplfd taught demonstration"
_VERSION: Final = 1

Sample = Float[np.ndarray, " 9"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Taught:
    """A demonstration of a person at a door, with the inputs."""

    name: str
    door: config.DoorConfig
    inputs: Float[np.ndarray, "N 9"]
    """A sample of the device per control period, `INPUTS`."""
    recorded: Demonstration
    """Motion and wrenches of the hand, N + 1 samples from the closed handle on."""

    @property
    def demonstration(self) -> Demonstration:
        """Demonstration for learning: without pauses, relative to its first pose."""
        return alignment.without_rests(self.recorded)[0].relative_to_first()


class TaughtSet:
    """The demonstrations in a folder; ValueError if it holds something else."""

    def __init__(self, folder: Path, options: Mapping[str, Any]) -> None:
        check_folder(folder)
        names = [path.name for path in folder.glob("*")]
        if names and _FOLDER not in names:
            raise ValueError(
                f"{folder} exists and is no set of gplfd demos teach; give another "
                "folder"
            )
        self.place, self._options = folder, options
        self.kept = read_taught(folder)
        if self.kept:
            self._write_index()

    def keep(self, taught: Taught) -> None:
        """Save a demonstration."""
        numbers = [int(file.stem) for file in _files(self.place)]
        arrays = {
            "door": np.array(json.dumps({taught.name: taught.door.as_dict()})),
            "origin": np.array(json.dumps(provenance(self._options))),
            "inputs": taught.inputs,
            "times": taught.recorded.times,
            "poses": taught.recorded.poses,
            "wrenches": taught.recorded.wrenches,
        }
        file = self.place / _FOLDER / f"{max(numbers, default=0) + 1:04d}.npz"
        write_archive(file, kind=_KIND, version=_VERSION, arrays=arrays)
        self.kept.append(taught)
        try:
            self._write_index()
        except OSError:  # It can be kept again, but not stored twice.
            self.kept.pop()
            file.unlink()
            raise

    def _write_index(self) -> None:
        npz.save_demonstrations(
            self.place / npz.FILE,
            [taught.demonstration for taught in self.kept],
            [taught.door.radius for taught in self.kept],
        )


def read_taught(folder: Path) -> list[Taught]:
    """Return the demonstrations of a set, in the order in which they were kept."""
    return [
        read_archive(file, kind=_KIND, version=_VERSION, build=_taught)
        for file in _files(folder)
    ]


def _files(folder: Path) -> list[Path]:
    return sorted((folder / _FOLDER).glob("[0-9][0-9][0-9][0-9].npz"))


def _taught(members: Members) -> Taught:
    [(name, door)] = settings(members["door"]).items()
    inputs = members["inputs"]
    times, poses, wrenches = map(members.__getitem__, ("times", "poses", "wrenches"))
    if inputs.shape != (len(times) - 1, 9):
        raise ValueError(f"inputs have shape {inputs.shape} for {len(times)} poses")
    return Taught(
        name=name,
        door=config.door_config(door),
        inputs=inputs,
        recorded=Demonstration(times=times, poses=poses, wrenches=wrenches),
    )


class CorrectedSkill:
    """A skill that learns from corrections, and its file."""

    def __init__(self, method: Method, skill: Skill, place: Path) -> None:
        self.method, self.place = method, place
        self.skill: Movement = skill
        self.kept: list[Correction] = []

    def keep(self, correction: Correction) -> None:
        """Learn from a correction, and save skill and correction."""
        skill = self.method.update(self.skill, correction)
        if isinstance(skill, Skill):
            skill.save(self.place)
        self.skill = skill
        self.kept.append(correction)


INPUTS: Final = ("held", "u", "v", "x", "y", "z", "about_x", "about_y", "about_z")
"""Sample of a device in a control period: whether the pointer is pressed, its position
in the picture from the left and from the top in widths and heights, and six deflections
(keys, wheel, SpaceMouse) from -1 to 1 along and about the axes of the task frame."""

SPRING: Final = (300.0, 100.0)  # Stiffness of the virtual spring [N/m, N m/rad].
_FORCE: Final = 45.0  # Largest force of the spring [N].
_ACROSS: Final = 0.1  # Share of the stiffness across the motion of a moving hand.
_MOVING: Final = 0.05  # Speed from which a hand counts as moving [m/s].
_SPEED: Final = 0.3  # Speed of the target at full deflection [m/s].
_TURN: Final = 0.1  # Deflection of the wrist's spring at full input [rad]: 10 N m.


def checked_input(values: object) -> Sample:
    """Return a sample of `INPUTS`, or raise ValueError; deflections within ±1."""
    try:
        sample = np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        sample = np.empty(0)
    if sample.shape != (len(INPUTS),) or not np.isfinite(sample).all():
        raise ValueError(
            f"an input must be {len(INPUTS)} finite numbers {', '.join(INPUTS)}; got "
            f"{values!r:.80}"
        )
    sample[3:] = np.clip(sample[3:], -1.0, 1.0)
    return sample


@dataclass(frozen=True, kw_only=True, slots=True)
class CameraView:
    """A static camera: position and axes (right, up, back) in the task frame.

    A position in the picture stands for a point in a plane with the normal `normal`, in
    which the door moves the hand.
    """

    position: Vectors
    axes: Float[np.ndarray, "3 3"]
    extent: tuple[float, float]
    """Half the width and height of the picture at a distance of 1."""
    normal: Vectors

    @classmethod
    def of(cls, data: mujoco.MjData, camera: str, aspect: float, level: bool) -> Self:
        """Return the view of a scene's camera; `level`: the door has a level hinge."""
        task, seen = data.site("task_frame"), data.camera(camera)
        to_task = task.xmat.reshape(3, 3).T
        fovy = float(data.model.camera(camera).fovy[0])
        height = math.tan(math.radians(fovy) / 2.0)
        return cls(
            position=to_task @ (seen.xpos - task.xpos),
            axes=to_task @ seen.xmat.reshape(3, 3),
            extent=(aspect * height, height),
            normal=np.array([0.0, 0.0, 1.0] if level else [0.0, 1.0, 0.0]),
        )

    def point(self, u: float, v: float, level: Vectors) -> Vectors | None:
        """Return the point in the plane through `level`, or None beyond its horizon."""
        width, height = self.extent
        ray = self.axes @ [(2.0 * u - 1.0) * width, (1.0 - 2.0 * v) * height, -1.0]
        along = float(self.normal @ ray)
        distance = float(self.normal @ (level - self.position))
        if not distance / along > 0.0 if along else True:
            return None
        return np.asarray(self.position + distance / along * ray)

    def place(self, point: Vectors) -> tuple[float, float]:
        """Return the position of a point in the picture, (u, v)."""
        right, up, back = self.axes.T @ (point - self.position)
        width, height = self.extent
        return 0.5 - 0.5 * right / (back * width), 0.5 + 0.5 * up / (back * height)


class Lead:
    """Target of the hand, moved by a device; `servo`: stiffness of the arm [N/m]."""

    def __init__(
        self, view: CameraView, *, force: float = _FORCE, servo: float = SPRING[0]
    ) -> None:
        self._view, self._reach = view, force / SPRING[0]
        self._give = SPRING[0] / servo
        self.target: Vectors = np.zeros(3)
        """Target of the spring [m]."""
        self._grip: Vectors | None = None
        self._level, self._active = np.zeros(3), False

    def command(self, sample: Sample, observation: Observation, wrist: Vectors) -> Pose:
        """Return the commanded pose of the hand for a control period [m, rad].

        `wrist` is its rotation vector without deflections about the axes. Pressing the
        pointer does not move the hand; after release, the hand keeps its position.
        """
        hand, velocity = observation["ee_pose"][:3], observation["ee_twist"][:3]
        shift = _SPEED * CONTROL_PERIOD * sample[3:6]
        held, deflected = bool(sample[0]), bool(sample[3:6].any())
        if held:
            if self._grip is None:
                self._level = hand
            point = self._view.point(sample[1], sample[2], self._level)
            if point is not None:
                start = hand - point if self._grip is None else self._grip
                self._grip = start + shift
                self.target = point + self._grip
        else:
            self._grip = None
            let_go = self._active and not deflected
            self.target = (hand if let_go else self.target) + shift
        self._active = held or deflected
        error = self.target - hand
        error *= self._reach / max(self._reach, float(np.linalg.norm(error)))
        if not held:
            self.target = hand + error
        speed = float(np.linalg.norm(velocity))
        along = velocity * (velocity @ error) / speed**2 if speed else error
        moving = (1.0 - _ACROSS) * min(1.0, speed / _MOVING)
        stretch = moving * along + (1.0 - moving) * error
        turned = se3.compose_rotvecs(_TURN * sample[6:], wrist)
        return np.concatenate([hand + self._give * stretch, turned])


class LeadingPerson:
    """Leads the hand of a policy while a device is held or deflected, as a `Leader`.

    The pull is limited, and taking the hand and handing it over are blended.
    """

    by: Who = "person"

    def __init__(self, view: CameraView) -> None:
        self._view = view

    def begin(self, door: geometry.DoorGeometry) -> None:
        """Watch an episode at a door."""
        self._door = door
        force = PULLS[door.travel > 0.0]
        self.spring = Lead(self._view, force=force, servo=SERVO_STIFFNESS[0])
        self._share = 0.0  # blend from the policy's command (0) to the person's (1)

    def take(self, sample: Sample, handle_angle: float) -> None:
        """Set the sample of the next control period, and the handle's angle [rad]."""
        self._sample, self._turn = sample, handle_angle

    def lead(self, observation: Observation, step: AgentStep) -> Pose | None:
        """Return the command while the hand is led or handed over."""
        active = bool(self._sample[0] or self._sample[3:].any())
        change = CONTROL_PERIOD / BLEND_TIME
        self._share = np.clip(self._share + (change if active else -change), 0.0, 1.0)
        if active:
            self._held = self._sample  # It continues to pull during the hand-over.
        elif self._share == 0.0:
            self.spring.target = np.array(observation["ee_pose"][:3])
            return None
        angle = self._door.angle(observation["ee_pose"][:3])
        wrist = self._door.easy_hand_poses(angle, self._turn)[3:]
        pose = self.spring.command(self._held, observation, wrist)
        share = minimum_jerk(np.array(self._share))
        return np.asarray((1.0 - share) * step.action + share * pose)


SIZE: Final = (480, 360)  # Width and height of the pictures [px].


class Lesson(ABC):
    """A person leads a hand on the handle of a closed door, step by step.

    Each input, `INPUTS`, advances the simulation by one control period, independent of
    real time: equal inputs give equal recordings. The picture is from above.
    """

    longest: ClassVar[int]  # Of an episode, in control periods.
    control: ClassVar[Control]
    invitation: ClassVar[str]  # Text for the person before an episode.
    request: ClassVar[str]  # Text for the person during an episode.

    def __init__(self, task: EpisodeTask, *, drawn: bool) -> None:
        self.task, self.door = task, config.DoorConfig(**task.door_config)
        self._camera = "overview" if self.door.level else "top"
        self._made = make_environment(
            task,
            self.control,
            render_mode="rgb_array" if drawn else None,
            camera_name=self._camera,
            width=SIZE[0],
            height=SIZE[1],
        )
        # The person ends the episode, or this class.
        self._env: Any = self._made.unwrapped
        self.restart()

    def restart(self) -> None:
        """Close the door and delete the recording."""
        self._observation, self._info = self._env.reset(seed=self.task.reset_seed)
        aspect = SIZE[0] / SIZE[1]
        self.view = CameraView.of(self._env.data, self._camera, aspect, self.door.level)
        self.over, self._inputs, self._rows = "", list[Any](), list[Any]()
        self.spring = self._begin()
        self._note()

    def _begin(self) -> Lead:
        """Begin an episode; return the spring by which the person leads."""
        return Lead(self.view)

    @abstractmethod
    def _action(self, sample: Sample) -> Float[np.ndarray, " n"]:
        """Return the action of the environment."""

    @abstractmethod
    def record(self) -> Any:
        """Return the recording of the episode so far."""

    @abstractmethod
    def result(self) -> str:
        """Return a text about the result; raise a ValueError if it cannot be kept."""

    def step(self, sample: Sample) -> None:
        """Simulate one control period; `over` is the reason for the end."""
        action = self._action(sample)
        self._observation, _, _, diverged, self._info = self._env.step(action)
        if diverged:
            self.over = "the simulation has diverged"
            return
        self._inputs.append(sample)
        self._note()
        if self._info["failure"] == LOST:
            self.over = "the hand has lost the handle"
        elif len(self._inputs) >= self.longest:
            self.over = f"it has lasted {self.longest * CONTROL_PERIOD:g} s"

    def _note(self) -> None:
        pose, wrench = self._observation["ee_pose"], self._observation["wrench"]
        self._rows.append((pose, -wrench, self._env.data.qpos.copy()))

    @property
    def state(self) -> dict[str, Any]:
        """State of the lesson for the page, as JSON."""
        pose, wrench, _ = self._rows[-1]
        return {
            "door": self.task.door,
            "angle": math.degrees(self._info["door_angle"]),
            "force": float(np.linalg.norm(wrench[:3])),
            "time": len(self._inputs) * CONTROL_PERIOD,
            "hand": self.view.place(pose[:3]),
            "target": self.view.place(self.spring.target),
        }

    @property
    def motion(self) -> Demonstration:
        """Motion and wrenches of the hand; raises a ValueError if it has not moved."""
        poses, wrenches, _ = map(np.array, zip(*self._rows, strict=True))
        poses[:, 3:] = rotation_paths.unwrap_rotvecs(poses[:, 3:])
        times = CONTROL_PERIOD * np.arange(len(poses))
        return Demonstration(times=times, poses=poses, wrenches=wrenches)

    def picture(self) -> UInt8[np.ndarray, "h w 3"]:
        """Return the scene from the camera."""
        return np.asarray(self._env.render())

    def moving(self) -> list[int]:
        """Return the indices of samples without pauses; ValueError if empty."""
        try:
            recorded = self.motion
            rests, times = alignment.without_rests(recorded)[1], recorded.times
        except ValueError:
            raise ValueError("No demonstration: the hand did not move") from None
        paused = [(times >= rest.start) & (times < rest.end) for rest in rests]
        return np.flatnonzero(~np.any([times < 0.0, *paused], axis=0)).tolist()

    def show(self, sample: int) -> None:
        """Set the scene to the state of a sample; then only `restart` is possible."""
        data = self._env.data
        data.qpos[:] = self._rows[sample][2]
        mujoco.mj_forward(data.model, data)

    def close(self) -> None:
        """Free the renderer."""
        self._made.close()


class DemonstrationLesson(Lesson):
    """A demonstration: the person alone leads the compliant hand."""

    longest, control = 6000, "impedance"
    invitation = "Lead the hand to open the door."
    request = "Stop when the door is open far enough."

    def __init__(self, name: str, door: config.DoorConfig, *, drawn: bool) -> None:
        super().__init__(episode_task(name, door, policy="gp", seed=0), drawn=drawn)

    def _action(self, sample: Sample) -> Float[np.ndarray, " 12"]:
        angle, turn = self._info["door_angle"], self._info["handle_angle"]
        wrist = self._env.door_geometry.easy_hand_poses(angle, turn)[3:]
        pose = self.spring.command(sample, self._observation, wrist)
        return np.concatenate([pose, np.repeat(SPRING, 3)])

    def record(self) -> Taught:
        """Return the demonstration; raise a ValueError if the hand has not moved."""
        return Taught(
            name=self.task.door,
            door=self.door,
            inputs=np.reshape(self._inputs, (-1, 9)),
            recorded=self.motion,
        )

    def result(self) -> str:
        """Return a text about the result, with the reason of an automatic end."""
        over = self.over and f"It ended: {self.over}. "
        return f"{over}This is your demonstration."


class CorrectionLesson(Lesson):
    """An episode of a policy, which acts while the person does not lead the hand."""

    longest, control = 3000, "pose"
    invitation = "Press Start: the policy opens the door."
    request = "Lead the hand where the policy fails; then the policy continues."

    def __init__(
        self, task: EpisodeTask, store: CorrectedSkill, device: str, *, drawn: bool
    ) -> None:
        self._store, self._device = store, device
        super().__init__(task, drawn=drawn)

    def _begin(self) -> Lead:
        self._person = LeadingPerson(self.view)
        agent = self._store.method.follow(self._store.skill)
        self._agent = LedAgent(agent, self._person)
        self._agent.inform(self._env.door_geometry)
        self._agent.reset(self._observation)
        return self._person.spring

    def _action(self, sample: Sample) -> Pose:
        self._person.take(sample, float(self._info["handle_angle"]))
        return self._agent.act(self._observation).command(self.control)

    def step(self, sample: Sample) -> None:
        """Simulate one control period, until the door is open."""
        super().step(sample)
        if self._info["success"]:
            self.over = "the door is open"

    def record(self) -> Correction:
        """Return the correction; raise a ValueError if there is none."""
        correction = self._agent.correction(door=self.task.door, seed=self.task.seed)
        if correction is None:
            raise ValueError(f"{self._ended}. The hand was not led: nothing to keep")
        if self._info["failure"] in (LOST, "simulation_error"):
            raise ValueError(f"{self._ended}. This gives no correction")
        return replace(correction, device=self._device, inputs=np.array(self._inputs))

    def result(self) -> str:
        """Return how the episode ended, and the time of leading."""
        return f"{self._ended}. You led the hand for {self.record().seconds:.1f} s."

    @property
    def _ended(self) -> str:
        if self._info["success"]:
            return "The door is open"
        angle, why = round(self.state["angle"]), self.over or "you stopped"
        return f"The door is not open, at {angle}°: {why}"


def replay(taught: Taught) -> Taught:
    """Lead the hand by recorded inputs; the demonstration is equal, bit for bit."""
    lesson = DemonstrationLesson(taught.name, taught.door, drawn=False)
    for sample in taught.inputs:
        lesson.step(sample)
    return lesson.record()
