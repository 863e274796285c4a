"""Trials: what they consist of, and that their answers follow from the numbers."""

import dataclasses
import functools
import json
import re
from collections import Counter
from collections.abc import Callable
from typing import Any
from unittest import mock

import numpy as np
import pytest

from gplfd_env.doors.disturbance import disturbance_named
from gplfd_env.doors.randomization import door_randomization
from gplfd_experiments.analysis.results.measures import EPISODE_MEASURES
from gplfd_experiments.analysis.results.reading import read_results
from gplfd_experiments.analysis.results.statistics import success_rate
from gplfd_experiments.analysis.results.trials import (
    MEASURES,
    answered,
    answers_by_trial,
    of_trials,
    protocol_problems,
    trial_answers,
)
from gplfd_experiments.cli.commands.studies import Trials
from gplfd_experiments.cli.main import main
from gplfd_experiments.episodes.task import EpisodeTask
from gplfd_experiments.studies import jobs, runner
from gplfd_experiments.studies.store import RESULT_STAMP
from gplfd_experiments.studies.tasks import task_from
from gplfd_experiments.studies.trials import protocol
from gplfd_experiments.studies.trials.protocol import (
    FIRST_SEED,
    PARTS,
    SEEDS,
    TRACKS,
    TRIALS,
    VERSION,
    Contrast,
    ProtocolPart,
    Side,
    named_trials,
    taking_part,
    trial_tasks,
)
from gplfd_policies.registry.catalogue import policy_named

pytestmark = pytest.mark.slow

MakeEpisode = Callable[..., dict[str, Any]]
FEW: Any = {part: dataclasses.replace(of, seeds=2) for part, of in PARTS.items()}
"""The parts with two seeds, for time."""


@functools.cache
def tasks_of(part: ProtocolPart = "whole") -> tuple[EpisodeTask, ...]:
    with mock.patch.object(protocol, "PARTS", FEW):
        return trial_tasks(named_trials((), part), part=part)


def test_every_policy_of_the_protocol_meets_the_same_draws():
    tasks = tasks_of()
    first = [task for task in tasks if task.seed == FIRST_SEED]
    assert len({task.key for task in first}) == len(first) == len(tasks) / 2
    assert {task.seed for task in tasks} == {FIRST_SEED, FIRST_SEED + 1}
    assert PARTS["whole"].seeds == PARTS["ideas"].seeds == SEEDS
    counts = [
        f"{len(tasks_of(part)) * PARTS[part].seeds // FEW[part].seeds:,}"
        for part in PARTS
    ]
    assert re.findall(r"[\d,]+\d", Trials.__doc__ or "") == counts
    met: dict[str, set[Any]] = {}
    for task in tasks:
        met.setdefault(task.policy, set()).add(
            (task.trial, task.level, task.door, task.seed, task.reset_seed)
        )
    for track in TRACKS.values():
        draws = {draw for draw in met["oracle"] if draw[0] in track.trials}
        assert {trial for trial, *_ in draws} == set(track.trials)
        # `oracle` learns nothing, and is not corrected.
        assert all(draws <= met[policy] for policy in track.policies)
    # Who takes a prior mean also meets the levels that give one.
    prior = {(trial, level) for trial, level, *_ in met["gp"] - met["dmp"]}
    prior = {(t, level) for t, level in prior if t in ("further", "few", "radius")}
    assert {("further", "prior mean"), ("few", "two and a prior mean")} <= prior


def test_tasks_come_back_from_their_files_and_share_what_they_learn():
    tasks = tasks_of("ideas")
    for task in tasks[::20]:
        assert task_from(task.definition) == task


def test_the_protocol_is_sound():
    for name, trial in TRIALS.items():
        assert trial.question.endswith("?"), name
        compared = {contrast.measure for contrast in trial.contrasts}
        for measure in compared | set(trial.measures):
            assert EPISODE_MEASURES[measure].name, measure
        for level in trial.levels.values():
            door_randomization(level.randomization)
            disturbance_named(level.disturbance)
        present = taking_part(name)
        assert all(map(policy_named, present)), name
        for contrast in trial.contrasts:
            for side in (contrast.having, contrast.lacking):
                assert side.policy in present, name
                assert side.level in ("", *trial.levels), name
    for part in PARTS.values():
        for name, variants in part.variants.items():
            assert {*part.everywhere, *variants} <= set(taking_part(name))


def test_own_policies_take_part_and_unknown_names_are_refused():
    trials = named_trials(("stop",))
    tasks = trial_tasks(trials, policies=("gp-homoscedastic", "gp"), part="small")
    counts = Counter(task.policy for task in tasks)
    assert counts["gp-homoscedastic"] == counts["gp"] == 6
    with pytest.raises(ValueError, match=r"unknown trial 'stopp' \(did you mean 'stop"):
        named_trials(("stopp",))


