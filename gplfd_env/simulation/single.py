"""Physics and commands of one simulation, independent of the task."""

from typing import Any, Final, NamedTuple

import mujoco

from gplfd_env.conventions.constants import CONTROL_PERIOD, Array
from gplfd_env.doors.motion import end_angle
from gplfd_env.doors.variation import Variation
from gplfd_env.robot.config import RobotConfig
from gplfd_env.robot.mobile_base import BASE_DRIVES
from gplfd_env.robot.model import GRIPS, Hold
from gplfd_env.scene.build import GRASP_KEY, build_scene, load_scene
from gplfd_env.scene.door import set_hinge, structure_of
from gplfd_env.simulation.command import Command, ExtraInputs, ServoGains

_BAD: Final = mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQACC
BAD_STATE: Final = slice(int(_BAD[0]), int(_BAD[1]) + 1)
"""MuJoCo's warnings about a diverged state, which MuJoCo resets."""


class Robot(NamedTuple):
    """The robot of a simulation, its hold of the handle, and its kind of command."""

    hold: Hold
    command: Command
    config: RobotConfig

    def scene(self, variation: Variation) -> dict[str, Any]:
        """Return arguments of `gplfd_env.scene.build.build_scene` and `load_scene`."""
        door, placement, standoff = variation.scene
        drawn = {"door": door, "placement": placement, "standoff": standoff}
        kind = {"grasp": self.hold, "control": self.command.control}
        return drawn | kind | {"robot": self.config}

    def loaded_bodies(self, model: mujoco.MjModel) -> tuple[int, ...]:
        """Return the bodies on which `Loads.wrenches` act."""
        names = self.config.tool, self.config.forearm, "door"
        return tuple(model.body(name).id for name in names)

    def controls(self, model: mujoco.MjModel) -> tuple[slice, slice]:
        """Return the slices of the controls with the base's rate and the fingers.

        They are empty if the base is fixed or the fingers stay.
        """
        drives = BASE_DRIVES if self.config.base == "mobile" else ()
        grips = GRIPS if self.hold == "gripper" else ()
        first = [model.actuator(x[0]).id if x else 0 for x in (drives, grips)]
        rate, width = model.actuator_ctrladr[first].tolist()
        return slice(rate, rate + len(drives)), slice(width, width + len(grips))


class DoorSimulation:
    """One simulation; for many see `gplfd_env.simulation.batch.DoorBatch`.

    A deep or unpickled copy is an independent simulation in the same state.
    """

    def __init__(self, robot: Robot, begin: Variation) -> None:
        self._robot, self.variation = robot, begin
        self._build(begin)

    def _build(self, variation: Variation) -> None:
        """Build a new model, for a door of another structure."""
        self.model = build_scene(**self._robot.scene(variation))
        self.data = mujoco.MjData(self.model)
        self._bind()

    def _bind(self) -> None:
        """Keep the live views of model and data that every step needs."""
        model, data = self.model, self.data
        self.sensordata: Array = data.sensordata
        self._pose: Array = data.ctrl[:6]
        rate, fingers = self._robot.controls(model)
        self._rate: Array = data.ctrl[rate]
        self._fingers: Array = data.ctrl[fingers]
        bodies = self._robot.loaded_bodies(model)
        self._loaded = [data.xfrc_applied[body] for body in bodies]
        self._divergences = data.warning.number[BAD_STATE]
        impedance = self._robot.command.control == "impedance"
        self._gains = ServoGains(model) if impedance else None
        self._substeps = round(CONTROL_PERIOD / model.opt.timestep)

    def restart(self, variation: Variation) -> None:
        """Start at rest with a door; raise a ValueError before if out of reach."""
        now, door = self.variation, variation.door
        if structure_of(door) != structure_of(now.door):
            self._build(variation)
        elif variation.scene != now.scene:
            load_scene(self.model, self.data, **self._robot.scene(variation))
        if not now.disturbance.idle:
            set_hinge(self.model, end_angle(door), door.friction)
        self.variation = variation
        mujoco.mj_resetDataKeyframe(self.model, self.data, GRASP_KEY)
        # Before the forward pass: the first observation must not depend on the gains
        # that the last episode ended with.
        self._apply(self._robot.command.resting(variation, self._robot.config))
        mujoco.mj_forward(self.model, self.data)

    def advance(self, command: Array, inputs: ExtraInputs) -> bool:
        """Simulate one control period; return whether MuJoCo reports divergence."""
        self._apply(command)
        for rate in inputs.base_rates.values():
            self._rate[:] = rate
        for width in inputs.gripper_widths.values():
            self._fingers[:] = 0.5 * width
        for load in inputs.loads.values():
            set_hinge(self.model, load.stop, load.friction)
            for applied, wrench in zip(self._loaded, load.wrenches, strict=True):
                applied[:] = wrench
        mujoco.mj_step(self.model, self.data, nstep=self._substeps)
        return any(self._divergences.tolist())

    def _apply(self, command: Array) -> None:
        self._pose[:] = command[:6]
        if self._gains is not None:
            self._gains.set(command[6:])

    def __getstate__(self) -> tuple[Any, ...]:
        return self._robot, self.variation, self.model, self.data

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        self._robot, self.variation, self.model, data = state
        # A copied MjData has its own model, and views do not survive a copy.
        self.data = mujoco.MjData(self.model)
        mujoco.mj_copyData(self.data, self.model, data)
        self._bind()
