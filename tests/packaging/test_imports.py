"""What importing the packages does, each in a fresh interpreter."""

import importlib.metadata
import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGES = ("gplfd_env", "policies", "experiments")


def run(program: str, folder: Path) -> str:
    result = subprocess.run(
        [sys.executable, "-W", "error", "-c", program],
        capture_output=True,
        text=True,
        check=False,
        cwd=folder,
    )
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    return result.stdout


@pytest.mark.parametrize("package", ["gplfd_env", "gplfd_env.task", "policies"])
def test_importing_does_not_load_the_simulator(package: str, tmp_path: Path) -> None:
    program = (
        f"import sys, {package}\n"
        "heavy = {'mujoco', 'rerun', 'glfw', 'matplotlib', 'sklearn'}\n"
        "print(sorted(heavy & set(sys.modules)))\n"
    )
    assert run(program, tmp_path).strip() == "[]"


@pytest.mark.parametrize("package", PACKAGES)
def test_importing_changes_nothing_outside(package: str, tmp_path: Path) -> None:
    """No file written, no environment variable set, no global random state touched.

    Gymnasium, imported first, sets a variable of its own.
    """
    program = (
        "import os, random, gymnasium, numpy as np\n"
        "def state():\n"
        "    drawn = np.random.get_state()[1].tolist()\n"
        "    return dict(os.environ), random.getstate(), drawn\n"
        "before = state()\n"
        f"import {package}\n"
        "print(state() == before)\n"
    )
    assert run(program, tmp_path).split() == ["True"]
    assert list(tmp_path.iterdir()) == []


def test_the_import_names_are_ours() -> None:
    """`policies` and `experiments` are generic names that other projects ship, too."""
    owners = importlib.metadata.packages_distributions()
    for package in PACKAGES:
        assert owners[package] == ["gplfd"]


def test_packages_are_marked_as_typed() -> None:
    for package in PACKAGES:
        spec = importlib.util.find_spec(package)
        assert spec is not None
        (folder,) = spec.submodule_search_locations or ()
        assert (Path(folder) / "py.typed").is_file()


def test_console_script_exists_and_explains_itself(tmp_path: Path) -> None:
    (script,) = importlib.metadata.entry_points(group="console_scripts", name="gplfd")
    assert script.value == "experiments.cli:main"
    result = subprocess.run(
        [Path(sys.executable).with_name("gplfd"), "--help"],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
    )
    assert result.returncode == 0, result.stderr
    for command in ("run", "view", "list"):
        assert command in result.stdout
    assert list(tmp_path.iterdir()) == []
