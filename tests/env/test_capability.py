"""The stages of an episode, and the diagnosis of a failure."""

import math
from typing import Any

import pytest

from gplfd_env.doors.config import DOORS
from gplfd_env.task.observation import DoorReading
from gplfd_env.task.opening import GRASP_LOST
from gplfd_env.task.stages import REASONS, STAGES, Diagnosis, stage_after, turned_angle

ROOM, BAR = DOORS["room-834"], DOORS["medium"]
TURNED = turned_angle(ROOM)
LIMITS = ((-1.0, 1.0), (0.0, 2.0))
INSIDE = [0.5, 1.0]


def reading(degrees: float = 0.0, **changes: Any) -> DoorReading:
    axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    rest: dict[str, Any] = {
        "velocity": 0.0,
        "handle_position": (0.0, 0.0, 0.0),
        "hand_on_handle": (0.0, 0.0, 0.0),
        "forces": (0.0, 0.0, 0.0),
        "grasped": True,
        "axes": axes,
        "stop_torque": 0.0,
        "handle_angle": 0.0,
        "bolt": 0.0,
    }
    return DoorReading(angle=math.radians(degrees), **{**rest, **changes})


def test_a_latched_door_passes_every_stage_in_order() -> None:
    """Also 90°, and what comes after the end of the task."""
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
    assert stages == list(range(len(STAGES)))


def test_a_stage_that_was_reached_stays_reached() -> None:
    stage = stage_after(0, reading(40.0), TURNED, latched=False, held=False)
    assert STAGES[stage] == "30 degrees"
    stage = stage_after(stage, reading(), TURNED, latched=True, held=False)
    assert STAGES[stage] == "30 degrees"


def test_what_nothing_holds_is_unlatched_by_who_grasps_it() -> None:
    turned = turned_angle(BAR)
    stage = stage_after(0, reading(), turned, latched=False, held=False)
    assert STAGES[stage] == "unlatched"
    stage = stage_after(stage, reading(61.0), turned, latched=False, held=True)
    assert STAGES[stage] == "held"


def test_a_handle_that_is_turned_too_little_is_only_grasped() -> None:
    turned = reading(handle_angle=0.49 * ROOM.handle_travel)
    stage = stage_after(0, turned, TURNED, latched=True, held=False)
    assert STAGES[stage] == "grasped"


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
def test_a_reason_tells_what_is_behind_a_failure(
    state: DoorReading, joints: list[float], failure: str, reason: str
) -> None:
    diagnosis = Diagnosis()
    diagnosis.update(state, joints, LIMITS, stalled=failure == "stalled")
    assert REASONS[diagnosis.reason(REASONS.index(failure))] == reason


def test_what_hindered_long_ago_is_no_reason() -> None:
    diagnosis = Diagnosis()
    diagnosis.update(reading(**PULL), INSIDE, LIMITS, stalled=False)
    for _ in range(60):
        diagnosis.update(reading(), INSIDE, LIMITS, stalled=False)
    assert REASONS[diagnosis.reason(GRASP_LOST)] == "handle_lost"
