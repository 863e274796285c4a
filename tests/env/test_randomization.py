"""What every episode draws: ranges, presets, doors by the standards, wrong ones."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.hardware import EN_1154, LEAF_HEIGHT
from gplfd_env.doors.randomization import (
    LEAVES,
    RANDOMIZATIONS,
    DoorRandomization,
    door_randomization,
    standard_door,
)
from gplfd_env.doors.variation import Variation

# Field: the widest range, as the page says.
DOOR_FIELDS = {
    "radius": (0.30, 0.95),
    "hinge_friction": (0.0, 50.0),
    "hinge_damping": (0.0, 50.0),
    "closer_stiffness": (0.0, 50.0),
    "closer_preload": (0.0, 50.0),
    "panel_mass": (1.0, 100.0),
    "handle_height": (0.50, 1.22),
}
WIDTHS = {
    "base_position": 0.05,
    "base_yaw": 0.1,
    "grasp_height": 0.05,
    "grasp_depth": 0.008,
}

ranges = st.fixed_dictionaries(
    {},
    optional={
        name: st.tuples(st.floats(*span), st.floats(*span)).map(
            lambda pair: tuple(sorted(pair))
        )
        for name, span in DOOR_FIELDS.items()
    }
    | {name: st.floats(0.0, width) for name, width in WIDTHS.items()}
    | {"longest_delay": st.integers(0, 10)},
)
seeds = st.integers(0, 2**32 - 1)


def drawn_numbers(variation: Variation) -> dict[str, float]:
    """Return the numbers of a variation by the names of `DoorRandomization`."""
    door = variation.door
    return {
        **{name: getattr(door, name, None) for name in DOOR_FIELDS},
        "closer_stiffness": door.closer.stiffness,
        "closer_preload": door.closer.preload,
        **dataclasses.asdict(variation.placement),
        "pose_noise": (variation.noise.position, variation.noise.rotation),
        "wrench_noise": (variation.noise.force, variation.noise.torque),
        "delay": variation.delay,
    }


@given(fields=ranges, seed=seeds)
def test_draws_stay_within_their_ranges(fields, seed):
    door = DoorConfig(radius=0.42, panel_mass=7.0, leaf={"handle_standoff": 0.09})
    drawn = DoorRandomization(**fields).sample(door, np.random.default_rng(seed))
    before, after = (drawn_numbers(one) for one in (Variation(door=door), drawn))
    for name in DOOR_FIELDS:
        low, high = fields.get(name, (before[name], before[name]))
        assert low <= after[name] <= high
    assert drawn.door.leaf.handle_standoff == 0.09, "never varied"
    place = drawn.placement
    for name in ("base_yaw", "grasp_height", "grasp_depth"):
        assert abs(getattr(place, name)) <= fields.get(name, 0.0)
    beside = max(abs(place.base_x), abs(place.base_y))
    assert beside <= fields.get("base_position", 0.0)
    assert 0 <= drawn.delay <= fields.get("longest_delay", 0)


@given(fields=ranges, other=ranges, seed=seeds)
def test_a_range_changes_the_draws_of_no_other(fields, other, seed):
    """Of two randomisations, what has the same range in both is drawn the same."""
    first, second = (
        drawn_numbers(
            DoorRandomization(**each).sample(DoorConfig(), np.random.default_rng(seed))
        )
        for each in (fields, other)
    )
    drawn_as = {"base_position": ("base_x", "base_y"), "longest_delay": ("delay",)}
    for name in (*DOOR_FIELDS, *WIDTHS, "longest_delay"):
        if fields.get(name) == other.get(name):
            for value in drawn_as.get(name, (name,)):
                assert first[value] == second[value], value


def test_draws_are_uniform_and_independent():
    """Mean, variance and all correlations, within about 4 standard errors."""
    widest = DoorRandomization(**DOOR_FIELDS, **WIDTHS, longest_delay=10)
    rng, n = np.random.default_rng(0), 2500
    rows = [drawn_numbers(widest.sample(DoorConfig(), rng)) for _ in range(n)]
    spans = DOOR_FIELDS | {name: (-width, width) for name, width in WIDTHS.items()}
    spans["base_x"] = spans["base_y"] = spans.pop("base_position")
    spans["delay"] = (-0.5, 10.5)
    drawn = np.array([[row[name] for name in spans] for row in rows])
    low, high = np.array(list(spans.values())).T
    unit = (drawn - low) / (high - low)
    assert np.abs(unit.mean(axis=0) - 0.5).max() < 4 * math.sqrt(1 / 12 / n)
    assert np.abs(unit.var(axis=0) * 12 - 1.0).max() < 0.05
    correlation = np.corrcoef(unit.T) - np.eye(len(spans))
    assert np.abs(correlation).max() < 4 / math.sqrt(n)
    assert {row["delay"] for row in rows} == set(range(11))


def test_names_mappings_and_records():
    hard = RANDOMIZATIONS["hard"]
    assert door_randomization("hard") is door_randomization(hard) is hard
    assert door_randomization({}) == RANDOMIZATIONS["none"]
    assert door_randomization(dataclasses.asdict(hard)) == hard
    mapping = {"preset": "hard", "radius": [0.4, 0.5], "base_yaw": 0}
    changed = door_randomization(mapping)
    assert changed == dataclasses.replace(hard, radius=(0.4, 0.5), base_yaw=0.0)
    assert type(changed.radius) is tuple, "lists, as JSON has them, become pairs"


@pytest.mark.parametrize(
    ("spec", "kind", "message"),
    [
        ("mid", ValueError, r"'mid' \(did you mean 'mild'\?\).*none, mild, hard"),
        ({"radus": (0, 1)}, ValueError, r"'radus' \(did you mean 'ra.*fields: radius"),
        (3, TypeError, r"3 \(int\)"),
        ({"radius": 0.4}, ValueError, r"\.radius = 0\.4 must be a pair of numbers"),
        ({"radius": ("0.4", 0.5)}, TypeError, r"must be a number, got '0\.4' \(str\)"),
        ({"radius": (0.5, 0.4)}, ValueError, "low <= high"),
        ({"panel_mass": (1, 101)}, ValueError, r"mass = 101\.0 is outside \[1, 100\]"),
        ({"base_yaw": -0.1}, ValueError, r"\.base_yaw = -0\.1 is outside \[0, 0\.1\]"),
        ({"longest_delay": 11}, ValueError, r"_delay = 11 must.*0 to 10"),
        ({"shortest_delay": 3, "longest_delay": 2}, ValueError, "not exceed"),
        ({"doors": "din"}, ValueError, "doors = 'din' is not one of 'given'"),
    ],
)
def test_wrong_ones_are_told_what_is_allowed(spec, kind, message):
    with pytest.raises(kind, match=message):
        door_randomization(spec)


# --- Doors by the standards ----------------------------------------------------------

DRAWN = [standard_door(np.random.default_rng(seed)) for seed in range(600)]


def test_drawn_doors_are_within_the_tables():
    """Hydraulic closers are no larger than the leaf asks, and beat the friction."""
    for door in DRAWN:
        assert (door.leaf.width, door.leaf.backset) in LEAVES
        assert door.leaf.width is not None
        assert door.radius == pytest.approx(door.leaf.width - door.leaf.backset)
        assert 8.0 <= door.panel_mass / (door.leaf.width * LEAF_HEIGHT) <= 23.0 + 1e-9
        assert (door.latch == "spring") == (door.handle != "bar")
        if door.closer.closing_damping > 0.0:
            closing = door.closer.preload + door.closer.boost - door.closer.friction
            assert EN_1154[1].closing[0] <= closing <= EN_1154[2].closing[1]
            size = 1 if closing <= EN_1154[1].closing[1] else 2
            assert door.leaf.width <= EN_1154[size].widest
            assert door.panel_mass <= EN_1154[size].heaviest
            assert door.closer.preload > door.friction
    assert sum(door.closer.closing_damping > 0.0 for door in DRAWN) > 50


def test_ranges_apply_to_drawn_doors_too():
    narrow = DoorRandomization(doors="standard", hinge_damping=(2.0, 2.0))
    door = narrow.sample(DRAWN[0], np.random.default_rng(0)).door
    assert door.hinge_damping == 2.0
    assert (door.leaf.width, door.leaf.backset) in LEAVES
