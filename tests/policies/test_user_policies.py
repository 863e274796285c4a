"""Policies of one's own: by module, by file, from a package; checked at once."""

import dataclasses
import hashlib
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from gplfd_policies import (
    POLICIES,
    Learner,
    Method,
    Pipeline,
    PolicyOrigin,
    TrainingInput,
    ViaPoint,
    adapt,
    make_agent,
    policy_named,
)
from gplfd_policies.adaptation import begin_adaptation
from gplfd_policies.registry import catalogue
from gplfd_policies.registry.built_in import in_pipeline
from gplfd_policies.registry.catalogue import packaged_summaries

MODULE = '''
"""Somebody's policies."""
import numpy as np
from gplfd_policies import Learner, Method, Policy, fit_skill


class Still:
    """Stays at the closed handle."""

    def __init__(self, training):
        self.poses = np.zeros((len(training.demonstrations), 6))

    def act(self, observation):
        return self.poses[0]


def make(training):
    """Stay where the handle is closed."""
    return Still(training)


def make_with_seed(training, seed):
    return Still(training)


method = Method(learner=Learner(fit=fit_skill))
learner = Learner(summary="as it says, too", fit=fit_skill)
policy = Policy(summary="as it says", make=method)
number = 3
'''
OBSERVATION = {"ee_pose": np.ones(6), "wrench": np.zeros(6)}


@pytest.fixture(autouse=True)
def forgotten_modules():
    """Forget what a test imported."""
    before, path = set(sys.modules), list(sys.path)
    yield
    for name in set(sys.modules) - before:
        del sys.modules[name]
    assert sys.path == path


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A working folder with a module of somebody's."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.py").write_text(MODULE)
    return tmp_path


@pytest.mark.parametrize(
    ("prediction", "message"),
    [
        (None, "must return a GaussianTrajectory, or mean and standard deviation"),
        (np.zeros((3, 6)), r"of shape \(2, 6\)"),
        ((np.zeros((2, 6)), np.zeros((2, 3))), r"of shape \(2, 6\)"),
        ((np.full((2, 6), np.nan), np.zeros((2, 6))), "finite, and no σ < 0"),
        ((np.zeros((2, 6)), np.full((2, 6), -1.0)), "finite, and no σ < 0"),
    ],
)
def test_a_learner_predicts_a_mean_and_a_standard_deviation(
    prediction, message, demonstrations
):
    def fit(aligned):
        return SimpleNamespace(predict=lambda phases: prediction)

    training = TrainingInput(demonstrations=demonstrations)
    movement = Method(learner=Learner(fit=fit)).learn(training)
    phases = np.array([0.2, 0.4])
    with pytest.raises(ValueError, match=message):
        movement.predict(phases)
    curves = np.array([[0.1] * 6, [0.3] * 6])
    prediction = curves, 0.1 * curves
    trajectory = movement.predict(phases)
    assert_array_equal(trajectory.std, 0.1 * curves)
    np.testing.assert_allclose(trajectory.mean_rate, 1.0)
    with pytest.raises(ValueError, match=r"with predict\(phases\), not 1.0"):
        Method(learner=Learner(fit=lambda aligned: 1.0)).learn(training)


def test_what_a_learner_has_fitted_may_adapt_by_itself(demonstrations):
    class Shifted(SimpleNamespace):
        def predict(self, phases):
            return np.tile(phases[:, None], 6) + self.shift, np.ones((len(phases), 6))

        def adapt(self, via_points):
            return Shifted(shift=1.0) if self.shift == 0.0 else None

    method = Method(learner=Learner(fit=lambda aligned: Shifted(shift=0.0)))
    movement = method.learn(TrainingInput(demonstrations=demonstrations))
    still = dataclasses.replace(method, pipeline=Pipeline(adapts=False))
    assert still.adaptation(movement) is None
    phases, point = np.array([0.2, 0.4]), ViaPoint(phase=0.3, pose=np.zeros(6))
    online = begin_adaptation(movement, method.adaptation(movement), phases)
    online.observe(point)
    assert_array_equal(online.mean[:, 0], 1.0 + phases)
    assert_array_equal(adapt(movement, [point]).predict(phases).mean, online.mean)
    with pytest.raises(ValueError, match=r"and adapt.. of a learner must .* not None"):
        online.observe(point)


@pytest.mark.parametrize("name", ["mine:make", "./mine.py:make"])
def test_a_function_in_a_file_is_a_policy(name, folder, demonstrations):
    policy = policy_named(name)
    assert policy.summary == "Stay where the handle is closed."
    assert policy.method is None
    assert policy.origin == PolicyOrigin(
        name=name,
        kind="module",
        folder=str(folder),
        file=str(folder / "mine.py"),
        sha256=hashlib.sha256(MODULE.encode()).hexdigest(),
    )
    agent = make_agent(name, demonstrations)
    agent.reset(OBSERVATION)
    assert_array_equal(agent.act(OBSERVATION).action, np.zeros(6))


