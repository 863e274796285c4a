"""The checkout: tracked files, and the wheel and sdist that are built from them.

These tests need the repository itself; an installed wheel is tested without them.
"""

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


@pytest.mark.needs("clone")
def test_no_tracked_file_names_a_machine():
    """Absolute paths of someone's home or build machine do not belong here."""
    folders = "|".join(("home", "root", "work", "Users", "mnt", "private"))
    path = rf"(?<![\w./~])/(?:{folders})/[\w.]"
    search = ["git", "grep", "-nP", path]
    found = subprocess.run(search, cwd=ROOT, capture_output=True, check=False)
    assert (found.returncode, found.stdout) == (1, b"")


def test_wheel_has_every_module_asset_marker_and_licence_and_nothing_else(tmp_path):
    (path,) = WheelBuilder(str(ROOT)).build(
        directory=str(tmp_path), versions=["standard"]
    )
    wheel = zipfile.ZipFile(path)
    names = set(wheel.namelist())
    for folder, package in PACKAGES.items():
        for module in (ROOT / folder).rglob("*.py"):
            assert f"{package}/{module.relative_to(ROOT / folder)}" in names
    data = ("teaching/page.html", "studies/trials/protocol.toml")
    assert {f"gplfd_experiments/{name}" for name in data} <= names
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
    assert tests | top | below | {"assets/tiago_like.urdf"} <= names
