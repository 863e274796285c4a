"""The documents speak of things that exist."""

import importlib
import json
import re
import runpy
import shlex
from collections.abc import Iterator
from pathlib import Path

import gymnasium
import matplotlib
import pytest

import gplfd_env  # noqa: F401  (registers the ids)
from gplfd_experiments.cli import main as cli
from gplfd_experiments.studies.settings import StudySettings, write_settings

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
TUTORIALS = sorted((DOCS / "tutorials").glob("*.ipynb"))
DOCUMENTS = [
    *(ROOT / f"{name}.md" for name in ("README", "CONTRIBUTING", "SECURITY")),
    ROOT / "CODE_OF_CONDUCT.md",
    ROOT / "paper" / "paper.md",
    *sorted(DOCS.glob("*.md")),
    *TUTORIALS,
]


def text_of(document: Path) -> str:
    """Return a page as Markdown; of a notebook what is told and the commands."""
    text = document.read_text()
    if document.suffix != ".ipynb":
        return text
    parts = []
    for cell in json.loads(text)["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
        elif source.startswith("%%bash\n"):
            parts.append(f"```bash\n{source.removeprefix('%%bash')}\n```")
    return "\n".join(parts)


def test_named_tests_exist():
    texts = (path.read_text() for path in (ROOT / "tests").rglob("test_*.py"))
    suite = set(re.findall(r"^def (test_\w+)", "".join(texts), re.M))
    for document in DOCUMENTS:
        named = set(re.findall(r"`(test_\w+)`", text_of(document)))
        assert named <= suite, document.name
        assert document.stem != "method" or len(named) > 30, "tests settle what it says"


def test_links_lead_somewhere():
    """Those of the site, which has nothing else, to its own pages."""
    for document in DOCUMENTS:
        for link in re.findall(r"\]\((?!https?://|#)([^)#]+)", text_of(document)):
            path = (document.parent / link).resolve()
            # The wheel's test run has no assets folder beside the documents.
            assert path.exists() or link.startswith("assets/"), (document.name, link)
            assert path.is_relative_to(DOCS) or not document.is_relative_to(DOCS), link


def test_tables_of_the_pages_come_from_the_code():
    """Every line that names a table becomes one, and no table is left unnamed."""
    pages = "".join(page.read_text() for page in DOCS.glob("*.md"))
    names = ("tables", "commands")
    tables, commands = (runpy.run_path(f"{DOCS}/{name}.py") for name in names)
    built = commands["on_page_markdown"](tables["on_page_markdown"](pages))
    assert "<!-- table: " not in built
    assert all(f"\n<!-- table: {name} -->\n" in pages for name in tables["TABLES"])
    assert "`closer.preload` | 0 | [0, 50] | N m | Closing torque at every" in built


CODE = r"```python\n(.*?)```"


@pytest.mark.filterwarnings("ignore")
def test_code_in_the_pages_runs(tmp_path, monkeypatch):
    """Every block, with names of its own, after the README's first command."""
    monkeypatch.chdir(tmp_path)
    matplotlib.use("agg")  # shows nothing
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    blocks = [
        block
        for page in (ROOT / "README.md", *sorted(DOCS.glob("*.md")))
        for mark, block in re.findall(
            rf"^(<!-- python: .* -->\n)?{CODE}", page.read_text(), re.M | re.S
        )
        if not mark
    ]
    assert cli.main(["run", "--doors", "medium", "--out", "results/first"]) == 0
    for block in blocks:
        exec(compile(block, block, "exec"), {"__name__": "__main__"})
    # A reader copies one of them: none lives on what another has imported.
    assert all("gplfd_env" in block for block in blocks if '"gplfd/' in block)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.usefixtures("policies_here")
def test_policies_that_readers_copy_open_doors_gently(tmp_path, monkeypatch, capsys):
    """The doors of `gplfd run` and of `--config small`, with the literal snippets."""
    page = (DOCS / "your-policy.md").read_text()
    blocks = re.findall(CODE, page, re.S)
    snippet = next(block for block in blocks if "def act(" in block)
    tutorial = json.loads((DOCS / "tutorials" / "your-policy.ipynb").read_text())
    cells = ["".join(cell["source"]) for cell in tutorial["cells"]]
    (feel,) = (cell for cell in cells if cell.startswith("%%writefile feel.py\n"))
    (method,) = re.findall(r"```python\n([^`]*^make = Learner[^`]*)```", page, re.M)
    monkeypatch.chdir(tmp_path)
    (shifted,) = re.findall(r"```python\n([^`]*^shifted = [^`]*)```", page, re.M)
    (tmp_path / "method.py").write_text(method + shifted)
    (tmp_path / "mine.py").write_text(snippet)
    (tmp_path / "feel.py").write_text(feel.split("\n", 1)[1])
    study = (
        "benchmark --config small --no-skill --engine serial --json --quiet "
        "--seeds 1 --doors small large --policies mine:make feel:make method:make "
        "method:shifted@no-size"
    )
    assert cli.main(study.split()) == 0
    rows = json.loads(capsys.readouterr().out)
    assert {(row["door"], row["opened"]) for row in rows} == {
        (door, 1) for door in ("small", "large")
    }
    assert all(row["force_radial_peak"] < 8.0 for row in rows)
    assert all(row["force_tangential_peak"] < 16.0 for row in rows)


def commands(document: Path) -> Iterator[list[str]]:
    """Yield the arguments of every `gplfd` in the commands of a page."""
    for block in re.findall(r"```bash\n(.*?)```", text_of(document), re.S):
        for line in re.sub(r"\\\n", " ", block).splitlines():
            words = shlex.split(line, comments=True)
            for start, word in enumerate(words):
                if word.endswith("gplfd") and (start == 0 or words[start - 1] == "&&"):
                    rest = words[start + 1 :]
                    ends = [n for n, one in enumerate(rest) if one in ("|", "&&")]
                    yield rest[: ends[0]] if ends else rest


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_commands_are_what_the_command_line_takes(document, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "results/study").mkdir(parents=True)
    write_settings(tmp_path / "results/study/study.toml", StudySettings())
    for command in cli.COMMANDS.values():
        monkeypatch.setattr(command, "execute", lambda self: 0)
    for arguments in commands(document):
        assert cli.main(arguments) == 0, arguments


def test_every_public_name_has_a_place_in_the_reference():
    """Whatever a module exports, and every class that an environment's id makes."""
    pages = "".join(path.read_text() for path in (ROOT / "docs" / "api").glob("*.md"))
    described = re.findall(r"^::: ([\w.]+)$", pages, re.MULTILINE)
    exporting = set()
    for package in ("gplfd_env", "gplfd_policies", "gplfd_experiments"):
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


def test_the_container_runs_the_first_command_of_the_readme():
    """And both containers install the system packages that the pages name."""
    container = ROOT / ".devcontainer"
    image, development = (
        (container / name).read_text() for name in ("Dockerfile", "devcontainer.json")
    )
    lists = re.findall(r"^(?:ENTRYPOINT|CMD) (\[.*\])$", image, re.MULTILINE)
    command = " ".join(word for part in lists for word in json.loads(part))
    assert f"pip install . && {command}\n" in (ROOT / "README.md").read_text()
    quickstart = (DOCS / "quickstart.md").read_text()
    (packages,) = re.findall(r"`apt-get install (.*?)`", quickstart)
    assert packages in image
    assert packages in json.loads(development)["onCreateCommand"]
