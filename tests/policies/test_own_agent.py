"""Anything that can act is an agent; what it leaves out is filled in."""

import pickle
from typing import Any

import numpy as np
import pytest

from gplfd_env import DoorGeometry
from gplfd_policies.agents.agent import Agent, CompliantAgent, as_agent
from gplfd_policies.agents.lockstep import batch_agents
from gplfd_policies.control.compliance import ComplianceConfig
from gplfd_policies.control.steps import AgentStep
from gplfd_policies.movements.trajectory import GaussianTrajectory

EXPECTED = GaussianTrajectory.from_moments(
    np.zeros(1), np.zeros((1, 6)), np.zeros((1, 6)), lambda: np.zeros((6, 1, 1))
)
OBSERVATION = {"ee_pose": np.zeros(6), "wrench": np.zeros(6)}


class Counting:
    """Commands the number of its steps; knows nothing else."""

    def __init__(self) -> None:
        self.steps = 0

    def act(self, observation: Any) -> np.ndarray:
        self.steps += 1
        return np.full(6, float(self.steps))


class Returning(Counting):
    """Returns what it was given, and good poses until then."""

    def __init__(self, given: Any, good: int = 0) -> None:
        super().__init__()
        self.given, self.good = given, good

    def act(self, observation: Any) -> Any:
        pose = super().act(observation)
        return pose if self.steps <= self.good else self.given


@pytest.mark.parametrize("given", [np.arange(6.0), list(range(6)), (0, 1, 2, 3, 4, 5)])
def test_a_pose_is_a_step(given: Any) -> None:
    agent = as_agent(Returning(given))
    assert isinstance(agent, Agent)
    agent.reset(OBSERVATION)
    step = agent.act(OBSERVATION)
    np.testing.assert_array_equal(step.action, np.arange(6.0))
    assert np.isnan(step.std).all()
    assert agent.forecast() is None


class Soft(Returning):
    """Commands stiffness, too."""

    control = "impedance"


SOFTLY = AgentStep(action=np.arange(6.0), stiffness=np.arange(6.0, 12.0), phase=0.5)


@pytest.mark.parametrize("given", [np.arange(12.0), list(range(12)), SOFTLY])
def test_pose_and_stiffness_are_a_step_of_an_agent_that_says_so(given: Any) -> None:
    agent = as_agent(Soft(given, good=0))
    assert agent.control == "impedance"
    step = agent.act(OBSERVATION)
    np.testing.assert_array_equal(step.action, np.arange(6.0))
    np.testing.assert_array_equal(step.stiffness, np.arange(6.0, 12.0))
    np.testing.assert_array_equal(step.command(agent.control), np.arange(12.0))
    np.testing.assert_array_equal(step.command("pose"), np.arange(6.0))


@pytest.mark.parametrize(
    "given",
    [
        np.zeros(6),
        np.full(12, np.nan),
        AgentStep(action=np.zeros(6)),
        AgentStep(action=np.zeros((2, 6)), stiffness=np.ones((2, 6))),
    ],
)
def test_a_pose_without_stiffness_is_reported_to_who_promised_one(given: Any) -> None:
    message = r"Soft\.act returned .* at step 1 .* twelve finite numbers"
    with pytest.raises(ValueError, match=message):
        as_agent(Soft(given)).act(OBSERVATION)


def test_stiffness_of_an_agent_that_commands_poses_says_how_to_command_it() -> None:
    message = "six finite numbers.* control = 'impedance'"
    with pytest.raises(ValueError, match=message):
        as_agent(Returning(np.zeros(12))).act(OBSERVATION)


def test_unknown_control_is_reported_at_once() -> None:
    own = Counting()
    own.control = "force"  # type: ignore[attr-defined]
    with pytest.raises(ValueError, match=r"Counting\.control is 'force'; .* 'pose'"):
        as_agent(own)


def test_a_batch_commands_one_thing() -> None:
    soft = [Soft(np.zeros(12)), Soft(SOFTLY)]
    batch = batch_agents(soft)
    assert (batch.control, batch_agents([Counting()]).control) == ("impedance", "pose")
    rows = {name: np.stack([row, row]) for name, row in OBSERVATION.items()}
    command = batch.act(rows).command(batch.control)
    np.testing.assert_array_equal(command, [np.zeros(12), np.arange(12.0)])
    with pytest.raises(ValueError, match=r"some command poses and others .* batch of"):
        batch_agents([*soft, Counting()])


