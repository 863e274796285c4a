"""Physics and commands of one robot before its door; knows no task."""

from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from gplfd_env.conventions.constants import CONTROL_PERIOD, Base
from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.variation import Variation
from gplfd_env.robot.mobile_base import BASE_DRIVES
from gplfd_env.robot.model import FOREARM, GRIPPER, GRIPS, Hold
from gplfd_env.robot.whole_body import Planar
from gplfd_env.scene.build import GRASP_KEY, build_scene, load_scene
from gplfd_env.scene.door import set_hinge, structure_of
from gplfd_env.simulation.command import Command, ServoGains
from gplfd_env.simulation.loads import Loads

Array = NDArray[np.float64]

BAD_STATE: Final = slice(
    int(mujoco.mjtWarning.mjWARN_BADQPOS), int(mujoco.mjtWarning.mjWARN_BADQACC) + 1
)
"""MuJoCo's warnings that it has reset a diverged state."""


def loaded_bodies(model: mujoco.MjModel) -> tuple[int, ...]:
    """Return the bodies on which `Loads.wrenches` act."""
    return tuple(model.body(name).id for name in (GRIPPER, FOREARM, "door"))


def driven(model: mujoco.MjModel, base: Base) -> slice:
    """Return where in the control vector the rate of the base is; nowhere if fixed."""
    if base == "fixed":
        return slice(0)
    first = int(model.actuator_ctrladr[model.actuator(BASE_DRIVES[0]).id])
    return slice(first, first + 3)


def gripped(model: mujoco.MjModel, grasp: Hold) -> slice:
    """Return where in the control vector the fingers are; nowhere if they stay."""
    if grasp != "gripper":
        return slice(0)
    first = int(model.actuator_ctrladr[model.actuator(GRIPS[0]).id])
    return slice(first, first + 2)


class DoorSimulation:
    """One simulation; `gplfd_env.simulation.batch.DoorBatch` is many.

    `model` stays the same object for all doors of one structure, `sensordata` is live.
    A deep or unpickled copy is a simulation of its own in the same state.
    """

    def __init__(
        self, door: DoorConfig, grasp: Hold, command: Command, base: Base
    ) -> None:
        self._grasp, self._command, self._base = grasp, command, base
        self.variation = Variation(door=door)
        self.model = build_scene(door, grasp, control=command.control, base=base)
        self.data = mujoco.MjData(self.model)
        self._bind()

    def _bind(self) -> None:
        """Take the live views of model and data that every step needs."""
        self.sensordata: Array = self.data.sensordata
        self._pose: Array = self.data.ctrl[:6]
        self._rate: Array = self.data.ctrl[driven(self.model, self._base)]
        self._fingers: Array = self.data.ctrl[gripped(self.model, self._grasp)]
        self._loaded = [
            self.data.xfrc_applied[row] for row in loaded_bodies(self.model)
        ]
        self._divergences = self.data.warning.number[BAD_STATE]
        impedance = self._command.control == "impedance"
        self._gains = ServoGains(self.model) if impedance else None
        self._substeps = round(CONTROL_PERIOD / self.model.opt.timestep)

    def restart(self, variation: Variation) -> None:
        """Begin at rest before a door, its handle in the hand or the hand before it.

        Raises a ValueError, and changes nothing, if the hand cannot be there.
        """
        now = self.variation
        if structure_of(variation.door) != structure_of(now.door):
            self._rebuild(variation)
        elif variation.scene != now.scene:
            load_scene(
                self.model,
                self.data,
                variation.door,
                self._grasp,
                placement=variation.placement,
                standoff=variation.standoff,
                control=self._command.control,
                base=self._base,
            )
        if not now.disturbance.idle:
            set_hinge(self.model, variation.door.stop_angle, variation.door.friction)
        self.variation = variation
        mujoco.mj_resetDataKeyframe(self.model, self.data, GRASP_KEY)
        # Before the forward pass: the first observation must not depend on the gains
        # that the last episode ended with.
        self._apply(self._command.resting(variation, self._base))
        mujoco.mj_forward(self.model, self.data)

    def _rebuild(self, variation: Variation) -> None:
        """Take another model, for a door of another structure."""
        self.model = build_scene(
            variation.door,
            self._grasp,
            placement=variation.placement,
            standoff=variation.standoff,
            control=self._command.control,
            base=self._base,
        )
        self.data = mujoco.MjData(self.model)
        self._bind()

    def advance(
        self,
        command: Array,
        loads: Loads | None = None,
        drive: Planar | None = None,
        width: float | None = None,
    ) -> bool:
        """Go on by one control period; return whether MuJoCo reports divergence.

        Without loads nothing acts from outside all episode long, without a rate the
        base does not move, without a width [m] the fingers stay.
        """
        self._apply(command)
        if drive is not None:
            self._rate[:] = drive
        if width is not None:
            self._fingers[:] = 0.5 * width
        if loads is not None:
            set_hinge(self.model, loads.stop, loads.friction)
            for applied, wrench in zip(self._loaded, loads.wrenches, strict=True):
                applied[:] = wrench
        mujoco.mj_step(self.model, self.data, nstep=self._substeps)
        return any(self._divergences.tolist())

    def _apply(self, command: Array) -> None:
        self._pose[:] = command[:6]
        if self._gains is not None:
            self._gains.write(command[6:])

    def __getstate__(self) -> tuple[object, ...]:
        robot = self._grasp, self._command, self._base
        return robot, self.variation, self.model, self.data

    def __setstate__(self, state: tuple[object, ...]) -> None:
        robot, self.variation, self.model, data = state  # type: ignore[assignment]
        self._grasp, self._command, self._base = robot  # type: ignore[misc]
        # A copied MjData brings another model, and views do not survive a copy.
        self.data = mujoco.MjData(self.model)
        mujoco.mj_copyData(self.data, self.model, data)
        self._bind()
