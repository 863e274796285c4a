"""n simulations of one robot, each with its own door, stepped on threads."""

from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import Any, Final

import mujoco
import numpy as np
from mujoco.batch import Batch

from gplfd_env.conventions.constants import CONTROL_PERIOD, Array, Mask
from gplfd_env.doors.motion import end_angle
from gplfd_env.doors.variation import Variation
from gplfd_env.scene.build import DOOR_FIELDS, GRASP_KEY, build_scene, load_scene
from gplfd_env.scene.door import Structure, set_hinge, structure_of
from gplfd_env.simulation.command import ExtraInputs, ServoGains
from gplfd_env.simulation.single import BAD_STATE, Robot

Rows = Sequence[int]

_COUNT: Final = 1  # Column of `Batch.warning` with the counts.


class SameStructureBatch:
    """n simulations with doors of the same structure, a part of a `DoorBatch`.

    They share one model but for the fields in which they differ, as n models exceed the
    processor's cache. Under impedance control and after `separate`, each has its own.
    """

    def __init__(self, n: int, robot: Robot, begin: Variation, threads: int) -> None:
        self._robot, self._threads = robot, threads
        self._scene = build_scene(**robot.scene(begin))
        self.loaded = [begin] * n
        self.models = [self._scene] * n  # Loaded rows have their own, of 0.2 MB.
        self._sharing = robot.command.control != "impedance"
        self._bind()

    def _bind(self) -> None:
        """Create the batch of the models and keep its live views."""
        scene = self._scene.__copy__()
        self._scratch = mujoco.MjData(scene)
        self._impedance = self._robot.command.control == "impedance"
        self._batch = Batch(scene, nsim=len(self.models), nthread=self._threads)
        self._values: dict[str, Array] = {}
        self._take(range(len(self.models)))
        self._ctrl = self._batch.bind("ctrl")
        self.qpos: Array = self._batch.bind("qpos")
        self.sensordata: Array = self._batch.bind("sensordata")
        self._applied: Array = self._batch.bind("xfrc_applied")
        self._bodies = self._robot.loaded_bodies(scene)
        self._base_rate, self._fingers = self._robot.controls(scene)
        self._counts = self._batch.warning[:, BAD_STATE, _COUNT]
        self._seen = self._counts.copy()
        self._substeps = round(CONTROL_PERIOD / scene.opt.timestep)

    def _take(self, rows: Rows) -> None:
        """Let the batch use the present models of rows."""
        if not self._sharing:
            self._batch.set_models(self.models)
            return
        for name in DOOR_FIELDS:
            values, shared = self._values.get(name), getattr(self._scene, name)
            for row in rows:
                of_row = getattr(self.models[row], name)
                if values is None and np.count_nonzero(of_row != shared):
                    values = self._values[name] = self._batch.expand(name)
                if values is not None:
                    values[row] = of_row[: values.shape[1]]  # Not bounds of meshes.

    def separate(self) -> None:
        """Let simulations use their own models from now on, so that edits count."""
        if self._sharing:
            self._sharing, states = False, self._batch.state.copy()
            self._bind()
            self._batch.state[:] = states

    def load(self, row: int, variation: Variation) -> None:
        """See `DoorBatch.load`; the door has this structure."""
        now, door = self.loaded[row], variation.door
        if (model := self.models[row]) is self._scene:
            model = self.models[row] = self._scene.__copy__()
        if variation.scene != now.scene:
            load_scene(model, self._scratch, **self._robot.scene(variation))
        if not now.disturbance.idle:
            set_hinge(model, end_angle(door), door.friction)
        self.loaded[row] = variation

    def restart(self, rows: Rows) -> None:
        """See `DoorBatch.restart`."""
        for row in rows if self._impedance else ():
            ServoGains(self.models[row]).set(self._robot.command.rest[6:])
        self._take(rows)
        self._batch.reset(rows, keyframe=GRASP_KEY)
        # A reset also sets the warning counts of these simulations to zero.
        self._seen = self._counts.copy()

    def advance(
        self, commands: Array, rows: Rows | None, inputs: ExtraInputs
    ) -> Mask | None:
        """See `DoorBatch.advance`."""
        chosen = slice(None) if rows is None else rows
        self._ctrl[chosen, :6] = commands[chosen, :6]
        for row, rate in inputs.base_rates.items():
            self._ctrl[row, self._base_rate] = rate
        for row, width in inputs.gripper_widths.items():
            self._ctrl[row, self._fingers] = 0.5 * width
        for row, load in inputs.loads.items():
            self._applied[row, self._bodies] = load.wrenches
            if set_hinge(self.models[row], load.stop, load.friction):
                self._take([row])
        if self._impedance:
            every = range(len(self.models)) if rows is None else rows
            for row in every:
                ServoGains(self.models[row]).set(commands[row, 6:])
            self._take(every)
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
        names = "_robot", "_threads", "_scene", "loaded", "models", "_sharing"
        return {x: getattr(self, x) for x in names}, self._batch.state.copy()

    def __setstate__(self, kept: tuple[Any, ...]) -> None:
        values, states = kept
        vars(self).update(values)
        # Neither the batch nor its views can be copied.
        self._bind()
        self._batch.state[:] = states


