"""Which episodes are recorded, and that their repetition is compared with the study."""

import builtins
import dataclasses
import json
import shutil
from pathlib import Path

import pytest

from gplfd_env.doors.config import DoorConfig
from gplfd_experiments.analysis.report.recordings import recording_name
from gplfd_experiments.analysis.results.reading import read_results
from gplfd_experiments.episodes.task import EpisodeTask
from gplfd_experiments.studies.runner import run_study
from gplfd_experiments.workflows import study_recordings as module
from gplfd_experiments.workflows.study_recordings import (
    COMPARED,
    differences,
    extremes,
    record_extremes,
    repeat,
    same_door,
)

pytestmark = pytest.mark.slow

CONFIG = dataclasses.asdict(DoorConfig())


@pytest.fixture
def episodes(write_study, episode_result):
    """Read episodes from result files of (policy, seed, success, force, angle)."""

    def read(*rows):
        results = []
        for policy, seed, success, force, angle in rows:
            result = episode_result(policy, seed, opened=success)
            result["metrics"] |= {"force_radial_peak": force, "final_angle_deg": angle}
            results.append(result)
        return read_results(write_study(results)).episodes

    return read


def won(*forces):
    return [("gp", seed, True, force, 64.0) for seed, force in enumerate(forces)]


@pytest.mark.parametrize(
    ("rows", "seeds"),
    [
        ([], {}),
        (won(1.0), {"best": 0}),
        (won(1.0, 2.0), {"best": 0, "worst": 1}),
        (won(1.0, 2.0, 3.0), {"best": 0, "median": 1, "worst": 2}),
        (
            [
                ("gp", 0, False, 0.1, 50.0),
                ("gp", 1, True, 3.0, 64.0),
                ("gp", 2, True, 1.0, 64.0),
                ("gp", 3, False, 0.1, 20.0),
                ("gp", 4, True, 1.0, 65.0),
            ],
            {"best": 4, "median": 1, "worst": 3},
        ),
    ],
)
def test_extremes_are_different_by_success_then_force_then_angle(episodes, rows, seeds):
    found = extremes(episodes(*rows) if rows else [])
    assert {rank: one.task.seed for rank, one in found.items()} == seeds


def test_the_comparison_goes_from_the_best_to_the_worst(episodes):
    others = [(f"p{k}", 0, True, 2.0 + k, 64.0) for k in range(8)]
    read = episodes(("gp", 0, False, 9.0, 3.0), *others, ("gp", 1, True, 1.0, 64.0))
    chosen = same_door(read, 0.5, "gp")
    assert list(chosen) == ["gp", "p0", "p2", "p4", "p5", "p7"]
    assert len(chosen) == COMPARED
    assert {one.task.seed for one in chosen.values()} == {0}
    assert same_door(read, 0.65, "gp") == {}


def test_doors_of_another_kind_are_not_compared(write_study, episode_result):
    lever = DoorConfig(radius=0.5, handle="lever", latch="spring")
    door = {"door_config": lever.as_dict(), "demonstrated_kind": lever.kind}
    radii = {"demonstrated_radii": [0.5]}
    results = [episode_result("gp"), episode_result("kmp", door="x", **door, **radii)]
    read = read_results(write_study(results)).episodes
    assert [one.split for one in read] == ["demonstrated radii"] * 2
    assert [*same_door(read, 0.5, "gp")] == ["gp"]


def test_only_times_may_differ_in_a_repetition():
    stored = {"work": 1.0, "latency_median_ms": 1.0, "stiffness_min": [1.0], "old": 3}
    again = {"work": 1.5, "latency_median_ms": 2.0, "stiffness_min": [1.0], "new": 4}
    assert differences(stored, again) == {"work": [1.0, 1.5]}


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """One short episode, run as a study does, and its repetition."""
    folder = tmp_path_factory.mktemp("study")
    task = EpisodeTask(
        policy="oracle",
        seed=0,
        door="medium",
        door_config=CONFIG,
        demonstrations_per_door=1,
    )
    list(run_study(folder, [task]))
    (episode,) = read_results(folder).episodes
    return folder, repeat(episode)


@pytest.fixture
def study(ran, tmp_path):
    return Path(shutil.copytree(ran[0], tmp_path / "study"))


