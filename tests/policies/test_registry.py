"""Policies by name."""

import numpy as np
import pytest

from policies import POLICIES, make_agent


@pytest.mark.parametrize("name", sorted(POLICIES))
def test_every_policy_makes_a_finite_first_step(name, demonstrations):
    agent = make_agent(name, demonstrations, seed=0, radius=0.5)
    observation = {"ee_pose": np.zeros(6), "wrench": np.zeros(6)}
    agent.reset(observation)
    step = agent.act(observation)
    assert np.isfinite(step.action).all()
    assert np.abs(step.action[:3]).max() < 0.01


@pytest.mark.parametrize("name", ["gp", "gp-product", "gp-fixed"])
def test_same_demonstrations_give_the_same_bits(name, demonstrations):
    actions = []
    for _ in range(2):
        agent = make_agent(name, demonstrations)
        observation = {"ee_pose": np.zeros(6), "wrench": np.full(6, 0.3)}
        agent.reset(observation)
        actions.append([agent.act(observation).action for _ in range(50)])
    np.testing.assert_array_equal(*actions)


def test_unknown_policy_lists_what_exists(demonstrations):
    with pytest.raises(ValueError, match=r"did you mean 'gp-fixed'.*gp-product"):
        make_agent("gp-fixd", demonstrations)


def test_no_demonstrations_is_an_error():
    with pytest.raises(ValueError, match="at least one"):
        make_agent("gp", ())


def test_oracle_asks_for_the_radius(demonstrations):
    with pytest.raises(ValueError, match=r"true radius.*radius=0.5"):
        make_agent("oracle", demonstrations)
