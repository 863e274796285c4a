"""One demonstration while it is given, and its replay from the inputs alone."""

import math
from typing import Any, Final

import mujoco
import numpy as np
from jaxtyping import Float, UInt8

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.doors.config import DoorConfig
from gplfd_env.spatial.rotation_paths import unwrap_rotvecs
from gplfd_experiments.episodes.build import make_environment
from gplfd_experiments.episodes.task import episode_task
from gplfd_experiments.teaching.lead import Lead, View
from gplfd_experiments.teaching.taught import Taught
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.demonstrations.rests import without_rests

SIZE: Final = (480, 360)
"""Width and height of the pictures [px]."""

_LONGEST: Final = 6000
"""Control periods after which a demonstration ends by itself: a minute."""


class Lesson:
    """A hand on the handle of a closed door that a person leads, step by step.

    An input is a sample of the device (`gplfd_experiments.teaching.lead.INPUTS`). It
    moves the simulation by one control period, whenever it comes, so that equal inputs
    give equal demonstrations. The picture is drawn from above, of a flap from the side.
    """

    def __init__(self, name: str, door: DoorConfig, *, drawn: bool) -> None:
        self.name, self.door = name, door
        self._camera = "overview" if door.motion == "flap" else "top"
        self._made = make_environment(
            episode_task(name, door, policy="gp", seed=0),
            "impedance",
            render_mode="rgb_array" if drawn else None,
            camera_name=self._camera,
            width=SIZE[0],
            height=SIZE[1],
        )
        # An episode that is solved goes on until the person ends it.
        self._env: Any = self._made.unwrapped
        self.restart()

    def restart(self) -> None:
        """Close the door and forget what was shown."""
        self._observation, self._info = self._env.reset(seed=0)
        shown = SIZE[0] / SIZE[1], self.door.motion
        self.view = View.of(self._env.data, self._camera, *shown)
        self.lead, self.over = Lead(self.view), ""
        self._inputs: list[Any] = []
        self._rows: list[tuple[Any, Any, Any]] = []
        self._note()

    def step(self, sample: Float[np.ndarray, " 9"]) -> None:
        """Lead the hand for one control period; `over` says why it has ended."""
        action = self.lead.command(sample, self._observation, self._info)
        self._observation, _, _, diverged, self._info = self._env.step(action)
        if diverged:
            self.over = "the simulation has diverged"
            return
        self._inputs.append(sample)
        self._note()
        if self._info["failure"] == "grasp_lost":
            self.over = "the hand has lost the handle"
        elif len(self._inputs) >= _LONGEST:
            self.over = "it has lasted a minute"

    def _note(self) -> None:
        pose, wrench = self._observation["ee_pose"], self._observation["wrench"]
        self._rows.append((pose, -wrench, self._env.data.qpos.copy()))

    @property
    def state(self) -> dict[str, Any]:
        """What a person wants to know while leading, in JSON."""
        pose, wrench, _ = self._rows[-1]
        return {
            "door": self.name,
            "angle": math.degrees(self._info["door_angle"]),
            "force": float(np.linalg.norm(wrench[:3])),
            "time": len(self._inputs) * CONTROL_PERIOD,
            "hand": self.view.place(pose[:3]),
            "target": self.view.place(self.lead.target),
        }

    def taught(self) -> Taught:
        """Return what was shown; raise a ValueError if the hand has not moved."""
        poses, wrenches, _ = map(np.array, zip(*self._rows, strict=True))
        poses[:, 3:] = unwrap_rotvecs(poses[:, 3:])
        times = CONTROL_PERIOD * np.arange(len(poses))
        return Taught(
            name=self.name,
            door=self.door,
            inputs=np.reshape(self._inputs, (-1, 9)),
            recorded=Demonstration(times=times, poses=poses, wrenches=wrenches),
        )

    def picture(self) -> UInt8[np.ndarray, "h w 3"]:
        """Return the scene from the camera."""
        return np.asarray(self._env.render())

    def moving(self) -> list[int]:
        """Return the numbers of the samples that are no pause."""
        recorded = self.taught().recorded
        rests, times = without_rests(recorded)[1], recorded.times
        paused = [(times >= rest.start) & (times < rest.end) for rest in rests]
        return np.flatnonzero(~np.any([times < 0.0, *paused], axis=0)).tolist()

    def show(self, sample: int) -> None:
        """Put the scene into the state of a sample; then only `restart` goes on."""
        data = self._env.data
        data.qpos[:] = self._rows[sample][2]
        mujoco.mj_forward(data.model, data)

    def close(self) -> None:
        """Free the renderer."""
        self._made.close()


def replay(taught: Taught) -> Taught:
    """Lead the hand by recorded inputs; the demonstration is the same, bit for bit."""
    lesson = Lesson(taught.name, taught.door, drawn=False)
    for sample in taught.inputs:
        lesson.step(sample)
    return lesson.taught()
