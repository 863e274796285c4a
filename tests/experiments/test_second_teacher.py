"""The second synthetic human: what it demonstrates is the door's motion, roughly."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from gplfd_env.doors.config import DOORS, DoorConfig
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_experiments.data.teacher.second import (
    demonstrate,
    demonstrate_doors,
    trapezoid,
)
from gplfd_experiments.episodes.build import demonstrations_of
from gplfd_experiments.studies.trials.protocol import named_trials, trial_tasks

ANGLE = np.radians(65.0)


def test_a_trapezoid_of_speed_is_integrated() -> None:
    progress = np.linspace(-0.1, 1.1, 100_001)
    way = trapezoid(progress, 0.3, 0.2)
    t = np.clip(progress, 0.0, 1.0)
    speed = np.minimum(1.0, np.minimum(t / 0.3, (1.0 - t) / 0.2))
    expected = np.cumsum(speed) / speed.sum()
    assert_allclose(way, expected, atol=2e-5)


@pytest.mark.parametrize("name", ["medium", "bifold-closet", "pocket-door", "room-834"])
def test_the_hand_follows_the_handle_within_its_slide(name: str) -> None:
    """At most 3 cm of slide and 2 mm of tremor, after a turn of the axes by < 8°."""
    door = DOORS[name]
    angles = np.linspace(0.0, 1.2, 200)
    press = door.handle_travel if door.handle != "bar" else 0.0
    paths = [
        DoorGeometry.of(door).easy_hand_poses(angles, turn)[:, :3]
        for turn in np.linspace(0.0, press, 20)
    ]
    path = np.concatenate(paths)
    path = path - path[0]
    for seed in range(4):
        poses = demonstrate(door, ANGLE, np.random.default_rng(seed)).poses[::5]
        assert_array_equal(poses[0], 0.0)
        turned = Rotation.from_rotvec([0.0, np.radians(8.0), 0.0]).apply(poses[:, :3])
        reach = np.linalg.norm(turned - poses[:, :3], axis=1).max() + 0.04
        distances = np.linalg.norm(poses[:, None, :3] - path, axis=2).min(axis=1)
        assert distances.max() < reach


def test_wrists_turn_less_or_more_than_the_leaf() -> None:
    doors = [DoorConfig(radius=0.5)] * 30
    openings = demonstrate_doors(doors, 1, ANGLE, np.random.default_rng(0))
    turns = np.array([np.linalg.norm(opening.poses[-1, 3:]) for opening in openings])
    assert turns.min() < 0.85 * ANGLE
    assert turns.max() > 1.05 * ANGLE
    assert len({len(opening.times) for opening in openings}) > 20


def test_tasks_name_who_demonstrates_and_the_draws_are_kept() -> None:
    trial = named_trials(("radius",))
    first, second = (
        trial_tasks(trial, only=["gp"], seeds=1, taught_by=human)
        for human in ("first", "second")
    )
    assert "taught_by" not in first[0].definition
    assert {task.key for task in first}.isdisjoint(task.key for task in second)
    assert [task.reset_seed for task in first] == [task.reset_seed for task in second]
    ours = demonstrations_of(second[0])
    assert ours.radii == demonstrations_of(first[0]).radii
    assert_array_equal(
        ours.demonstrations[0].poses,
        demonstrations_of(second[1]).demonstrations[0].poses,
    )
