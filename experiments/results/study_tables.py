"""The tables of a study's episodes, as `gplfd benchmark` prints and keeps them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from experiments.files.table import markdown_table
from experiments.results.reading import read_files
from experiments.results.table import error_count, study_table
from experiments.study.plan import conditions, episodes
from experiments.study.settings import StudySettings
from experiments.study.store import result_path
from policies.storage import complete_or_absent


def write_tables(folder: Path, settings: StudySettings) -> str:
    """Write DIR/table.md, a table per condition of the study, and return its text.

    Raises:
        OSError: A file cannot be read or written.
    """
    text = "\n\n".join(_tables(folder, settings))
    with complete_or_absent(folder / "table.md") as path:
        path.write_text(text + "\n", encoding="utf-8")
    return text


def _tables(folder: Path, settings: StudySettings) -> Iterator[str]:
    """Yield a table per condition of the study, and what is missing in it."""
    several = list(conditions(settings))
    for condition in several:
        tasks = episodes(settings, condition, range(settings.seeds))
        results, _, unreadable = read_files(result_path(folder, one) for one in tasks)
        if len(several) > 1:
            yield f"{condition}:"
        yield from filter(None, (error_count(results), *unreadable))
        yield markdown_table(study_table(results))
