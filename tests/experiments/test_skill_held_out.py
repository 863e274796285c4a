"""What is left out, and that learning does not see it."""

import dataclasses

import numpy as np
import pytest

from gplfd_experiments.data.teacher import Teacher, TeacherConfig
from gplfd_experiments.studies.learning_tests.folds import aligned_to, folds
from gplfd_policies.demonstrations.alignment import align
from gplfd_policies.demonstrations.demonstration import Demonstration

RADII = (0.35, 0.50, 0.65)


def demonstrated(seed: int = 0, per_door: int = 2) -> list[tuple[Demonstration, ...]]:
    recorded = Teacher().demonstrate_doors(
        RADII, per_door, rng=np.random.default_rng(seed)
    )
    return [
        recorded[first : first + per_door]
        for first in range(0, len(recorded), per_door)
    ]


@pytest.mark.parametrize("held_out", ["demonstration", "radius"])
def test_learning_does_not_see_what_is_left_out(held_out: str) -> None:
    doors, others = demonstrated(seed=0), demonstrated(seed=1)
    for number, fold in enumerate(folds(doors, held_out, seed=0)):
        left_out = {id(one) for one in fold.left_out}
        changed = [
            tuple(
                other if id(own) in left_out else own
                for own, other in zip(*pair, strict=True)
            )
            for pair in zip(doors, others, strict=True)
        ]
        again = folds(changed, held_out, seed=0)[number]
        assert not {id(one) for one in again.left_out} & left_out
        before, after = (align(each.given) for each in (fold, again))
        np.testing.assert_array_equal(before.poses, after.poses)
        aligned_to(again.left_out[0], before)
        np.testing.assert_array_equal(before.poses, after.poses)
        assert len(fold.given) + len(fold.left_out) == 6
        assert not left_out & {id(one) for one in fold.given}


def test_every_demonstration_is_left_out_equally_often() -> None:
    doors = demonstrated()
    counts: dict[int, int] = {}
    for seed in range(6):
        for fold in folds(doors, "demonstration", seed):
            (one,) = fold.left_out
            counts[id(one)] = counts.get(id(one), 0) + 1
    assert list(counts.values()) == [2] * 6


def test_a_radius_is_left_out_with_all_its_demonstrations() -> None:
    doors = demonstrated(per_door=3)
    for seed, outer in ((0, 0), (1, 2), (2, 0)):
        middle, other = folds(doors, "radius", seed)
        assert middle.left_out == doors[1]
        assert other.left_out == doors[outer]


def test_unknown_kind_of_held_out_names_what_there_is() -> None:
    with pytest.raises(ValueError, match=r"'demonstration', 'radius'.*got 'door'"):
        folds(demonstrated(), "door", 0)


def test_a_single_door_cannot_be_split() -> None:
    with pytest.raises(ValueError, match="at least three doors are needed, got 1"):
        folds(demonstrated()[:1], "radius", 0)


def test_timing_of_the_left_out_demonstration_does_not_matter() -> None:
    """The same path in another time lies at the same phases."""
    quiet = TeacherConfig(
        noise_position_std=0.0, noise_rotation_std=0.0, wobble_position_std=0.0
    )
    config = dataclasses.replace(quiet, wobble_rotation_std=0.0, vertical_drift_std=0.0)
    one = Teacher(config).demonstrate(0.5, np.random.default_rng(0))
    share = (one.times / one.times[-1]) ** 1.5
    poses = np.stack(
        [np.interp(share, one.times / one.times[-1], c) for c in one.poses.T], axis=1
    )
    late = Demonstration(times=2.0 * one.times, poses=poses)
    aligned = align([one])

    found = aligned_to(late, aligned)

    error = found.at(aligned.times) - aligned.poses[0]
    assert np.abs(error).max() < 2e-3
    assert (np.diff(found.phases) > 0.0).all()
    assert found.phases[[0, -1]] == pytest.approx([0.0, 1.0])


def test_every_movement_is_asked_for_the_same_poses() -> None:
    doors = demonstrated()
    early, late = (align(doors[0]), align(doors[2]))
    a, b = (aligned_to(doors[1][0], each).thinned(50) for each in (early, late))
    np.testing.assert_array_equal(a.poses, b.poses)
    assert not np.array_equal(a.phases, b.phases)
