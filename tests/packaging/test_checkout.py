"""The checkout: tracked files, and the wheel and sdist that are built from them.

These tests need the repository itself; an installed wheel is tested without them.
"""

import re
import subprocess
import tarfile
import zipfile
from pathlib import Path

import pytest
from hatchling.builders.sdist import SdistBuilder
from hatchling.builders.wheel import WheelBuilder

ROOT = Path(__file__).parents[2]
PACKAGES = {
    "gplfd_env": "gplfd_env",
    "policies/gplfd_policies": "gplfd_policies",
    "experiments/gplfd_experiments": "gplfd_experiments",
    "experiments/gplfd": "gplfd",
}
"""Where folders of the checkout are in a wheel."""


@pytest.fixture(scope="module")
def tracked():
    listing = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True
    ).stdout.decode()
    # Without what is deleted, and not yet committed.
    files = [ROOT / name for name in listing.split("\0") if name]
    return [file for file in files if file.is_file()]


@pytest.mark.needs("clone")
def test_no_tracked_file_names_a_machine(tracked):
    """Absolute paths of someone's home or build machine do not belong here."""
    folders = "|".join(("home", "root", "work", "Users", "mnt", "private"))
    path = re.compile(rf"(?<![\w./~])/(?:{folders})/[\w.]".encode())
    offenders = [
        f"{file.relative_to(ROOT)}:{number}: {line[:100]!r}"
        for file in tracked
        for number, line in enumerate(file.read_bytes().splitlines(), start=1)
        if path.search(line)
    ]
    assert not offenders, "\n".join(offenders)


@pytest.mark.needs("clone")
def test_no_generated_file_is_tracked_and_tests_have_unique_names(tracked):
    """Unique names and no packages let pytest import tests by path."""
    generated = {".pyc", ".rrd", ".egg-info", ".whl", ".log"}
    assert not [file for file in tracked if file.suffix in generated]
    assert not [file for file in tracked if file.name == "MUJOCO_LOG.TXT"]
    names = [file.name for file in tracked if file.is_relative_to(ROOT / "tests")]
    assert "__init__.py" not in names
    tests = [name for name in names if name.startswith("test_")]
    assert len(tests) == len(set(tests))


def test_wheel_has_every_module_asset_marker_and_licence_and_nothing_else(tmp_path):
    (path,) = WheelBuilder(str(ROOT)).build(
        directory=str(tmp_path), versions=["standard"]
    )
    wheel = zipfile.ZipFile(path)
    names = set(wheel.namelist())
    for folder, package in PACKAGES.items():
        for module in (ROOT / folder).rglob("*.py"):
            assert f"{package}/{module.relative_to(ROOT / folder)}" in names
    assert "gplfd_experiments/teaching/page.html" in names
    assert {f"{package}/py.typed" for package in PACKAGES.values()} <= names
    for asset in (ROOT / "assets").iterdir():
        assert wheel.read(f"gplfd_env/assets/{asset.name}") == asset.read_bytes()
    (metadata,) = {name.split("/")[0] for name in names} - {*PACKAGES.values()}
    assert metadata.endswith(".dist-info")
    assert not [n for n in names if n.split("/")[-1].startswith(("test_", "conftest"))]
    assert not [name for name in names if name.endswith((".pyc", ".rrd"))]
    (licence,) = [name for name in names if name.endswith("licenses/LICENSE")]
    assert wheel.read(licence) == (ROOT / "LICENSE").read_bytes()


def test_sdist_can_be_tested(tmp_path):
    """It carries all tests, the pages that tests read, and what a build needs."""
    (path,) = SdistBuilder(str(ROOT)).build(
        directory=str(tmp_path), versions=["standard"]
    )
    with tarfile.open(path) as archive:
        names = {name.split("/", 1)[1] for name in archive.getnames()}
    tests = {str(test.relative_to(ROOT)) for test in (ROOT / "tests").rglob("*.py")}
    top = {"pyproject.toml", "README.md", "LICENSE", "CITATION.cff", "CONTRIBUTING.md"}
    below = {"docs/environment.md", "paper/paper.bib", "benchmarks/speed.py"}
    assets = {
        f"assets/{name}"
        for name in (
            *("tiago_like.urdf", "panda_like.urdf", "ur5e_like.urdf"),
            *("stand.urdf", "gripper.urdf", "README.md"),
        )
    }
    assert tests | top | below | assets <= names
