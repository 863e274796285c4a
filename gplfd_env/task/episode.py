"""Episodes of one simulation and of many: circumstances, progress, outcome."""

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal, NamedTuple, TypeVar

import numpy as np

from gplfd_env.conventions.constants import (
    CONTROL_PERIOD,
    GRIPPER_WIDTH,
    SUCCESS_ANGLE,
    Array,
    Info,
    Mask,
)
from gplfd_env.conventions.one_and_many import (
    Flag,
    Number,
    anywhere,
    by_row,
    columns,
    mapped,
    negated,
    sqrt,
    stacked,
    where,
    with_rows,
)
from gplfd_env.doors.motion import CloserLaw, LeafPath
from gplfd_env.doors.variation import Variation
from gplfd_env.robot.gripper import Gripper
from gplfd_env.robot.placement import hand_position_w
from gplfd_env.robot.whole_body import BaseDrive
from gplfd_env.scene.handle import GAP, PLAY
from gplfd_env.simulation.command import NO_EXTRA_INPUTS, Command, ExtraInputs
from gplfd_env.simulation.single import Robot
from gplfd_env.spatial.se3 import canonical_rotvec
from gplfd_env.task.draw import DelayLine, NoiseSource, SampledEpisode
from gplfd_env.task.info import INFO, TEXTS, VECTORS
from gplfd_env.task.intervention import Intervention
from gplfd_env.task.observation import (
    AT_REST,
    BaseState,
    DoorReading,
    Hand,
    Observation,
    Sensors,
    Triple,
    Values,
    Wrench,
)
from gplfd_env.task.opening import (
    GRASP_LOST,
    NOT_GRASPED,
    SIMULATION_ERROR,
    STALLED,
    TRIED_ANGLE,
    Diagnosis,
    OpeningMonitor,
    reward_terms,
    sparse_reward_terms,
    stage_after,
    turned_angle,
)

Reward = Literal["dense", "sparse"]
Thing = TypeVar("Thing")

REWARDS: Final = {"dense": reward_terms, "sparse": sparse_reward_terms}
"""Terms of the reward, by name of the reward."""

_CLOSED: Final = [0.0] * 6  # Pose of a hand that holds the closed handle.


class Constants(NamedTuple):
    """Values that are constant during an episode: numbers, or arrays (n,)."""

    hand: Hand
    path: LeafPath
    radius: Number  # As in `DoorConfig`; likewise `hand_radius`.
    hand_radius: Number
    closer: CloserLaw
    latched: Flag  # The door has a bolt.
    bolt_throw: Number  # Distance by which the bolt protrudes [m].
    turned: Number  # Angle from which the handle counts as turned [rad].
    stopped: Flag  # A disturbance may stop the door.


class Readings(NamedTuple):
    """Sensor readings without noise: numbers, or arrays (n,)."""

    time: Number  # Time since the reset [s].
    wrench: Wrench  # Wrench on the hand [N, N m].
    hand: tuple[Number, ...]  # Its pose, only for movable grippers [m, rad].
    base: BaseState
    door: DoorReading
    latched: Flag  # The bolt holds the door.


@dataclass(slots=True)
class Progress:
    """How far an episode has come: numbers, or arrays (n,)."""

    steps: Number  # Control periods so far.
    opening: OpeningMonitor
    stage: Number  # Furthest stage, an index into `STAGES`.
    diagnosis: Diagnosis
    grasp_point: Triple  # Grasped point in the handle's frame [m].
    terms: dict[str, Number]  # Terms of the last step's reward.
    simulation_error: Flag  # MuJoCo has reset a diverged state.


class EpisodeParts(NamedTuple):
    """Optional parts of an episode; each computes with numbers of one simulation."""

    variation: Variation
    rest: Array  # The action that keeps the hand at its initial pose.
    noise: NoiseSource | None
    delay: DelayLine | None
    intervention: Intervention | None
    drive: BaseDrive | None
    gripper: Gripper | None


