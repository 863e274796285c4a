"""Every command opens a door of every kind, from both starts, alone and together."""

import contextlib
import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import rerun as rr

from gplfd_env.doors.config import DOORS
from gplfd_experiments.analysis.results.reading import read_results
from gplfd_experiments.episodes.build import make_environment
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.task import episode_task
from gplfd_experiments.recording import live
from gplfd_experiments.recording.stream import open_stream
from gplfd_experiments.studies.settings import StudySettings
from gplfd_experiments.studies.settings_file import read_settings, write_settings
from gplfd_experiments.workflows import runs
from gplfd_policies.demonstrations.npz import load_demonstrations

pytestmark = pytest.mark.slow

Gplfd = Callable[..., int]

PUSHED = {"radius": 0.7, "handle": "knob", "latch": "spring", "swing": "push"}
KINDS = {
    (*door.kind.values(), door.radius > 0.65): name for name, door in DOORS.items()
}
"""The last preset of every kind of door and robot."""


@pytest.fixture(params=[*KINDS.values(), "pushed.json"])
def door(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """Return a door of every kind as a person gives it, the last as a file."""
    (tmp_path / "pushed.json").write_text(json.dumps(PUSHED))
    return str(request.param)


def test_the_presets_are_of_several_kinds() -> None:
    assert len(KINDS) >= 2
    assert {DOORS[name].handle for name in KINDS.values()} >= {"bar", "lever"}


@pytest.mark.parametrize("start", ["grasped", "approach"])
def test_run_opens_it(gplfd: Gplfd, tmp_path: Path, door: str, start: str) -> None:
    out = tmp_path / "run"
    given = ("--doors", door, "--start", start, "--policy", "oracle")
    assert gplfd("run", *given, "--out", str(out)) == 0
    (metrics,) = json.loads((out / "metrics.json").read_text())
    assert metrics["success"], metrics
    assert (out / f"{metrics['door']}.rrd").stat().st_size > 0


@pytest.mark.filterwarnings("ignore:rests")
def test_a_run_of_several_kinds_learns_each_from_its_own(
    gplfd: Gplfd, tmp_path: Path
) -> None:
    doors = ("small", "room-584", "0.42")
    out = tmp_path / "run"
    out.mkdir()
    # Of an earlier run with one kind of doors.
    (out / "run.json").write_text('{"config": {"door_configs": {"small": {}}}}')
    (out / "demonstrations.npz").touch()
    assert gplfd("run", "--policy", "promp", "--doors", *doors, "--out", str(out)) == 0
    assert not (out / "demonstrations.npz").exists()
    metrics = json.loads((out / "metrics.json").read_text())
    assert [(one["door"], one["success"]) for one in metrics] == [
        (door, True) for door in doors
    ]
    bars = load_demonstrations(out / "demonstrations-small.npz")
    levers = load_demonstrations(out / "demonstrations-room-584.npz")
    assert bars.radii == (0.35, 0.35, 0.50, 0.50, 0.65, 0.65)
    assert levers.radii == (0.53, 0.53, 0.65, 0.65, 0.78, 0.78)
    # Who turns a lever turns the hand about the axis normal to the leaf.
    turned = [np.abs(one.poses[:, 3]).max() for one in levers.demonstrations]
    assert min(turned) > math.radians(15.0)
    config = json.loads((out / "run.json").read_text())["config"]
    assert config["demonstrations_of"] == {
        "small": "demonstrations-small.npz",
        "room-584": "demonstrations-room-584.npz",
        "0.42": "demonstrations-small.npz",
    }
    # Alone or beside doors of another kind, an episode is the same.
    given = ("--policy", "promp", "--doors", "room-584")
    assert gplfd("run", *given, "--out", str(tmp_path / "alone")) == 0
    alone = EpisodeLog.load(tmp_path / "alone" / "room-584.npz")
    together = EpisodeLog.load(out / "room-584.npz")
    np.testing.assert_array_equal(alone.ee_pose, together.ee_pose)
    # What the run of several kinds wrote goes when another run takes its folder.
    assert (
        gplfd("run", "--policy", "oracle", "--doors", "small", "--out", str(out)) == 0
    )
    assert sorted(file.name for file in out.iterdir()) == [
        *("demonstrations.npz", "metrics.json", "run.json", "small.npz", "small.rrd")
    ]


def test_one_set_of_demonstrations_is_for_one_kind_of_doors(
    gplfd: Gplfd, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shown = tmp_path / "shown"
    assert gplfd("run", "--policy", "oracle", "--doors", "small", "--out", "shown") == 0
    capsys.readouterr()
    given = ("--demonstrations", str(shown / "demonstrations.npz"))
    assert gplfd("run", *given, "--doors", "small", "room-834", "--out", "two") == 2
    message = capsys.readouterr().err
    assert "differ in handle, latch" in message
    assert "leave out --demonstrations" in message
    assert not (tmp_path / "two").exists()


def test_demos_are_recorded_and_replayed(
    gplfd: Gplfd, door: str, capsys: pytest.CaptureFixture[str]
) -> None:
    for start in ("grasped", "approach"):
        name = f"{start}-v0"
        given = ("--doors", door, "--start", start, "--policy", "oracle")
        cut = ("--max-steps", "40", "--quiet")
        assert gplfd("demos", "record", *given, *cut, "--out", name) == 0
        assert gplfd("demos", "replay", name, "--quiet") == 0
        assert "bit-exact over 40 steps" in capsys.readouterr().out


def test_a_data_set_has_one_robot(
    gplfd: Gplfd, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ("--doors", "small", "room-834", "--policy", "oracle")
    assert gplfd("demos", "record", *given, "--out", "both-v0") == 2
    assert "record two data sets" in capsys.readouterr().err


def test_an_environment_of_a_task_has_everything_that_it_names() -> None:
    task = episode_task(
        "room-834",
        DOORS["room-834"],
        policy="oracle",
        seed=3,
        randomization="mild",
        disturbance="person",
        start="approach",
    )
    env = make_environment(task, "pose", max_episode_steps=7)
    assert env.spec is not None
    assert env.spec.max_episode_steps == 7
    assert env.spec.kwargs == {
        "door": dict(task.door_config),
        "randomization": "mild",
        "disturbance": "person",
        "base": "mobile",
        "start": "approach",
    }


@pytest.mark.usefixtures("small_plots")
@pytest.mark.parametrize("start", ["grasped", "approach"])
def test_a_study_of_doors_of_several_kinds_can_be_read_and_recorded(
    gplfd: Gplfd, tmp_path: Path, capsys: pytest.CaptureFixture[str], start: str
) -> None:
    (tmp_path / "pushed.json").write_text(json.dumps(PUSHED))
    doors = (*KINDS.values(), "pushed.json")
    given = ("--doors", *doors, "--start", start, "--policies", "oracle")
    where = ("--engine", "serial", "--quiet", "--record", "--out", "study")
    assert gplfd("benchmark", *given, "--seeds", "1", "--no-skill", *where) == 0
    study = read_results(tmp_path / "study")
    assert not study.unreadable
    assert [one.task.door for one in study.episodes if not one.solved] == []
    assert {one.task.door for one in study.episodes} == {*KINDS.values(), "pushed"}
    table = capsys.readouterr().out
    for door in KINDS.values():
        assert door in table
    index = json.loads((tmp_path / "study" / "recordings" / "index.json").read_text())
    assert [one["different"] for one in index["episodes"]] == [{}, {}, {}]
    assert gplfd("report", "study") == 0


def test_a_study_keeps_its_start(tmp_path: Path) -> None:
    settings = StudySettings(doors=("small",), start="approach", seeds=1)
    write_settings(tmp_path / "study.toml", settings)
    assert read_settings(tmp_path / "study.toml") == settings
    (tmp_path / "study.toml").write_text('start = "before"\n')
    with pytest.raises(ValueError, match="must be 'grasped' or 'approach'"):
        read_settings(tmp_path / "study.toml")


class _Viewer:
    """A viewer that nobody closes until the episode has ended."""

    def poll(self) -> None:
        return None

    def wait(self) -> int:
        return 0


@pytest.mark.parametrize(
    ("door", "start"),
    [("cabinet", "approach"), ("room-584", "grasped"), ("pushed.json", "approach")],
)
def test_it_is_watched_live(
    gplfd: Gplfd,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    door: str,
    start: str,
) -> None:
    (tmp_path / "pushed.json").write_text(json.dumps(PUSHED))

    @contextlib.contextmanager
    def stream_to(url: str, arrangement: object) -> Iterator[rr.RecordingStream]:
        stream = open_stream()
        stream.save(url, default_blueprint=arrangement)
        yield stream
        stream.flush()
        stream.disconnect()

    @contextlib.contextmanager
    def viewer_process(*, serve: bool) -> Iterator[tuple[_Viewer, str]]:
        yield _Viewer(), str(tmp_path / "live.rrd")

    monkeypatch.setattr(live, "_stream_to", stream_to)
    monkeypatch.setattr(live, "_viewer_process", viewer_process)
    given = ("--door", door, "--start", start, "--policy", "oracle")
    assert gplfd("view", "--live", "--serve", *given, "--speed", "1e6") == 0
    assert ": opened in" in capsys.readouterr().err
    assert (tmp_path / "live.rrd").stat().st_size > 0


def test_a_run_names_files_that_were_deleted_while_it_went_on(
    gplfd: Gplfd,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def record_and_delete(file: Path, *_: object) -> None:
        file.write_bytes(b"")
        (file.parent / "run.json").unlink()

    monkeypatch.setattr(runs, "record_episode", record_and_delete)
    given = ("--policy", "oracle", "--doors", "small", "--out", "run")
    assert gplfd("run", *given) == 2
    assert "were deleted" in (message := capsys.readouterr().err)
    assert "run.json" in message


@pytest.mark.usefixtures("small_plots")
def test_a_report_names_tasks_without_a_result(gplfd: Gplfd, tmp_path: Path) -> None:
    given = ("--policies", "oracle", "--doors", "small", "0.42", "--seeds", "1")
    where = ("--no-skill", "--engine", "serial", "--quiet", "--out", "study")
    assert gplfd("benchmark", *given, *where) == 0
    next((tmp_path / "study" / "tasks").iterdir()).unlink()
    assert gplfd("report", "study") == 0
    page = (tmp_path / "study" / "report.md").read_text()
    assert "1 of 2 tasks have no result" in page
    about = json.loads((tmp_path / "study" / "study.json").read_text())
    (tmp_path / "study" / "study.json").write_text(
        json.dumps(about | {"format_version": 99})
    )
    assert gplfd("report", "study") == 2
