"""n simulations of one robot before doors of their own, stepped on threads."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from gplfd_env.command import Command, ServoGains, servo_gains
from gplfd_env.door_opening import BAD_STATE
from gplfd_env.robot import Grasp
from gplfd_env.scene import GRASP_KEY, build_scene, load_scene
from gplfd_env.task import CONTROL_PERIOD
from gplfd_env.variation import Variation

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Rows = Sequence[int]

_COUNT: Final = 1
"""Column of `Batch.warning` that counts."""


class DoorBatch:
    """Physics and commands of n simulations; knows no task.

    Args:
        n: Number of simulations.
        grasp: See `gplfd_env.scene.build_spec`.
        command: The meaning of an action.
        num_threads: Threads that step the simulations; 0 for one per core.

    Attributes:
        models: One per simulation.
        sensordata: MuJoCo's sensor arrays, (n, ...); refreshed by every call.
        qpos: Joint positions, (n, nq) [m, rad]; live.
        rest: The command that holds the closed handle.
    """

    def __init__(
        self,
        n: int,
        grasp: Grasp,
        command: Command,
        num_threads: int,
    ) -> None:
        self._control, self._grasp = command.control, grasp
        self.rest = command.rest
        begin = Variation()
        scene = build_scene(begin.door, grasp, control=command.control)
        self._data = mujoco.MjData(scene)
        self._loaded = [(begin.door, begin.placement)] * n
        self.models = tuple(scene.__copy__() for _ in range(n))
        impedance = command.control == "impedance"
        self._gains = [ServoGains(model) for model in self.models if impedance]
        self._batch = Batch(scene, nsim=n, nthread=num_threads)
        self._batch.set_models(self.models)
        self._ctrl = self._batch.bind("ctrl")
        self.qpos = self._batch.bind("qpos")
        self.sensordata = self._batch.bind("sensordata")
        self._counts = self._batch.warning[:, BAD_STATE, _COUNT]
        self._seen = self._counts.copy()
        self._substeps = round(CONTROL_PERIOD / scene.opt.timestep)

    def load(self, row: int, variation: Variation) -> None:
        """Bring one simulation to another door; `restart` it afterwards."""
        scene = variation.door, variation.placement
        if scene != self._loaded[row]:
            load_scene(
                self.models[row],
                self._data,
                variation.door,
                self._grasp,
                placement=variation.placement,
                control=self._control,
            )
            self._loaded[row] = scene

    def restart(self, rows: Rows) -> None:
        """Put simulations at rest, door closed and handle in the hand."""
        for row in rows if self._gains else ():
            self._gains[row].write(self.rest[6:])
        self._batch.set_models(self.models)
        self._batch.reset(rows, keyframe=GRASP_KEY)
        # A reset also sets its simulations' counts back to zero.
        self._seen = self._counts.copy()

    def advance(self, commands: Array, rows: Rows | None) -> Mask | None:
        """Command simulations for one control period.

        Args:
            commands: Of all simulations, (n, ...).
            rows: Which to step; None for all.

        Returns:
            Which ones MuJoCo reports as diverged, (n,); None if none.
        """
        if rows is None:
            self._ctrl[:, :6] = commands[:, :6]
        else:
            self._ctrl[rows, :6] = commands[rows, :6]
        if self._gains:
            gains = zip(*servo_gains(commands[:, 6:]), strict=True)
            for servo, gain in zip(self._gains, gains, strict=True):
                servo.set(*gain)
            self._batch.set_models(self.models)
        self._batch.step(rows, nstep=self._substeps)
        rises = self._counts != self._seen
        # ndarray.any costs five times as much at this size.
        if not np.count_nonzero(rises):
            return None
        self._seen = self._counts.copy()
        diverged: Mask = rises.any(axis=1)
        return diverged

    def copy_state(self, row: int, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Copy one simulation into a model and its data, e.g. to draw it."""
        self._batch.get_model(row, model)
        self._batch.get_data(row, data)
        mujoco.mj_forward(model, data)
