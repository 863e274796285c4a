"""Doors by name, radius, mapping or record, and every way to ask for a wrong one."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gplfd_env.doors.config import DOORS, DoorConfig, door_config
from gplfd_env.doors.parts import Closer, Leaf, Lockset, Mechanism


@given(radius=st.floats(0.30, 1.05))
def test_many_ways_to_say_the_same_door(radius):
    expected = DoorConfig(radius=radius)
    assert door_config(radius) == expected
    assert door_config({"radius": radius}) == expected
    assert door_config({"preset": "small", "radius": radius}) == expected
    assert door_config(expected) is expected
    assert door_config(dataclasses.asdict(expected)) == expected
    assert door_config(np.float64(radius)) == expected


@pytest.mark.parametrize(
    ("record", "field", "wrong"),
    [
        (DoorConfig, "panel_mass", 0.9),
        (Leaf, "thickness", math.nan),
        (Lockset, "bolt_throw", 1.0),
        (Closer, "preload", -0.1),
        (Mechanism, "rise", math.inf),
        (DoorConfig, "handle", "both"),
    ],
)
def test_every_part_checks_its_fields(record, field, wrong):
    """The page has a table of the ranges, made from the records."""
    allowed = rf"{record.__name__}\.{field} = {wrong!r} is (outside|not one of)"
    with pytest.raises(ValueError, match=allowed):
        record(**{field: wrong})


@pytest.mark.parametrize(
    ("door", "kind", "parts"),
    [
        ("mediun", ValueError, ["unknown door 'mediun' (did you mean 'medium'?)"]),
        (1.07, ValueError, ["DoorConfig.radius = 1.07", "[0.3, 1.05] m"]),
        ({"preset": 3}, ValueError, ["unknown door 3"]),
        ({"radios": 0.4}, ValueError, ["door field 'radios'", "mean 'radius'?"]),
        ({"closer": {"prelod": 5.0}}, ValueError, ["mean 'preload'?", "boost_angle"]),
        ({"closer": 5.0}, TypeError, ["DoorConfig.closer must be a Closer", "5.0"]),
        (None, TypeError, ["door must be", "got None (NoneType)"]),
        ({"radius": True}, TypeError, ["DoorConfig.radius must be a number, got"]),
        *[
            (fields, ValueError, ["no such door: ", *parts])
            for fields, *parts in (
                ({"latch": "spring"}, "latch = 'spring'", "handle = 'bar'", "'lever'"),
                ({"mechanism": {"clear_width": 0.6}}, "clear_width", "sliding"),
                ({"motion": "flap"}, "hinge_side = 'right'", "bottom or top"),
                ({"hinge_side": "top"}, "motion = 'hinged'", "bottom or top"),
                ({"motion": "folding", "handle": "lever"}, "'lever'", "choose 'bar'"),
                ({"motion": "folding", "swing": "push"}, "choose swing = 'pull'"),
                ({"leaf": {"width": 0.8}}, "= 0.8", "backset = 0.08", "radius = 0.5"),
                ({"lockset": {"handle_travel": 0.3, "dead_travel": 0.2}}, "= 0.2"),
            )
        ],
    ],
)
def test_wrong_doors_are_told_what_is_allowed(door, kind, parts):
    with pytest.raises(kind) as error:
        door_config(door)
    for part in parts:
        assert part in str(error.value)


def test_a_leaf_s_width_follows_its_radius():
    assert DoorConfig(radius=0.4).overhang == 0.01
    door = DoorConfig(radius=0.78, leaf={"width": 0.834, "backset": 0.055})
    assert door.overhang == pytest.approx(-0.001)


def test_a_door_s_dictionary_is_the_door():
    """Hashes of tasks are made of it: it has only what differs from the default."""
    for door in DOORS.values():
        assert DoorConfig(**door.as_dict()) == door
    assert DOORS["medium"].as_dict() == {}
    assert DOORS["heavy"].as_dict() == {
        "hinge_friction": 2.0,
        "closer": {"preload": 5.0},
    }


def test_a_mapping_of_a_part_changes_only_what_it_names():
    door = door_config({"preset": "oven", "closer": {"preload": 6.0}})
    assert door.closer == Closer(preload=6.0, stiffness=12.0)
    assert DOORS["oven"].replaced({"closer": {"preload": 6.0}}) == door
    assert DoorConfig(closer={"preload": 6.0}).closer == Closer(preload=6.0)


@pytest.mark.parametrize(
    ("fields", "spring"),
    [
        ({"handle": "lever"}, (0.5, 1.2)),
        ({"handle": "knob"}, (0.175, 0.2)),
        ({"handle": "knob", "lockset": {"handle_stiffness": 0.3}}, (0.175, 0.3)),
        ({"handle": "lever", "lockset": {"handle_preload": 0.0}}, (0.0, 1.2)),
        ({"preset": "room-709", "handle": "knob"}, (0.175, 0.2)),
    ],
)
def test_a_handle_s_spring_is_that_of_its_kind_unless_given(fields, spring):
    assert door_config(fields).handle_spring == spring