def outcomes(
    make: MakeEpisode, policy: str, values: Any, measure: str, **task: Any
) -> list[dict[str, Any]]:
    """Episodes of a trial, one per seed, with given values of a measure."""
    results = []
    for seed, value in enumerate(values):
        result = make(policy, seed, **{"trial": "stop", "level": "stop", **task})
        result["metrics"][measure] = value
        results.append(result)
    return results


NOISE = np.random.default_rng(0).normal(0.0, 1.0, 20)
KEPT = [seed >= 6 for seed in range(20)]
SOME = [None, None, 1.0, 1.0, 1.0, 1.0]


@pytest.mark.parametrize(
    ("measure", "with_it", "without", "doors", "found"),
    [
        ("force_radial_peak", 28.0 + NOISE, 30.0, 1, (20, -2.0, "shows")),
        ("force_radial_peak", 30.0 + NOISE, 30.0, 1, (20, 0.0, "open")),
        ("force_radial_peak", 32.0 + NOISE, 30.0, 1, (20, 2.0, "harms")),
        # What is smaller than 1 N does not count, however certain it is.
        ("force_radial_peak", 29.5 + 0.1 * NOISE, 30.0, 1, (20, -0.5, "open")),
        ("final_angle_deg", 34.0 + NOISE, 30.0, 1, (20, 4.0, "shows")),
        ("final_angle_deg", 30.0 + NOISE, 30.0, 1, (20, 0.0, "open")),
        ("final_angle_deg", 26.0 + NOISE, 30.0, 1, (20, -4.0, "harms")),
        # Shares are compared on average: the median of differences would be zero.
        ("success", [True] * 20, KEPT, 1, (20, 0.3, "shows")),
        # The doors of a seed are one number, and three pairs are too few.
        ("force_radial_peak", [1.0] * 3, 9.0, 10, (3, -8.0, "open")),
        # Missing numbers count for nothing.
        ("recovery_time", SOME, 1.0, 1, (4, 0.0, "open")),
        ("recovery_time", [None] * 8, 1.0, 1, (None, None, "open")),
    ],
)
def test_an_idea_shows_where_its_interval_leaves_zero_out(
    measure, with_it, without, doors, found, write_study, episode_result
):
    """Of two policies at all levels, or of two levels of one policy."""
    without = np.broadcast_to(without, len(with_it)).tolist()
    pairs, estimate, verdict = found
    for having, lacking in (
        (Side(policy="gp"), Side(policy="gp@no-adaptation")),
        (Side(policy="gp", level="stop"), Side(policy="gp", level="other")),
    ):
        results = []
        for radius in np.linspace(0.3, 0.6, doors):
            for side, values in ((having, with_it), (lacking, without)):
                place = {"level": side.level or "stop", "radius": radius}
                results += outcomes(
                    episode_result, side.policy, values, measure, **place
                )
        episodes = of_trials(read_results(write_study(results)))["stop"]
        sides = {"having": having, "lacking": lacking}
        answer = answered(Contrast(idea="an idea", measure=measure, **sides), episodes)
        assert answer.verdict == verdict
        if pairs is None:
            assert answer.shift is None
        else:
            tolerance = 0.5 if isinstance(with_it, np.ndarray) else 1e-9
            assert answer.shift.estimate == pytest.approx(estimate, abs=tolerance)


def test_levels_weigh_the_same_with_any_doors(write_study, episode_result):
    results, force = [], "force_radial_peak"
    for level, radius, gain in (("a", 0.3, 0.0), ("b", 0.3, 6.0), ("b", 0.4, 6.0)):
        for policy, value in (("gp", gain), ("mean", 0.0)):
            place = {"level": level, "radius": radius}
            results += outcomes(episode_result, policy, [value], force, **place)
    levels = of_trials(read_results(write_study(results)))["stop"]
    sides = {"having": Side(policy="gp"), "lacking": Side(policy="mean")}
    answer = answered(Contrast(idea="an idea", measure=force, **sides), levels)
    assert answer.shift.estimate == 3.0


def test_p_values_are_corrected_for_contrasts_of_a_track(write_study, episode_result):
    """A contrast that is significant alone is not among the others of its track."""
    measure, better = "stop_force_sustained", [-2.0, -3.0, -2.5, -4.0, -3.5, -1.5, 0.2]
    results = []
    for trial in ("stop", "locked"):
        for policy in ("gp", "gp@constant-100", "gp@constant-500", "gp@carried-load"):
            values = [30.0 + (policy == "gp") * shift for shift in better]
            place = {"trial": trial, "level": trial}
            results += outcomes(episode_result, policy, values, measure, **place)
    ran = of_trials(read_results(write_study(results)))
    alone = answered(TRIALS["locked"].contrasts[0], ran["locked"])
    together = answers_by_trial(ran)
    assert alone.p_value == pytest.approx(0.03125)
    assert alone.verdict == "shows"
    group = [answer for answers in together.values() for answer in answers]
    assert all(answer.p_value > 0.05 for answer in group)
    assert all(answer.verdict == "open" for answer in group)


