"""Reaching: a learned movement to the handle, and who acts then."""

import numpy as np
import pytest

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_experiments.data.teacher import ForceConfig, Teacher
from gplfd_policies import AgentStep, as_agent
from gplfd_policies.agents.reaching import (
    CLOSING,
    ReachingAgent,
    join_at_grasp,
    learn_reach,
    split_at_grasp,
)

ELSEWHERE = np.array([0.136, 0.02, -0.064, 0.0, 0.05, 0.0])


class Holding:
    """Commands one pose and remembers how it was begun."""

    def __init__(self, control="pose"):
        self.control, self.begun = control, list[float]()

    def reset(self, observation):
        self.begun.append(float(observation["time"][0]))

    def act(self, observation):
        return AgentStep(action=np.full(6, 0.5), stiffness=np.full(6, 50.0))


@pytest.fixture(scope="module")
def reach():
    return learn_reach(Teacher().standard_reaches(seed=0))


def commands(agent, start, seconds):
    steps = []
    for step in range(round(seconds / CONTROL_PERIOD)):
        observation = {"ee_pose": start, "time": np.array([step * CONTROL_PERIOD])}
        if step == 0:
            agent.reset(observation)
        steps.append(agent.act(observation))
    return steps


@pytest.mark.parametrize("forces", [None, ForceConfig()])
def test_parts_are_what_they_were_joined_from(forces):
    teacher, rng = Teacher(forces=forces), np.random.default_rng(0)
    reached, opening = teacher.demonstrate_reach(rng), teacher.demonstrate(0.5, rng)
    whole = join_at_grasp(reached, opening)
    for part, original in zip(
        split_at_grasp(whole, whole.times >= 0.0), (reached, opening), strict=True
    ):
        assert np.array_equal(part.times, original.times)
        assert np.array_equal(part.poses, original.poses)
        assert np.array_equal(part.wrenches, original.wrenches)
    if forces is not None:
        assert not whole.wrenches[whole.times < 0.0].any()


@pytest.mark.parametrize("away", [0.8 * ELSEWHERE, ELSEWHERE, 1.3 * ELSEWHERE])
def test_it_leads_from_where_the_hand_is_to_the_handle(reach, away):
    agent = ReachingAgent(reach, as_agent(Holding()))
    path = np.array(
        [step.action for step in commands(agent, away, reach.duration + CLOSING)]
    )
    assert path[0] == pytest.approx(away, abs=3e-3)
    assert path[-1] == pytest.approx(np.zeros(6), abs=1e-3)
    speeds = np.linalg.norm(np.diff(path[:, :3], axis=0), axis=1) / CONTROL_PERIOD
    # A minimum-jerk motion has 1.875 times its mean speed at most.
    assert speeds.max() < 3.0 * np.linalg.norm(away[:3]) / reach.duration
    waiting = path[-round(CLOSING / CONTROL_PERIOD) :]
    assert np.abs(waiting).max() < 2e-3


def test_it_is_surest_at_the_handle(reach):
    agent = ReachingAgent(reach, as_agent(Holding()))
    steps = commands(agent, ELSEWHERE, reach.duration)
    spread = np.array([np.linalg.norm(step.std[:3]) for step in steps])
    assert spread[-1] < 0.1 * spread.max()


def test_it_hands_over_once_when_the_gripper_has_closed(reach):
    then = Holding()
    agent = ReachingAgent(reach, as_agent(then))
    steps = commands(agent, ELSEWHERE, reach.duration + CLOSING + 0.5)
    reaching = [step.action[0] != 0.5 for step in steps]
    lasting = sum(reaching) * CONTROL_PERIOD
    assert reaching == sorted(reaching, reverse=True)
    assert lasting == pytest.approx(reach.duration + CLOSING, abs=1.5 * CONTROL_PERIOD)
    assert then.begun == pytest.approx([lasting])
    commands(agent, ELSEWHERE, 0.1)
    assert len(then.begun) == 1, "the next episode begins with another reach"


def test_it_is_stiff_where_the_other_commands_stiffness(reach):
    soft = ReachingAgent(reach, as_agent(Holding("impedance")))
    assert soft.control == "impedance"
    (step,) = commands(soft, ELSEWHERE, CONTROL_PERIOD)
    assert step.command("impedance")[6:].tolist() == [2000.0] * 3 + [100.0] * 3
    (step,) = commands(
        ReachingAgent(reach, as_agent(Holding())), ELSEWHERE, CONTROL_PERIOD
    )
    assert np.isnan(step.stiffness).all()
