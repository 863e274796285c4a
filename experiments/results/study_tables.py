"""The tables of a study's episodes, as `gplfd benchmark` prints and keeps them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from experiments.atomic_write import complete_or_absent
from experiments.results.table import summary_table
from experiments.study.plan import conditions, episodes
from experiments.study.settings import StudySettings
from experiments.study.store import stored_result


def write_tables(folder: Path, settings: StudySettings) -> str:
    """Write DIR/table.md, a table per condition of the study, and return its text.

    Raises:
        ValueError: A stored result is damaged.
        OSError: A file cannot be read or written.
    """
    text = "\n\n".join(_tables(folder, settings))
    with complete_or_absent(folder / "table.md") as path:
        path.write_text(text + "\n", encoding="utf-8")
    return text


def _tables(folder: Path, settings: StudySettings) -> Iterator[str]:
    several = list(conditions(settings))
    for condition in several:
        stored = (
            stored_result(folder, task)
            for task in episodes(settings, condition, range(settings.seeds))
        )
        table = summary_table(result for result in stored if result is not None)
        yield table if len(several) == 1 else f"{condition}:\n\n{table}"
