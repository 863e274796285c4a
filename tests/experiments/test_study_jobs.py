"""Jobs: learned once, opened together, and each task as if it were alone."""

import dataclasses
import errno
import math
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest

from gplfd_env.doors.config import door_config
from gplfd_experiments.episodes import build
from gplfd_experiments.episodes.metrics import PROGRESS, episode_metrics
from gplfd_experiments.episodes.task import EpisodeTask
from gplfd_experiments.studies import jobs
from gplfd_experiments.studies.engines import Engine
from gplfd_experiments.studies.jobs import run_job
from gplfd_experiments.studies.runner import run_study
from gplfd_experiments.studies.store import stored_results
from gplfd_experiments.studies.tasks import SkillTask, jobs_of
from gplfd_policies.adaptation.process import ProcessAdaptation
from gplfd_policies.movements.skill import fit_skill
from gplfd_policies.registry import catalogue as registry
from gplfd_policies.registry.built_in import POLICIES
from gplfd_policies.registry.method import Learner, Method, TrainingInput

pytestmark = pytest.mark.slow


def task(policy: str = "gp", door: float = 0.35, **fields: Any) -> EpisodeTask:
    return EpisodeTask(
        policy=policy,
        door=str(door),
        door_config=dataclasses.asdict(door_config(door)),
        seed=fields.pop("seed", 0),
        **fields,
    )


def timeless(folder: Path, task: EpisodeTask) -> dict[str, Any]:
    (result,) = stored_results(folder, [task]).finished
    times = {key for key in result["metrics"] if key.startswith(("latency_", "cpu_"))}
    for name in times:
        del result["metrics"][name]
    return {name: result[name] for name in ("task", "metrics")}


def test_a_study_is_the_same_on_every_engine_and_in_any_grouping(tmp_path, monkeypatch):
    study = [task("gp", 0.35), task("gp", 0.6, seed=1), task("oracle", 0.35)]
    assert len(jobs_of(study)) == 2
    list(run_study(tmp_path / "loky", study, Engine(workers=1)))
    agent = build.learned_agents(study[2], registry.policy_named("oracle"))()
    (log,) = build.open_together(study[2:], [agent], forecast_period=0.05)
    metrics = timeless(tmp_path / "loky", study[2])["metrics"]
    assert metrics["success"]
    assert metrics["radius"] == study[2].door_config["radius"]
    final = math.radians(metrics["final_angle_deg"])
    assert log.opening.door_angle[-1] == pytest.approx(final)
    assert log.seed == study[2].seed
    # A study takes only the forecasts that are scored.
    every = jobs.episode_log(study[1])
    assert len(every.forecasts.times) > 5 * len(PROGRESS)
    together = timeless(tmp_path / "loky", study[1])["metrics"]
    alone = jobs._plain(episode_metrics(every))
    assert together == {name: alone[name] for name in together}


@pytest.fixture
def opened(monkeypatch, make_log):
    """Replace the rollouts by logs by formula; remember what was asked of them."""
    asked = []

    def fake(envs: Any, agents: Any, **options: Any) -> tuple[Any, ...]:
        envs.reset(seed=options["seeds"])
        asked.append({"envs": envs, **options})
        if "0.65" in options["doors"]:
            raise FloatingPointError("the door of 0.65 m came off")
        return tuple(make_log(door=door) for door in options["doors"])

    monkeypatch.setattr(build, "rollouts", fake)
    return asked


def test_what_is_learned_once_opens_all_doors(opened, monkeypatch):
    learned = []

    class Noting(Method):
        def learn(self, training: TrainingInput) -> Any:
            learned.append(training)
            return super().learn(training)

    fit: Any = mock.MagicMock(side_effect=fit_skill)
    fit.__hash__ = mock.Mock(side_effect=TypeError)  # as of a user's dataclass
    method = Noting(learner=Learner(fit=fit, adaptation=ProcessAdaptation))
    changed = dataclasses.replace(registry.policy_named("gp"), make=method)
    monkeypatch.setattr(registry, "POLICIES", {"gp": changed})
    doors, slow = (0.35, 0.42, 0.5), {**task().teacher, "duration_mean": 9.0}
    fields = {"seed": 3, "teacher": slow, "randomization": "mild"}
    job = tuple(task(door=door, **fields) for door in doors)
    names = "gp@no-size", "gp@no-modes", "gp@no-continuation"
    results = run_job((*job, *(task(name, **fields) for name in names)))
    assert [result["metrics"]["door"] for result in results][:3] == [*map(str, doors)]
    # Only the continuation changes what is learned.
    (training, again), call = learned, opened[0]
    assert [*again.demonstrations] == [*training.demonstrations]
    durations = [one.times[-1] for one in training.demonstrations]
    assert (training.seed, len(durations), min(durations) > 6.0) == (3, 6, True)
    assert call["policies"] == ["gp", "gp", "gp", *names]
    assert call["seeds"][:3] == [one.reset_seed for one in job]
    assert len(set(call["seeds"])) == 3
    assert call["forecast_period"] == jobs.FORECAST_PERIOD
    varied = [variation.door for variation in call["envs"].variations][:3]
    assert [door.radius for door in varied] == list(doors)
    assert varied[0].hinge_friction != door_config(0.35).hinge_friction
    assert len({door.hinge_friction for door in varied}) == 3