@pytest.mark.parametrize("share", ["success", "grasp_kept"])
def test_an_error_of_the_policy_is_a_failure_in_every_share(
    share, write_study, episode_result
):
    results = [episode_result("gp", n, trial="stop", level="stop") for n in range(16)]
    for result in results[:8]:
        result.update(error="ValueError: no", traceback="Traceback ...")
    results[8].update(error="its worker died", lost=True)
    found = read_results(write_study(results))
    rate = MEASURES[share].typical(of_trials(found)["stop"]["stop"]["gp"])
    assert (rate.successes, rate.trials) == (7, 15)
    assert rate == success_rate((seed, seed >= 8) for seed in range(15))
    entry = trial_answers(found)["trials"]["stop"]["stop"]["gp"]
    assert (entry["episodes"], entry["errors"], entry["lost"]) == (16, 8, 1)
    assert entry["success"]["estimate"] == pytest.approx(7 / 15, abs=1e-5)


def test_a_part_is_run_and_continued(tmp_path, monkeypatch, capsys, episode_result):
    ran = []
    metrics = episode_result("gp")["metrics"]

    def run_job(job: Any, **_: Any) -> list[Any]:
        ran.extend(job)
        return [{**jobs._origin(task), "metrics": metrics} for task in job]

    monkeypatch.setattr(runner, "run_job", run_job)
    arguments = ["trials", "--trials", "stop", "--part", "small", "--engine", "serial"]
    arguments += ["--out", str(tmp_path / "out"), "--quiet"]
    assert main(arguments) == 0
    assert {task.trial for task in ran} == {"stop"}
    assert len(ran) == 6 * 6
    ran.clear()
    assert main([*arguments, "--policies", "gp-homoscedastic"]) == 0
    assert {task.policy for task in ran} == {"gp-homoscedastic"}
    capsys.readouterr()
    assert main([*arguments, "--json"]) == 0
    (stop,) = json.loads(capsys.readouterr().out)["trials"]["stop"].values()
    assert stop["gp"]["episodes"] == stop["gp-homoscedastic"]["episodes"] == 6
    assert stop["gp"]["success"]["seeds"] == {
        str(FIRST_SEED + number): metrics["success"] for number in range(6)
    }
    assert main(["trials", "--trials", "stops"]) == 2


def test_a_seed_has_its_own_number_whatever_the_order(write_study, episode_result):
    """Results are read in the order of radii, which are drawn, and of files."""
    force, values = "stop_force_sustained", [float(number) for number in range(6)]
    results = outcomes(episode_result, "gp", values, force)
    for number, result in enumerate(results):
        result["metrics"]["radius"] = 0.9 - 0.1 * number
    answers = trial_answers(read_results(write_study(results[::-1])))
    seeds = answers["trials"]["stop"]["stop"]["gp"][force]["seeds"]
    assert seeds == {str(number): float(number) for number in range(6)}
    assert [*seeds] == sorted(seeds)


@functools.cache
def stored(policy: str) -> str:
    """The results of a whole trial by one policy, without running it, as JSON."""
    tasks = trial_tasks(named_trials(("stop",)), policies=[policy])
    return json.dumps(
        [
            {
                **RESULT_STAMP,
                "task": task.definition,
                "versions": {"gplfd": "0.1.0"},
                "git": {"commit": "0123456789abcdef", "dirty": False},
                "demonstrations": jobs.demonstrations_hash(task),
            }
            for task in tasks
            if task.policy == policy
        ]
    )


@pytest.fixture
def whole(episode_result, monkeypatch):
    monkeypatch.setattr(protocol, "PARTS", FEW)
    metrics = episode_result("gp")["metrics"]
    return lambda policy="gp": [
        {**one, "metrics": dict(metrics)} for one in json.loads(stored(policy))
    ]


def test_a_whole_trial_follows_the_protocol(write_study, whole, capsys):
    results = [*whole(), *whole("hinge-fit")]
    # An error of a policy is a result.
    results[1].update(error="ValueError: no", traceback="Traceback ...")
    folder = write_study(results)
    assert protocol_problems(read_results(folder)) == []
    assert main(["report", str(folder), "--check"]) == 0
    assert capsys.readouterr().out == f"the results follow protocol v{VERSION}\n"


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda r: r.pop(), "gp: 1 of 2 are missing: stop, stop, medium, seed 101"),
        (lambda r: r[1]["task"].update(disturbance="push"), "1 are not the protocol"),
        (lambda r: r[1].update(demonstrations="0"), "1 episodes used other demonstra"),
        (lambda r: r[1]["git"].update(dirty=True), "made by code with edits"),
        (lambda r: r[1].update(error="x", lost=True), "1 episodes were lost by the"),
    ],
)
def test_what_does_not_follow_the_protocol_is_named(
    spoil, message, write_study, whole, capsys
):
    results = whole()
    spoil(results)
    folder = write_study(results)
    assert main(["report", str(folder), "--check"]) == 1
    assert message in capsys.readouterr().out
