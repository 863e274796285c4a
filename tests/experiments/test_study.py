"""Studies: tasks named by their definition, results kept, nothing done twice."""

import dataclasses
import json
import re

import pytest

from gplfd_env.conventions.assets import asset_path
from gplfd_env.doors.config import DoorConfig
from gplfd_experiments.analysis.results.measures import EPISODE_MEASURES
from gplfd_experiments.data import teacher
from gplfd_experiments.episodes.task import EpisodeTask, episode_task
from gplfd_experiments.files import provenance
from gplfd_experiments.studies import jobs, runner, store
from gplfd_experiments.studies.engines import Lost
from gplfd_experiments.studies.runner import run_study
from gplfd_experiments.studies.store import stored_results
from gplfd_experiments.studies.tasks import SkillTask, jobs_of

DOORS = {"small": {"radius": 0.35}, "large": {"radius": 0.65}}


def episode(policy="gp", door="small", seed=0, **fields):
    fields |= {"policy": policy, "door": door, "seed": seed}
    return EpisodeTask(door_config=DOORS[door], **fields)


def episodes(policies, seeds):
    return [episode(p, d, seed) for seed in seeds for p in policies for d in DOORS]


@pytest.fixture
def succeeded(episode_result):
    """Return the result of a task that was measured."""
    metrics = episode_result("gp")["metrics"]
    return lambda task: {**jobs._origin(task), "metrics": metrics}


@pytest.fixture
def runs(monkeypatch, succeeded):
    """Replace what a worker does by a record of which jobs ran."""
    done = []

    def fake(job, **_):
        done.append(job)
        bad = "ValueError: cannot learn from this"
        return [
            jobs.failed(t, bad) if t.policy == "broken" else succeeded(t) for t in job
        ]

    monkeypatch.setattr(runner, "run_job", fake)
    return done


CHANGES = {
    "policy": "oracle",
    "door": "tiny",
    "door_config": {"radius": 0.36},
    "seed": 1,
    "demonstrations_per_door": 3,
    "teacher": {"noise_bandwidth": 2.0},
    "randomization": "mild",
    "disturbance": "person",
    "demonstrated_radii": (0.4,),
    "habits": {"pauses": 1},
    "demonstrated_forces": True,
    "demonstrated_hardware": ({"closer": {"preload": 5.0}}, {}, {}),
    "prior_radius": 0.5,
    "taught_by": "second",
    "trial": "person",
    "level": "500 N/m",
    "held_out": "radius",
    "demonstrated_kind": {"handle": "lever", "latch": "bolt"},
    "base": "mobile",
    "robot": "panda-like",
    "robot_content": "ab12",
    "practice": {"corrections": 1},
    "start": "approach",
    "policy_source": {"kind": "module", "file": "mine.py", "sha256": "ab12"},
}


@pytest.mark.parametrize(
    "task", [episode(), SkillTask(policy="gp", seed=0, held_out="demonstration")]
)
def test_key_depends_on_every_field(task):
    names = {field.name for field in dataclasses.fields(task)} - {"kind"}
    keys = {dataclasses.replace(task, **{name: CHANGES[name]}).key for name in names}
    assert len(keys | {task.key}) == len(names) + 1


def test_every_episode_draws_its_own_door_and_all_policies_the_same():
    assert episode(seed=7).reset_seed == 7
    hard = [
        episode(policy, door, seed, randomization="hard").reset_seed
        for policy in ("gp", "dmp")
        for door in DOORS
        for seed in range(3)
    ]
    assert hard[:6] == hard[6:]
    assert len(set(hard)) == 6
    assert episode(disturbance="push").reset_seed == hard[0]


def test_keys_are_the_same_in_every_process_but_for_another_teacher(monkeypatch):
    # They change with the fields of a task and with the standard teacher: then no
    # stored result is of the same task any more.
    assert episode().key == "729ae4581ec21027"
    assert SkillTask(policy="gp", seed=0, held_out="radius").key == "a69b9f69a16b398d"
    slower = teacher.TeacherConfig(duration_mean=9.0)
    monkeypatch.setattr(teacher, "TeacherConfig", lambda: slower)
    assert episode().teacher["duration_mean"] == 9.0
    assert episode().key != "729ae4581ec21027"


def test_another_file_of_the_same_name_is_another_robot(tmp_path):
    file, text = tmp_path / "a.urdf", asset_path("ur5e_like.urdf").read_text()
    task = {"policy": "gp", "seed": 0, "robot": str(file)}
    file.write_text(text)
    key = episode_task("medium", DoorConfig(), **task).key
    file.write_text(text.replace('effort="150"', 'effort="140"'))
    assert episode_task("medium", DoorConfig(), **task).key != key


