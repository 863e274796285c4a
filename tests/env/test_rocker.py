"""Paddles, touch bars and handlesets: geometry, limits, and that they open."""

import gymnasium as gym
import numpy as np
import pytest

from gplfd_env.doors.config import TURNING, DoorConfig
from gplfd_env.doors.geometry import ROCKERS, DoorGeometry
from gplfd_policies.agents.model_based.oracle import OracleAgent

pytestmark = pytest.mark.slow

KINDS = [
    (handle, swing, side)
    for handle in ROCKERS
    for swing in ("pull", "push")
    for side in ("right", "left")
    if (handle, swing) != ("touch-bar", "pull")
]


def door(handle, swing, side, **more):
    latch = "none" if handle == "bar" else "spring"
    fields = {"radius": 0.7, "handle_height": 1.0, **more}
    return DoorConfig(
        handle=handle, latch=latch, swing=swing, hinge_side=side, **fields
    )


@pytest.mark.parametrize("kind", KINDS, ids="-".join)
def test_a_turn_presses_a_thumb_piece_down_and_moves_others_as_the_door_opens(kind):
    config = door(*kind)
    x, y, z = DoorGeometry.of(config).hand_poses(0.0, config.handle_travel)[:3]
    way = config.handle_arm * np.sin(config.handle_travel)
    if config.handle == "handleset":
        assert y == pytest.approx(-way)
    else:
        assert x == pytest.approx(config.swing_sign * way)
    assert z == 0.0


@pytest.mark.parametrize("handle", TURNING)
def test_what_is_not_given_is_that_of_the_kind_and_can_be_given(handle):
    swing = "push" if handle == "touch-bar" else "pull"
    plain, usual = DoorConfig(handle=handle, swing=swing), TURNING[handle]
    assert (*plain.handle_spring, plain.handle_travel, plain.handle_arm) == usual
    given = plain.replaced({"lockset": {"handle_travel": 0.5, "handle_arm": 0.1}})
    assert (given.handle_travel, given.handle_arm) == (0.5, 0.1)


@pytest.mark.parametrize(
    ("kind", "radius", "most"),
    [
        (("paddle", "pull", "left"), 0.7, 60.0),
        (("touch-bar", "push", "right"), 1.0, 60.0),
        (("touch-bar", "push", "left"), 0.7, 60.0),
        (("handleset", "pull", "right"), 0.7, 40.0),
        # The palm once met the jamb beside the lock at 5 to 9 degrees.
        (("bar", "push", "left"), 0.95, 10.0),
    ],
    ids=str,
)
def test_who_knows_the_door_opens_it_gently(kind, radius, most):
    env = gym.make(
        "gplfd/DoorOpening-v1", door=door(*kind, radius=radius), base="mobile"
    ).unwrapped
    observation, info = env.reset(seed=0)
    agent, done, peak = OracleAgent(), False, 0.0
    agent.inform(env.door_geometry)
    agent.reset(observation)
    while not done:
        action = agent.act(observation).action
        observation, _, terminated, truncated, info = env.step(action)
        peak = max(peak, float(np.linalg.norm(observation["wrench"][:3])))
        done = terminated or truncated
    env.close()
    assert info["success"]
    assert peak < most
