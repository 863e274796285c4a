"""Anything that can act is an agent; what it leaves out is filled in."""

import re
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from gplfd_env import DoorConfig, DoorGeometry
from gplfd_policies import AgentStep, GaussianTrajectory, as_agent, batch_agents

EXPECTED = GaussianTrajectory.from_moments(
    np.zeros(1), np.zeros((1, 6)), np.zeros((1, 6)), lambda: np.zeros((6, 1, 1))
)
OBSERVATION = {"ee_pose": np.zeros(6), "wrench": np.zeros(6)}


class Counting:
    """Commands the number of its steps; knows nothing else."""

    def __init__(self):
        self.steps = 0

    def act(self, observation):
        self.steps += 1
        return np.full(6, float(self.steps))


class Returning(Counting):
    """Returns an answer, and good poses until then."""

    def __init__(self, answer, good=0):
        super().__init__()
        self.answer, self.good = answer, good

    def act(self, observation):
        pose = super().act(observation)
        return pose if self.steps <= self.good else self.answer


class Soft(Returning):
    """Commands stiffness, too."""

    control = "impedance"


SOFTLY = AgentStep(action=np.arange(6.0), stiffness=np.arange(6.0, 12.0), phase=0.5)


@pytest.mark.parametrize("answer", [np.arange(12.0), list(range(12)), SOFTLY])
def test_pose_and_stiffness_are_a_step_of_an_agent_that_says_so(answer):
    agent = as_agent(Soft(answer))
    assert agent.control == "impedance"
    step = agent.act(OBSERVATION)
    assert_array_equal(step.action, np.arange(6.0))
    assert_array_equal(step.stiffness, np.arange(6.0, 12.0))
    assert_array_equal(step.command(agent.control), np.arange(12.0))
    assert_array_equal(step.command("pose"), np.arange(6.0))


POSE, TWELVE = "six finite numbers", "twelve finite numbers"
PAIR = AgentStep(action=np.zeros((2, 6)), stiffness=np.ones((2, 6)))


@pytest.mark.parametrize(
    ("kind", "answer", "what"),
    [
        (Returning, np.zeros(3), rf"array\(\[0\., 0\., 0\.\]\).*{POSE}"),
        (Returning, PAIR, rf"AgentStep\(action=array\(\[\[0.*{POSE}"),
        (Returning, AgentStep(action=np.full(6, np.inf)), rf"array\(\[inf.*{POSE}"),
        (Returning, None, rf"None.*{POSE}"),
        (Returning, "pull", rf"'pull'.*{POSE}"),
        (Returning, np.zeros(12), rf"{POSE}.* control = 'impedance'"),
        (Soft, np.zeros(6), TWELVE),
        (Soft, AgentStep(action=np.zeros(6)), TWELVE),
    ],
)
def test_what_is_no_command_is_reported_with_its_step(kind, answer, what):
    good = 2 if kind is Returning else 0
    agent = as_agent(kind(answer, good=good))
    agent.reset(OBSERVATION)
    for _ in range(good):
        agent.act(OBSERVATION)
    message = rf"{kind.__name__}\.act returned .* at step {good + 1} of"
    with pytest.raises(ValueError, match=message) as error:
        agent.act(OBSERVATION)
    assert re.search(what, str(error.value))


class Whole(Counting):
    """Has every method that an agent may have."""

    forecasted: Any = EXPECTED

    def inform(self, door):
        self.door = door

    def reset(self, observation):
        self.began_with = observation
        self.steps = 0

    def forecast(self):
        return self.forecasted


def test_an_agent_changes_only_its_own_observation():
    class InPlace:
        def reset(self, observation):
            observation["ee_pose"][:] = observation["wrench"][:] = 9.0

        def act(self, observation):
            observation["ee_pose"] += 1.0
            return observation.pop("ee_pose")

    agent, observation = (
        as_agent(InPlace()),
        {n: a.copy() for n, a in OBSERVATION.items()},
    )
    agent.reset(observation)
    for _ in range(2):
        assert_array_equal(agent.act(observation).action, np.ones(6))
    assert observation.keys() == OBSERVATION.keys()
    assert not np.any([*observation.values()])


def test_other_methods_are_called_where_they_exist():
    whole = Whole()
    doors = [DoorGeometry.of(DoorConfig(radius=radius)) for radius in (0.4, 0.5)]
    agent = as_agent(whole)
    agent.inform(doors[0])
    assert whole.door is doors[0]
    for _ in range(2):
        agent.reset(OBSERVATION)
        assert agent.act(OBSERVATION).action[0] == 1.0
    assert whole.began_with.keys() == OBSERVATION.keys()
    assert agent.forecast() is EXPECTED
    batch_agents([Counting(), whole]).inform(doors)
    assert whole.door is doors[1]
    whole.forecasted = np.zeros((100, 6))
    with pytest.raises(ValueError, match=r"Whole\.forecast returned .*ndarray"):
        agent.forecast()


def test_a_batch_commands_one_thing():
    soft = [Soft(np.zeros(12)), Soft(SOFTLY)]
    batch = batch_agents(soft)
    assert (batch.control, batch_agents([Counting()]).control) == ("impedance", "pose")
    rows = {name: np.stack([row, row]) for name, row in OBSERVATION.items()}
    command = batch.act(rows).command(batch.control)
    assert_array_equal(command, [np.zeros(12), np.arange(12.0)])
    with pytest.raises(ValueError, match=r"some command poses and others .* batch of"):
        batch_agents([*soft, Counting()])
