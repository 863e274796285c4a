"""Watching an episode live, without a viewer: streams end in files."""

import contextlib
import itertools
import stat
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import Chunk, RrdReader

from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.recording import record_episode, viewer
from gplfd_experiments.recording.layout import layout
from gplfd_experiments.recording.live import LiveRecording
from gplfd_experiments.recording.stream import open_stream
from gplfd_experiments.workflows import live
from gplfd_experiments.workflows.live import watched_rollout

pytestmark = pytest.mark.slow

NAMES = {"policy": "gp", "door": "medium", "seed": 3}
DEMONSTRATIONS = Teacher().demonstrate_doors([0.5], 1, rng=np.random.default_rng(0))


@pytest.fixture
def watch(tmp_path, columns):
    """Run an episode and return its log and what was streamed, in order."""

    def watch(env: Any, agent: Any, **options: Any) -> tuple[EpisodeLog, list[Chunk]]:
        stream = open_stream()
        stream.save(tmp_path / "live.rrd", default_blueprint=layout((), live=True))
        recording = LiveRecording(stream, env.unwrapped.model, DEMONSTRATIONS)
        try:
            log = watched_rollout(env, agent, recording, **options, **NAMES)
        finally:
            stream.flush()
            stream.disconnect()
        return log, list(RrdReader(tmp_path / "live.rrd").stream())

    return watch


def times_of(chunk: Chunk) -> list[int]:
    column = chunk.to_record_batch().column("sim_time")
    return column.cast(pa.int64()).to_pylist()


@pytest.mark.parametrize("outcome", ["success", "grasp_lost"])
def test_live_and_recorded_show_the_same(
    watch, door_env, arc_agent, tmp_path, monkeypatch, outcome
):
    monkeypatch.setattr(live, "_PERIOD", 0.0)  # an update per step
    env = door_env(outcome)
    log, chunks = watch(env, arc_agent(), speed=np.inf)
    record_episode(tmp_path / "recorded.rrd", log, env.model, DEMONSTRATIONS)
    recorded = list(RrdReader(tmp_path / "recorded.rrd").stream())
    shown, expected = (
        {(chunk.entity_path, chunk.is_static) for chunk in one}
        for one in (chunks, recorded)
    )
    assert shown == expected
    pages = [
        chunk.to_record_batch().column("TextDocument:text").to_pylist()[0][0]
        for chunk in chunks
        if chunk.entity_path == "/about"
    ]
    assert "being opened" in pages[0]
    assert ("**opened**" in pages[1]) is (outcome == "success")
    # Times arrive in order, and every step is shown once.
    series: dict[str, list[int]] = {}
    for chunk in chunks:
        if not chunk.is_static:
            series.setdefault(chunk.entity_path, []).extend(times_of(chunk))
    for path, times in series.items():
        assert times == sorted(times), path
    rows = rr.TimeColumn("sim_time", duration=log.times).as_arrow_array()
    assert series["/plots/force/parts"] == rows.cast(pa.int64()).to_pylist()
    assert len(series["/world/task/policy_now"]) == log.forecast_times.size == 3
    arrived = [
        max(times_of(chunk))
        for chunk in chunks
        if not chunk.is_static and not chunk.entity_path.startswith("/stage")
    ]
    # No part holds anything that is older than the part before it.
    period = round(1e9 * log.dt)
    assert all(b >= a - period for a, b in itertools.pairwise(arrived))


def test_an_episode_is_watched_in_its_own_time(watch, door_env, arc_agent):
    started = time.perf_counter()
    log, _ = watch(door_env(n_steps=60), arc_agent(n_steps=60), speed=2.0)
    assert time.perf_counter() - started >= log.times[-1] / 2.0


def test_an_episode_that_nobody_watches_is_given_up(watch, door_env, arc_agent):
    env = door_env()
    with pytest.raises(InterruptedError, match="the viewer was closed"):
        watch(env, arc_agent(), speed=np.inf, wanted=lambda: False)
    assert len(env.actions) < env.n_steps


LISTENING = """\
import socket, sys
arguments = sys.argv[1:]
open("arguments", "w").write(" ".join(arguments))
listener = socket.create_server(("127.0.0.1", int(arguments[3])))
while True:
    listener.accept()
"""


def stand_in(monkeypatch: pytest.MonkeyPatch, script: str) -> None:
    """Let a Python script play the viewer."""
    path = Path("viewer").resolve()
    path.write_text(f"#!{sys.executable}\n{script}")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setattr(viewer, "viewer", lambda: str(path))


ORACLE = ("--live", "--serve", "--policy", "oracle")


def test_viewer_listens_on_loopback_only_and_ends_with_the_command(
    gplfd, monkeypatch, capsys
):
    seen: dict[str, Any] = {}

    @contextlib.contextmanager
    def connected(url: str, arrangement: rrb.Blueprint) -> Iterator[str]:
        seen.update(url=url, arrangement=arrangement)
        yield url

    def show(*_: Any, wanted: Callable[[], bool], **options: Any) -> None:
        seen.update(door=options["door"], wanted=wanted)
        assert wanted()
        raise InterruptedError

    monkeypatch.setattr(live, "stream_to", connected)
    monkeypatch.setattr(live, "watched_rollout", show)
    stand_in(monkeypatch, LISTENING)
    assert gplfd("view", *ORACLE, "--door", "0.42", "--disturbance", "person") == 0
    assert seen["arrangement"] is layout(("person",), (), "right", live=True)
    assert seen["arrangement"].time_panel.play_state == "following"
    assert layout(()).time_panel.play_state == "playing"
    arguments = Path("arguments").read_text().split()
    assert arguments[:3] == ["--bind", "127.0.0.1", "--port"]
    assert arguments[4:6] == ["--serve-web", "--web-viewer-port"]
    assert seen["door"] == "0.42"
    assert seen["url"] == f"rerun+http://127.0.0.1:{arguments[3]}/proxy"
    assert not seen["wanted"]()
    printed = capsys.readouterr().err
    address = f"http://127.0.0.1:{arguments[6]}/?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A"
    assert f"watch it at  {address}{arguments[3]}%2Fproxy" in printed
    assert "closed before the episode ended" in printed


@pytest.mark.parametrize(
    ("script", "patience", "message"),
    [
        ("raise SystemExit(102)", 30.0, "the viewer ended with status 102"),
        ("import time; time.sleep(60)", 0.2, "did not answer within 0.2 s"),
    ],
)
def test_a_viewer_that_does_not_start_or_answer_is_told(
    gplfd, monkeypatch, capsys, script, patience, message
):
    monkeypatch.setattr(viewer, "_START_TIMEOUT", patience)
    stand_in(monkeypatch, script)
    assert gplfd("view", *ORACLE) == 2
    assert message in capsys.readouterr().err
