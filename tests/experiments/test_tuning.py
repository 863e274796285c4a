"""Tuning: the same candidates, one objective, and a file that survives interruption."""

import json

import pytest

from gplfd_env.doors.config import DOORS
from gplfd_experiments.cli.main import main
from gplfd_experiments.data.teacher import standard_teacher
from gplfd_experiments.studies import engines, tuning
from gplfd_experiments.studies.engines import Lost, Serial
from gplfd_experiments.studies.learning_tests.scores import method_metrics
from gplfd_experiments.studies.settings import PRESETS
from gplfd_experiments.studies.tuning import (
    STANDARD,
    Candidate,
    Protocol,
    best,
    candidates,
    checked_policies,
    evaluate,
)
from gplfd_policies import POLICIES
from gplfd_policies.registry.tuning_spaces import SPACES, tuned_settings

pytestmark = pytest.mark.slow

SMALL = Protocol(evaluations=5, seeds=(1000,), radii=(0.46,))


def evaluation(nlpd, closed=0, force=1.0):
    episodes = [
        {"success": number >= closed, "force_radial_peak": force} for number in range(3)
    ]
    return {"nlpd": nlpd, "episodes": episodes}


ERROR = {"error": "ValueError: no", "traceback": ""}


def pretended(candidate):
    """An evaluation that costs nothing and differs from candidate to candidate."""
    outcome = evaluation(-float(candidate.number), force=1.0 + candidate.number % 3)
    about = {"candidate": candidate.definition, "cpu_s": 0.5}
    return {**about, **tuning.code_state(), **outcome}


@pytest.mark.parametrize("policy", SPACES)
def test_candidates_are_the_same_every_time(policy):
    first, again = candidates(policy), candidates(policy)
    assert first == again
    assert len({one.key for one in first}) == len(first) == STANDARD.evaluations
    assert first[0].settings == SPACES[policy].published
    for one in first:
        for name, setting in SPACES[policy].settings.items():
            assert one.settings[name] in setting
    other = candidates(policy, Protocol(sequence=2))
    assert [one.settings for one in other[1:]] != [one.settings for one in first[1:]]


def test_any_budget_is_spent_and_half_of_it_in_each_half_of_a_setting():
    for evaluations in (1, 2, 3, 9, 17, 18):
        found = candidates("gmr", Protocol(evaluations=evaluations))
        assert [one.number for one in found] == list(range(evaluations))
    setting = SPACES["gmr"].settings["components"]
    found = candidates("gmr", Protocol(evaluations=33))[1:]
    middle = (setting.low + setting.high + 1) / 2
    assert sum(one.settings["components"] < middle for one in found) == 16


def test_no_study_has_the_seeds_or_doors_of_tuning():
    for settings in PRESETS.values():
        assert settings.seeds < min(STANDARD.seeds)
        for door in settings.doors:
            radius = DOORS[door].radius if door in DOORS else float(door)
            assert radius not in STANDARD.radii


def test_closed_doors_count_before_forces_and_density_as_much():
    given = [(0.0, 0, 9.0), (-1.0, 1, 1.0), (-2.0, 0, 2.0)]
    assert best([evaluation(*one) for one in given]) == (2, [2.5, 2.5, 1.0])


def test_what_has_no_density_or_ended_in_an_error_comes_last():
    given = [ERROR, evaluation(50.0, force=2.0), evaluation(None, force=1.0)]
    assert best(given) == (2, [3.0, 1.5, 1.5])  # the better task
    assert best([evaluation(None), evaluation(None)]) == (0, [1.5, 1.5])
    # Equal candidates leave the method as published.
    assert best([evaluation(-1.0)] * 4)[0] == 0


def test_density_is_that_of_the_learning_tests():
    found = evaluate(candidates("promp", SMALL)[0])
    metrics = method_metrics(
        POLICIES["promp"].method,
        seed=1000,
        demonstrations_per_door=2,
        teacher=standard_teacher(),
        held_out="demonstration",
    )
    assert found["nlpd"] == pytest.approx(metrics["nlpd"], abs=1e-12)
    (episode,) = found["episodes"]
    assert (episode["seed"], episode["radius"]) == (1000, 0.46)
    assert episode["force_radial_peak"] > 0.0
    json.dumps(found, allow_nan=False)


def test_settings_with_which_nothing_can_be_learned_are_an_error_of_theirs():
    wrong = Candidate(policy="gmr", number=1, settings={}, protocol=SMALL)
    found = evaluate(wrong)
    assert found["error"].startswith("ValueError: the settings are components")
    assert "Traceback" in found["traceback"]


