"""Studies: tasks named by their definition, results kept, nothing done twice."""

import dataclasses
import json

import pytest

from experiments import study as studies
from experiments.study import run_study, tasks

DOORS = {"small": {"radius": 0.35}, "large": {"radius": 0.65}}


@pytest.fixture
def runs(monkeypatch):
    """Replace the episode by a record of which tasks ran."""
    done = []

    def fake(task):
        done.append(task)
        if task.policy == "broken":
            raise ValueError("cannot learn from this")
        return {"success": True, "seed": task.seed}

    monkeypatch.setattr(studies, "run_task", fake)
    return done


def test_a_study_is_policies_times_doors_times_seeds():
    study = tasks(("gp", "oracle"), DOORS, range(3))
    assert len(study) == len({task.key for task in study}) == 2 * 2 * 3
    assert [task.seed for task in study[:4]] == [0, 0, 0, 0]


def test_key_depends_on_every_field():
    (task,) = tasks(("gp",), {"small": DOORS["small"]}, (0,))
    changes = {
        "policy": "oracle",
        "door": "tiny",
        "door_config": {"radius": 0.36},
        "seed": 1,
        "demonstrations_per_door": 3,
    }
    assert changes.keys() == {field.name for field in dataclasses.fields(task)}
    keys = {
        dataclasses.replace(task, **{name: value}).key
        for name, value in changes.items()
    }
    assert len(keys | {task.key}) == len(changes) + 1


def test_key_is_the_same_in_every_process():
    (task,) = tasks(("gp",), {"small": {"radius": 0.35}}, (0,))
    assert task.key == "0bd7eee228ee6c11"


def test_interrupted_study_goes_on_where_it_stopped(tmp_path, runs):
    study = tasks(("gp",), DOORS, range(4))
    results = run_study(tmp_path, study)
    for _ in range(3):
        next(results)
    results.close()
    assert len(list(run_study(tmp_path, study))) == 8
    assert runs == list(study)


def test_more_seeds_repeat_nothing(tmp_path, runs):
    list(run_study(tmp_path, tasks(("gp",), DOORS, range(2))))
    list(run_study(tmp_path, tasks(("gp",), DOORS, range(3))))
    assert [task.seed for task in runs] == [0, 0, 1, 1, 2, 2]


def test_a_task_that_fails_is_a_result(tmp_path, runs):
    study = tasks(("broken", "gp"), {"small": DOORS["small"]}, (0,))
    failed, fine = run_study(tmp_path, study)
    assert failed["error"] == "ValueError: cannot learn from this"
    assert fine["metrics"]["success"]


def test_result_file_says_what_made_it(tmp_path, runs):
    (task,) = tasks(("gp",), {"small": DOORS["small"]}, (7,))
    list(run_study(tmp_path, [task]))
    stored = json.loads((tmp_path / "tasks" / f"{task.key}.json").read_text())
    assert stored["task"] == dataclasses.asdict(task)
