"""A learned skill in a file, and back."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from gplfd_policies import POLICIES, ViaPoint, align, fit_skill, load_skill
from gplfd_policies.adaptation import ADAPTATIONS
from gplfd_policies.gp.heteroscedastic import KerstingNoise
from gplfd_policies.registry.method import TrainingInput

pytestmark = pytest.mark.slow

PHASES = np.linspace(-0.05, 1.05, 45)
VIA_POINT = ViaPoint(phase=0.4, pose=np.array([0.2, 0.0, -0.05, 0.0, 0.4, np.nan]))


@pytest.fixture(scope="module")
def small(demonstrations):
    return fit_skill(align(demonstrations, n_samples=20))


@pytest.fixture(scope="module")
def saved(small, tmp_path_factory):
    path = tmp_path_factory.mktemp("skills") / "skill.npz"
    small.save(path)
    return path


def same_bits(first, second):
    names = ("times", "mean", "std", "mean_rate", "std_rate", "covariance")
    return first.degrees_of_freedom == second.degrees_of_freedom and all(
        getattr(first, name).tobytes() == getattr(second, name).tobytes()
        for name in names
    )


def test_a_loaded_skill_is_the_saved_one_bit_for_bit(small, saved):
    loaded = load_skill(saved)
    assert repr(loaded) == repr(small)
    for phases in (PHASES, PHASES[3:-3]):
        assert same_bits(loaded.predict(phases), small.predict(phases))
    assert loaded.deviations == small.deviations
    for form in ADAPTATIONS.values():
        adaptations = [form(source, PHASES) for source in (loaded, small)]
        for adaptation in adaptations:
            adaptation.observe(VIA_POINT)
        assert same_bits(*(adaptation.trajectory() for adaptation in adaptations))


@pytest.mark.parametrize(
    ("noise", "count"),
    [(KerstingNoise(n_iterations=1), 6), ("homoscedastic", 6), ("homoscedastic", 1)],
)
@pytest.mark.filterwarnings("ignore:One demonstration")
def test_skills_of_every_noise_model(noise, count, demonstrations, tmp_path):
    aligned = align(demonstrations[:count], n_samples=20)
    skill = fit_skill(aligned, noise, centred=False)
    skill.save(tmp_path / "skill.npz")
    loaded = load_skill(tmp_path / "skill.npz")
    assert same_bits(loaded.predict(PHASES), skill.predict(PHASES))


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"poses": None}, "it lacks 'poses'"),
        ({"poses": np.full((6, 20, 6), np.nan)}, "'poses' must be finite numbers"),
        ({"duration": np.array(0.0)}, "duration positive"),
        ({"format_version": np.array(1)}, "version 1, and this program reads"),
        ({"duration": np.array(1e9)}, r"duration \[s\] is 1e.09; at most 3600 is"),
        ({"duration": np.array(0.01)}, r"speed \[m/s\] is .*; at most 10 is"),
        ({"scale": np.zeros(6)}, "speed .* is nan"),
        ({"length_scale": np.zeros(6)}, "length_scale must be positive"),
        ({"noise_coefficients": np.full((6, 48), 400.0)}, "standard deviation"),
        ({"wobble": -np.ones(6)}, "wobble"),
        ({"white": np.full(6, 2.0)}, "shares in .0, 1."),
    ],
)
def test_wrong_content_is_refused(saved, tmp_path, changes, reason):
    with np.load(saved) as archive:
        arrays = dict(archive) | changes
    copy = tmp_path / "copy.npz"
    np.savez(copy, **{name: a for name, a in arrays.items() if a is not None})
    with pytest.raises(ValueError, match=rf"copy\.npz cannot be read .*{reason}"):
        load_skill(copy)


def test_what_loading_refuses_is_not_saved(small, tmp_path):
    hasty = replace(small, aligned=replace(small.aligned, duration=0.01))
    with pytest.raises(ValueError, match=r"speed \[m/s\] is .* in m, rad, s, N and"):
        hasty.save(tmp_path / "skill.npz")
    assert not [*tmp_path.iterdir()]


def test_forces_are_kept_with_the_skill(demonstrations, tmp_path):
    rng = np.random.default_rng(4)
    felt = [
        replace(motion, wrenches=rng.normal(3.0, 0.5, motion.poses.shape))
        for motion in demonstrations[1:]
    ]
    method = POLICIES["gp"].method
    training = TrainingInput(demonstrations=[demonstrations[0], *felt])
    learned = method.learn(training)
    learned.save(tmp_path / "skill.npz")
    loaded = load_skill(tmp_path / "skill.npz")
    assert_array_equal(loaded.aligned.wrenches, learned.aligned.wrenches)
    assert same_bits(loaded.predict(PHASES), learned.predict(PHASES))
    assert same_bits(loaded.forces.predict(PHASES), learned.forces.predict(PHASES))
    assert loaded.forces.deviations == learned.forces.deviations
    assert method.follow(loaded).forces is not None
