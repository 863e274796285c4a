"""The notebooks of docs/tutorials as pages: a hook of MkDocs.

They are run whenever the site is built, so that what stands on a page is what the
present code prints and draws; one that fails ends the build. Outputs are not kept in
the notebooks. Links lead to the notebooks, here and where they are read without a site.
"""

import base64
import functools
import os
import re
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import nbformat
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from nbclient import NotebookClient
from nbformat import NotebookNode

_ROOT = Path(__file__).parents[1]
_MAGIC = re.compile(r"%%(bash|writefile)(?: (.*))?\n")


class NotebookPage(File):
    """A notebook that is a page, and no file to download."""

    def is_documentation_page(self) -> bool:
        """Return that it is, whatever its name ends with."""
        return True


def on_files(files: Files, *, config: MkDocsConfig) -> Files:
    """Put a page in the place of every notebook, and its pictures beside it."""
    notebooks = [file for file in files if file.src_uri.endswith(".ipynb")]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        texts = [file.content_string for file in notebooks]
        for file, ran in zip(notebooks, pool.map(executed, texts), strict=True):
            pictures: dict[str, bytes] = {}
            page = "\n\n".join(_parts(ran, Path(file.src_uri).stem, pictures))
            files.remove(file)
            files.append(NotebookPage.generated(config, file.src_uri, content=page))
            for name, content in pictures.items():
                uri = str(Path(file.src_uri).with_name(name))
                files.append(File.generated(config, uri, content=content))
    return files


@functools.lru_cache(maxsize=16)
def executed(text: str) -> NotebookNode:
    """Run a notebook in a folder of its own, in which `examples` lies.

    Args:
        text: Content of the file.

    Raises:
        nbclient.exceptions.CellExecutionError: A cell failed.
    """
    notebook = nbformat.reads(text, as_version=4)
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "examples").symlink_to(_ROOT / "examples")
        place = {"metadata": {"path": folder}}
        client = NotebookClient(
            notebook, timeout=120, coalesce_streams=True, resources=place
        )
        # Over files; TCP, which others can listen to, is warned of.
        manager = client.create_kernel_manager()
        manager.transport, manager.ip = "ipc", f"{folder}/.kernel"
        client.execute(env=os.environ | {"PATH": path})
    return notebook


def _parts(
    notebook: NotebookNode, stem: str, pictures: dict[str, bytes]
) -> Iterator[str]:
    """Yield the Markdown of a notebook's cells and outputs; collect its pictures."""
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            yield cell.source
            continue
        yield _code(cell.source)
        for output in cell.outputs:
            data = output.get("data", {})
            if "image/png" in data:
                name = f"{stem}-{len(pictures) + 1}.png"
                pictures[name] = base64.b64decode(data["image/png"])
                yield f"![What the lines above draw]({name})"
            elif text := output.get("text") or data.get("text/plain"):
                yield _fenced("text", text.rstrip())


def _code(source: str) -> str:
    """Return a code cell as Markdown: Python, a file that is written, or commands."""
    magic = _MAGIC.match(source)
    if magic is None:
        return _fenced("python", source)
    kind, file = magic.groups()
    heading = "bash" if kind == "bash" else f'python title="{file}"'
    return _fenced(heading, source[magic.end() :])


def _fenced(heading: str, text: str) -> str:
    return f"```{heading}\n{text}\n```"
