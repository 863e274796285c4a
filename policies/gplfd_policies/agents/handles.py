"""Movements and load of hands that open doors whose handle turns.

The controller of `control.compliance` models no handle; movements and load here do.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from gplfd_policies.adaptation.gridded import (
    LOOK_AHEAD,
    GriddedMovement,
    GriddedMovements,
)
from gplfd_policies.arrays.rows import ALL_ROWS, PerRow, Rows
from gplfd_policies.arrays.shapes import Axes, Bool, Float, Vectors
from gplfd_policies.control.compliance import ComplianceConfig
from gplfd_policies.control.load import ContactState, Load, LoadResponse
from gplfd_policies.demonstrations.turned_handle import TurnedHandle
from gplfd_policies.movements.movement import ViaPoint

_SERVO_LAG: Final = 0.012
"""Lag of a hand that turns a handle behind its command: 24 N of the servo [m]."""
LATCHED_FORCE: Final = 10.0
"""Force along the path above which a door that does not move may be latched [N]. Tuned,
below the least limit for opening a door, 22.2 N (ADA 404.2.9)."""
CLOSED_DISTANCE: Final = 0.01
"""A door counts as closed while its handle axis has moved less than this [m]."""
FOLLOWING_SHARE: Final = 0.8
"""Share of the commanded turn above which a handle follows, not at its stop, and of the
demonstrated turn above which it is turned. Tuned."""
GEAR_RATE: Final = 0.5
"""Growth rate of the gear ratio while the door does not move [1/s]."""
MAX_TURN: Final = 1.3
"""Greatest commanded turn [rad]: no handle turns further than about 75°."""
INSISTENCE_RATE: Final = 20.0
"""Rate at which the hand pulls harder at a door that does not move [N/s]."""
GIVING_UP: Final = 68.0
"""Force at which it gives up [N]: half a second after the 58 N that the arm carries."""


class HandleMovements(GriddedMovements):
    """Movements of hands that turn handles; their paths are the paths of the axes.

    * Path and via-points of a door are those of the handle's axis
      (`gplfd_policies.demonstrations.turned_handle`), not of the hand: how the policy
      itself turns the handle is no information about the door.
    * A gear ratio, initially 1, relates the demonstrated turn to the turn of the hand:
      observed turns are divided by it, commanded turns multiplied.

    Each hand is computed with scalars, so that one hand and many give the same bits.
    """

    def __init__(
        self,
        movements: GriddedMovement | Sequence[GriddedMovement],
        handles: Sequence[TurnedHandle],
    ) -> None:
        super().__init__(movements)
        self._handles = tuple(handles)
        self._gears = [1.0] * len(self._handles)
        # Greatest commanded turn of a closed door's handle; None once it has opened.
        self._pressed: list[float | None] = [0.0] * len(self._handles)

    def reset(self, rows: Rows = ALL_ROWS) -> None:
        """Forget the via-points and the gear ratios of these rows."""
        super().reset(rows)
        for number in self._of(rows):
            self._gears[number] = 1.0
            self._pressed[number] = 0.0

    def observe(self, members: Sequence[int], via_points: Sequence[ViaPoint]) -> None:
        """Condition some rows' movements on via-points, given as poses of the hands."""
        points = [*via_points]
        for index, (member, point) in enumerate(zip(members, via_points, strict=True)):
            rows = np.array([member]) if self.numbers.shape else ALL_ROWS
            phase = np.full(self.numbers[rows].shape, point.phase)
            expected = self.at(phase, rows)[..., :6].ravel().tolist()
            handle, hand = self._handles[member], point.pose.tolist()
            pose = np.array(handle.without_handle_motion(hand, expected))
            points[index] = replace(point, pose=pose)
        super().observe(members, points)

    def ahead(
        self, phases: PerRow, rows: Rows = ALL_ROWS
    ) -> tuple[Axes, Axes, Vectors]:
        """Return mean, σ, and the chord of the axis's path in the opening ahead."""
        opens = [self._handles[number].opens for number in self._of(rows)]
        start = np.maximum(phases, np.reshape(opens, np.shape(phases)))
        end = np.minimum(start + LOOK_AHEAD, 1.0)
        moments = self.at(np.array([phases, end - LOOK_AHEAD, end]), rows)
        begin, end = self.axis_positions(moments[1:, ..., :6], rows)[..., :3]
        return moments[0, ..., :6], moments[0, ..., 6:12], end - begin

    def geared(self, poses: Axes, power: int, rows: Rows = ALL_ROWS) -> Axes:
        """Return hand poses at these rows' handle turns for poses of the movements.

        With power -1, hand poses at the demonstrated turns for these rows' hands.
        Handles of closed doors do not turn back: bolts would be extended again.
        """
        geared = poses.copy()
        for number, row in zip(self._of(rows), geared.reshape(-1, 6), strict=True):
            handle, gear = self._handles[number], self._gears[number]
            pressed = self._pressed[number] if power > 0 else None
            if gear != 1.0 or pressed is not None:
                _, turn = handle.swing_twist(row[3:].tolist())
                turn *= gear**power
                if pressed is not None:
                    turn = self._pressed[number] = max(turn, pressed)
                row[:] = handle.with_turn(row.tolist(), turn)
        return geared

    def axis_positions(
        self, poses: Float[np.ndarray, "*S 6"], rows: Rows = ALL_ROWS
    ) -> Float[np.ndarray, "*S 6"]:
        """Return poses (..., *N, 6) with positions of the axes instead of the hands."""
        numbers, positions = self._of(rows), poses.copy()
        if not numbers:
            return positions
        columns = positions.reshape(-1, len(numbers), 6)
        for column, hand in enumerate(numbers):
            axes = self._handles[hand].axis_positions(columns[:, column])
            columns[:, column] = axes
        return positions

    def turning_directions(self, poses: Axes, rows: Rows = ALL_ROWS) -> Vectors:
        """Return the unit vectors along which hands move while their handles turn."""
        hands = poses.reshape(-1, 6).tolist()
        directions = [
            self._handles[number].turning_direction(pose)
            for number, pose in zip(self._of(rows), hands, strict=True)
        ]
        return np.reshape(directions, (*poses.shape[:-1], 3))

    def turn_further(
        self,
        poses: Axes,
        closed: Bool[np.ndarray, "*N"],
        load: PerRow,
        period: float,
        rows: Rows = ALL_ROWS,
    ) -> Bool[np.ndarray, "*N"]:
        """Turn handles further if their doors do not move; return which.

        The bolt cannot be observed. A handle is turned further if the door is closed,
        resists along its path with a load [N], and the handle has reached the commanded
        angle, which is that of the demonstrations; up to a stop.
        """
        turned = []
        for number, pose, shut, force in zip(
            self._of(rows),
            poses.reshape(-1, 6).tolist(),
            np.ravel(closed).tolist(),
            np.ravel(load).tolist(),
            strict=True,
        ):
            handle, gear = self._handles[number], self._gears[number]
            pressed = (self._pressed[number] or 0.0) if shut else None
            self._pressed[number] = pressed
            most = MAX_TURN / handle.travel
            turns = shut and force >= LATCHED_FORCE and gear < most
            if turns and pressed is not None:
                follows = FOLLOWING_SHARE * pressed
                if handle.arm > 0.0:
                    follows = min(follows, pressed - _SERVO_LAG / handle.arm)
                turns = pressed >= FOLLOWING_SHARE * gear * handle.travel
                turns = turns and handle.turned(pose) >= follows
            if turns:
                gear = min(gear + GEAR_RATE * period, most)
                self._gears[number] = gear
            turned.append(turns)
        return np.reshape(np.array(turned, dtype=np.bool_), np.shape(load))

    def _of(self, rows: Rows) -> list[int]:
        numbers: list[int] = np.ravel(self.numbers[rows]).tolist()
        return numbers


