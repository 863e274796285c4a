"""Studies: tasks named by their definition, results kept, nothing done twice."""

import dataclasses
import json

import gymnasium
import pytest

from experiments import cli, provenance, rollout, teacher
from experiments import study as studies
from experiments.study import made_by_other_code, run_study, tasks

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
        "teacher": {**task.teacher, "noise_bandwidth": 2.0},
    }
    assert changes.keys() == {field.name for field in dataclasses.fields(task)}
    keys = {
        dataclasses.replace(task, **{name: value}).key
        for name, value in changes.items()
    }
    assert len(keys | {task.key}) == len(changes) + 1


def test_key_is_the_same_in_every_process():
    (task,) = tasks(("gp",), {"small": {"radius": 0.35}}, (0,))
    # Changes with the fields of a task and with the standard teacher: then no stored
    # result is of the same task any more.
    assert task.key == "68ce6a52accb6d5c"


def test_another_standard_teacher_makes_another_task(monkeypatch):
    (task,) = tasks(("gp",), {"small": DOORS["small"]}, (0,))
    slower = teacher.TeacherConfig(duration_mean=9.0)
    monkeypatch.setattr(teacher, "TeacherConfig", lambda: slower)
    (other,) = tasks(("gp",), {"small": DOORS["small"]}, (0,))
    assert other.teacher == {**task.teacher, "duration_mean": 9.0}
    assert other.key != task.key


def test_the_teacher_of_the_task_demonstrates(monkeypatch):
    (task,) = tasks(("gp",), {"small": DOORS["small"]}, (0,))
    task = dataclasses.replace(task, teacher={**task.teacher, "duration_mean": 9.0})
    configs = []

    def stop(self, *_, **__):
        configs.append(self.config)
        raise ArithmeticError

    monkeypatch.setattr(teacher.Teacher, "demonstrate_doors", stop)
    with pytest.raises(ArithmeticError):
        studies.run_task(task)
    assert configs == [teacher.TeacherConfig(duration_mean=9.0)]


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


def test_a_task_that_failed_is_run_again(tmp_path, runs, monkeypatch):
    study = tasks(("broken", "gp"), {"small": DOORS["small"]}, (0,))
    list(run_study(tmp_path, study))
    assert [task.policy for task in runs] == ["broken", "gp"]
    monkeypatch.setattr(studies, "run_task", lambda _: {"success": True})
    repaired, _ = run_study(tmp_path, study)
    assert repaired["metrics"] == {"success": True}
    assert "error" not in repaired
    list(run_study(tmp_path, study))
    assert [task.policy for task in runs] == ["broken", "gp"]


def test_result_file_says_what_made_it(tmp_path, runs):
    study = tasks(("gp", "broken"), {"small": DOORS["small"]}, (7,))
    list(run_study(tmp_path, study))
    for task in study:
        stored = json.loads((tmp_path / "tasks" / f"{task.key}.json").read_text())
        assert stored["task"] == dataclasses.asdict(task)
        assert stored["versions"] == dict(provenance.versions())
        assert stored["git"] == provenance.code_state()["git"]


@pytest.fixture
def code(monkeypatch):
    """Replace the state of the code by one that a test may change."""
    state = {"versions": {"numpy": "2.0"}, "git": {"commit": "a", "dirty": False}}
    monkeypatch.setattr(studies, "code_state", lambda: state)
    return state


@pytest.mark.parametrize(
    "change",
    [
        {"git": {"commit": "b", "dirty": False}},
        {"git": {"commit": "a", "dirty": True}},
        {"git": None},
        {"versions": {"numpy": "2.1"}},
    ],
)
def test_results_of_other_code_are_counted(tmp_path, runs, code, change):
    old = tasks(("gp", "broken"), DOORS, range(2))
    list(run_study(tmp_path, old))
    assert made_by_other_code(tmp_path, old) == 0
    code.update(change)
    # Neither what failed nor what is still missing will be another code's result.
    assert made_by_other_code(tmp_path, tasks(("gp", "broken"), DOORS, range(3))) == 4


def test_results_of_unknown_code_are_other_code(tmp_path, runs):
    (task,) = tasks(("gp",), {"small": DOORS["small"]}, (0,))
    list(run_study(tmp_path, [task]))
    path = tmp_path / "tasks" / f"{task.key}.json"
    stored = json.loads(path.read_text())
    del stored["versions"], stored["git"]
    path.write_text(json.dumps(stored))
    assert made_by_other_code(tmp_path, [task]) == 1


def test_benchmark_warns_of_results_of_other_code(tmp_path, monkeypatch, code, capsys):
    fields = ("stability_margin_translation", "prediction_error_position")
    metrics = dict.fromkeys((*fields, "governed_share", "latency_median_ms"), 1.0) | {
        "success": False
    }
    monkeypatch.setattr(studies, "run_task", lambda _: metrics)
    out = tmp_path / "study"
    command = ["benchmark", "--policies", "oracle", "--doors", "small"]
    command += ["--out", str(out), "--seeds"]
    assert cli.main([*command, "2"]) == 0
    assert cli.main([*command, "2"]) == 0
    assert "warning" not in capsys.readouterr().err
    code["git"] = {"commit": "b", "dirty": False}
    assert cli.main([*command, "3"]) == 0
    (warning,) = (
        line for line in capsys.readouterr().err.splitlines() if "warning" in line
    )
    assert warning == (
        "gplfd: warning: 2 of 3 results were made by other code (another git state or "
        f"other package versions); use another --out or delete {out} to have one "
        "version"
    )


def test_environment_is_closed_when_the_rollout_fails(tmp_path, monkeypatch):
    class Door:
        closed = False

        def close(self):
            self.closed = True

    def fail(*_, **__):
        raise ArithmeticError("the simulation diverged")

    door = Door()
    monkeypatch.setattr(gymnasium, "make", lambda *_, **__: door)
    monkeypatch.setattr(rollout, "rollout", fail)
    (task,) = tasks(("oracle",), {"small": DOORS["small"]}, (0,))
    with pytest.raises(ArithmeticError, match="diverged"):
        studies.run_task(task)
    assert door.closed
    # `gplfd run` opens doors by itself.
    door.closed = False
    command = ["run", "--policy", "oracle", "--doors", "small", "--out", str(tmp_path)]
    with pytest.raises(ArithmeticError, match="diverged"):
        cli.main(command)
    assert door.closed