def test_what_is_explained_is_kept() -> None:
    step = AgentStep(action=np.zeros(6), std=np.ones(6), phase=0.25)
    assert as_agent(Returning(step)).act(OBSERVATION) is step


def test_reset_and_forecast_are_asked_where_they_exist() -> None:
    class Whole(Counting):
        def reset(self, observation: Any) -> None:
            self.began_with = observation
            self.steps = 0

        def forecast(self) -> GaussianTrajectory:
            return EXPECTED

    own = Whole()
    agent = as_agent(own)
    for _ in range(2):
        agent.reset(OBSERVATION)
        assert agent.act(OBSERVATION).action[0] == 1.0
    assert own.began_with is OBSERVATION
    assert agent.forecast() is EXPECTED


def test_an_agent_that_wants_to_know_the_door_is_told() -> None:
    class Knowing(Counting):
        def inform(self, door: DoorGeometry) -> None:
            self.door = door

    own, doors = Knowing(), [DoorGeometry.nominal(radius) for radius in (0.4, 0.5)]
    as_agent(own).inform(doors[0])
    assert own.door is doors[0]
    batch_agents([Counting(), own]).inform(doors)
    assert own.door is doors[1]


def test_agents_are_wrapped_once() -> None:
    agent = as_agent(Counting())
    assert as_agent(agent) is agent
    assert isinstance(pickle.loads(pickle.dumps(agent)), type(agent))
    compliant = object.__new__(CompliantAgent)
    object.__setattr__(compliant, "config", ComplianceConfig())
    assert as_agent(compliant) is compliant


@pytest.mark.parametrize(
    ("given", "what"),
    [
        (np.zeros(3), r"array\(\[0\., 0\., 0\.\]\)"),
        (np.zeros((1, 6)), r"array\(\[\[0\., 0\."),
        (AgentStep(action=np.zeros((2, 6))), r"AgentStep\(action=array\(\[\[0"),
        (np.array([0.0, np.nan, 0.0, 0.0, 0.0, 0.0]), r"array\(\[ ?0\., nan"),
        (AgentStep(action=np.full(6, np.inf)), r"AgentStep\(action=array\(\[inf"),
        (0.5, "0.5"),
        (None, "None"),
        ({"action": np.zeros(6)}, r"{'action': array"),
        ("pull", "'pull'"),
    ],
)
def test_what_is_no_pose_is_reported_with_its_step(given: Any, what: str) -> None:
    agent = as_agent(Returning(given, good=2))
    agent.reset(OBSERVATION)
    for _ in range(2):
        agent.act(OBSERVATION)
    message = rf"Returning\.act returned {what}.* at step 3 .* six finite numbers"
    with pytest.raises(ValueError, match=message):
        agent.act(OBSERVATION)


def test_a_forecast_is_a_trajectory() -> None:
    class Guessing(Counting):
        def forecast(self) -> np.ndarray:
            return np.zeros((100, 6))

    with pytest.raises(ValueError, match=r"Guessing\.forecast returned .*ndarray"):
        as_agent(Guessing()).forecast()


@pytest.mark.parametrize(
    ("candidate", "what"),
    [
        (object(), "an object of <class 'object'>"),
        (None, "an object of <class 'NoneType'>"),
        (Counting, r"<class '.*Counting'> itself, no object of it,"),
    ],
)
def test_what_cannot_act_is_refused(candidate: object, what: str) -> None:
    with pytest.raises(ValueError, match=rf"^{what} is no agent: .*act\(observation\)"):
        as_agent(candidate)
    with pytest.raises(ValueError, match="is no agent"):
        batch_agents([candidate])


def test_agents_of_ones_own_act_in_a_batch() -> None:
    batch = batch_agents([Counting(), Counting()])
    observations = {name: np.zeros((2, 6)) for name in OBSERVATION}
    batch.reset(observations)
    batch.act(observations, np.array([True, False]))
    steps = batch.act(observations)
    np.testing.assert_array_equal(steps.action[:, 0], [2.0, 1.0])
    assert batch.forecast(0) is None