def test_classes_methods_and_helpers_beside_a_module_are_found(folder):
    package = folder / "laboratory"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "best.py").write_text("from mine import make\nimport mine\n")
    here = folder / "a@b"
    here.mkdir()
    (here / "hers.py").write_text(MODULE)
    for name, summary, is_method in (
        ("mine:Still", "Stays at the closed handle.", False),
        ("mine:method", "method of mine (", True),
        ("mine:policy", "as it says", True),
        ("mine:learner", "as it says, too", True),
        ("mine:learner@no-size", "as it says, too; infers no size", True),
        (f"{here}/hers.py:make", "Stay where", False),
        ("laboratory.best:mine.Still", "Stays at the closed handle.", False),
    ):
        policy = policy_named(name)
        assert policy.summary.startswith(summary)
        assert isinstance(policy.method, Method) is is_method


def test_parts_of_a_pipeline_are_joined(folder):
    pipeline = policy_named(
        "mine:learner@no-size+no-modes+carried-load"
    ).method.pipeline
    expected = in_pipeline("gp", POLICIES["gp"], "carried-load").method.pipeline
    assert pipeline == dataclasses.replace(expected, size_inference=None, modes=None)
    with pytest.raises(ValueError, match="two of its parts replace profile"):
        policy_named("gp@constant-100+constant-500")


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("absent:make", r"'absent:make': there is no module 'absent', .*path/to/file"),
        ("absent.py:make", r"there is no file .*absent\.py"),
        (
            "mine:metod",
            r"y\) has no 'metod' \(.* 'method'\?\); it has Still, ",
        ),
        ("mine:number", "number of mine .* is a int; it must be a Learner, a"),
        ("mine:make_with_seed", r"make_with_seed\(training, seed\) of mine .*one arg"),
        (":", "names no module; give module:function or path/to/file.py:function"),
        ("mine.py", r"name a function in it, as in mine\.py:make"),
        ("users:make", r"importing users failed with Zero.*\(broken\.py, line 2, in"),
        ("json:make", r"module 'json' is already .*; rename .*json\.py"),
    ],
)
def test_what_cannot_be_used_is_refused_at_once(name, message, folder):
    (folder / "broken.py").write_text("\n1 / 0\n")
    (folder / "users.py").write_text("import broken\n")
    (folder / "json.py").write_text(MODULE)
    with pytest.raises(ValueError, match=message):
        policy_named(name)


def forget(*modules):
    """Forget modules and their files, as another process would."""
    for name in modules:
        del sys.modules[name]
    catalogue._FIRST_SEEN.clear()


@pytest.mark.parametrize(
    ("name", "helpers"),
    [
        ("users", {"helper/__init__.py": "from .a import *", "helper/a.py": "N = 1"}),
        ("pack.users", {"helper.py": "", "pack/__init__.py": "NUMBER = 1"}),
    ],
)
def test_a_policy_is_also_what_it_imports_beside_it(folder, name, helpers):
    module = f"{name.replace('.', '/')}.py"
    for file, text in {module: f"import helper, json\n{MODULE}", **helpers}.items():
        (folder / file).parent.mkdir(exist_ok=True)
        (folder / file).write_text(text)
    policy = f"{name}:make"
    before = policy_named(policy).origin.sha256
    last = folder / list(helpers)[-1]
    last.write_text(last.read_text() + "0")
    # What was imported is not what is in the file.
    with pytest.raises(ValueError, match=f"{last} has changed since this process"):
        policy_named(policy)
    forget(name, "helper")
    assert policy_named(policy).origin.sha256 != before
    last.write_text(helpers[str(last.relative_to(folder))])
    # What lies there and is not imported does not count, nor what was imported before.
    (folder / "unrelated.py").write_text(f"import helper\n{MODULE}")
    (folder / "policies").mkdir()
    (folder / "policies" / "__init__.py").write_text("")
    forget(name)
    policy_named("unrelated:make")
    assert policy_named(policy).origin.sha256 == before


def test_packages_offer_policies_by_name(tmp_path, monkeypatch):
    site = tmp_path / "site"
    information = site / "theirs-1.2.dist-info"
    information.mkdir(parents=True)
    (information / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: theirs\nVersion: 1.2\n"
    )
    (information / "entry_points.txt").write_text(
        "[gplfd_policies]\nbest = theirs:make\nworst = theirs:policy\n"
    )
    (site / "theirs.py").write_text(MODULE)
    monkeypatch.syspath_prepend(site)
    policy = policy_named("best")
    assert policy.summary == "Stay where the handle is closed."
    assert policy.origin == PolicyOrigin(
        name="best",
        kind="package",
        file=str(site / "theirs.py"),
        sha256=hashlib.sha256(MODULE.encode()).hexdigest(),
        distribution="theirs",
        version="1.2",
    )
    listed = packaged_summaries(POLICIES)
    assert list(listed) == ["best", "worst"]
    assert listed["best"] == f"{policy.summary} (theirs 1.2)"
    with pytest.raises(
        ValueError, match=r"unknown policy 'bets' \(did you mean 'best'"
    ):
        policy_named("bets")
