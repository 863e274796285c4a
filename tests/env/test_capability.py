"""The stages of an episode, and what hinders a hand."""

import math
from typing import Any

import pytest

from gplfd_env.doors.config import DOORS
from gplfd_env.task.observation import DoorReading
from gplfd_env.task.stages import STAGES, Capability, Hindrance

ROOM, BAR = DOORS["room-834"], DOORS["medium"]
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
    capability, levels = Capability(ROOM), []
    for state, latched, held in story:
        capability.update(state, latched=latched, held=held)
        levels.append(capability.level)
    assert levels == list(range(len(STAGES)))


def test_a_stage_that_was_reached_stays_reached() -> None:
    capability = Capability(ROOM)
    capability.update(reading(40.0), latched=False, held=False)
    assert STAGES[capability.level] == "30 degrees"
    capability.update(reading(), latched=True, held=False)
    assert STAGES[capability.level] == "30 degrees"


def test_what_nothing_holds_is_unlatched_by_who_grasps_it() -> None:
    capability = Capability(BAR)
    capability.update(reading(), latched=False, held=False)
    assert STAGES[capability.level] == "unlatched"
    capability.update(reading(61.0), latched=False, held=True)
    assert STAGES[capability.level] == "held"


def test_a_handle_that_is_turned_too_little_is_only_grasped() -> None:
    capability = Capability(ROOM)
    turned = reading(handle_angle=0.49 * ROOM.handle_travel)
    capability.update(turned, latched=True, held=False)
    assert STAGES[capability.level] == "grasped"


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
    hindrance = Hindrance(LIMITS)
    hindrance.update(state, joints, stalled=failure == "stalled")
    assert hindrance.reason(failure) == reason


def test_what_hindered_long_ago_is_no_reason() -> None:
    hindrance = Hindrance(LIMITS)
    hindrance.update(reading(**PULL), INSIDE, stalled=False)
    for _ in range(60):
        hindrance.update(reading(), INSIDE, stalled=False)
    assert hindrance.reason("grasp_lost") == "handle_lost"
