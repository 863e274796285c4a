"""Success, failure, stages and reward against sequences whose outcome is known."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gplfd_env.conventions.constants import SUCCESS_ANGLE
from gplfd_env.doors.config import DOORS
from gplfd_env.task.observation import DoorReading
from gplfd_env.task.opening import (
    FAILURES,
    REASONS,
    STAGES,
    STALL_ANGLE,
    Diagnosis,
    OpeningMonitor,
    reward_terms,
    stage_after,
    turned_angle,
)

DT = 0.01
OPEN = SUCCESS_ANGLE + 1e-6


# --- Success and failure -------------------------------------------------------------


def watched(*spells: tuple[Any, ...]) -> list[tuple[bool, str]]:
    """Return success and failure after each of some spells.

    Each is a number of periods, the angle, whether the handle is grasped and, if it
    matters, the handle's angle and what else there is to tell.
    """
    monitor, said = OpeningMonitor(), []
    for periods, angle, grasped, *rest in spells:
        turn, further = rest or (0.0, {})
        for _ in range(periods):
            monitor.update(angle, grasped, turn, **further)
        said.append((monitor.success, FAILURES[monitor.failure]))
    return said


SUCCESS, GOES_ON = (True, ""), (False, "")
STALLED, LOST, LATCHED = (False, "stalled"), (False, "grasp_lost"), (False, "latched")
BELOW = float(np.nextafter(SUCCESS_ANGLE, 0.0))
HELD, FREE = {"latched": True}, {"latched": False}
ON_PURPOSE, BY_ITSELF = {"opened": True}, {"opened": False}


@pytest.mark.parametrize(
    ("spells", "outcomes"),
    [
        # Success needs exactly half a second, at the angle itself, without a break.
        ([(49, OPEN, True), (1, OPEN, True)], [GOES_ON, SUCCESS]),
        ([(50, SUCCESS_ANGLE, True)], [SUCCESS]),
        ([(100, BELOW, True)], [GOES_ON]),
        (
            [(49, OPEN, True), (1, BELOW, True), (49, OPEN, True), (1, OPEN, True)],
            [GOES_ON, GOES_ON, GOES_ON, SUCCESS],
        ),
        # It is kept, and silences failures.
        ([(50, OPEN, True), (1000, 0.0, False)], [SUCCESS, SUCCESS]),
        # A grasp is lost after a quarter of a second, for good.
        ([(24, 0.1, False), (1, 0.1, False), (10, 0.1, True)], [GOES_ON, LOST, LOST]),
        ([*10 * [(1, 0.1, False), (19, 0.1, True)]], 20 * [GOES_ON]),
        # Not if it was let go on purpose, or never taken.
        ([(25, 0.1, False, 0.0, ON_PURPOSE)], [GOES_ON]),
        (
            [
                (25, 0.1, False, 0.0, ON_PURPOSE),
                (1, 0.1, True, 0.0, BY_ITSELF),
                (25, 0.1, False, 0.0, BY_ITSELF),
            ],
            [GOES_ON, GOES_ON, LOST],
        ),
        # A door that stands still has stalled until it moves.
        (
            [(300, 0.2, True), (1, 0.2, True), (1, 0.2 + STALL_ANGLE, True)],
            [GOES_ON, STALLED, GOES_ON],
        ),
        # A latched door is told from one that is stuck.
        ([(400, 0.0, True, 0.0, HELD), (1, 0.0, True, 0.0, FREE)], [LATCHED, STALLED]),
    ],
)
def test_what_is_said_after_each_spell(spells, outcomes):
    assert watched(*spells) == outcomes


def test_turning_the_handle_is_no_stall():
    rate = math.radians(2.0) * DT
    turning = [(1, 0.0, True, rate * step, HELD) for step in range(800)]
    *said, last = watched(*turning, (301, 0.0, True, 800 * rate, HELD))
    assert set(said) == {GOES_ON}
    assert last == LATCHED


# --- Reward and arc ------------------------------------------------------------------


@given(
    angles=st.lists(st.floats(0.0, 1.7), min_size=2, max_size=60),
    forces=st.lists(st.floats(-50, 50), min_size=60, max_size=60),
)
def test_progress_telescopes_to_the_angle_over_sixty_degrees(angles, forces):
    total = sum(
        reward_terms(after - before, force, False)["progress"]
        for before, after, force in zip(angles, angles[1:], forces, strict=False)
    )
    assert total == pytest.approx((angles[-1] - angles[0]) / SUCCESS_ANGLE, abs=1e-9)


# --- Stages and diagnosis ------------------------------------------------------------

ROOM, BAR = DOORS["room-834"], DOORS["medium"]
TURNED = turned_angle(ROOM)
LIMITS = ((-1.0, 1.0), (0.0, 2.0))
INSIDE = [0.5, 1.0]


ZERO: Any = (0.0, 0.0, 0.0)
AXES = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
REST = DoorReading(0.0, 0.0, ZERO, ZERO, ZERO, True, AXES, 0.0, 0.0, 0.0)


def reading(degrees: float = 0.0, **changes: Any) -> DoorReading:
    return REST._replace(angle=math.radians(degrees), **changes)


def test_a_latched_door_passes_every_stage_in_order():
    """Also 90°, and what comes after the end of the task; none is lost again."""
    turned = 0.51 * ROOM.handle_travel
    story = [
        (reading(grasped=False), True, False),
        (reading(), True, False),
        (reading(handle_angle=turned), True, False),
        (reading(handle_angle=turned), False, False),
        *[(reading(degrees), False, False) for degrees in (15.1, 30.1, 60.1, 90.1)],
        (reading(91.0), False, True),
        (reading(91.0, grasped=False), False, True),
        (reading(0.5, grasped=False), True, True),
    ]
    stage, stages = 0, []
    for state, latched, held in story:
        stage = stage_after(stage, state, TURNED, latched, held)
        stages.append(stage)
        assert stage_after(stage, reading(), TURNED, latched=True, held=False) >= stage
    assert stages == list(range(len(STAGES)))


@pytest.mark.parametrize(
    ("door", "before", "state", "latched", "held", "stage"),
    [
        (ROOM, "not grasped", reading(40.0), False, False, "30 degrees"),
        (BAR, "not grasped", reading(), False, False, "unlatched"),
        (BAR, "unlatched", reading(61.0), False, True, "held"),
        # A handle that is turned too little is only grasped.
        (ROOM, "not grasped", reading(handle_angle=0.39), True, False, "grasped"),
    ],
)
def test_a_stage_may_be_reached_at_once(door, before, state, latched, held, stage):
    turned = turned_angle(door)
    after = stage_after(STAGES.index(before), state, turned, latched, held)
    assert STAGES[after] == stage


PULL = {"forces": (21.0, 0.0, 0.0)}


@pytest.mark.parametrize(
    ("state", "joints", "failure", "reason"),
    [
        (reading(), INSIDE, "", ""),
        (reading(), INSIDE, "stalled", "stalled"),
        (reading(), INSIDE, "grasp_lost", "handle_lost"),
        (reading(**PULL), INSIDE, "stalled", "too_heavy"),
        (reading(**PULL), INSIDE, "grasp_lost", "too_heavy"),
        (reading(**PULL), INSIDE, "latched", "latched"),
        (reading(**PULL), INSIDE, "base_blocked", "base_blocked"),
        (reading(**PULL), [0.5, 2.0], "stalled", "out_of_reach"),
        (reading(), [-1.0, 1.0], "stalled", "out_of_reach"),
        (reading(20.0, stop_torque=3.0), INSIDE, "stalled", "blocked"),
        (reading(forces=(0.0, 30.0, 0.0)), INSIDE, "stalled", "stalled"),
    ],
)
def test_a_reason_tells_what_is_behind_a_failure(state, joints, failure, reason):
    diagnosis = Diagnosis()
    diagnosis.update(state, joints, LIMITS, stalled=failure == "stalled")
    assert REASONS[diagnosis.reason(REASONS.index(failure))] == reason
