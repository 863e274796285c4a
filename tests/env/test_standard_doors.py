"""Doors drawn by the standards."""

from collections import Counter
from collections.abc import Callable

import numpy as np
import pytest

from gplfd_env.doors.hardware import EN_1154, LEAF_HEIGHT
from gplfd_env.doors.randomization import DoorRandomization
from gplfd_env.doors.standard import LEAVES, standard_door

DRAWN = [standard_door(np.random.default_rng(seed)) for seed in range(600)]


def test_every_kind_occurs_about_as_often_as_said() -> None:
    shares = {
        "handle": {"lever": 0.4, "knob": 0.375, "bar": 0.225},
        "swing": {"pull": 0.5, "push": 0.5},
        "hinge_side": {"right": 0.5, "left": 0.5},
    }
    for field, expected in shares.items():
        counts = Counter(getattr(door, field) for door in DRAWN)
        assert counts.keys() == expected.keys()
        for name, share in expected.items():
            # Four standard deviations of a count.
            spread = 4.0 * np.sqrt(len(DRAWN) * share * (1.0 - share))
            assert abs(counts[name] - share * len(DRAWN)) < spread


@pytest.mark.parametrize("seed", range(0, 600, 60))
def test_a_drawn_door_is_within_the_tables(seed: int) -> None:
    door = DRAWN[seed]
    assert (door.leaf_width, door.backset) in LEAVES
    assert door.leaf_width is not None
    assert door.radius == pytest.approx(door.leaf_width - door.backset)
    assert 8.0 <= door.panel_mass / (door.leaf_width * LEAF_HEIGHT) <= 23.0 + 1e-9
    assert (door.latch == "spring") == (door.handle != "bar")


def test_hydraulic_closers_are_no_larger_than_the_leaf_asks() -> None:
    closed = [door for door in DRAWN if door.closing_damping > 0.0]
    assert len(closed) > 50
    for door in closed:
        closing = door.closer_preload + door.closer_boost - door.closer_friction
        assert EN_1154[1].closing[0] <= closing <= EN_1154[2].closing[1]
        assert door.leaf_width is not None
        size = 1 if closing <= EN_1154[1].closing[1] else 2
        assert door.leaf_width <= EN_1154[size].widest
        assert door.panel_mass <= EN_1154[size].heaviest


def test_a_door_closes_by_itself_against_its_friction() -> None:
    for door in DRAWN:
        if door.closing_damping > 0.0:
            assert door.closer_preload > door.friction


def test_doors_change_with_the_seed_alone(make_env: Callable) -> None:
    env = make_env(base="mobile", randomization="standard")
    seen = []
    for seed in (1, 2, 3, 4, 1):
        env.reset(seed=seed)
        seen.append(env.door)
    assert seen[0] == seen[-1]
    assert len(set(seen)) == 4


def test_ranges_apply_to_drawn_doors_too() -> None:
    narrow = DoorRandomization(doors="standard", hinge_damping=(2.0, 2.0))
    door = narrow.sample(DRAWN[0], np.random.default_rng(0)).door
    assert door.hinge_damping == 2.0
    assert (door.leaf_width, door.backset) in LEAVES
    with pytest.raises(ValueError, match=r"doors = 'din' is not one of 'given'"):
        DoorRandomization(doors="din")  # type: ignore[arg-type]


@pytest.mark.parametrize("seed", range(12))
def test_random_commands_before_standard_doors(seed: int, make_env: Callable) -> None:
    """Finite numbers, and a latch that is not drawn is never passed through."""
    env = make_env(base="mobile", randomization="standard")
    observation, info = env.reset(seed=seed)
    rng, drawn = np.random.default_rng(seed), 0.0
    pose = np.zeros(6)
    for _ in range(150):
        pose += rng.normal(size=6) * [0.01, 0.01, 0.01, 0.03, 0.03, 0.03]
        pose = np.clip(pose, -0.3, 0.3)
        observation, reward, terminated, truncated, info = env.step(pose)
        assert all(np.isfinite(value).all() for value in observation.values())
        assert np.isfinite(reward)
        assert not truncated
        drawn = max(drawn, info["bolt"])
        if env.door.latch == "spring" and drawn < 0.004:
            assert info["door_angle"] < np.radians(1.0)
        if terminated:
            break
