"""Show an episode while it happens, in a viewer on this machine.

What a viewer has been sent in the end is what a recording of the episode holds.
"""

import contextlib
import dataclasses
import math
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final
from urllib.parse import quote

import gymnasium as gym
import mujoco
import rerun as rr
import rerun.blueprint as rrb

from gplfd_env.doors.disturbance import disturbance_named
from gplfd_experiments.console.arguments import check_least
from gplfd_experiments.console.progress import LOG
from gplfd_experiments.episodes.build import (
    demonstrations_of,
    learned_agents,
    make_environment,
    reported_errors,
)
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.rollout import Progress, rollout
from gplfd_experiments.episodes.task import episode_task, named_doors
from gplfd_experiments.recording.disturbances import KINDS
from gplfd_experiments.recording.episode import (
    mean_radius,
    page,
    part_chunks,
    recording_name,
    static_chunks,
)
from gplfd_experiments.recording.lanes import stage_lane, stages
from gplfd_experiments.recording.layout import layout
from gplfd_experiments.recording.mechanism import mechanism_of
from gplfd_experiments.recording.stream import Part, open_stream
from gplfd_experiments.recording.viewer import has_display, viewer
from gplfd_policies.agents.agent import Agent
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.registry.catalogue import policy_named

LOOPBACK: Final = "127.0.0.1"
"""Where the viewer listens: nobody on another machine can reach it."""

FORECAST_PERIOD: Final = 0.2
"""Simulated time between the forecasts of a live view [s]."""

_PERIOD: Final = 0.05
"""Time between two updates [s]; more often would cost more than it shows."""
_START_TIMEOUT: Final = 30.0
_FLUSH_TIMEOUT: Final = 10.0


class LiveRecording:
    """Sends an episode part by part to a connected stream."""

    def __init__(
        self,
        stream: rr.RecordingStream,
        model: mujoco.MjModel,
        demonstrations: Sequence[Demonstration],
    ) -> None:
        self._stream, self._model = stream, model
        self._demonstrations = demonstrations
        self._radius = mean_radius(demonstrations)
        self._rows = self._forecasts = 0
        self._stages: set[str] = set()

    def show(self, log: EpisodeLog, *, ended: bool = False) -> None:
        """Send what is new in the episode so far, of two rows or more."""
        stream = self._stream
        if self._rows == 0:
            stream.send_recording_name(recording_name(log))
            stream.send_chunks(static_chunks(log, self._model, self._demonstrations))
        if log.times.size > self._rows:
            part = Part(
                log=log,
                first_row=self._rows,
                first_forecast=self._forecasts,
                demonstrated_radius=self._radius,
            )
            stream.send_chunks(part_chunks(part, self._model))
        stream.send_chunks(stage_lane(log, self._stages, ended=ended))
        if ended or self._rows == 0:
            stream.send_chunks(page(log, len(self._demonstrations), ended=ended))
        self._rows, self._forecasts = log.times.size, log.forecast_times.size
        self._stages |= {name for _, name in stages(log)}


def watched_rollout(
    env: gym.Env[Any, Any],
    agent: Agent,
    live: LiveRecording,
    *,
    speed: float = 1.0,
    wanted: Callable[[], bool] = lambda: True,
    **names: Any,
) -> EpisodeLog:
    """Run an episode in real time, show it meanwhile and return its log.

    ``speed`` is in simulated seconds per second; when the computer cannot keep up, the
    episode takes longer. ``wanted`` is asked at every update whether anyone still
    watches; InterruptedError if nobody does. ``names`` are for `rollout`.
    """
    started, updated = time.perf_counter(), -math.inf

    def on_step(progress: Progress) -> None:
        nonlocal updated
        if progress.steps < 2:
            return
        elapsed = time.perf_counter() - started
        if elapsed - updated >= _PERIOD:
            if not wanted():
                raise InterruptedError("nobody watches the episode any more")
            # While it lasts, an episode has not failed.
            live.show(dataclasses.replace(progress.log(), success=True, failure=""))
            updated = elapsed
        time.sleep(max(0.0, progress.time / speed - (time.perf_counter() - started)))

    log = rollout(env, agent, forecast_period=FORECAST_PERIOD, on_step=on_step, **names)
    live.show(log, ended=True)
    return log


