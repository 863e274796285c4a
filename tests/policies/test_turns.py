"""Motions that turn by about a full turn and more: valves, knobs and lids."""

import warnings

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from gplfd_env.spatial.turns import accumulated_rotvecs, main_turn
from gplfd_policies import POLICIES, Demonstration, TrainingInput, align
from gplfd_policies.demonstrations.aligned import partition
from gplfd_policies.demonstrations.demonstration import turned

TIMES = np.linspace(0.0, 6.0, 201)


def demonstrations(degrees, tilt=2.0, count=4):
    """A hand turns a valve and moves 20 cm; it tilts in another way every time."""
    rng = np.random.default_rng(1)
    share = TIMES / TIMES[-1]
    share = 10.0 * share**3 - 15.0 * share**4 + 6.0 * share**5
    made = []
    for _ in range(count):
        phase, turn = rng.uniform(0.0, 6.0), np.radians(degrees + rng.uniform(-4, 4))
        wobble = np.radians(tilt) * np.column_stack(
            [np.sin(2.0 * share + phase), np.cos(2.0 * share + phase), 0.0 * share]
        )
        hands = Rotation.from_rotvec(np.outer(turn * share, [0.0, 0.0, 1.0]))
        quaternions = (hands * Rotation.from_rotvec(wobble)).as_quat(scalar_first=True)
        positions = np.outer(share, [0.2, 0.0, 0.0])
        motion = Demonstration.from_quaternions(TIMES, positions, quaternions)
        made.append(motion.relative_to_first())
    return made


ANGLES = [90, 330, 360, 375, 800]


@pytest.mark.filterwarnings("ignore:turns")
@pytest.mark.parametrize("degrees", ANGLES)
def test_a_turn_is_learned_and_reported(degrees):
    motions = demonstrations(degrees)
    assert turned(motions[0]) == pytest.approx(degrees, abs=6.0)
    method = POLICIES["gp"].method
    assert len(partition(method.pipeline.align(motions))) == 1
    skill = method.learn(TrainingInput(demonstrations=motions))
    phases, end = skill.aligned.times, skill.aligned.end
    inside = phases <= end
    mean = skill.predict(phases).mean
    assert mean[inside][-1, 5] == pytest.approx(np.radians(degrees), abs=0.05)
    # The continuation goes on in the same direction.
    if degrees > 300:
        assert np.diff(mean[:, 5]).min() > -5e-3
        assert mean[-1, 5] > 1.3 * mean[inside][-1, 5]
    demonstrated = Rotation.from_rotvec(skill.aligned.poses[:, inside, 3:].mean(0))
    learned = Rotation.from_rotvec(mean[inside, 3:])
    assert np.degrees((learned * demonstrated.inv()).magnitude()).max() < 1.5


@pytest.mark.parametrize("degrees", [345, 400, 540])
def test_accumulated_rotations_are_smooth_and_err_by_less_than_the_tilt(degrees):
    for motion in demonstrations(degrees):
        exact = motion.poses[:, 3:]
        rotvecs, tilt = accumulated_rotvecs(exact)
        errors = Rotation.from_rotvec(rotvecs) * Rotation.from_rotvec(exact).inv()
        assert errors.magnitude().max() < 1.1 * tilt < np.radians(5.0)
        assert np.linalg.norm(np.diff(rotvecs, axis=0), axis=1).max() < 0.15
        early = np.maximum.accumulate(np.linalg.norm(exact, axis=1)) < np.pi
        assert_allclose(rotvecs[early], exact[early], rtol=0.0, atol=1e-12)


def test_the_axis_is_that_of_the_whole_turn_and_not_of_its_fastest_step():
    turns = np.radians(np.linspace(0.0, 400.0, 401))
    nods = np.eye(401, 3, -200) * np.radians(8.0)
    path = Rotation.from_rotvec(turns[:, None] * [0.0, 0.0, 1.0])
    axis, accumulated = main_turn((path * Rotation.from_rotvec(nods)).as_rotvec())
    assert axis[2] > 0.999
    assert accumulated[-1] == pytest.approx(turns[-1], abs=0.02)


def test_a_turn_about_several_axes_is_refused_and_a_tilt_is_warned_of():
    with pytest.raises(ValueError, match=r"turns by 3\d\d degrees, and by .* Cut"):
        align(demonstrations(345, tilt=20.0))
    with pytest.warns(UserWarning, match="tilts, here up to"):
        align(demonstrations(345))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        align(demonstrations(345, tilt=0.0))
