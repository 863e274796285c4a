"""What policies make goes to another process and back without changing a bit."""

import dataclasses
import pickle

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from gplfd_env.spatial.se3 import handle_pose_on_arc
from gplfd_policies import POLICIES, ViaPoint

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("unchecked_types")]

PHASES = np.linspace(0.0, 1.0, 30)
VIA_POINT = ViaPoint(phase=0.3, pose=handle_pose_on_arc(0.42, 0.35), std=1e-3)


def sent(thing):
    return pickle.loads(pickle.dumps(thing))


def assert_equal(one, other):
    """Bit for bit, field by field; arrays that are computed on first use, too."""
    names = [field.name for field in dataclasses.fields(one) if field.compare]
    names += ["covariance"] if hasattr(one, "covariance") else []
    for name in set(names) - {"covariance_function"}:
        assert_array_equal(getattr(one, name), getattr(other, name), name)


def observations(count):
    """A door that is opened whatever is commanded, and shakes."""
    rng = np.random.default_rng(0)
    for angle in np.linspace(0.0, 0.5, count):
        yield {
            "ee_pose": handle_pose_on_arc(0.42, angle) + 1e-4 * rng.normal(size=6),
            "wrench": rng.normal(size=6) * [9.0, 3.0, 3.0, 0.1, 0.1, 0.1],
        }


LEARNED = ("gp", "gp-one-size", "gp-carried-load", "gp-impedance", "dmp")
MODEL_BASED = [name for name, policy in POLICIES.items() if policy.method is None]


@pytest.mark.parametrize("name", [*LEARNED, *MODEL_BASED])
@pytest.mark.filterwarnings("ignore:sensor noise")
def test_agents_act_on_as_if_nothing_had_happened(name, learned_agent):
    agent = learned_agent(name)
    copy = sent(agent)
    for time, observation in enumerate(observations(6)):
        if time == 0:
            agent.reset(observation)
            copy.reset(observation)
        if time == 3:
            copy = sent(copy)
        assert_equal(agent.act(observation), copy.act(observation))
    if agent.forecast() is not None:
        assert_equal(agent.forecast(), copy.forecast())
        assert_equal(agent.forecast(), sent(agent.forecast()))
