"""Which episodes are recorded, and that their repetition is compared with the study."""

import dataclasses
import json

import pytest

from experiments import extremes as module
from experiments.extremes import COMPARED, extremes, record_extremes, same_door
from experiments.repetition import differences
from experiments.results.reading import read_results
from experiments.study.runner import run_study
from experiments.study.tasks import EpisodeTask
from gplfd_env.config import DoorConfig

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


def test_order_is_success_then_force_then_angle(episodes):
    chosen = extremes(
        episodes(
            ("gp", 0, False, 0.1, 50.0),
            ("gp", 1, True, 3.0, 64.0),
            ("gp", 2, True, 1.0, 64.0),
            ("gp", 3, False, 0.1, 20.0),
            ("gp", 4, True, 1.0, 65.0),
        )
    )
    assert {rank: one.task.seed for rank, one in chosen.items()} == {
        "best": 4,
        "median": 1,
        "worst": 3,
    }


@pytest.mark.parametrize(
    ("count", "ranks"),
    [(0, []), (1, ["best"]), (2, ["best", "worst"]), (3, ["best", "median", "worst"])],
)
def test_no_episode_is_recorded_twice(episodes, count, ranks):
    rows = [("gp", seed, True, 1.0 + seed, 64.0) for seed in range(count)]
    found = extremes(episodes(*rows)) if rows else extremes([])
    assert list(found) == ranks
    assert len({one.task.seed for one in found.values()}) == count


def test_the_comparison_goes_from_the_best_to_the_worst(episodes):
    others = [(f"p{k}", 0, True, 2.0 + k, 64.0) for k in range(8)]
    read = episodes(("gp", 0, False, 9.0, 3.0), *others, ("gp", 1, True, 1.0, 64.0))
    chosen = same_door(read, 0.5, "gp")
    assert list(chosen) == ["gp", "p0", "p2", "p4", "p5", "p7"]
    assert len(chosen) == COMPARED
    assert {one.task.seed for one in chosen.values()} == {0}
    assert same_door(read, 0.65, "gp") == {}


def test_only_times_may_differ_in_a_repetition():
    stored = {"work": 1.0, "latency_median_ms": 1.0, "stiffness_min": [1.0], "old": 3}
    again = {"work": 1.5, "latency_median_ms": 2.0, "stiffness_min": [1.0], "new": 4}
    assert differences(stored, again) == {"work": [1.0, 1.5]}


@pytest.fixture
def study(tmp_path):
    """One short episode, run as a study does."""
    task = EpisodeTask(
        policy="oracle",
        seed=0,
        door="medium",
        door_config=CONFIG,
        demonstrations_per_door=1,
    )
    list(run_study(tmp_path, [task]))
    return tmp_path


def test_a_study_s_episode_is_repeated_exactly(study):
    shown = []
    index = json.loads(record_extremes(study, shown.append).read_text())
    assert shown == ["oracle-best.rrd", "comparison.rrd"]
    (entry,) = index["episodes"]
    assert entry["repeated"] is True
    assert entry["different"] == {}
    assert (entry["policy"], entry["door"], entry["rank"]) == (
        "oracle",
        "medium",
        "best",
    )
    (compared,) = index["comparisons"]
    assert compared["file"] == "comparison.rrd"
    files = {path.name for path in (study / "recordings").iterdir()}
    assert files == {"oracle-best.rrd", "comparison.rrd", "index.json"}
    first = (study / "recordings" / "index.json").read_bytes()
    record_extremes(study)
    assert (study / "recordings" / "index.json").read_bytes() == first


def test_a_number_that_is_not_repeated_is_said(study, monkeypatch):
    (file,) = (study / "tasks").glob("*.json")
    result = json.loads(file.read_text())
    true = result["metrics"]["work"]
    result["metrics"]["work"] = 123.0
    file.write_text(json.dumps(result))
    monkeypatch.setattr(module, "same_door", lambda *_: {})
    (entry,) = json.loads(record_extremes(study).read_text())["episodes"]
    assert entry["repeated"] is False
    assert entry["different"] == {"work": [123.0, true]}


def test_a_policy_that_is_gone_does_not_take_the_others_along(study):
    (file,) = (study / "tasks").glob("*.json")
    result = json.loads(file.read_text())
    result["task"]["policy"] = "gone"
    (study / "tasks" / "gone.json").write_text(json.dumps(result))
    index = json.loads(record_extremes(study).read_text())
    gone, oracle = index["episodes"]
    assert "unknown policy 'gone'" in gone["error"]
    assert oracle["repeated"] is True
    assert not (study / "recordings" / "gone-best.rrd").exists()
    assert [each["policy"] for each in index["comparisons"][0]["episodes"]] == [
        "gone",
        "oracle",
    ]


def test_a_folder_without_results_is_refused(tmp_path):
    with pytest.raises(ValueError, match="not the folder of a study"):
        record_extremes(tmp_path)
