"""What policies make goes to another process and back without changing a bit."""

import dataclasses
import pickle
from functools import cache

import numpy as np
import pytest

from gplfd_env import DoorGeometry
from gplfd_env.spatial.arc import handle_pose_on_arc
from gplfd_policies import POLICIES, ViaPoint, align, make_agent
from gplfd_policies.adaptation import ADAPTATIONS
from gplfd_policies.movements.movement import Adaptable
from gplfd_policies.movements.skill import Skill
from gplfd_policies.registry.built_in import TABLE_1
from gplfd_policies.registry.method import TrainingInput

PHASES = np.linspace(0.0, 1.0, 30)
VIA_POINT = ViaPoint(phase=0.3, pose=handle_pose_on_arc(0.42, 0.35), std=1e-3)


def sent(thing):
    return pickle.loads(pickle.dumps(thing))


def assert_equal(one, other):
    """Bit for bit, field by field; arrays that are computed on first use, too."""
    names = [field.name for field in dataclasses.fields(one) if field.compare]
    names += ["covariance"] if hasattr(one, "covariance") else []
    for name in set(names) - {"covariance_function"}:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), name)


def observations(count):
    """A door that is opened whatever is commanded, and shakes."""
    rng = np.random.default_rng(0)
    for angle in np.linspace(0.0, 0.5, count):
        yield {
            "ee_pose": handle_pose_on_arc(0.42, angle) + 1e-4 * rng.normal(size=6),
            "wrench": rng.normal(size=6) * [9.0, 3.0, 3.0, 0.1, 0.1, 0.1],
        }


@pytest.fixture(scope="module")
def agents(demonstrations):
    """Every policy's agent; learned once, as a reset makes it as new."""

    @cache
    def make(name):
        agent = make_agent(name, demonstrations)
        agent.inform(DoorGeometry.nominal(0.42))
        return agent

    return make


@pytest.mark.parametrize("name", sorted(POLICIES))
@pytest.mark.filterwarnings("ignore:sensor noise")
def test_agents_act_on_as_if_nothing_had_happened(name, agents):
    agent = agents(name)
    copy = sent(agent)
    for time, observation in enumerate(observations(10)):
        if time == 0:
            agent.reset(observation)
            copy.reset(observation)
        if time == 5:
            copy = sent(copy)
        assert_equal(agent.act(observation), copy.act(observation))
    if agent.forecast() is not None:
        assert_equal(agent.forecast(), copy.forecast())
        assert_equal(agent.forecast(), sent(agent.forecast()))


@pytest.mark.parametrize("name", TABLE_1)
@pytest.mark.filterwarnings("ignore:sensor noise")
def test_movements_predict_and_adapt_the_same(name, demonstrations):
    training = TrainingInput(demonstrations=demonstrations)
    movement = POLICIES[name].method.learn(training)
    copy = sent(movement)
    predicted = movement.predict(PHASES)
    assert_equal(predicted, copy.predict(PHASES))
    assert_equal(predicted, sent(predicted))
    if isinstance(movement, Adaptable) and not isinstance(movement, Skill):
        adapted = movement.adapt([VIA_POINT])
        assert_equal(adapted.predict(PHASES), copy.adapt([VIA_POINT]).predict(PHASES))
        assert_equal(adapted.predict(PHASES), sent(adapted).predict(PHASES))


@pytest.mark.parametrize("form", sorted(ADAPTATIONS))
def test_adaptations_go_on_where_they_were(form, skill):
    adaptation = ADAPTATIONS[form](skill, PHASES)
    adaptation.observe(VIA_POINT)
    copy = sent(adaptation)
    assert_equal(adaptation.trajectory(), copy.trajectory())
    another = dataclasses.replace(VIA_POINT, phase=0.6)
    adaptation.observe(another)
    copy.observe(another)
    assert_equal(adaptation.trajectory(), copy.trajectory())


def test_demonstrations_and_via_points(demonstrations):
    for record in (demonstrations[0], align(demonstrations), VIA_POINT):
        assert_equal(record, sent(record))
