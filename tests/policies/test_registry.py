"""Policies by name."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gplfd_env.spatial.se3 import handle_pose_on_arc
from gplfd_policies import POLICIES, Demonstration, TrainingInput, make_agent
from gplfd_policies.registry.built_in import PARTS, PUBLISHED, tuned_settings

pytestmark = pytest.mark.slow

NAMES = [
    *POLICIES,
    *(f"gp@{part}" for part in PARTS),
    *(f"{name}@published" for name in PUBLISHED),
    *(f"{name}@tuned" for name in tuned_settings()),
]


@pytest.mark.parametrize("name", NAMES)
def test_every_policy_makes_finite_steps(name, learned_agent):
    """From the closed handle on, and until the first via-point is taken."""
    agent = learned_agent(name)
    observation = {"ee_pose": np.zeros(6), "wrench": np.zeros(6)}
    agent.reset(observation)
    step = agent.act(observation)
    assert np.isfinite(step.action).all()
    # Three components, which suit the whole path best, begin beside its start.
    off = 0.02 if name == "gmm-gp@tuned" else 0.01
    assert np.abs(step.action[:3]).max() < off
    for angle in (0.02, 0.04, 0.06):
        pose = handle_pose_on_arc(0.5, angle)
        step = agent.act({"ee_pose": pose, "wrench": np.full(6, -0.3)})
        assert np.isfinite(step.action).all()


@pytest.mark.parametrize(
    ("scale", "shift", "message"),
    [
        (1.0, [0.0, 0.1, 0.0], r"demonstration 1 .* closed handle"),
        (1000.0, [0.0, 0.0, 0.0], "in metres"),
    ],
)
def test_demonstrations_must_start_at_the_closed_handle(
    scale, shift, message, demonstrations
):
    first = demonstrations[0]
    poses = first.poses * np.repeat([scale, 1.0], 3) + np.pad(shift, (0, 3))
    with pytest.raises(ValueError, match=message):
        make_agent("gp", [first, Demonstration(times=first.times, poses=poses)])


@pytest.mark.parametrize("name", ["gp", "promp", "dmp"])
def test_motions_of_any_task_are_learned(name):
    # In the plane, far from the origin, of different lengths, rates and starts.
    rng = np.random.default_rng(0)
    motions = []
    for number in range(4):
        times = np.linspace(0.0, 2.0 + number, 80 + 40 * number)
        share = times / times[-1]
        start = [5.0, 2.0] + 0.1 * rng.normal(size=2)
        way = np.column_stack([share, 0.3 * np.sin(6.0 * share)])
        poses = np.pad(start + way, ((0, 0), (0, 4)))
        motions.append(Demonstration(times=times, poses=poses))
    method = POLICIES[name].method
    movement = method.learn(TrainingInput(demonstrations=motions))
    mean = movement.predict(np.array([0.0, movement.aligned.end])).mean
    assert_allclose(mean[:, 0], [5.0, 6.0], atol=0.2)
    assert_allclose(mean[:, 2:], 0.0, atol=1e-3)
    with pytest.raises(ValueError, match=r"demonstration 0 .* closed handle"):
        make_agent(name, motions)