def test_demonstrated_doors_have_their_own_hardware():
    """The hand presses a handle harder whose door has a closer; the motion is equal."""
    forces = {"demonstrated_forces": True, "demonstrations_per_door": 1}
    closers = ({}, {"closer": {"preload": 10.0}}, {})
    plain, closed = (
        build.demonstrations_of(task("gp", **forces, demonstrated_hardware=each))
        for each in ((), closers)
    )
    pulls = []
    for one, other in zip(plain.demonstrations, closed.demonstrations, strict=True):
        assert np.array_equal(one.poses, other.poses)
        pulls.append(
            np.median(np.linalg.norm(other.wrenches[:, :3], axis=1))
            - np.median(np.linalg.norm(one.wrenches[:, :3], axis=1))
        )
    assert pulls == pytest.approx([0.0, 10.0 / 0.5, 0.0], abs=2.0)


def test_a_prior_mean_is_the_arc_at_the_phases_of_demonstrations(monkeypatch):
    learned = mock.Mock()
    monkeypatch.setattr(build, "learned", learned)
    short = {**task().teacher, "angle_mean": 0.5}
    one = task("gp", teacher=short, prior_radius=0.45)
    build.learned_agents(one, POLICIES["gp"])
    _, training, *_ = learned.call_args.args
    prior = training.prior_mean
    pose = prior.mean(np.array([1.0]))[0]
    arc = [0.45 * np.sin(0.5), 0.0, 0.45 * (np.cos(0.5) - 1), 0.0, 0.5, 0.0]
    np.testing.assert_allclose(pose, arc, atol=1e-4)
    assert prior.mean(np.array([9.0]))[0, 4] == pytest.approx(np.radians(67.0))


def test_agents_that_are_computed_together_share_a_batch(opened):
    """Those of two kinds of demonstrations try one after the other, and act alone."""
    kinds: Any = {"demonstrated_radii": (0.4, 0.6, 0.4, 0.6)}
    kinds["demonstrated_hardware"] = ({}, {}, {"swing": "push"}, {"swing": "push"})
    several = [task("gp", door, **kinds) for door in (0.42, 0.58)]
    alike = [task("gp", 0.35), task("gp", 0.5)]
    results = run_job((alike[0], *several, alike[1]))
    assert [call["doors"] for call in opened] == [["0.35", "0.5"], ["0.42", "0.58"]]
    assert [result["task"]["door"] for result in results] == [
        *("0.35", "0.42", "0.58", "0.5")
    ]


def test_a_policy_without_a_method_learns_once_per_door(opened, monkeypatch):
    oracle = registry.policy_named("oracle")
    make = mock.Mock(side_effect=oracle.make)
    changed = {"oracle": dataclasses.replace(oracle, make=make, kind="method")}
    monkeypatch.setattr(registry, "POLICIES", changed)
    run_job((task("oracle", 0.35), task("oracle", 0.5)))
    assert make.call_count == 2


@pytest.mark.parametrize("policy", ["oracle", "hinge-fit"])
def test_equal_episodes_of_a_reference_are_opened_once(policy, opened):
    """Whatever was demonstrated, and whatever the door and the trial are called."""
    first = task(policy)
    other = {"door": "narrow", "trial": "few", "demonstrations_per_door": 1}
    equal = dataclasses.replace(first, **other)
    drawn, seed = task(policy, randomization="mild"), task(policy, seed=1)
    results = run_job((first, equal, drawn, seed))
    assert [call["doors"] for call in opened] == [3 * ["0.35"]]
    assert [result["metrics"]["door"] for result in results][:2] == ["0.35", "narrow"]
    assert [result["task"] for result in results][1] == equal.definition
    assert results[0]["demonstrations"] != results[1]["demonstrations"]


def test_one_doors_error_leaves_the_others_alone(opened):
    results = run_job(tuple(task("oracle", door) for door in (0.35, 0.42, 0.65, 0.5)))
    assert [result.get("error") for result in results] == [
        *(None, None, "FloatingPointError: the door of 0.65 m came off", None)
    ]
    assert "in fake" in results[2]["traceback"]
    assert [call["doors"] for call in opened] == [
        *(["0.35", "0.42", "0.65", "0.5"], ["0.35", "0.42"]),
        *(["0.65", "0.5"], ["0.65"], ["0.5"]),
    ]
    assert opened[0]["envs"].closed


@pytest.mark.parametrize(
    ("error", "machine"),
    [
        (SystemExit(0), False),
        (MemoryError(), True),
        (OSError(errno.ENOSPC, "no space left on device"), True),
    ],
)
def test_an_error_is_the_policy_s_or_the_machine_s(error, machine, monkeypatch, opened):
    """And a policy that cannot learn is asked once."""
    learn = mock.Mock(side_effect=error)
    monkeypatch.setattr(jobs, "learned_agents", learn)
    for result in run_job((task("oracle", 0.35), task("oracle", 0.5))):
        assert result["error"].startswith(type(error).__name__)
        assert result.get("lost", False) == machine
        assert result["format_version"] == 1
    assert (learn.call_count, opened) == (1, [])


def test_a_learning_test_is_measured_without_a_robot(opened, monkeypatch):
    def method_metrics(method: Any, **options: Any) -> dict[str, Any]:
        assert method is POLICIES["gp"].method
        numbers = {"nlpd": -2.0, "far": math.nan, "cpu": {"2": math.inf, "6": (1.0, 2)}}
        return {"asked": list(options.values()), **numbers}

    monkeypatch.setattr(jobs, "method_metrics", method_metrics)
    one = SkillTask(policy="gp", seed=4, held_out="radius", demonstrations_per_door=3)
    (result,) = run_job((one,))
    assert opened == []
    # JSON knows neither NaN nor infinity.
    assert result["metrics"] == {
        "asked": [4, 3, one.teacher, False, "radius"],
        "nlpd": -2.0,
        "far": None,
        "cpu": {"2": None, "6": [1.0, 2]},
    }
