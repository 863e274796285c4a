"""Episodes that a person leads, alone or while a policy acts, and their recording."""

import math
from abc import ABC, abstractmethod
from dataclasses import replace
from typing import Any, ClassVar, Final

import mujoco
import numpy as np
from jaxtyping import Float, UInt8

from gplfd_env.conventions.constants import CONTROL_PERIOD, Control
from gplfd_env.doors.config import DoorConfig
from gplfd_env.spatial.rotation_paths import unwrap_rotvecs
from gplfd_experiments.episodes.build import make_environment
from gplfd_experiments.episodes.leading import LedAgent
from gplfd_experiments.episodes.practice import LOST
from gplfd_experiments.episodes.task import EpisodeTask, episode_task
from gplfd_experiments.teaching.lead import SPRING, Lead, Person, View
from gplfd_experiments.teaching.taught import CorrectedSkill, Taught
from gplfd_policies.demonstrations.alignment import without_rests
from gplfd_policies.demonstrations.demonstration import Correction, Demonstration

SIZE: Final = (480, 360)  # Width and height of the pictures [px].


class Lesson(ABC):
    """A person leads a hand on the handle of a closed door, step by step.

    An input is a sample of the device (`gplfd_experiments.teaching.lead.INPUTS`). Each
    input advances the simulation by one control period, independent of real time, so
    that equal inputs give equal recordings. The picture is from above, for a flap from
    the side.
    """

    longest: ClassVar[int]  # Of an episode, in control periods.
    control: ClassVar[Control]
    invitation: ClassVar[str]  # Text for the person before an episode.
    request: ClassVar[str]  # Text for the person during an episode.

    def __init__(self, task: EpisodeTask, *, drawn: bool) -> None:
        self.task, self.door = task, DoorConfig(**task.door_config)
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
        self.view = View.of(self._env.data, self._camera, aspect, self.door.level)
        self.over, self._inputs, self._rows = "", list[Any](), list[Any]()
        self.spring = self._begin()
        self._note()

    @abstractmethod
    def _begin(self) -> Lead:
        """Begin an episode; return the spring by which the person leads."""

    @abstractmethod
    def _action(self, sample: Float[np.ndarray, " 9"]) -> Float[np.ndarray, " n"]:
        """Return the action of the environment."""

    @abstractmethod
    def record(self) -> Any:
        """Return the recording of the episode so far."""

    @abstractmethod
    def result(self) -> str:
        """Return a text about the result; raise a ValueError if it cannot be kept."""

    def step(self, sample: Float[np.ndarray, " 9"]) -> None:
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
        poses[:, 3:] = unwrap_rotvecs(poses[:, 3:])
        times = CONTROL_PERIOD * np.arange(len(poses))
        return Demonstration(times=times, poses=poses, wrenches=wrenches)

    def picture(self) -> UInt8[np.ndarray, "h w 3"]:
        """Return the scene from the camera."""
        return np.asarray(self._env.render())

    def moving(self) -> list[int]:
        """Return the indices of samples without pauses; ValueError if empty."""
        try:
            recorded = self.motion
            rests, times = without_rests(recorded)[1], recorded.times
        except ValueError:
            raise ValueError(
                "There is no demonstration: the hand did not move"
            ) from None
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

    def __init__(self, name: str, door: DoorConfig, *, drawn: bool) -> None:
        super().__init__(episode_task(name, door, policy="gp", seed=0), drawn=drawn)

    def _begin(self) -> Lead:
        return Lead(self.view)

    def _action(self, sample: Float[np.ndarray, " 9"]) -> Float[np.ndarray, " 12"]:
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
        self._person = Person(self.view)
        agent = self._store.method.follow(self._store.skill)
        self._agent = LedAgent(agent, self._person)
        self._agent.inform(self._env.door_geometry)
        self._agent.reset(self._observation)
        return self._person.spring

    def _action(self, sample: Float[np.ndarray, " 9"]) -> Float[np.ndarray, " 6"]:
        self._person.take(sample, float(self._info["handle_angle"]))
        return self._agent.act(self._observation).command(self.control)

    def step(self, sample: Float[np.ndarray, " 9"]) -> None:
        """Simulate one control period, until the door is open."""
        super().step(sample)
        if self._info["success"]:
            self.over = "the door is open"

    def record(self) -> Correction:
        """Return the correction; raise a ValueError if there is none."""
        correction = self._agent.correction(door=self.task.door, seed=self.task.seed)
        if correction is None:
            raise ValueError(
                f"{self._ended}. The hand was not led: there is nothing to keep"
            )
        if self._info["failure"] in (LOST, "simulation_error"):
            raise ValueError(f"{self._ended}. This gives no correction")
        return replace(correction, device=self._device, inputs=np.array(self._inputs))

    def result(self) -> str:
        """Return how the episode ended, and the time of leading."""
        seconds = self.record().seconds
        return f"{self._ended}. You led the hand for {seconds:.1f} s."

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