class HandleLoad(Load):
    """A load rule applied twice: to the spring of the handle, and to the door.

    While the door opens, the force of a lever's spring is across the path, and a hand
    that yields to it turns the handle back. Therefore the load of the handle is
    compensated along the motion about its axis, that of the door along the axis's path.
    """

    def __init__(self, config: ComplianceConfig, movements: HandleMovements) -> None:
        self._movements, self._period = movements, config.control_period
        shape = movements.numbers.shape
        self._door = config.load.begin(config.profile, shape)
        self._handle = config.load.begin(config.profile, shape)
        self._insistence = np.zeros(shape)  # [N]; negative: it has given up

    def reset(self, rows: Rows = ALL_ROWS) -> None:
        """Forget these rows' doors."""
        self._door.reset(rows)
        self._handle.reset(rows)
        self._insistence[rows] = 0.0

    def update(self, contact: ContactState, rows: Rows = ALL_ROWS) -> LoadResponse:
        """Respond along the door's path; turn handles further if doors do not open."""
        poses = contact.pose
        axes = self._movements.axis_positions(poses, rows)
        turning = replace(
            contact,
            direction=self._movements.turning_directions(poses, rows),
            pose=poses - axes,
            expected=None,
            expected_ahead=None,
        )
        of_handle = self._handle.update(turning, rows)
        wrench = of_handle.compliant_wrench
        insistence = self._insistence[rows]
        opening = replace(
            contact, wrench=wrench, pose=axes, hook_grasp=True, insistence=insistence
        )
        response = self._door.update(opening, rows)
        along = np.add.reduce(contact.direction * axes[..., :3], axis=-1)
        closed, load = along < CLOSED_DISTANCE, response.compensated_load
        turned = self._movements.turn_further(poses, closed, load, self._period, rows)
        # A closer may hold a door with more than a held hand bears; so does a lock.
        held = closed & (load >= LATCHED_FORCE)
        carried = np.where(held, np.maximum(insistence, load), insistence)
        change = np.where(held, INSISTENCE_RATE, -INSISTENCE_RATE) * self._period
        changed = np.maximum(carried + np.where(turned, 0.0, change), 0.0)
        over = (insistence < 0.0) | (changed > GIVING_UP)
        self._insistence[rows] = np.where(over, -1.0, changed)
        # While the hand turns the handle further, it does not pull harder.
        pace = np.where(turned, np.minimum(response.pace, 0.0), response.pace)
        return replace(response, pace=pace)
