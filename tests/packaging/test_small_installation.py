"""With NumPy and SciPy alone, agents act as they do with everything installed."""

import os
import re
import subprocess
import sys
from pathlib import Path

import jaxtyping
import numpy as np
import pytest

from gplfd_experiments.data.teacher import ForceConfig, Teacher
from gplfd_policies import (
    POLICIES,
    TrainingInput,
    align,
    fit_skill,
    save_demonstrations,
)

pytestmark = [pytest.mark.slow, pytest.mark.bits]

ALONE = """\
import sys

OWN = {"gplfd", "gplfd_env", "gplfd_experiments", "gplfd_policies", "numpy", "scipy"}


class Alone:
    def find_spec(self, name, path=None, target=None):
        root = name.partition(".")[0]
        if root in OWN | sys.stdlib_module_names or root.startswith("_sysconfigdata"):
            return None
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)


sys.meta_path.insert(0, Alone())
"""
"""Hides every other installed package."""


EVERY_MODULE = """\
import importlib, pkgutil, gplfd_policies
for module in pkgutil.walk_packages(gplfd_policies.__path__, "gplfd_policies."):
    importlib.import_module(module.name)
"""

ACT = """\
import numpy as np
from gplfd_policies import POLICIES, load_demonstrations, load_skill, make_agent

agents = {
    "skill": POLICIES["gp"].method.follow(load_skill("skill.npz")),
    "learned": make_agent("gp", load_demonstrations("shown.npz").demonstrations),
}
seen, done = np.load("seen.npz"), {}
for name, agent in agents.items():
    actions = []
    for pose, wrench in zip(seen["poses"], seen["wrenches"], strict=True):
        observation = {"ee_pose": pose, "wrench": wrench}
        if not actions:
            agent.reset(observation)
        step = agent.act(observation)
        numbers = step.action, step.stiffness, step.expected_force
        actions.append(np.concatenate(numbers))
    done[name] = np.array(actions)
"""


@pytest.fixture
def alone(tmp_path):
    """Return a function: runs a program without any other package."""

    # The same BLAS kernels as here, which .ci/run chooses.
    same = {k: v for k, v in os.environ.items() if k == "OPENBLAS_CORETYPE"}

    def run(program, *arguments):
        command = [sys.executable, "-c", ALONE + program, *arguments]
        return subprocess.run(
            command, cwd=tmp_path, env=same, capture_output=True, text=True, check=False
        )

    return run


@pytest.mark.filterwarnings("ignore:3 demonstrations")
def test_agents_act_bit_for_bit_as_with_everything(alone, tmp_path, monkeypatch):
    """From a skill's file and from demonstrations, motions and forces, a door long.

    And every module can be imported; what needs another package names it.
    """
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    monkeypatch.chdir(tmp_path)
    shown = Teacher(forces=ForceConfig()).standard_demonstrations(seed=0, per_door=1)
    save_demonstrations("shown.npz", shown)
    skill = POLICIES["gp"].method.learn(TrainingInput(demonstrations=shown))
    skill.save("skill.npz")
    poses = skill.predict(np.linspace(0.0, 1.0, 80)).mean
    wrenches = np.random.default_rng(0).normal(0.0, 3.0, poses.shape)
    np.savez("seen.npz", poses=poses, wrenches=wrenches)
    shorter = ACT.replace('make_agent("gp"', 'make_agent("gmr"')
    ended = alone(f"{ACT}np.savez('done.npz', **done)\n{EVERY_MODULE}{shorter}")
    assert "which is not installed; pip install scikit-learn" in ended.stderr
    here = {}
    exec(ACT, here)
    with np.load("done.npz") as there:
        assert set(there) == set(here["done"]) == {"skill", "learned"}
        for name, actions in here["done"].items():
            assert np.isfinite(actions).all()
            assert np.ptp(actions[:, 0]) > 5e-3  # the hand is sent along the way
            np.testing.assert_array_equal(there[name], actions)


def test_the_code_of_the_page_acts(alone, tmp_path):
    shown = Teacher().standard_demonstrations(seed=0)
    fit_skill(align(shown, n_samples=20)).save(tmp_path / "skill.npz")
    page = (Path(__file__).parents[2] / "docs/quickstart.md").read_text()
    (code,) = re.findall(r"<!-- python: small -->\n```python\n(.*?)```", page, re.S)
    given = "import numpy as np\npose = wrench = np.zeros(6)\n"
    ended = alone(f"{given}{code}print(step.action)")
    assert ended.returncode == 0, ended.stderr
    assert ended.stdout.startswith("[")
