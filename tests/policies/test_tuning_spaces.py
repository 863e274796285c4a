"""Spaces of settings: published ones are the learners', tuned ones are policies."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from gplfd_env.spatial.se3 import handle_pose_on_arc
from gplfd_policies import ViaPoint, align, policy_named
from gplfd_policies.adaptation import begin_adaptation
from gplfd_policies.agents.agent import shared_in_batch
from gplfd_policies.registry.built_in import LEARNERS, SPACES, tuned
from gplfd_policies.registry.method import Method, profile_of_spread

pytestmark = pytest.mark.slow

GRID = np.linspace(0.0, 1.0, 40)
VIA_POINT = ViaPoint(phase=0.3, pose=handle_pose_on_arc(0.42, 0.35), std=1e-3)


def adapted(method, movement):
    adaptation = begin_adaptation(movement, method.adaptation(movement), GRID)
    adaptation.observe(VIA_POINT)
    return adaptation.trajectory()


@pytest.mark.parametrize("name", SPACES)
def test_published_settings_are_those_of_the_learner_in_the_default_pipeline(
    name, demonstrations, learned
):
    registered = Method(learner=LEARNERS[name])
    again = tuned(name, {}).method
    movement = learned(registered, demonstrations)
    agents = (again.follow(movement), registered.follow(movement))
    assert shared_in_batch(agents[0]) == shared_in_batch(agents[1])
    assert_array_equal(*(agent.config.profile.beta for agent in agents))
    ours, theirs = (
        adapted(method, learned(method, demonstrations))
        for method in (again, registered)
    )
    assert_array_equal(ours.mean, theirs.mean)
    assert_array_equal(ours.std, theirs.std)


@pytest.mark.parametrize("name", SPACES)
def test_both_ends_of_every_setting_are_a_method(name):
    for end in ("low", "high"):
        settings = SPACES[name].settings.items()
        values = {setting: getattr(limits, end) for setting, limits in settings}
        method = tuned(name, values).method
        assert (method.learner.fit == LEARNERS[name].fit) == (name == "mean")
        assert method.pipeline.config.via_std[0] == 2e-3 * values["via_std_factor"]
        assert method.pipeline.phases.keywords["config"].similarity.size_std in (0.1, 1)


def test_a_tuned_policy_has_the_settings_and_says_them():
    policy = tuned("gmr", {"components": 5, "regularisation": 1e-3})
    assert policy.summary == "gmr, tuned: components 5, regularisation 0.001"
    config = policy.method.learner.fit.keywords["config"]
    assert (config.components, config.regularisation) == (5, 1e-3)
    profile = tuned("gmr", {"resolution": 3e-4}).method.pipeline.profile
    assert profile.keywords["resolution"] == (3e-4, 3e-2)


@pytest.mark.parametrize(
    ("name", "resolution"), [("gp", 1e-4), ("promp", 1e-4), ("promp@published", 3e-4)]
)
def test_chosen_resolution_is_that_of_the_stiffness_law(
    name, resolution, demonstrations
):
    aligned = align(demonstrations)
    expected = profile_of_spread(aligned, (resolution, 3e-2))
    profile = policy_named(name).method.pipeline.profile(aligned)
    assert_array_equal(profile.beta, expected.beta)
