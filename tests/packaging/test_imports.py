"""What importing the packages does, each in a fresh interpreter."""

import pytest

PACKAGES = ("gplfd_env", "gplfd_policies", "gplfd_experiments")


@pytest.mark.parametrize("package", PACKAGES)
def test_importing_changes_nothing_outside(package, tmp_path, run_python):
    """No file written, no environment variable set, no global random state touched.

    Imported first: the two dependencies that set variables of their own.
    """
    program = (
        "import os, random, gymnasium, threadpoolctl, numpy as np\n"
        "def state():\n"
        "    drawn = np.random.get_state()[1].tolist()\n"
        "    return dict(os.environ), random.getstate(), drawn\n"
        "before = state()\n"
        f"import {package}\n"
        "print(state() == before)\n"
    )
    ran = run_python("-W", "error", "-c", program)
    assert (ran.stdout, ran.stderr) == ("True\n", "")
    assert list(tmp_path.iterdir()) == []


DRAW = "mujoco rerun glfw matplotlib sklearn scipy.stats scipy.signal"


@pytest.mark.parametrize(
    ("modules", "heavy"),
    [
        ("gplfd_env", DRAW + " scipy gplfd_env.doors"),
        ("gplfd_env.task.opening, gplfd_policies", DRAW),
        ("gplfd_experiments.cli.doctor", DRAW + " joblib scipy.spatial"),
        ("gplfd_experiments.workflows.runs", "scipy.stats scipy.signal scipy.optimize"),
        ("gplfd_experiments.analysis.results.measures", "scipy.stats scipy.signal"),
        ("gplfd_experiments.studies.runner", "scipy.stats scipy.signal sklearn"),
    ],
)
def test_slow_libraries_are_loaded_where_they_are_used(modules, heavy, run_python):
    program = f"import sys, {modules}\nprint({{*{heavy.split()}}} & {{*sys.modules}})"
    assert run_python("-c", program).stdout == "set()\n"
