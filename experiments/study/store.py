"""The result files of a study: where they are, and which code made them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from experiments.files.provenance import code_state
from experiments.study.tasks import Result, Task


def made_by_other_code(folder: Path, study: Iterable[Task]) -> int:
    """Count the results that `run_study` would keep although other code made them.

    Other code is another git commit, a checkout with edits where this one has none or
    the reverse, or other package versions. Two different edits of one commit cannot be
    told apart.
    """
    stored = (stored_result(folder, task) for task in study)
    return sum(
        any(result.get(name) != state for name, state in code_state().items())
        for result in stored
        if result is not None and is_finished(result)
    )


def is_finished(result: Mapping[str, Any] | None) -> bool:
    """Tell whether a result stays: it is there, and no error."""
    return result is not None and "error" not in result


def result_path(folder: Path, task: Task) -> Path:
    """Return where a task's result is kept."""
    return folder / "tasks" / f"{task.key}.json"


def stored_result(folder: Path, task: Task) -> Result | None:
    """Return the result of a task, which may be an error; None if there is none."""
    path = result_path(folder, task)
    if not path.is_file():
        return None
    result: Result = json.loads(path.read_text(encoding="utf-8"))
    return result
