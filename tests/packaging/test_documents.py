"""The documents speak of things that exist."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


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
