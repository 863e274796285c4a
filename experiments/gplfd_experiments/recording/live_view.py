"""Run an episode and watch it in a viewer on this machine."""

import contextlib
import math
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from typing import Any, Final
from urllib.parse import quote

import rerun as rr
import rerun.blueprint as rrb

from gplfd_env.conventions.constants import Start
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
from gplfd_experiments.episodes.task import episode_task, named_doors
from gplfd_experiments.recording.layout import layout
from gplfd_experiments.recording.live import LiveRecording, watched_rollout
from gplfd_experiments.recording.mechanism import mechanism_of
from gplfd_experiments.recording.outside import CAUSES
from gplfd_experiments.recording.stream import open_stream
from gplfd_experiments.recording.viewer import has_display, viewer
from gplfd_policies.registry.catalogue import policy_named

LOOPBACK: Final = "127.0.0.1"
"""Where the viewer listens: nobody on another machine can reach it."""

_START_TIMEOUT: Final = 30.0
_FLUSH_TIMEOUT: Final = 10.0


def watch(
    door: str,
    *,
    policy: str,
    seed: int,
    randomization: str,
    disturbance: str,
    start: Start,
    speed: float,
    serve: bool,
) -> None:
    """Run an episode, show it, and wait until the viewer is closed.

    Args:
        door: Name of a door, or a radius [m] as text.
        policy: Name of the policy.
        seed: Seed of teacher, policy and environment.
        randomization: Name of what the environment draws anew.
        disturbance: Name of what happens from outside.
        start: What the episode begins with.
        speed: Simulated seconds per second.
        serve: Serve a browser on this machine instead of opening a window.

    Raises:
        ValueError: An argument is wrong, or there is no screen.
        OSError: The viewer is not installed or did not start.
    """
    check_least("--seed", seed, 0)
    _check_speed(speed)
    _check_screen(serve=serve)
    chosen = policy_named(policy)
    [(name, config)] = named_doors([door], start=start).items()
    task = episode_task(
        name,
        config,
        policy=policy,
        seed=seed,
        randomization=randomization,
        disturbance=disturbance,
        start=start,
    )
    with reported_errors(policy, chosen):
        agent = learned_agents(task, chosen)()
    demonstrations = demonstrations_of(task).demonstrations
    env = make_environment(task, agent.control)

    # What is drawn decides what there is to show; the episode draws the same again.
    env.reset(seed=task.reset_seed)
    inner: Any = env.unwrapped
    model, drawn = inner.model, inner.door
    there = mechanism_of(model, drawn.as_dict())
    arrangement = layout(_causes(disturbance), there, drawn.hinge_side, live=True)

    def show(stream: rr.RecordingStream, viewer: subprocess.Popen[bytes]) -> EpisodeLog:
        return watched_rollout(
            env,
            agent,
            LiveRecording(stream, model, demonstrations),
            speed=speed,
            wanted=lambda: viewer.poll() is None,
            policy=policy,
            door=name,
            seed=task.reset_seed,
        )

    with contextlib.closing(env), _viewer_process(serve=serve) as (process, url):
        try:
            with (
                _stream_to(url, arrangement) as stream,
                reported_errors(policy, chosen),
            ):
                log = show(stream, process)
        except InterruptedError:
            LOG.info("the viewer was closed before the episode ended")
            return
        outcome = "opened" if log.success else f"not opened ({log.failure})"
        LOG.info("%s: %s in %.1f s", name, outcome, log.times[-1])
        if serve:
            LOG.info("the episode has ended; Ctrl-C stops serving it")
        process.wait()


def _causes(disturbance: str) -> tuple[str, ...]:
    """Return the names of what will happen from outside and be seen."""
    named = disturbance_named(disturbance)
    return tuple(name for name in CAUSES if getattr(named, name) is not None)


def _check_speed(speed: float) -> None:
    if not 0.0 < speed < math.inf:
        raise ValueError(
            f"--speed {speed:g} must be positive and finite: simulated seconds per "
            "second"
        )


def _check_screen(*, serve: bool) -> None:
    if not serve and not has_display(sys.platform, os.environ):
        raise ValueError(
            "there is no display to open the viewer on. `gplfd view --live --serve` "
            "serves the episode to a browser on this machine (over ssh, forward the "
            "two ports of the address that it prints)."
        )


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
    """Start a viewer on loopback; yield its process and where it takes data.

    Raises:
        OSError: It is not installed, or it ended or said nothing.
    """
    port, web_port = _free_ports()
    url = f"rerun+http://{LOOPBACK}:{port}/proxy"
    command = [viewer(), "--bind", LOOPBACK, "--port", str(port)]
    if serve:
        command += ["--serve-web", "--web-viewer-port", str(web_port)]
    # Only what goes wrong, unless the user asks for more.
    process = subprocess.Popen(command, env={"RUST_LOG": "warn", **os.environ})
    try:
        _wait_for(process, port)
        if serve:
            address = f"http://{LOOPBACK}:{web_port}/?url={quote(url, safe='')}"
            LOG.info("watch it at  %s", address)
            if sys.stdin.isatty():
                input("press Enter to start the episode ")
        yield process, url
    finally:
        process.terminate()
        process.wait()


def _free_ports() -> tuple[int, int]:
    """Two ports that nobody listens at."""
    with contextlib.ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket()) for _ in range(2)]
        for each in sockets:
            each.bind((LOOPBACK, 0))
        first, second = (each.getsockname()[1] for each in sockets)
    return first, second


def _wait_for(process: subprocess.Popen[bytes], port: int) -> None:
    """Wait until something listens at the port.

    Raises:
        OSError: The process ended before, or it takes too long.
    """
    deadline = time.monotonic() + _START_TIMEOUT
    while time.monotonic() < deadline:
        if process.poll() is not None:
            raise OSError(
                f"the viewer ended with status {process.returncode}; without a screen "
                "or graphics driver, `gplfd view --live --serve` serves a browser"
            )
        with (
            contextlib.suppress(OSError),
            socket.create_connection((LOOPBACK, port), timeout=1.0),
        ):
            return
        time.sleep(0.05)
    raise OSError(f"the viewer did not answer within {_START_TIMEOUT:g} s")
