"""What importing the packages does, in a fresh interpreter."""

DRAW = "mujoco rerun glfw matplotlib sklearn scipy.stats scipy.signal"
LEFT_OUT = {
    "gplfd_env": f"{DRAW} scipy gplfd_env.doors",
    "gplfd_experiments.cli.main": f"{DRAW} scipy asyncio",
    "gplfd_experiments.cli.doctor": f"{DRAW} joblib scipy",
    "gplfd_env.task.opening": DRAW,
    "gplfd_policies; from gplfd_policies import *": f"{DRAW} scipy.optimize",
    "gplfd_experiments.workflows.runs": "scipy.stats scipy.signal scipy.optimize",
    "gplfd_experiments.analysis.results.measures": "scipy.stats scipy.signal",
    "gplfd_experiments.studies.runner": "scipy.stats scipy.signal sklearn imageio",
}
"""Slow libraries that are loaded where they are used, not with these modules."""

PROGRAM = f"""\
import sys, gplfd_policies
assert not {{"numpy", "scipy", "gymnasium"}} & {{*sys.modules}}
import os, random, gymnasium, threadpoolctl, numpy as np
def state():
    drawn = np.random.get_state()[1].tolist()
    return dict(os.environ), random.getstate(), drawn
before = state()
for modules, left_out in {LEFT_OUT}.items():
    exec(f"import {{modules}}")
    assert "mujoco" in sys.modules or state() == before, modules
    loaded = {{*left_out.split()}} & {{*sys.modules}}
    assert not loaded, (modules, loaded)
pools = [p for p in threadpoolctl.threadpool_info() if p["user_api"] == "blas"]
assert len(pools) > 1 and {{p["num_threads"] for p in pools}} == {{1}}, pools
"""


def test_imports_change_nothing_outside_and_leave_slow_libraries(tmp_path, run_python):
    """No file written, no environment variable set, no global random state touched.

    Imported first: the two dependencies that set variables of their own. From the
    package that loads least on: what one module loads, those after it have. BLAS of
    NumPy and of SciPy has one thread then, whatever number it was given.
    """
    ran = run_python("-W", "error", "-c", PROGRAM, OPENBLAS_NUM_THREADS="2")
    assert (ran.stdout, ran.stderr) == ("", "")
    assert list(tmp_path.iterdir()) == []
