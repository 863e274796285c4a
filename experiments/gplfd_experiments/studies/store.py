"""The result files of a study: locations, and the code that made them."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
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
"""Name of the file that states how the results of a folder were made."""
PLANNED: Final = "tasks"
"""Entry of that file: number of tasks of the study."""
STUDY_KIND: Final = "gplfd study"
STUDY_VERSION: Final = 1


def write_study(folder: Path, about: Mapping[str, Any]) -> None:
    """Write study.json, unless a later version wrote it."""
    refuse_newer(read_study, folder)
    write_json(folder / STUDY, stamp(STUDY_KIND, STUDY_VERSION) | dict(about))


def read_study(folder: Path) -> dict[str, Any]:
    """Return the content of study.json."""
    about = read_json(folder / STUDY)
    with naming(folder / STUDY):
        check_stamp(about, STUDY_KIND, STUDY_VERSION)
    return about


def result_path(folder: Path, task: Task) -> Path:
    """Return the path of a task's result."""
    return folder / "tasks" / f"{task.key}.json"


@dataclass(frozen=True, kw_only=True, slots=True)
class StoredResults:
    """The results of a study in a folder."""

    finished: tuple[Result, ...]
    """Complete results without an error."""
    failed: tuple[Result, ...]
    """Results that are an error."""
    unfinished: tuple[Task, ...]
    """Tasks without a complete result, or with an error; these are run."""
    damaged: tuple[str, ...]
    """Problem of each file without a complete result."""

    @property
    def from_other_code(self) -> int:
        """Number of finished results that other code made.

        Other code is another git commit, a checkout with edits where this one has none
        or the reverse, or other package versions. Two different edits of one commit
        count as the same code.
        """
        here = {name: code_state()[name] for name in ("versions", "git")}
        return sum(
            any(result.get(name) != state for name, state in here.items())
            for result in self.finished
        )

    @property
    def from_other_machines(self) -> int:
        """Number of finished results from another kind of machine.

        They equal results of this machine only up to a tolerance; see
        docs/reproducibility.md.
        """
        here = code_state().get("arithmetic")
        return sum(result.get("arithmetic") != here for result in self.finished)


def stored_results(folder: Path, study: Iterable[Task]) -> StoredResults:
    """Read the result of every task of a study."""
    finished, failed, unfinished, damaged = [], [], [], []
    for task in study:
        path = result_path(folder, task)
        try:
            result = read_json(path)
            with naming(path):
                outcome(result, task)
                if task_from(entry(result, "task", dict[str, Any])).key != task.key:
                    raise ValueError("it holds the result of another task")
        except NewerFormatError:
            raise
        except FileNotFoundError:
            unfinished.append(task)
        except (OSError, ValueError) as error:
            unfinished.append(task)
            damaged.append(str(error))
        else:
            if "error" in result:
                failed.append(result)
                unfinished.append(task)
            else:
                finished.append(result)
    return StoredResults(
        finished=tuple(finished),
        failed=tuple(failed),
        unfinished=tuple(unfinished),
        damaged=tuple(damaged),
    )
