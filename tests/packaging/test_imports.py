"""What importing the packages does, each in a fresh interpreter."""

import importlib.metadata
import importlib.util
import json
from pathlib import Path
from urllib.parse import urlparse
from urllib.request import url2pathname

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


def folder_of(package: str) -> Path:
    spec = importlib.util.find_spec(package)
    assert spec is not None
    (folder,) = spec.submodule_search_locations or ()
    return Path(folder)


@pytest.mark.parametrize("package", ["gplfd", *PACKAGES])
def test_the_import_names_are_ours_and_typed(package):
    """`policies` and `experiments` are folders of the checkout, not import names:
    other projects and users' folders have them, too.
    """
    assert (folder_of(package) / "py.typed").is_file()
    distribution = importlib.metadata.distribution("gplfd")
    origin = json.loads(distribution.read_text("direct_url.json") or "{}")
    if origin.get("dir_info", {}).get("editable"):
        # An editable installation lists no packages, only the checkout's address.
        checkout = Path(url2pathname(urlparse(origin["url"]).path)).resolve()
        assert folder_of(package).resolve().is_relative_to(checkout)
    else:
        owners = importlib.metadata.packages_distributions()
        assert owners[package.split(".")[0]] == ["gplfd"]
        assert not {"policies", "experiments"} & set(owners)
        place = distribution.locate_file(package.replace(".", "/"))
        assert folder_of(package) == Path(str(place))
