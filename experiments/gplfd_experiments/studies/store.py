"""The result files of a study: where they are, and which code made them."""

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from gplfd_experiments.episodes.task import Task
from gplfd_experiments.files.plain_data import (
    NewerFormatError,
    check_stamp,
    entry,
    naming,
    read_json,
    refuse_newer,
    stamp,
    write_json,
)
from gplfd_experiments.files.provenance import code_state
from gplfd_experiments.studies.result_format import outcome
from gplfd_experiments.studies.tasks import Result, task_from

STUDY: Final = "study.json"
"""Name of the file that says what made the results of a folder."""
PLANNED: Final = "tasks"
"""Entry of that file: number of tasks of the study."""
STUDY_KIND: Final = "gplfd study"
STUDY_VERSION: Final = 1


def write_study(folder: Path, about: Mapping[str, Any]) -> None:
    """Write what made a study's results, complete or not at all.

    Raises:
        NewerFormatError: A later version of this package wrote the file that is there.
        OSError: The file cannot be written.
    """
    refuse_newer(read_study, folder)
    stamped = stamp(STUDY_KIND, STUDY_VERSION) | dict(about)
    write_json(folder / STUDY, stamped)


def read_study(folder: Path) -> dict[str, Any]:
    """Return what study.json says.

    Raises:
        FileNotFoundError: There is none.
        NewerFormatError: A later version of this package wrote it.
        OSError: It cannot be read.
        ValueError: It is damaged.
    """
    about = read_json(folder / STUDY)
    with naming(folder / STUDY):
        check_stamp(about, STUDY_KIND, STUDY_VERSION)
    return about


def made_elsewhere(folder: Path, study: Iterable[Task]) -> int:
    """Count the results whose last bits another machine decided.

    They equal those made here to a tolerance only; see docs/reproducibility.md.
    """
    here = code_state().get("arithmetic")
    return sum(result.get("arithmetic") != here for result in _kept(folder, study))


def made_by_other_code(folder: Path, study: Iterable[Task]) -> int:
    """Count the results that `run_study` would keep although other code made them.

    Other code is another git commit, a checkout with edits where this one has none or
    the reverse, or other package versions. Two different edits of one commit count as
    the same code.
    """
    here = {name: code_state()[name] for name in ("versions", "git")}
    return sum(
        any(result.get(name) != state for name, state in here.items())
        for result in _kept(folder, study)
    )


def _kept(folder: Path, study: Iterable[Task]) -> Iterator[Result]:
    for task in study:
        result = stored_result(folder, task)
        if result is not None and is_finished(result):
            yield result


def damaged_results(folder: Path, study: Iterable[Task]) -> tuple[str, ...]:
    """Say of every result file that holds no complete result what is wrong.

    Raises:
        NewerFormatError: A later version of this package wrote one of them.
    """
    reasons = []
    for task in study:
        try:
            _read(folder, task)
        except FileNotFoundError:
            continue
        except NewerFormatError:
            raise
        except (OSError, ValueError) as error:
            reasons.append(str(error))
    return tuple(reasons)


def is_finished(result: Mapping[str, Any] | None) -> bool:
    """Tell whether a result stays: it is there, complete, and no error."""
    return result is not None and "error" not in result


def result_path(folder: Path, task: Task) -> Path:
    """Return where a task's result is kept."""
    return folder / "tasks" / f"{task.key}.json"


def stored_result(folder: Path, task: Task) -> Result | None:
    """Return the result of a task, which may be an error.

    None if there is none: no file, or one of those that `damaged_results` names.

    Raises:
        NewerFormatError: A later version of this package wrote it.
    """
    try:
        return _read(folder, task)
    except NewerFormatError:
        raise
    except (OSError, ValueError):
        return None


def _read(folder: Path, task: Task) -> Result:
    path = result_path(folder, task)
    result = read_json(path)
    with naming(path):
        outcome(result, task)
        if task_from(entry(result, "task", dict[str, Any])).key != task.key:
            raise ValueError("it holds the result of another task")
    return result
