"""The documents speak of things that exist."""

import importlib
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import gymnasium
import pytest
import yaml

import gplfd_env  # noqa: F401  (registers the ids)

ROOT = Path(__file__).parents[2]
DOCUMENTS = [
    *(ROOT / f"{name}.md" for name in ("README", "CONTRIBUTING", "SECURITY")),
    ROOT / "CODE_OF_CONDUCT.md",
    ROOT / "paper" / "paper.md",
    *sorted((ROOT / "docs").glob("*.md")),
]


def suite() -> set[str]:
    names: set[str] = set()
    for path in (ROOT / "tests").rglob("test_*.py"):
        names |= set(re.findall(r"^def (test_\w+)", path.read_text(), re.MULTILINE))
    return names


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_named_tests_exist(document):
    named = set(re.findall(r"`(test_\w+)`", document.read_text()))
    assert named <= suite(), named - suite()


def test_the_method_page_names_the_tests_that_settle_it():
    named = re.findall(r"`(test_\w+)`", (ROOT / "docs" / "method.md").read_text())
    assert len(set(named)) > 30


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_somewhere(document):
    links = re.findall(r"\]\((?!https?://|#)([^)#]+)", document.read_text())
    missing = [link for link in links if not (document.parent / link).exists()]
    # The wheel's test run has no assets folder beside the documents.
    assert [link for link in missing if not link.startswith("assets/")] == []


def test_the_citation_is_of_this_package() -> None:
    """Keys that the Citation File Format 1.2.0 requires, and what is said twice."""
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert {"cff-version", "message", "title", "authors"} <= set(citation)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    for ours, its in {"title": "name", "version": "version"}.items():
        assert citation[ours] == project[its]
    assert citation["license"] == project["license"]
    assert citation["keywords"] == project["keywords"]
    assert citation["authors"] == project["authors"]
    for reference in citation["references"]:
        assert {"type", "title", "authors"} <= set(reference)


def test_the_paper_cites_what_its_bibliography_has() -> None:
    paper = (ROOT / "paper" / "paper.md").read_text()
    _, header, body = paper.split("---\n", 2)
    assert {"title", "tags", "authors", "affiliations", "date", "bibliography"} <= set(
        yaml.safe_load(header)
    )
    assert 250 <= len(body.split()) <= 1000
    bibliography = (ROOT / "paper" / "paper.bib").read_text()
    has = re.findall(r"^@\w+\{(\w+),$", bibliography, re.MULTILINE)
    assert set(re.findall(r"@(\w+)", body)) == set(has)
    for title in ("Summary", "Statement of need", "State of the field"):
        assert f"\n# {title}\n" in body


def python_blocks() -> list[str]:
    return re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.S)


@pytest.fixture(scope="module")
def first_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which the README's first command has been run, for one door."""
    folder = tmp_path_factory.mktemp("newcomer")
    command = [sys.executable, "-m", "gplfd", "run", "--doors", "medium"]
    subprocess.run([*command, "--out", "results/first"], cwd=folder, check=True)
    return folder


@pytest.mark.parametrize("number", range(len(python_blocks())))
def test_code_in_the_readme_runs(number: int, first_run: Path) -> None:
    ran = subprocess.run(
        [sys.executable, "-c", python_blocks()[number]],
        cwd=first_run,
        env=os.environ | {"MPLBACKEND": "agg"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr


def test_every_public_name_has_a_place_in_the_reference() -> None:
    """Whatever a module exports, and every class that an environment's id makes."""
    pages = "".join(path.read_text() for path in (ROOT / "docs" / "api").glob("*.md"))
    described = re.findall(r"^::: ([\w.]+)$", pages, re.MULTILINE)
    exporting = set()
    for package in ("gplfd_env", "gplfd.policies", "gplfd.experiments"):
        folder = Path(importlib.import_module(package).__path__[0])
        for path in folder.rglob("*.py"):
            if re.search(r"^__all__ = ", path.read_text(), re.MULTILINE):
                parts = (package, *path.relative_to(folder).with_suffix("").parts)
                exporting.add(".".join(parts).removesuffix(".__init__"))
    assert exporting - set(described) == set()
    made = set()
    for spec in gymnasium.registry.values():
        if spec.namespace == "gplfd":
            made |= {str(spec.entry_point), str(spec.vector_entry_point)}
    assert len(made) == 10
    for module, name in (each.split(":") for each in made):
        (shown,) = re.findall(rf"^::: {module}\n(?: +(.*))?", pages, re.MULTILINE)
        assert not shown or name in shown, f"{module}.{name}"


def test_every_page_is_three_clicks_away() -> None:
    """From the start page: by its links, and by the navigation beside it."""
    pages = {path.name for path in (ROOT / "docs").glob("*.md")}
    reached, front = {"index.md"}, {"index.md"}
    for _ in range(3):
        links = {
            link
            for page in front
            for link in re.findall(
                r"\]\((?!https?://|#)([\w-]+\.md)", (ROOT / "docs" / page).read_text()
            )
        }
        front = links - reached
        reached |= links
    assert pages - reached == set()
