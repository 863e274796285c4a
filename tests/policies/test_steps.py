"""The record of a control step: one agent or many, with or without explanations."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from gplfd_policies import AgentStep
from gplfd_policies.control.steps import STEP_SHAPES

ACTIONS = np.arange(18.0).reshape(3, 6)


@pytest.mark.parametrize("action", [ACTIONS[0], ACTIONS])
def test_an_action_is_a_whole_step(action):
    step = AgentStep(action=action)
    assert_array_equal(step.action, action)
    assert not np.any(step.via_point)
    for name in set(STEP_SHAPES) - {"action", "via_point"}:
        value = getattr(step, name)
        assert np.shape(value) == action.shape[:-1] + STEP_SHAPES[name]
        assert np.isnan(value).all()


def test_what_was_given_stays_the_givers():
    action = ACTIONS[0].copy()
    step = AgentStep(action=action)
    action[0] = 7.0
    assert step.action[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        step.action[0] = 1.0


def test_no_steps_are_a_stack_of_none():
    assert AgentStep.stacked([]).action.shape == (0, 6)