class DoorBatch:
    """Physics and commands of n simulations, independent of the task.

    One batch per structure of doors is stepped by `physics` on `num_threads` threads
    (0: one per core). A deep or unpickled copy has its own n simulations in the same
    states.
    """

    def __init__(
        self,
        robot: Robot,
        begin: Sequence[Variation],
        num_threads: int,
        physics: type[SameStructureBatch] = SameStructureBatch,
    ) -> None:
        self._robot, self._threads, self._physics = robot, num_threads, physics
        self._batches: dict[Structure, SameStructureBatch] = {}
        self._structure = [structure_of(variation.door) for variation in begin]
        for row, variation in enumerate(begin):
            self.load(row, variation)

    @property
    def models(self) -> tuple[mujoco.MjModel, ...]:
        """The model of each simulation; live: from now on, edits of it count."""
        for batch in self._batches.values():
            batch.separate()
        rows = enumerate(self._structure)
        return tuple(self._batches[of].models[row] for row, of in rows)

    def load(self, row: int, variation: Variation) -> None:
        """Change the door of a simulation to restart; ValueError if out of reach."""
        structure = structure_of(variation.door)
        if structure not in self._batches:
            begin = len(self._structure), self._robot, variation, self._threads
            self._batches[structure] = self._physics(*begin)
        self._batches[structure].load(row, variation)
        self._structure[row] = structure

    def restart(self, rows: Rows) -> None:
        """Put simulations at rest, with closed door and initial pose of the hand."""
        for batch, of_batch in self._shares(rows):
            batch.restart(of_batch)

    def advance(
        self, commands: Array, rows: Rows | None, inputs: ExtraInputs
    ) -> Mask | None:
        """Step `rows` (None: all) by commands (n, ...); return which have diverged."""
        if len(self._batches) == 1:
            (batch,) = self._batches.values()
            return batch.advance(commands, rows, inputs)
        diverged: Mask | None = None
        for batch, of_batch in self._shares(rows):
            bad = batch.advance(commands, of_batch, inputs.of(of_batch))
            if bad is not None:
                diverged = bad if diverged is None else diverged | bad
        return diverged

    def read(
        self,
        rows: Rows | None,
        values: Array | None = None,
        of: Callable[[SameStructureBatch], Array] = attrgetter("sensordata"),
    ) -> Array:
        """Return arrays of sensors, (n, ...), zero-padded; other rows keep `values`."""
        if len(self._batches) == 1 and rows is None:
            return np.array(of(*self._batches.values()))
        widest = max(of(self._batches[kind]).shape[1] for kind in set(self._structure))
        result = np.zeros((len(self._structure), widest))
        if values is not None:
            shared = min(widest, values.shape[1])
            result[:, :shared] = values[:, :shared]
        for batch, of_batch in self._shares(rows):
            read = of(batch)
            result[of_batch] = 0.0
            result[of_batch, : read.shape[1]] = read[of_batch]
        return result

    def state_of(self, row: int) -> mujoco.MjData:
        """Return one simulation's state, e.g. to render it, until the next call."""
        return self._batches[self._structure[row]].state_of(row)

    def _shares(self, rows: Rows | None) -> list[tuple[SameStructureBatch, list[int]]]:
        """Group rows (None for all) by the batch that steps them."""
        shares: dict[Structure, list[int]] = {}
        for row in range(len(self._structure)) if rows is None else rows:
            shares.setdefault(self._structure[row], []).append(row)
        return [(self._batches[of], of_batch) for of, of_batch in shares.items()]