class DisturbanceEffects(NamedTuple):
    """Effects of a disturbance, see `Intervention`: numbers, or arrays (n,)."""

    push_force: Number = 0.0
    person_force: Number = 0.0
    person_energy: Number = 0.0
    base_shift: Triple = (0.0, 0.0, 0.0)
    base_distance: Number = 0.0


class Episode:
    """State of one episode besides the state in MuJoCo; `Episodes` has arrays (n,)."""

    readings: Readings
    progress: Progress

    def __init__(
        self,
        command: Command,
        reader: Sensors,
        reward: Reward,
        parts: Sequence[EpisodeParts],
        constants: Constants,
    ) -> None:
        self.command, self.constants = command, constants
        self.reader = dataclasses.replace(reader, hand=constants.hand)
        self._reward, self._terms = reward, REWARDS[reward]
        self._parts = list(parts)
        self._index()

    @classmethod
    def begin(
        cls, drawn: SampledEpisode, robot: Robot, reward: Reward, values: Values
    ) -> "Episode":
        """Return an episode of one simulation at rest, from its sensor values."""
        variation, noise, delay = drawn
        door, placement, _ = variation.scene
        hold, command, config = robot
        kind = hold, command.control, config, door.handle, door.swing
        reader = Sensors.of(*kind, level=door.level)
        rest, holds = command.resting(variation, config), variation.standoff is None
        drive = gripper = None
        if reader.odometry is not None:
            x, y, _ = hand_position_w(door, placement, config).tolist()
            drive = BaseDrive((x, y), door, config)
        if reader.finger is not None:
            width, uncertain = GRIPPER_WIDTH * (not holds), any(placement.belief)
            gripper = Gripper(door, width, uncertain=uncertain)
        idle = variation.disturbance.idle
        intervention = None if idle else Intervention(variation, config)
        constants = Constants(
            hand=reader.hand,
            path=LeafPath.of(door),
            radius=door.radius,
            hand_radius=door.hand_radius,
            closer=CloserLaw.of(door),
            latched=door.latch == "spring",
            bolt_throw=door.lockset.bolt_throw,
            turned=turned_angle(door),
            # A door may also reach the end of its hinge; this is not a disturbance.
            stopped=variation.disturbance.stop is not None,
        )
        parts = variation, rest, noise, delay, intervention, drive, gripper
        episode = cls(command, reader, reward, [EpisodeParts(*parts)], constants)
        readings = episode.readings = episode._read(values, 0, None)
        reading, latched = readings.door, readings.latched
        episode.progress = Progress(
            steps=0,
            opening=OpeningMonitor(taken=holds),
            stage=stage_after(0, reading, constants.turned, latched, held=False),
            diagnosis=Diagnosis(),
            grasp_point=reading.hand_on_handle,
            terms=episode._terms(0.0, 0.0, False),
            simulation_error=False,
        )
        return episode

    def _index(self) -> None:
        """Collect the simulations that have noise, a delay, a drive and so on."""
        rows = list(enumerate(self._parts))
        self._noises = {row: x.noise for row, x in rows if x.noise}
        self._delays = {row: x.delay for row, x in rows if x.delay}
        self._drives = {row: x.drive for row, x in rows if x.drive}
        self._grippers = {row: x.gripper for row, x in rows if x.gripper}
        self._interventions = {row: x.intervention for row, x in rows if x.intervention}
        rare = self._delays, self._drives, self._grippers, self._interventions
        self._commands_alone = not any(rare)
        self._read_effects()

    def _read_effects(self) -> None:
        """Read the effects of the disturbances."""
        zeros = DisturbanceEffects._field_defaults.items()
        self.effects = DisturbanceEffects(
            *(self._each(self._interventions, name, zero) for name, zero in zeros)
        )

    def prepare_step(self, commands: Array, stepped: Mask | None = None) -> ExtraInputs:
        """Delay commands (n, ...) in place; return loads, base rates and widths."""
        if self._commands_alone:
            return NO_EXTRA_INPUTS
        inputs = ExtraInputs({}, {}, {})
        readings, progress = self.readings, self.progress
        if self._interventions:
            door, taken = readings.door, progress.opening.taken
            moved = taken, door.hand_on_handle[0], progress.grasp_point[0]
            (t, n, r), state = door.axes, (readings.time, door.angle)
            numbers = by_row((*moved, *state, *t, *n, *r))
            for row, intervention in _chosen(self._interventions, stepped):
                holds, hand, point, time, angle, *axes = numbers[row]
                slip = float(hand - point) if holds else 0.0
                loads = intervention.loads(float(time), float(angle), axes, slip)
                inputs.loads[row] = loads
            self._read_effects()
        for row, delay in _chosen(self._delays, stepped):
            commands[row] = delay.pass_on(commands[row], self._parts[row].rest)
        for row, intervention in _chosen(self._interventions, stepped):
            # Commands are relative to the robot's frame, which a bump has moved.
            commands[row, :3] += intervention.base_shift
        if self._drives:
            bases = by_row((*readings.base.pose, progress.stage))
        for row, drive in _chosen(self._drives, stepped):
            hand, (x, y, yaw, stage) = commands[row].tolist(), bases[row]
            if self.command.drives:
                drive.obey(hand[-3:], (x, y, yaw))
            elif self._parts[row].variation.standoff is None or stage > 0:
                drive.follow(hand[:6], (x, y, yaw))
            else:
                # Only the arm moves: the base is already placed for the grasp.
                drive.follow(_CLOSED, (x, y, yaw))
            inputs.base_rates[row] = drive.rate
        if self._grippers:
            hands = by_row((progress.opening.taken, *readings.hand))
        for row, gripper in _chosen(self._grippers, stepped):
            if self.command.grips:
                gripper.obey(float(commands[row, -1]))
            else:
                taken, *pose = hands[row]
                gripper.close_at_handle(pose, taken=taken)
            inputs.gripper_widths[row] = gripper.width
        return inputs

    def advance(self, values: Values, stepped: Mask | None = None) -> None:
        """Update the episode from sensor values, a list or (number, n) array."""
        progress, opening = self.progress, self.progress.opening
        angle_before = self.readings.door.angle
        progress.steps = progress.steps + 1
        self.readings = readings = self._read(values, progress.steps, stepped)
        door, latched = readings.door, readings.latched
        blocked = opened = False
        if self._drives:
            rates = by_row(readings.base.velocity)
            for row, drive in _chosen(self._drives, stepped):
                drive.update_blocked(rates[row])
            blocked = self._each(self._drives, "blocked", False)
        if self._grippers:
            opened = self._each(self._grippers, "opened", False)
            # A first grasp may fail if the handle's position is uncertain.
            tried = self._each(self._grippers, "uncertain", False)
            opened = opened | (tried & (door.angle < TRIED_ANGLE))
        flags = {"latched": latched, "blocked": blocked, "opened": opened}
        took = opening.update(door.angle, door.grasped, door.handle_angle, **flags)
        if anywhere(took):
            pairs = zip(door.hand_on_handle, progress.grasp_point, strict=True)
            x, y, z = (where(took, new, old) for new, old in pairs)
            progress.grasp_point = x, y, z
        progress.stage = stage_after(
            progress.stage, door, self.constants.turned, latched, held=opening.success
        )
        failure = opening.failure
        stalled = (failure == STALLED) | (failure == NOT_GRASPED)
        joints, limits = values[self.reader.joint_pos], self.reader.arm_limits
        progress.diagnosis.update(door, joints, limits, stalled)
        gain = door.angle - angle_before
        progress.terms = self._terms(gain, door.forces.radial, opening.success)

    def mark_diverged(self, diverged: Flag = True) -> None:
        """Mark simulations as diverged; their readings stay the last good ones."""
        progress, idle = self.progress, self._terms(0.0, 0.0, False)
        progress.steps = progress.steps + 1 * diverged
        progress.simulation_error = progress.simulation_error | diverged
        terms = progress.terms.items()
        progress.terms = {name: where(diverged, idle[name], x) for name, x in terms}

    def observation(self, sensordata: Array) -> Observation:
        """Return the observation, with noise and the error of a moved base."""
        readings = self.readings
        wrench, time = self._column(readings.wrench), self._column((readings.time,))
        observation = self.reader.observation(sensordata, wrench, time, self.command)
        for row, intervention in self._interventions.items():
            if intervention.base_distance == 0.0:
                continue
            of_row = self._index_of(row)
            observation["ee_pose"][of_row][..., :3] -= intervention.base_shift
            observation["ee_twist"][of_row][..., :3] -= intervention.base_velocity
        for row, noise in self._noises.items():
            of_row = self._index_of(row)
            pose = observation["ee_pose"][of_row]
            pose += noise.sample[:6]
            if float(pose[3:] @ pose[3:]) > math.pi**2:
                pose[3:] = canonical_rotvec(pose[3:])
            observation["wrench"][of_row] += noise.sample[6:]
        return observation

    def _read(self, values: Values, steps: Number, stepped: Mask | None) -> Readings:
        """Return the sensor readings, and draw the noise of the observation."""
        constants, reader = self.constants, self.reader
        if self._noises:
            for _, noise in _chosen(self._noises, stepped):
                noise.draw()
        door, base = reader.door_reading(values, constants.path), AT_REST
        if reader.odometry is not None:
            x, y, yaw, *rate = values[reader.odometry]
            base = BaseState((x, y, yaw), (rate[0], rate[1], rate[2]))
        bolted = (door.angle < PLAY) & (door.bolt < constants.bolt_throw - GAP)
        time, latched = steps * CONTROL_PERIOD, constants.latched & bolted
        hand = tuple(values[reader.ee_pose]) if self._grippers else ()
        return Readings(time, reader.wrench(values), hand, base, door, latched)

    def _index_of(self, row: int) -> Any:
        """Return the index of a simulation in the arrays of an observation."""
        return ...

    def _column(self, vector: Sequence[Number]) -> Array:
        """Return a vector (k,) as a new array, or (n, k) for n simulations."""
        return np.array(vector)

    def _each(self, things: Mapping[int, Any], name: str, default: Any) -> Any:
        """Return an attribute of optional parts; simulations without get a default."""
        return getattr(things[0], name) if things else default

    def info(self) -> Info:
        """Return the info, see `gplfd_env.task.info.INFO`."""
        info = self._info_values()
        for name in VECTORS:
            info[name] = np.array(info[name])
        for name in TEXTS:
            info[name] = INFO[name].texts[info[name]]
        return info

    def _info_values(self) -> Info:
        """Return the values of an info; texts as their number, vectors as tuples."""
        readings, constants, progress = self.readings, self.constants, self.progress
        door, opening, effects = readings.door, progress.opening, self.effects
        pairs = zip(door.hand_on_handle, progress.grasp_point, strict=True)
        dx, dy, dz = (now - grasped for now, grasped in pairs)
        slip = where(opening.taken, sqrt(dx * dx + dy * dy + dz * dz), 0.0)
        stop_torque = where(constants.stopped, door.stop_torque, 0.0)
        x, y, z = door.handle_position
        dx, dy, dz = effects.base_shift
        rotation = door.handle_rotation(constants.path)
        error = progress.simulation_error
        failure = where(error, SIMULATION_ERROR, opening.failure)
        return {
            "door_angle": door.angle,
            "opening": door.angle / SUCCESS_ANGLE,
            "door_velocity": door.velocity,
            "door_radius": constants.radius,
            "slip": slip,
            "force_tangential": door.forces.tangential,
            "force_radial": door.forces.radial,
            "force_vertical": door.forces.vertical,
            "push_force": effects.push_force,
            "person_force": effects.person_force,
            "person_energy": effects.person_energy,
            "base_shift": effects.base_distance,
            "stop_force": stop_torque / constants.hand_radius,
            "handle_angle": door.handle_angle,
            "bolt": door.bolt,
            "closer_torque": constants.closer.torque(door.angle, door.velocity),
            "capability": progress.stage,
            "handle_pose": (x - dx, y - dy, z - dz, *rotation),
            "base_pose": readings.base.pose,
            "base_velocity": readings.base.velocity,
            "success": opening.success,
            "is_success": opening.success,
            "grasped": door.grasped,
            "simulation_error": error,
            "failure": failure,
            "reason": progress.diagnosis.reason(failure),
            "stage": progress.stage,
            "reward_terms": progress.terms,
        }

    def outcome(self, limit: float = math.inf) -> tuple[Number, Flag, Flag]:
        """Return the last step's reward, termination, truncation after `limit` steps.

        The task ends by success or a lost grasp; a diverged simulation is truncated.
        """
        progress, opening = self.progress, self.progress.opening
        ended, error = opening.success, progress.simulation_error
        ended = (ended | (opening.failure == GRASP_LOST)) & negated(error)
        return sum(progress.terms.values()), ended, error | (progress.steps >= limit)


