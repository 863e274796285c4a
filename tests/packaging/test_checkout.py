"""The checkout: tracked files, and the wheel and sdist that are built from them.

These tests need the repository itself; an installed wheel is tested without them.
"""

import re
import subprocess
import tarfile
import tomllib
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
    return [ROOT / name for name in listing.split("\0") if name]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    (path,) = WheelBuilder(str(ROOT)).build(
        directory=str(folder), versions=["standard"]
    )
    return zipfile.ZipFile(path)


@pytest.fixture(scope="module")
def sdist_names(tmp_path_factory):
    folder = tmp_path_factory.mktemp("sdist")
    (path,) = SdistBuilder(str(ROOT)).build(
        directory=str(folder), versions=["standard"]
    )
    with tarfile.open(path) as archive:
        return {name.split("/", 1)[1] for name in archive.getnames()}


@pytest.mark.needs("clone")
def test_no_tracked_file_names_a_machine(tracked):
    """Absolute paths of someone's home or build machine do not belong here."""
    folders = "|".join(("home", "root", "work", "Users", "mnt", "private"))
    path = re.compile(rf"(?<![\w./~])/(?:{folders})/[\w.]".encode())
    offenders = []
    for file in tracked:
        if not file.is_file():
            continue  # deleted, and not yet committed
        for number, line in enumerate(file.read_bytes().splitlines(), start=1):
            if path.search(line):
                offenders.append(f"{file.relative_to(ROOT)}:{number}: {line[:100]!r}")
    assert not offenders, "\n".join(offenders)


@pytest.mark.needs("clone")
def test_no_generated_file_is_tracked(tracked):
    generated = {".pyc", ".rrd", ".egg-info", ".whl", ".log"}
    assert not [file for file in tracked if file.suffix in generated]
    assert not [file for file in tracked if file.name == "MUJOCO_LOG.TXT"]


@pytest.mark.needs("clone")
def test_test_files_have_unique_names_and_no_packages(tracked):
    """What lets pytest import them by path (--import-mode=importlib)."""
    tests = [file for file in tracked if file.is_relative_to(ROOT / "tests")]
    assert not [file for file in tests if file.name == "__init__.py"]
    names = [file.name for file in tests if file.name.startswith("test_")]
    assert len(names) == len(set(names))


def test_wheel_has_every_module_asset_and_marker(wheel):
    names = set(wheel.namelist())
    for folder, package in PACKAGES.items():
        for module in (ROOT / folder).rglob("*.py"):
            assert f"{package}/{module.relative_to(ROOT / folder)}" in names
    assert {f"{package}/py.typed" for package in PACKAGES.values()} <= names
    for asset in (ROOT / "assets").iterdir():
        assert f"gplfd_env/assets/{asset.name}" in names
        assert wheel.read(f"gplfd_env/assets/{asset.name}") == asset.read_bytes()


def test_wheel_has_nothing_else(wheel):
    tops = {name.split("/")[0] for name in wheel.namelist()}
    (metadata,) = tops - {*PACKAGES.values()}
    assert metadata.endswith(".dist-info")
    modules = [name.split("/")[-1] for name in wheel.namelist()]
    assert not [name for name in modules if name.startswith(("test_", "conftest"))]
    assert not [name for name in wheel.namelist() if name.endswith((".pyc", ".rrd"))]


def test_wheel_carries_the_licence(wheel):
    (licence,) = [n for n in wheel.namelist() if n.endswith("licenses/LICENSE")]
    assert wheel.read(licence) == (ROOT / "LICENSE").read_bytes()


def test_sdist_can_be_tested(sdist_names):
    """It carries all tests, the pages that tests read, and what a build needs."""
    for test in (ROOT / "tests").rglob("*.py"):
        assert str(test.relative_to(ROOT)) in sdist_names
    for name in (
        "pyproject.toml",
        "README.md",
        "LICENSE",
        "docs/environment.md",
        "CITATION.cff",
        "CONTRIBUTING.md",
        "paper/paper.bib",
        "assets/tiago_like.urdf",
        "assets/README.md",
        "benchmarks/harness.py",
    ):
        assert name in sdist_names


def test_licence_is_apache_2():
    text = (ROOT / "LICENSE").read_text()
    assert text.split()[:4] == ["Apache", "License", "Version", "2.0,"]
    assert "END OF TERMS AND CONDITIONS" in text
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert project["license"] == "Apache-2.0"


def test_the_hosted_workflow_runs_the_script_and_nothing_else():
    workflow = (ROOT / ".github" / "workflows" / "ci.yml").read_text()
    assert re.findall(r"\brun: (.*)", workflow) == ["bash .ci/run"]


def test_what_brings_gigabytes_is_installed_on_request_alone():
    """The extra sb3 brings PyTorch, and warp compiles for a minute; tests that need
    them have a script of their own."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    extras = project["project"]["optional-dependencies"]

    def brought(extra: str) -> set[str]:
        own = re.match(r"gplfd\[(.*)\]", extras[extra][0])
        others = own[1].split(",") if own else []
        return {extra}.union(*map(brought, others))

    assert extras["sb3"] == ["stable-baselines3>=2.7"]
    assert brought("dev") >= {"docs", "test", "minari"}
    assert not {"sb3", "warp"} & brought("dev")
    folders = project["tool"]["pytest"]["ini_options"]["testpaths"]
    there = {str(each.relative_to(ROOT)) for each in (ROOT / "tests").glob("*/")}
    separate = there - set(folders) - {"tests/__pycache__"}
    assert separate == {"tests/learners"}
    assert "pytest -q -p no:cacheprovider tests/learners" in (
        (ROOT / ".ci" / "learners").read_text()
    )


@pytest.mark.parametrize(
    ("page", "name"),
    [("README.md", "run"), ("README.md", "test"), ("docs/learners.md", "clone")],
)
def test_pages_have_each_marked_command_once(page, name):
    """The continuous integration runs the pages' own text."""
    marked = re.findall(
        rf"<!-- command: {name} -->\n+```bash\n(.*?)\n```",
        (ROOT / page).read_text(),
        flags=re.DOTALL,
    )
    assert len(marked) == 1
    assert marked[0].strip()


def test_the_readme_activates_the_environment_whose_commands_it_uses():
    text = (ROOT / "README.md").read_text()
    first = text.index(".venv/bin/activate && pip install . && gplfd run")
    assert ".venv/bin/gplfd" not in text
    assert first < text.index("\ngplfd ")


def test_four_commands_lead_from_a_clone_to_a_network_judged_beside_gp():
    page = (ROOT / "docs/learners.md").read_text()
    (block,) = re.findall(r"<!-- command: clone -->\n```bash\n(.*?)\n```", page, re.S)
    install, train, judge, report = block.splitlines()
    assert "pip install ." in install
    network = "examples/cloned_policy.py:make"
    assert train.startswith(f"gplfd run --policy {network}")
    assert judge.startswith("gplfd benchmark ")
    assert f"--policies gp {network}" in judge
    assert report == f"gplfd report {judge.split()[-1]}"
    assert "marked docs/learners.md clone" in (ROOT / ".ci/run").read_text()
