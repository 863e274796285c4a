"""Policies of one's own: by module, by file, from a package; checked at once."""

import dataclasses
import hashlib
import importlib.metadata
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from gplfd_policies import (
    POLICIES,
    Method,
    PolicyOrigin,
    load_policy,
    make_agent,
    policy_named,
)
from gplfd_policies.registry import module_files, user_policies
from gplfd_policies.registry.user_policies import packaged_summaries

MODULE = '''
"""Somebody's policies."""
import numpy as np
from gplfd_policies import Method, Policy, fit_skill


class Still:
    """Stays at the closed handle."""

    def __init__(self, training):
        self.poses = np.zeros((len(training.demonstrations), 6))

    def act(self, observation):
        return self.poses[0]


def make(training):
    """Stay where the handle is closed.

    Longer text.
    """
    return Still(training)


def make_with_seed(training, seed):
    return Still(training)


method = Method(fit=fit_skill)
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
    "name", ["mine:make", "mine.py:make", "./mine.py:make", "{folder}/mine.py:make"]
)
def test_a_function_in_a_file_is_a_policy(name, folder, demonstrations):
    name = name.format(folder=folder)
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


@pytest.mark.parametrize(
    ("attribute", "summary", "is_method"),
    [
        ("Still", "Stays at the closed handle.", False),
        ("method", "method of mine (", True),
        ("policy", "as it says", True),
    ],
)
@pytest.mark.usefixtures("folder")
def test_classes_methods_and_policies_are_policies(attribute, summary, is_method):
    policy = policy_named(f"mine:{attribute}")
    assert policy.summary.startswith(summary)
    assert isinstance(policy.method, Method) is is_method


def test_modules_in_packages_and_helpers_beside_them_are_found(folder):
    package = folder / "laboratory" / "doors"
    package.mkdir(parents=True)
    (folder / "laboratory" / "__init__.py").touch()
    (package / "__init__.py").touch()
    (package / "best.py").write_text("from mine import make\nimport mine\n")
    assert policy_named("laboratory.doors.best:make").origin.file.endswith("best.py")
    assert policy_named("laboratory.doors.best:mine.Still").method is None


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("absent:make", r"'absent:make': there is no module 'absent', .*path/to/file"),
        ("mine.absent:make", "there is no module 'mine.absent'"),
        ("absent.py:make", r"there is no file .*absent\.py"),
        ("mine:absent", r"mine \(.*mine\.py\) has no 'absent'; it has Still, make, "),
        ("mine:", "has no ''"),
        ("mine:number", "number of mine .* is a int; it must be a function from"),
        ("mine:make_with_seed", r"make_with_seed\(training, seed\) of mine .*one arg"),
        (":", "names no module; give module:function or path/to/file.py:function"),
        ("mine.py", r"name a function in it, as in mine\.py:make"),
        ("broken:make", r"division by zero \(broken\.py, line 2, in <module>\)"),
        ("users:make", r"importing users failed with Zero.*\(broken\.py, line 2, in"),
        ("leaving:make", r"leaving failed with SystemExit: 3 \(leaving\.py, line 1"),
        ("needy:make", "importing needy failed with ModuleNotFoundError: .*'absent'"),
        ("json:make", r"module 'json' is already .*; rename .*json\.py"),
        ("sys:version", r"version of sys \(part of Python\) is a str"),
        ("os.path:absent", r"'os.path:absent': module posixpath"),
    ],
)
def test_what_cannot_be_used_is_refused_at_once(name, message, folder):
    (folder / "broken.py").write_text("\n1 / 0\n")
    (folder / "users.py").write_text("import broken\n")
    (folder / "leaving.py").write_text("raise SystemExit(3)\n")
    (folder / "needy.py").write_text("import absent\n")
    (folder / "json.py").write_text(MODULE)
    with pytest.raises(ValueError, match=message):
        policy_named(name)


def forget(*modules):
    """Forget modules and their files, as another process would."""
    for name in modules:
        del sys.modules[name]
    module_files._FIRST_SEEN.clear()


@pytest.mark.parametrize(
    ("name", "helpers"),
    [
        ("users", {"helper.py": "NUMBER = 1"}),
        ("users", {"helper.py": "import deeper", "deeper.py": "NUMBER = 1"}),
        ("users", {"helper/__init__.py": "from . import a", "helper/a.py": "N = 1"}),
        ("users", {"helper/__init__.py": "from .a import *", "helper/a.py": "N = 1"}),
        ("pack.users", {"helper.py": "import pack.a", "pack/a.py": "NUMBER = 1"}),
        ("pack.users", {"helper.py": "", "pack/__init__.py": "NUMBER = 1"}),
    ],
)
def test_a_policy_is_also_what_it_imports_beside_it(folder, name, helpers):
    own = Path(name.replace(".", "/") + ".py")
    for file, text in {str(own): f"import helper, json\n{MODULE}", **helpers}.items():
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


def test_another_file_is_not_the_policy_that_was_chosen(folder):
    origin = policy_named("mine:make").origin
    assert origin is not None
    assert load_policy(origin).origin == origin
    (folder / "mine.py").write_text(MODULE + "# changed\n")
    # What was imported is not what is in the file.
    with pytest.raises(ValueError, match=r"mine\.py has changed since this process"):
        policy_named("mine:make")
    forget("mine")
    with pytest.raises(ValueError, match="'mine:make' is not the one that was chosen"):
        load_policy(origin)
    (folder / "mine.py").unlink()
    del sys.modules["mine"]
    with pytest.raises(ValueError, match="there is no module 'mine'"):
        load_policy(origin)


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Installs a package that offers policies: name, version, entry points, module."""

    def make(package, version, entries, module=MODULE):
        site = tmp_path / "site"
        information = site / f"{package}-{version}.dist-info"
        information.mkdir(parents=True)
        (information / "METADATA").write_text(
            f"Metadata-Version: 2.1\nName: {package}\nVersion: {version}\n"
        )
        (information / "entry_points.txt").write_text(f"[gplfd_policies]\n{entries}\n")
        (site / f"{package}.py").write_text(module)
        if str(site) not in sys.path:
            monkeypatch.syspath_prepend(site)

    yield make
    monkeypatch.undo()


@pytest.mark.parametrize("library", ["importlib.metadata", "a backport of it"])
def test_packages_offer_policies_by_name(install, library, tmp_path, monkeypatch):
    if library != "importlib.metadata":
        # The backport's finder answers in its place, with entry points of its own.
        def backported(**selection):
            return [
                SimpleNamespace(
                    name=entry.name,
                    module=entry.module,
                    attr=entry.attr,
                    dist=entry.dist,
                )
                for entry in importlib.metadata.entry_points(**selection)
            ]

        monkeypatch.setattr(user_policies, "entry_points", backported)
    install("theirs", "1.2", "best = theirs:make\nworst = theirs:policy")
    policy = policy_named("best")
    assert policy.summary == "Stay where the handle is closed."
    assert policy.origin == PolicyOrigin(
        name="best",
        kind="package",
        file=str(tmp_path / "site" / "theirs.py"),
        sha256=hashlib.sha256(MODULE.encode()).hexdigest(),
        distribution="theirs",
        version="1.2",
    )
    assert load_policy(policy.origin) == policy
    newer = dataclasses.replace(policy.origin, version="1.3")
    with pytest.raises(
        ValueError, match=r"that was theirs 1\.3, .* this is theirs 1\.2"
    ):
        load_policy(newer)
    listed = packaged_summaries(POLICIES)
    assert list(listed) == ["best", "worst"]
    assert listed["best"] == f"{policy.summary} (theirs 1.2)"
    with pytest.raises(
        ValueError, match=r"unknown policy 'bets' \(did you mean 'best'"
    ):
        policy_named("bets")