def _chosen(
    things: Mapping[int, Thing], stepped: Mask | None
) -> Iterable[tuple[int, Thing]]:
    """Return the entries of simulations that are stepped, with their numbers."""
    if stepped is None or not things:
        return things.items()
    return [(row, thing) for row, thing in things.items() if stepped[row]]


_WORDS: Final = {name: np.array(INFO[name].texts, dtype=object) for name in TEXTS}


class Episodes(Episode):
    """n episodes whose numbers are arrays (n,), bit for bit equal to single ones."""

    def __init__(self, begun: Sequence[Episode]) -> None:
        first, self.n = begun[0], len(begun)
        parts = [episode._parts[0] for episode in begun]
        constants = stacked([episode.constants for episode in begun])
        super().__init__(first.command, first.reader, first._reward, parts, constants)
        self.readings = stacked([episode.readings for episode in begun])
        self.progress = stacked([episode.progress for episode in begun])

    def replace(self, begun: Mapping[int, Episode]) -> None:
        """Replace some episodes by new ones."""
        if not begun:
            return
        for name in ("constants", "readings", "progress"):
            records = [getattr(episode, name) for episode in begun.values()]
            changed = with_rows(getattr(self, name), self.n, list(begun), records)
            setattr(self, name, changed)
        self.reader = dataclasses.replace(self.reader, hand=self.constants.hand)
        for row, episode in begun.items():
            self._parts[row] = episode._parts[0]
        self._index()

    @property
    def variations(self) -> tuple[Variation, ...]:
        """Door and circumstances of every simulation."""
        return tuple(parts.variation for parts in self._parts)

    def advance(self, values: Values, stepped: Mask | None = None) -> None:
        """Update the episodes; those not `stepped` keep their state, without reward."""
        if stepped is None:
            super().advance(values)
            return
        # Arrays are never modified in place: a copy of the record is enough.
        before, time = mapped(lambda entry: entry, self.progress), self.readings.time
        super().advance(values, stepped)
        # Sensor values of the others are kept, and all but the time follow from them.
        time = where(stepped, self.readings.time, time)
        self.readings = self.readings._replace(time=time)
        before.terms = self._terms(0.0, 0.0, False)
        self.progress = mapped(lambda *x: where(stepped, *x), self.progress, before)

    def info(self) -> Info:
        """Return the infos as new arrays (n, ...)."""
        info = self._info_values()
        for name, value in info.items():
            kind = INFO[name].kind
            if kind is dict:
                info[name] = {x: columns((y,), self.n)[:, 0] for x, y in value.items()}
            elif name in VECTORS:
                info[name] = columns(value, self.n)
            elif kind is str:
                info[name] = _WORDS[name][value]
            else:
                info[name] = np.empty(self.n, kind)  # np.full takes half as long again.
                info[name][:] = value
        return info

    def _index_of(self, row: int) -> Any:
        return row

    def _column(self, vector: Sequence[Number]) -> Array:
        return columns(vector, self.n)

    def _each(self, things: Mapping[int, Any], name: str, default: Any) -> Any:
        if not things:
            return default
        values = np.empty((self.n, *np.shape(default)), np.asarray(default).dtype)
        values[:] = default
        for row, thing in things.items():
            values[row] = getattr(thing, name)
        return tuple(values.T) if values.ndim > 1 else values
