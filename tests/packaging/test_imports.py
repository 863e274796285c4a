"""What importing the packages does, each in a fresh interpreter."""

import pytest

PACKAGES = ("gplfd_env", "gplfd_policies", "gplfd_experiments")


@pytest.mark.parametrize("package", PACKAGES)
def test_importing_changes_nothing_outside(package, tmp_path, run_python):
    """No file written, no environment variable set, no global random state touched.

    Imported first: the two dependencies that set variables of their own. Environment
    and policies load neither the simulator nor what draws.
    """
    program = (
        "import os, random, sys, gymnasium, threadpoolctl, numpy as np\n"
        "def state():\n"
        "    drawn = np.random.get_state()[1].tolist()\n"
        "    return dict(os.environ), random.getstate(), drawn\n"
        "before = state()\n"
        f"import {package}\n"
        "print(state() == before)\n"
        "if 'gplfd_env' in sys.modules: import gplfd_env.task.opening\n"
        "heavy = {'mujoco', 'rerun', 'glfw', 'matplotlib', 'sklearn', 'scipy.stats'}\n"
        "print(*sorted(heavy & set(sys.modules)))\n"
    )
    ran = run_python("-W", "error", "-c", program)
    assert ran.stderr == ""
    unchanged, *heavy = ran.stdout.split()
    assert unchanged == "True"
    assert heavy == [] or package == "gplfd_experiments"
    assert list(tmp_path.iterdir()) == []
