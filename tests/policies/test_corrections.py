"""A correction of a motion: what it is, how a skill learns from it, and keeps it."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from gplfd_env.spatial.se3 import handle_pose_on_arc
from gplfd_policies import POLICIES, Demonstration, TrainingInput, load_skill
from gplfd_policies.demonstrations.demonstration import Correction

pytestmark = pytest.mark.slow

GP = POLICIES["gp"].method
GP = replace(
    GP, pipeline=replace(GP.pipeline, align=partial(GP.pipeline.align, n_samples=80))
)
NOISE = np.repeat([1e-3, 4e-3], 3)


def led(radius: float, until: float, *, noise: float = 1.0, **origin) -> Correction:
    """A hand that is led from 20° on, along an arc that ends early [rad]."""
    times = np.arange(0.0, 5.0, 0.02)
    angles = until * times / times[-1]
    poses = handle_pose_on_arc(radius, angles)
    rng = np.random.default_rng(0)
    poses[1:] += noise * NOISE * rng.standard_normal((len(times) - 1, 6))
    wrenches = np.tile([10.0, 0.0, 0.0, 0.0, 1.0, 0.0], (len(times), 1))
    motion = Demonstration(times=times, poses=poses, wrenches=wrenches)
    return Correction(motion=motion, led=angles > np.radians(20.0), **origin)


@pytest.fixture(scope="module")
def skill(demonstrations):
    return GP.learn(TrainingInput(demonstrations=demonstrations[:4]))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"led": np.zeros(500, bool)}, "be true where somebody led the hand.* 0 of"),
        ({"led": np.ones(3, bool)}, r"shape \(250,\).* got shape \(3,\)"),
        ({"by": "robot"}, "'robot' and 0.0"),
        ({"phase": np.nan}, r"phase within \[0, 1\]"),
    ],
)
def test_what_is_no_correction_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        replace(led(0.6, 0.7), **changes)


def test_via_points_complete_a_correction_to_the_motion_at_its_door(skill):
    """The rest of a 0.62 m arc, from a skill that was shown 0.35 and 0.50 m."""
    correction = led(0.62, np.radians(40.0), noise=0.1)
    whole = GP.completed(skill, correction)
    count = len(correction.motion.times)
    assert_array_equal(whole.poses[:count], correction.motion.poses)
    assert np.all(np.diff(whole.times) > 0.0)
    reached = -whole.poses[-1, 4]
    angle = np.arctan2(*(whole.poses[-1, [0, 2]] + [0.0, 0.62]))
    assert np.degrees(angle) > 60.0
    distance = np.hypot(whole.poses[:, 0], whole.poses[:, 2] + 0.62)
    assert np.abs(distance - 0.62).max() < 0.01
    assert abs(abs(reached) - angle) < 0.1
    assert_array_equal(whole.wrenches[-1], correction.motion.wrenches[-1])
    # Without via-points it would be the arc of the demonstrations' mean size.
    alone = skill.predict(np.array([skill.aligned.end])).mean[0]
    assert np.linalg.norm(whole.poses[-1, :3] - alone[:3]) > 0.1


def test_a_corrected_skill_is_another_one_that_knows_more_doors(skill):
    correction = led(0.62, np.radians(64.0), noise=0.0, by="synthetic", phase=0.3)
    before = skill.predict(np.linspace(0.0, 1.0, 20))
    better = GP.update(replace(skill, frame="given"), correction)
    assert better is not skill
    assert (skill.corrections, skill.count, better.count) == ((), 4, 5)
    assert (better.corrections, better.frame) == ((correction,), "given")
    after = skill.predict(np.linspace(0.0, 1.0, 20))
    assert_array_equal(before.mean, after.mean)
    # Only the correction had wrenches.
    assert len(better.forces.aligned.poses) == 1
    last = better.aligned.demonstrated.poses[-1]
    assert np.abs(np.hypot(last[:, 0], last[:, 2] + 0.62) - 0.62).max() < 0.01
    again = GP.update(better, replace(correction, seed=1))
    assert (again.count, [stored.seed for stored in again.corrections]) == (6, [0, 1])


def test_a_file_keeps_the_corrections_of_a_skill(skill, tmp_path):
    bare = led(0.55, np.radians(64.0), door="0.55", seed=7)
    bare = replace(bare, motion=replace(bare.motion, wrenches=None))
    bare = replace(bare, device="mouse", inputs=np.eye(len(bare.led), 9))
    better = replace(skill, corrections=(led(0.62, 0.9, by="synthetic"), bare))
    better.save(tmp_path / "skill.npz")
    loaded = load_skill(tmp_path / "skill.npz")
    for kept, correction in zip(loaded.corrections, better.corrections, strict=True):
        for name in ("times", "poses", "wrenches"):
            expected = getattr(correction.motion, name)
            assert_array_equal(getattr(kept.motion, name), expected)
        for name in ("door", "seed", "by", "phase", "led", "inputs", "device"):
            assert_array_equal(getattr(kept, name), getattr(correction, name))
    with pytest.raises(ValueError, match=r"inputs need 250 rows"):
        replace(bare, inputs=bare.inputs[1:])


def test_every_learner_learns_from_a_correction(demonstrations):
    """A door twice as large as the demonstrated ones is expected to be larger."""
    correction, mean = led(1.0, 0.9), POLICIES["mean"].method
    movement = mean.learn(TrainingInput(demonstrations=demonstrations))
    learned = mean.update(movement, correction)
    assert len(learned.aligned.poses) == len(demonstrations) + 1
    end = np.array([movement.aligned.end])
    before, after = (np.ptp(m.predict(end).mean[0, :3]) for m in (movement, learned))
    assert after > before + 0.02