@pytest.fixture
def known(ran, monkeypatch):
    """Do not run the episode again; policies named odd-X raise X."""

    def repeated(episode):
        name, _, error = episode.policy.partition("-")
        if name == "odd":
            raise getattr(builtins, error)("mine")
        log = dataclasses.replace(ran[1].log, policy=episode.policy)
        return dataclasses.replace(ran[1], log=log)

    monkeypatch.setattr(module, "repeat", repeated)


@pytest.fixture
def quick(known, monkeypatch):
    """Record nothing."""
    monkeypatch.setattr(module, "record_episode", lambda path, *_: written(path))
    monkeypatch.setattr(module, "record_comparison", lambda path, *_, **__: None)


def written(path):
    path.parent.mkdir(exist_ok=True)
    path.touch()


def test_a_study_s_episode_is_repeated_exactly(study, caplog, monkeypatch):
    with caplog.at_level("INFO", logger="gplfd"):
        index = json.loads(record_extremes(study).read_text())
    shown = [record.message for record in caplog.records]
    assert shown == ["recording oracle-best.rrd", "recording comparison.rrd"]
    (entry,) = index["episodes"]
    assert entry["repeated"] is True
    assert entry["different"] == {}
    place = (entry["policy"], entry["door"], entry["rank"])
    assert place == ("oracle", "medium", "best")
    (compared,) = index["comparisons"]
    assert compared["file"] == "comparison.rrd"
    files = {path.name for path in (study / "recordings").iterdir()}
    assert files == {"oracle-best.rrd", "comparison.rrd", "index.json"}
    first = (study / "recordings" / "index.json").read_bytes()
    monkeypatch.setattr(module, "record_episode", lambda *_: None)
    monkeypatch.setattr(module, "record_comparison", lambda *_, **__: None)
    record_extremes(study)
    assert (study / "recordings" / "index.json").read_bytes() == first


def test_a_number_that_is_not_repeated_is_said(study, monkeypatch):
    (file,) = (study / "tasks").glob("*.json")
    result = json.loads(file.read_text())
    true = result["metrics"]["work"]
    result["metrics"]["work"] = 123.0
    file.write_text(json.dumps(result))
    monkeypatch.setattr(module, "same_door", lambda *_: {})
    monkeypatch.setattr(module, "record_episode", lambda *_: None)
    (entry,) = json.loads(record_extremes(study).read_text())["episodes"]
    assert entry["repeated"] is False
    assert entry["different"] == {"work": [123.0, true]}


def renamed(study, policy):
    """Another policy's episode, of which nothing but the name is new."""
    file = min((study / "tasks").glob("*.json"))
    result = json.loads(file.read_text())
    result["task"]["policy"] = policy
    (study / "tasks" / f"z-{len(policy)}.json").write_text(json.dumps(result))


def test_what_a_policy_raises_is_noted_and_takes_no_other_along(study, quick):
    names = ("odd-LookupError", "odd-OSError", "odd-RecursionError")
    for name in names:
        renamed(study, name)
    index = json.loads(record_extremes(study).read_text())
    entries = {entry["policy"]: entry for entry in index["episodes"]}
    assert set(entries) == {"oracle", *names}
    for name in names:
        assert entries[name]["error"] == f"{name.removeprefix('odd-')}: mine"
        assert entries[name]["repeated"] is False
        assert not (study / "recordings" / entries[name]["file"]).exists()
    assert entries["oracle"]["repeated"] is True
    assert (study / "recordings" / "oracle-best.rrd").is_file()
    compared = [each["policy"] for each in index["comparisons"][0]["episodes"]]
    assert sorted(compared) == sorted(entries)


def test_a_disk_that_is_full_is_no_policy_s_error(study, quick, monkeypatch):
    def full(*_):
        raise OSError("no space left on device")

    monkeypatch.setattr(module, "record_episode", full)
    with pytest.raises(OSError, match="no space left"):
        record_extremes(study)


def test_any_name_of_a_policy_can_be_recorded(study, known):
    mine = "my_module:make/a.b"
    renamed(study, mine)
    index = json.loads(record_extremes(study, reference=mine).read_text())
    files = [entry["file"] for entry in index["episodes"]]
    assert files == [recording_name(mine, "best"), "oracle-best.rrd"]
    assert all((study / "recordings" / file).is_file() for file in files)
    (compared,) = index["comparisons"]
    assert [entry["policy"] for entry in compared["episodes"]] == [mine, "oracle"]
