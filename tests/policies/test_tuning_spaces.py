"""Spaces of settings: published ones are the methods', and every corner is a method."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from gplfd_env.spatial.arc import handle_pose_on_arc
from gplfd_policies import POLICIES, ViaPoint, align
from gplfd_policies.adaptation import begin_adaptation
from gplfd_policies.gp.noise import KerstingNoise
from gplfd_policies.registry.built_in import TABLE_1
from gplfd_policies.registry.catalogue import tuned
from gplfd_policies.registry.method import profile_of_spread
from gplfd_policies.registry.tuning_spaces import (
    SPACES,
    Setting,
    tuned_settings,
)

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("unchecked_types")]

GRID = np.linspace(0.0, 1.0, 40)
SHARES = st.floats(0.0, 1.0)
VIA_POINT = ViaPoint(phase=0.3, pose=handle_pose_on_arc(0.42, 0.35), std=1e-3)


def adapted(method, movement):
    adaptation = begin_adaptation(movement, method.adaptation, GRID)
    adaptation.observe(VIA_POINT)
    return adaptation.trajectory()


@pytest.mark.parametrize("name", SPACES)
@pytest.mark.filterwarnings("ignore:sensor noise")
def test_published_settings_are_those_of_the_registered_method(
    name, demonstrations, learned
):
    registered = POLICIES[name].method
    again = SPACES[name].method(registered, SPACES[name].published)
    assert again.config == registered.config
    if name == "gp-paper":  # of which `learned` shortens the search
        assert again.fit.keywords["noise"] == KerstingNoise()
    ours, theirs = (
        adapted(one, learned(one, demonstrations)) for one in (again, registered)
    )
    assert_array_equal(ours.mean, theirs.mean)
    assert_array_equal(ours.std, theirs.std)


def test_every_method_of_the_comparison_has_a_space():
    assert set(SPACES) == {*TABLE_1, "tp-gmm", "prodmp", "midigap"}


@pytest.mark.parametrize("name", SPACES)
def test_every_corner_is_a_method(name):
    space, registered = SPACES[name], POLICIES[name].method
    for corner in itertools.product((0.0, 1.0), repeat=len(space.settings)):
        values = space.at(corner)
        for share, setting, value in zip(
            corner, space.settings.values(), values.values(), strict=True
        ):
            assert value == (setting.high if share else setting.low)
        assert space.method(registered, values) != registered


@pytest.mark.parametrize(
    "setting",
    [
        Setting(published=0.3, low=0.1, high=20.0, logarithmic=True),
        Setting(published=0.3, low=0.1, high=20.0),
        Setting(published=4, low=3, high=9),
        Setting(published=False, low=False, high=True),
    ],
)
@given(a=SHARES, b=SHARES)
def test_a_setting_goes_from_low_to_high(setting, a, b):
    assert setting.at(0.0) == setting.low
    assert setting.at(1.0) == setting.high
    assert setting.at(a) in setting
    assert (setting.at(a) <= setting.at(b)) or a > b


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"components": 30}, r"components = 30 must be int from 3 to 20"),
        ({"components": 8.0}, r"components = 8.0 must be int"),
        ({"regularisation": 1.0}, r"regularisation = 1.0 must be float from 1e-07"),
        ({"width": 0.3}, r"the settings are components, regularisation, got"),
    ],
)
def test_settings_outside_a_space_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        tuned("gmr", SPACES["gmr"].published | changes)


def test_a_tuned_policy_has_the_settings_and_says_them():
    policy = tuned("gmr", {"components": 5, "regularisation": 1e-3})
    assert policy.summary == "gmr, tuned: components 5, regularisation 0.001"
    config = policy.method.fit.keywords["config"]
    assert (config.components, config.regularisation) == (5, 1e-3)


def test_tuned_policies_are_those_of_the_file():
    rows = {name for name in POLICIES if name.endswith("-tuned")}
    assert rows == {f"{name}-tuned" for name in tuned_settings()}
    for name, values in tuned_settings().items():
        expected = tuned(name, values, SPACES[name].resolution)
        assert repr(POLICIES[f"{name}-tuned"]) == repr(expected)


@pytest.mark.parametrize(
    ("name", "resolution"),
    [("gp", 1e-4), ("promp", 3e-4), ("kmp-tuned", 1e-3), ("promp-tuned", 1e-4)],
)
def test_chosen_resolution_is_that_of_the_stiffness_law(
    name, resolution, demonstrations
):
    aligned = align(demonstrations)
    expected = profile_of_spread(aligned, (resolution, 3e-2))
    assert_array_equal(POLICIES[name].method.profile(aligned).beta, expected.beta)
