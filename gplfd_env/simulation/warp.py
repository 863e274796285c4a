"""n doors of one structure on MuJoCo Warp, which can run on a GPU (experimental).

Tests compare its results on Warp's CPU backend with MuJoCo. Only this module needs the
extra ``warp``.
"""

from typing import Any, Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from gplfd_env.conventions.constants import CONTROL_PERIOD, Array, Mask
from gplfd_env.doors.variation import Variation
from gplfd_env.scene.build import GRASP_KEY, load_scene
from gplfd_env.scene.door import set_hinge, structure_of
from gplfd_env.simulation.batch import Rows, SameStructureBatch
from gplfd_env.simulation.command import ExtraInputs
from gplfd_env.simulation.single import Robot

try:
    import mujoco_warp as mjw
    import warp as wp
except ImportError as error:
    raise ImportError(
        f"gplfd_env.envs.warp needs MuJoCo Warp ({error}); in a checkout of gplfd: pip "
        "install '.[warp]', elsewhere: pip install 'gplfd[warp]'"
    ) from error

WORLD_FIELDS: Final = (
    "actuator_acc0", "actuator_biasprm", "body_inertia", "body_invweight0",
    "body_ipos", "body_iquat", "body_mass", "body_pos", "body_quat",
    "body_subtreemass", "dof_damping", "dof_frictionloss", "dof_invweight0", "eq_data",
    "geom_aabb", "geom_pos", "geom_quat", "geom_rbound", "geom_size", "jnt_axis",
    "jnt_range", "jnt_stiffness", "qpos_spring", "site_pos", "site_quat",
    "tendon_invweight0", "tendon_length0", "tendon_lengthspring", "tendon_range",
    "tendon_solref_lim", "tendon_stiffness",
)  # fmt: skip
"""Fields of the model that differ between simulations: those in which the physics of
two doors of the same structure can differ."""

# State that a simulation keeps from one step to the next, besides its controls.
_STATE: Final = ("qpos", "qvel", "qacc_warmstart", "xfrc_applied")


class WarpPhysics(SameStructureBatch):
    """n simulations with doors of one structure without latch, in float32 on Warp."""

    def __init__(self, n: int, robot: Robot, begin: Variation, threads: int) -> None:
        if structure_of(begin.door).latched:
            raise ValueError(
                "no latch on MuJoCo Warp: give a door with latch='none', or make "
                f"gplfd/DoorOpeningRL-v1; got latch={begin.door.latch!r}"
            )
        super().__init__(n, robot, begin, threads)

    def _bind(self) -> None:
        """Create model and data on the device, and capture a control period."""
        scene, n = self._scene.__copy__(), len(self.models)
        self._scratch, self._sharing = mujoco.MjData(scene), False
        self._bodies = self._robot.loaded_bodies(scene)
        self._model = mjw.put_model(scene, batch_sizes=dict.fromkeys(WORLD_FIELDS, n))
        # As MuJoCo solves: with Warp's default, forces are off by four times as much.
        self._model.opt.tolerance.fill_(scene.opt.tolerance)
        self._data = mjw.make_data(scene, nworld=n)
        self._changed: set[int] = set(range(n))
        self._ctrl = np.zeros((n, scene.nu))
        self._applied = np.zeros((n, scene.nbody, 6))
        self.qpos = np.tile(scene.qpos0, (n, 1))
        self.sensordata = np.zeros((n, scene.nsensordata))
        with wp.ScopedCapture() as capture:
            for _ in range(round(CONTROL_PERIOD / scene.opt.timestep)):
                mjw.step(self._model, self._data)
        self._period = capture.graph

    def load(self, row: int, variation: Variation) -> None:
        """See `gplfd_env.simulation.batch.DoorBatch.load`."""
        super().load(row, variation)
        self._changed.add(row)

    def restart(self, rows: Rows) -> None:
        """See `gplfd_env.simulation.batch.DoorBatch.restart`."""
        if not rows:
            return
        begun = []
        for row in rows:
            model, state = self.models[row], self._scratch
            mujoco.mj_resetDataKeyframe(model, state, GRASP_KEY)
            mujoco.mj_forward(model, state)
            begun.append([getattr(state, name).copy() for name in _STATE])
            self.qpos[row], self._ctrl[row] = state.qpos, state.ctrl
            self.sensordata[row] = state.sensordata
        self._applied[rows] = 0.0
        for name, values in zip(_STATE, zip(*begun, strict=True), strict=True):
            _put(getattr(self._data, name), rows, np.array(values))

    def advance(
        self, commands: Array, rows: Rows | None, inputs: ExtraInputs
    ) -> Mask | None:
        """See `gplfd_env.simulation.batch.DoorBatch.advance`."""
        stepped = range(len(self.models)) if rows is None else rows
        self._ctrl[stepped, :6] = commands[stepped, :6]
        self._data.ctrl.assign(self._ctrl)
        for row, load in inputs.loads.items():
            self._applied[row, self._bodies] = load.wrenches
            if set_hinge(self.models[row], load.stop, load.friction):
                self._changed.add(row)
        if inputs.loads:
            self._data.xfrc_applied.assign(self._applied)
        changed = sorted(self._changed)
        for name in WORLD_FIELDS if changed else ():
            values = [getattr(self.models[row], name) for row in changed]
            _put(getattr(self._model, name), changed, np.array(values))
        self._changed.clear()
        # This also steps simulations that should rest. Their state is not read, and it
        # is overwritten before they are stepped again.
        wp.capture_launch(self._period)
        for name in ("qpos", "sensordata"):
            now = getattr(self._data, name).numpy()
            getattr(self, name)[stepped] = now[stepped]
        # MuJoCo Warp does not detect bad states as MuJoCo does.
        diverged: Mask = ~np.all(np.abs(self.qpos) < mujoco.mjMAXVAL, axis=1)
        if not np.count_nonzero(diverged):
            return None
        self.restart(np.flatnonzero(diverged).tolist())
        return diverged

    def state_of(self, row: int) -> mujoco.MjData:
        """See `gplfd_env.simulation.batch.DoorBatch.state_of`."""
        state = self._scratch
        load_scene(state.model, state, **self._robot.scene(self.loaded[row]))
        state.qpos[:] = self.qpos[row]
        mujoco.mj_forward(state.model, state)
        return state

    def __getstate__(self) -> tuple[Any, ...]:
        raise TypeError("simulations on MuJoCo Warp cannot be copied or pickled")


def _put(target: Any, rows: Any, values: NDArray[Any]) -> None:
    """Write the values of some simulations into an array on the device, in place."""
    if target.size == 0:
        return
    of_one = target[:1].numpy().shape[1:]
    floats = np.asarray(values, dtype=np.float32).reshape(len(rows), *of_one)
    where: Any = wp.array(rows, dtype=wp.int32, device=target.device)
    wp.copy(target[where], wp.array(floats, dtype=target.dtype, device=target.device))
