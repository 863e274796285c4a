"""Files of this program, cut or of another type, are refused by their names.

Motion files are in test_motion_readers.py, archives of arrays in test_storage.py,
skills and demonstrations in tests of their archives, JSON in test_plain_data.py.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.metrics import episode_metrics
from gplfd_experiments.episodes.task import EpisodeTask
from gplfd_experiments.files.plain_data import write_json
from gplfd_experiments.studies.settings import (
    StudySettings,
    read_settings,
    write_settings,
)
from gplfd_experiments.studies.store import RESULT_STAMP, result_path, stored_results

pytestmark = pytest.mark.slow

Case = tuple[Path, Callable[[Path], object]]
"""A good file, and what reads it."""


def episode_log(folder: Path, log: EpisodeLog) -> Case:
    log.save(file := folder / "small.npz")
    return file, EpisodeLog.load


def settings(folder: Path, _: EpisodeLog) -> Case:
    write_settings(file := folder / "study.toml", StudySettings())
    return file, read_settings


def result(folder: Path, log: EpisodeLog) -> Case:
    """A damaged result stops no study: its task is run again, the file is named."""
    task = EpisodeTask(policy="gp", door="small", door_config={"radius": 0.35}, seed=0)
    metrics = episode_metrics(log)
    file = result_path(folder, task)
    write_json(file, {**RESULT_STAMP, "task": task.definition, "metrics": metrics})

    def read(_: Path) -> None:
        for reason in stored_results(folder, [task]).damaged:
            raise ValueError(reason)

    return file, read


@pytest.mark.parametrize("damage", ["cut", "another type"])
@pytest.mark.parametrize("make", [episode_log, settings, result])
def test_a_damaged_file_is_refused_by_its_name(
    tmp_path: Path, make_log: Any, make: Callable[..., Case], damage: str
) -> None:
    file, read = make(tmp_path, make_log(41))
    read(file)
    good = file.read_bytes()
    contents = {"cut": good[: -len(good) // 3], "another type": b"\x89PNG\r\n\x1a\n"}
    file.write_bytes(contents[damage])
    with pytest.raises(ValueError, match=file.name):
        read(file)
