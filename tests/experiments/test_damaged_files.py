"""Files of this program, cut or of another type, are refused by their names.

Motion files are in test_motion_readers.py, archives of arrays in test_storage.py.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import gplfd_policies as policies
from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.metrics import episode_metrics
from gplfd_experiments.episodes.task import EpisodeTask
from gplfd_experiments.files.plain_data import read_json, write_json
from gplfd_experiments.studies.settings import (
    StudySettings,
    read_settings,
    write_settings,
)
from gplfd_experiments.studies.store import RESULT_STAMP, result_path, stored_results
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.demonstrations.npz import load_demonstrations, save_demonstrations

pytestmark = pytest.mark.slow

Case = tuple[Path, Callable[[Path], object]]
"""A good file, and what reads it."""


def demonstrations(folder: Path, _: EpisodeLog) -> Case:
    moving = [Demonstration(times=np.arange(3.0), poses=np.eye(3, 6))] * 2
    save_demonstrations(file := folder / "demonstrations.npz", moving, [0.35, None])
    return file, load_demonstrations


def episode_log(folder: Path, log: EpisodeLog) -> Case:
    log.save(file := folder / "small.npz")
    return file, EpisodeLog.load


def skill(folder: Path, _: EpisodeLog) -> Case:
    shown = Teacher().demonstrate_doors([0.35, 0.5], 2, rng=np.random.default_rng(0))
    fitted = policies.fit_skill(policies.align(shown, n_samples=10))
    fitted.save(file := folder / "skill.npz")
    return file, policies.load_skill


def settings(folder: Path, _: EpisodeLog) -> Case:
    write_settings(file := folder / "study.toml", StudySettings())
    return file, read_settings


def plain_json(folder: Path, _: EpisodeLog) -> Case:
    write_json(file := folder / "study.json", {"versions": {"numpy": "2.0"}})
    return file, read_json


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
@pytest.mark.parametrize(
    "make", [demonstrations, episode_log, skill, settings, plain_json, result]
)
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
