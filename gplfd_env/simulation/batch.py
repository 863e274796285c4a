"""n simulations of one robot before doors of their own, stepped on threads."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from gplfd_env.conventions.constants import CONTROL_PERIOD, Base
from gplfd_env.doors.variation import Variation
from gplfd_env.robot.model import Hold
from gplfd_env.robot.whole_body import Planar
from gplfd_env.scene.build import GRASP_KEY, build_scene, load_scene
from gplfd_env.scene.door import Structure, set_hinge, structure_of
from gplfd_env.simulation.command import Command, ServoGains, servo_gains
from gplfd_env.simulation.loads import Loads
from gplfd_env.simulation.single import BAD_STATE, driven, gripped, loaded_bodies

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Rows = Sequence[int]

_COUNT: Final = 1
"""Column of `Batch.warning` that counts."""


class Alike:
    """n simulations before doors of one structure, as `DoorBatch` steps them."""

    def __init__(
        self,
        n: int,
        begin: Variation,
        grasp: Hold,
        command: Command,
        num_threads: int,
        base: Base,
    ) -> None:
        self._grasp, self._command, self._base = grasp, command, base
        self._threads = num_threads
        scene = build_scene(
            begin.door,
            grasp,
            placement=begin.placement,
            standoff=begin.standoff,
            control=command.control,
            base=base,
        )
        self.loaded = [begin] * n
        self.models = [scene.__copy__() for _ in range(n)]
        self._bind()

    def _bind(self) -> None:
        """Make the batch on the models and take its live views."""
        scene = self.models[0].__copy__()
        self._scratch = mujoco.MjData(scene)
        impedance = self._command.control == "impedance"
        self._gains = [ServoGains(model) for model in self.models if impedance]
        self._batch = Batch(scene, nsim=len(self.models), nthread=self._threads)
        self._batch.set_models(self.models)
        self._ctrl = self._batch.bind("ctrl")
        self.qpos: Array = self._batch.bind("qpos")
        self.sensordata: Array = self._batch.bind("sensordata")
        self._applied: Array = self._batch.bind("xfrc_applied")
        self._bodies = loaded_bodies(scene)
        self._driven = driven(scene, self._base)
        self._gripped = gripped(scene, self._grasp)
        self._counts = self._batch.warning[:, BAD_STATE, _COUNT]
        self._seen = self._counts.copy()
        self._substeps = round(CONTROL_PERIOD / scene.opt.timestep)

    def load(self, row: int, variation: Variation) -> None:
        """See `DoorBatch.load`; the door is of this structure."""
        now = self.loaded[row]
        if variation.scene != now.scene:
            self._bring(self.models[row], variation)
        if not now.disturbance.idle:
            door = variation.door
            set_hinge(self.models[row], door.stop_angle, door.friction)
        self.loaded[row] = variation

    def _bring(self, model: mujoco.MjModel, to: Variation) -> None:
        """Bring a model to another door."""
        load_scene(
            model,
            self._scratch,
            to.door,
            self._grasp,
            placement=to.placement,
            standoff=to.standoff,
            control=self._command.control,
            base=self._base,
        )

    def restart(self, rows: Rows) -> None:
        """See `DoorBatch.restart`."""
        for row in rows if self._gains else ():
            self._gains[row].write(self._command.rest[6:])
        self._batch.set_models(self.models)
        self._batch.reset(rows, keyframe=GRASP_KEY)
        # A reset also sets its simulations' counts back to zero.
        self._seen = self._counts.copy()

    def advance(
        self,
        commands: Array,
        rows: Rows | None,
        loads: Mapping[int, Loads],
        drives: Mapping[int, Planar],
        widths: Mapping[int, float],
    ) -> Mask | None:
        """See `DoorBatch.advance`."""
        if rows is None:
            self._ctrl[:, :6] = commands[:, :6]
        else:
            self._ctrl[rows, :6] = commands[rows, :6]
        for row, rate in drives.items():
            self._ctrl[row, self._driven] = rate
        for row, width in widths.items():
            self._ctrl[row, self._gripped] = 0.5 * width
        changed = bool(self._gains)
        for row, load in loads.items():
            self._applied[row, self._bodies] = load.wrenches
            changed |= set_hinge(self.models[row], load.stop, load.friction)
        if self._gains:
            gains = zip(*servo_gains(commands[:, 6:]), strict=True)
            for servo, gain in zip(self._gains, gains, strict=True):
                servo.set(*gain)
        if changed:
            self._batch.set_models(self.models)
        self._batch.step(rows, nstep=self._substeps)
        rises = self._counts != self._seen
        # ndarray.any costs five times as much at this size.
        if not np.count_nonzero(rises):
            return None
        self._seen = self._counts.copy()
        diverged: Mask = rises.any(axis=1)
        return diverged

    def state_of(self, row: int) -> mujoco.MjData:
        """See `DoorBatch.state_of`."""
        state = self._scratch
        self._batch.get_model(row, state.model)
        self._batch.get_data(row, state)
        mujoco.mj_forward(state.model, state)
        return state

    def __getstate__(self) -> tuple[Any, ...]:
        settings = self._grasp, self._command, self._threads, self._base
        return settings, self.loaded, self.models, self._batch.state.copy()

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        settings, self.loaded, self.models, states = state
        self._grasp, self._command, self._threads, self._base = settings
        # Neither the batch nor what is bound to it can be copied.
        self._bind()
        self._batch.state[:] = states


class DoorBatch:
    """Physics and commands of n simulations; knows no task.

    Those before doors of one structure are stepped together; there is a batch per
    structure that has occurred, stepped by `physics` on `num_threads` threads (0 for
    one per core). A deep or unpickled copy is n simulations of their own in the same
    states.
    """

    def __init__(
        self,
        begin: Sequence[Variation],
        grasp: Hold,
        command: Command,
        num_threads: int,
        base: Base,
        physics: type[Alike] = Alike,
    ) -> None:
        self._physics = physics
        self._robot = grasp, command, num_threads, base
        self._alike: dict[Structure, Alike] = {}
        self._structure = [structure_of(variation.door) for variation in begin]
        for row, variation in enumerate(begin):
            self.load(row, variation)

    @property
    def models(self) -> tuple[mujoco.MjModel, ...]:
        """One per simulation; live."""
        return tuple(
            self._alike[structure].models[row]
            for row, structure in enumerate(self._structure)
        )

    def qpos_of(self, row: int) -> Array:
        """Return one simulation's joint positions, (nq,) [m, rad]; live."""
        positions: Array = self._alike[self._structure[row]].qpos[row]
        return positions

    def load(self, row: int, variation: Variation) -> None:
        """Bring one simulation to another door; `restart` it afterwards.

        Raises a ValueError, and changes nothing, if the handle is out of reach.
        """
        structure = structure_of(variation.door)
        if structure not in self._alike:
            n = len(self._structure)
            self._alike[structure] = self._physics(n, variation, *self._robot)
        self._alike[structure].load(row, variation)
        self._structure[row] = structure

    def restart(self, rows: Rows) -> None:
        """Put simulations at rest, door closed and hand where it begins."""
        for structure, own in self._shares(rows):
            self._alike[structure].restart(own)

    def advance(
        self,
        commands: Array,
        rows: Rows | None,
        loads: Mapping[int, Loads],
        drives: Mapping[int, Planar],
        widths: Mapping[int, float],
    ) -> Mask | None:
        """Command simulations for one control period.

        Of the `commands` (n, ...) only those of `rows` count, None for all. Loads,
        rates of bases and widths of grippers [m] are by row, where there are any.
        Returns which ones MuJoCo reports as diverged, (n,); None if none.
        """
        if len(self._alike) == 1:
            (alike,) = self._alike.values()
            return alike.advance(commands, rows, loads, drives, widths)
        diverged: Mask | None = None
        everyone = range(len(self._structure))
        for structure, own in self._shares(everyone if rows is None else rows):
            acting = {row: loads[row] for row in own if row in loads}
            driving = {row: drives[row] for row in own if row in drives}
            told = {row: widths[row] for row in own if row in widths}
            found = self._alike[structure].advance(commands, own, acting, driving, told)
            if found is not None:
                diverged = found if diverged is None else diverged | found
        return diverged

    def read(self, rows: Rows | None, values: Array | None = None) -> Array:
        """Return MuJoCo's sensor arrays, (n, ...), shorter ones filled up with zeros.

        Only `rows` are read, None for all; the others keep their `values`.
        """
        if len(self._alike) == 1 and rows is None:
            (alike,) = self._alike.values()
            return np.array(alike.sensordata)
        everyone = range(len(self._structure))
        widest = max(self._alike[one].sensordata.shape[1] for one in self._structure)
        result = np.zeros((len(self._structure), widest))
        if values is not None:
            shared = min(widest, values.shape[1])
            result[:, :shared] = values[:, :shared]
        for structure, own in self._shares(everyone if rows is None else rows):
            read = self._alike[structure].sensordata
            result[own] = 0.0
            result[own, : read.shape[1]] = read[own]
        return result

    def state_of(self, row: int) -> mujoco.MjData:
        """Return one simulation's state, e.g. to draw it, until the next call."""
        return self._alike[self._structure[row]].state_of(row)

    def _shares(self, rows: Rows) -> list[tuple[Structure, list[int]]]:
        """Return rows by structure."""
        shares: dict[Structure, list[int]] = {}
        for row in rows:
            shares.setdefault(self._structure[row], []).append(row)
        return list(shares.items())