def test_a_job_has_what_one_learner_learns_in_any_pipeline(monkeypatch):
    """And all of a set of demonstrations, so that it is learned from once."""
    first = [episode(door=door) for door in DOORS] + [episode(policy="gp@no-size")]
    others = [episode(seed=1), episode(demonstrations_per_door=3)]
    others += [episode(demonstrated_forces=True), episode(habits={"pauses": 1})]
    apart = [episode(policy="oracle"), episode(base="mobile")]
    apart += [episode(robot="panda-like"), episode(start="approach")]
    apart += [episode(practice={"corrections": 1})]
    apart += [SkillTask(policy="gp", seed=0, held_out="radius")]
    apart += [SkillTask(policy="gp", seed=0, held_out="demonstration")]
    found = jobs_of([first[0], *apart, *others, *first])
    assert found == ((*first, *others), *((task,) for task in apart))
    monkeypatch.setattr("gplfd_experiments.studies.tasks.TOGETHER", 4)
    # Two jobs, the larger first; none has a share of the first demonstrations.
    assert jobs_of([*first, *others]) == (tuple(others), tuple(first))
    monkeypatch.setattr("gplfd_experiments.studies.tasks._LARGEST", 6)
    for number, size in ((16, 4), (40, 5), (96, 6)):  # an eighth, within limits
        study = [episode(seed=seed) for seed in range(number)]
        assert {len(job) for job in jobs_of(study)} == {size}


def test_interrupted_study_goes_on_where_it_stopped(tmp_path, runs, monkeypatch):
    monkeypatch.setattr("gplfd_experiments.studies.tasks.TOGETHER", 2)
    study, engine = episodes(("gp",), range(4)), Losing()
    results = run_study(tmp_path, study, engine)
    for _ in range(3):
        next(results)
    results.close()
    assert engine.closed
    # The job of seed 1 had one of its two files written.
    assert len(list(run_study(tmp_path, study))) == 5
    assert runs[2:] == [tuple(study[4:6]), tuple(study[6:]), (study[3],)]
    # Nothing is run again, and more seeds are added.
    more = run_study(tmp_path, episodes(("gp",), range(5)))
    assert {result["task"]["seed"] for result in more} == {4}


def test_a_task_that_failed_is_run_again(tmp_path, runs, succeeded, monkeypatch):
    study = episodes(("broken", "gp"), range(1))
    list(run_study(tmp_path, study))
    for task in study:
        stored = json.loads(store.result_path(tmp_path, task).read_text())
        assert stored["task"] == task.definition
        assert stored["versions"] == dict(provenance.versions())
        assert stored["git"] == provenance.code_state()["git"]
        no = None if task.policy == "gp" else "ValueError: cannot learn from this"
        assert stored.get("error") == no
    monkeypatch.setattr(runner, "run_job", lambda job, **_: list(map(succeeded, job)))
    assert list(run_study(tmp_path, study)) == [succeeded(task) for task in study[:2]]
    assert list(run_study(tmp_path, study)) == []


DAMAGES = {
    "cut": (lambda text: text[: len(text) // 2], "cannot be read as JSON"),
    "other task": (lambda text: text.replace("small", "large"), "of another task"),
}


@pytest.mark.parametrize(("damage", "message"), DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_result_is_named_and_its_task_run_again(
    tmp_path, runs, damage, message
):
    study = episodes(("gp",), range(2))
    results = list(run_study(tmp_path, study))
    path = store.result_path(tmp_path, study[0])
    path.write_text(damage(path.read_text()))
    (reason,) = stored_results(tmp_path, study).damaged
    assert re.match(f"{path}.*{message}", reason)
    assert list(run_study(tmp_path, study)) == results[:1]
    assert stored_results(tmp_path, study).damaged == []


def test_every_measure_is_of_a_metric(episode_result):
    metrics = episode_result("gp")["metrics"]
    assert EPISODE_MEASURES.keys() - {"grasp_kept"} <= metrics.keys()


class Losing:
    """An engine that loses the items with some doors."""

    def __init__(self, *doors):
        self.doors, self.closed = doors, False

    def run(self, work, items):
        try:
            for item in items:
                lost = any(task.door in self.doors for task in item)
                end = Lost("it died")
                yield item, end if lost else work(item)
        finally:
            self.closed = True


def test_tasks_whose_worker_died_are_run_in_halves(tmp_path, runs):
    study = [episode(), episode(door="large"), *(episode(seed=n) for n in range(1, 5))]
    results = list(run_study(tmp_path, study, Losing("large")))
    assert runs == [tuple(study[3:]), (study[0],), (study[2],)]
    (died,) = (result for result in results if "error" in result)
    assert (died["error"], died["task"]["door"]) == ("it died", "large")
    assert died["lost"]