def watch(
    door: str, *, policy: str, speed: float, serve: bool, **circumstances: Any
) -> None:
    """Run an episode, show it, and wait until the viewer is closed.

    Takes the options of ``gplfd view --live``; `circumstances` are seed, randomization,
    disturbance and start. ValueError: they are wrong, or there is no screen. OSError:
    the viewer is not installed or did not start.
    """
    check_least("--seed", circumstances["seed"], 0)
    if not 0.0 < speed < math.inf:
        raise ValueError(
            f"--speed {speed:g} must be positive and finite: simulated seconds per "
            "second"
        )
    if not serve and not has_display(sys.platform, os.environ):
        raise ValueError(
            "there is no display to open the viewer on. `gplfd view --live --serve` "
            "serves the episode to a browser on this machine (over ssh, forward the "
            "two ports of the address that it prints)."
        )
    chosen = policy_named(policy)
    [(name, config)] = named_doors([door], start=circumstances["start"]).items()
    task = episode_task(name, config, policy=policy, **circumstances)
    with reported_errors(policy, chosen):
        agent = learned_agents(task, chosen)()
    demonstrations = demonstrations_of(task).demonstrations
    env = make_environment(task, agent.control)

    # What is drawn decides what there is to show; the episode draws the same again.
    env.reset(seed=task.reset_seed)
    inner: Any = env.unwrapped
    model, drawn = inner.model, inner.door
    there = mechanism_of(model, drawn.as_dict())
    happens = disturbance_named(circumstances["disturbance"])
    kinds = tuple(one for one in KINDS if getattr(happens, one) is not None)
    arrangement = layout(kinds, there, drawn.hinge_side, live=True)

    with contextlib.closing(env), _viewer_process(serve=serve) as (process, url):
        try:
            with (
                _stream_to(url, arrangement) as stream,
                reported_errors(policy, chosen),
            ):
                log = watched_rollout(
                    env,
                    agent,
                    LiveRecording(stream, model, demonstrations),
                    speed=speed,
                    wanted=lambda: process.poll() is None,
                    policy=policy,
                    door=name,
                    seed=task.reset_seed,
                )
        except InterruptedError:
            LOG.info("the viewer was closed before the episode ended")
            return
        outcome = "opened" if log.success else f"not opened ({log.failure})"
        LOG.info("%s: %s in %.1f s", name, outcome, log.times[-1])
        if serve:
            LOG.info("the episode has ended; Ctrl-C stops serving it")
        process.wait()


@contextlib.contextmanager
def _stream_to(url: str, arrangement: rrb.Blueprint) -> Iterator[rr.RecordingStream]:
    """Connect a stream to a viewer; what was sent has arrived when the block ends."""
    stream = open_stream()
    try:
        stream.connect_grpc(url, default_blueprint=arrangement)
        yield stream
        stream.flush(timeout_sec=_FLUSH_TIMEOUT)
    finally:
        stream.disconnect()


@contextlib.contextmanager
def _viewer_process(*, serve: bool) -> Iterator[tuple[subprocess.Popen[bytes], str]]:
    """Start a viewer on loopback; yield its process and where it takes data."""
    with socket.socket() as first, socket.socket() as second:
        # Two ports that nobody listens at.
        for each in (first, second):
            each.bind((LOOPBACK, 0))
        port, web_port = first.getsockname()[1], second.getsockname()[1]
    url = f"rerun+http://{LOOPBACK}:{port}/proxy"
    command = [viewer(), "--bind", LOOPBACK, "--port", str(port)]
    if serve:
        command += ["--serve-web", "--web-viewer-port", str(web_port)]
    # Only what goes wrong, unless the user asks for more.
    process = subprocess.Popen(command, env={"RUST_LOG": "warn", **os.environ})
    try:
        # Until something listens at the port.
        deadline, listening = time.monotonic() + _START_TIMEOUT, False
        while not listening:
            if process.poll() is not None:
                raise OSError(
                    f"the viewer ended with status {process.returncode}; without a "
                    "screen or graphics driver, `gplfd view --live --serve` serves a "
                    "browser"
                )
            if time.monotonic() >= deadline:
                raise OSError(f"the viewer did not answer within {_START_TIMEOUT:g} s")
            with contextlib.suppress(OSError):
                socket.create_connection((LOOPBACK, port), timeout=1.0).close()
                listening = True
            time.sleep(0.05)
        if serve:
            address = f"http://{LOOPBACK}:{web_port}/?url={quote(url, safe='')}"
            LOG.info("watch it at  %s", address)
            if sys.stdin.isatty():
                input("press Enter to start the episode ")
        yield process, url
    finally:
        process.terminate()
        process.wait()