class Engine:
    """A person interrupts it after some items; or its workers die."""

    def __init__(self, after=None):
        self.after = after

    def run(self, work, items):
        for number, item in enumerate(items):
            if number == self.after:
                raise KeyboardInterrupt
            yield item, Lost(reason="it died") if self.after is None else work(item)


@pytest.fixture
def evaluated(monkeypatch):
    """Replace evaluations by some that cost nothing; remember the candidates."""
    counted = []
    monkeypatch.setattr(
        tuning, "evaluate", lambda one: counted.append(one) or pretended(one)
    )
    return counted


def test_interrupted_and_resumed_gives_the_same_file(tmp_path, evaluated, monkeypatch):
    policies = ("gmr", "kmp")
    whole, parts = tmp_path / "whole", tmp_path / "parts"
    table = tuning.tune(policies, whole, Serial(), SMALL)
    assert len(evaluated) == 10
    with pytest.raises(KeyboardInterrupt):
        tuning.tune(policies, parts, Engine(after=3), SMALL)
    assert not (parts / "tuned.json").exists()
    for _ in range(2):
        assert tuning.tune(policies, parts, Serial(), SMALL) == table
        assert len(evaluated) == 20
    assert (whole / "tuned.json").read_bytes() == (parts / "tuned.json").read_bytes()
    # A file that is deleted meanwhile is missed.
    monkeypatch.setattr(tuning, "write_json", lambda *_: None)
    with pytest.raises(ValueError, match=r"gone or changed; run the command again"):
        tuning.tune(("gmr",), tmp_path / "gone", Serial(), SMALL)


@pytest.mark.parametrize(
    "damage",
    [
        lambda whole: json.dumps(whole)[:100],
        lambda whole: json.dumps(whole | {"git": {"commit": "0", "dirty": False}}),
        lambda whole: json.dumps(whole | ERROR),
        lambda whole: "{}",
    ],
    ids=["cut", "other code", "error", "empty"],
)
def test_what_is_no_result_is_run_again(tmp_path, evaluated, damage):
    tuning.tune(("gmr",), tmp_path, Serial(), SMALL)
    file = sorted((tmp_path / "evaluations").iterdir())[0]
    whole = json.loads(file.read_text())
    file.write_text(damage(whole))
    tuning.tune(("gmr",), tmp_path, Serial(), SMALL)
    assert json.loads(file.read_text()) == whole


def test_workers_that_die_are_errors(tmp_path, caplog):
    with caplog.at_level("WARNING", logger="gplfd"):
        table = tuning.tune(("gmr",), tmp_path, Engine(), SMALL)
    assert "gmr, candidate 4: it died" in caplog.text
    written = json.loads((tmp_path / "tuned.json").read_text())
    assert written["policies"]["gmr"]["errors"] == SMALL.evaluations
    assert "gmr published" in table


def test_the_file_is_what_the_registry_reads_and_json_prints(
    tmp_path, evaluated, monkeypatch, capsys
):
    tuning.tune(("gmr", "dmp"), tmp_path, Serial(), SMALL)
    found = tuned_settings(tmp_path / "tuned.json")
    expected = {name: candidates(name, SMALL)[3].settings for name in ("gmr", "dmp")}
    assert found == expected
    written = json.loads((tmp_path / "tuned.json").read_text())
    assert written["protocol"]["seeds"] == [1000]
    assert {"command", "versions", "git"} <= written.keys()
    assert written["policies"]["gmr"]["published"]["nlpd"] == 0.0
    assert written["policies"]["gmr"]["tuned"]["force_radial_peak_median"] == 1.0
    monkeypatch.setattr(engines, "engine_named", lambda *_, **__: Serial())
    command = ["tune", "--policies", "gmr", "--out", str(tmp_path), "--json"]
    assert main(command) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((tmp_path / "tuned.json").read_text())["policies"]


@pytest.mark.parametrize(
    ("policies", "message"),
    [
        (["gmrr"], "'gmrr' has no settings to tune (did you mean 'gmr'?)"),
        (["oracle"], "policies: dmp, promp"),
        (["gmr", "gmr"], "gmr is given twice in --policies"),
    ],
)
def test_wrong_policies_are_told(policies, message, capsys, tmp_path):
    assert main(["tune", "--policies", *policies, "--out", str(tmp_path)]) == 2
    assert message in " ".join(capsys.readouterr().err.split())
    assert not list(tmp_path.iterdir())
    assert checked_policies(()) == tuple(SPACES)
