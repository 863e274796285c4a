"""``gplfd view --live``: run an episode and watch it in a viewer on this machine."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import quote

from experiments.commands.view import View
from experiments.recording.viewer import has_display, viewer
from experiments.study.doors import named_doors

if TYPE_CHECKING:
    from gplfd_env.config import DoorConfig
    from policies.agent import Agent
    from policies.demonstrations import Demonstration

LOOPBACK: Final = "127.0.0.1"
"""Where the viewer listens: nobody on another machine can reach it."""

_START_TIMEOUT: Final = 30.0
_FLUSH_TIMEOUT: Final = 10.0


@dataclass(frozen=True, kw_only=True, slots=True)
class _Episode:
    """What is to be watched."""

    door: str
    config: DoorConfig
    agent: Agent
    demonstrations: tuple[Demonstration, ...]


def watch(view: View) -> int:
    """Run an episode, show it, and wait until the viewer is closed.

    Raises:
        ValueError: An argument is wrong, or there is no screen.
        OSError: The viewer is not installed or did not start.
    """
    _check(view)
    episode = _prepare(view)
    with _viewer_process(serve=view.serve) as (process, url):
        try:
            _show(view, episode, process, url)
        except InterruptedError:
            print("the viewer was closed before the episode ended", file=sys.stderr)
            return 0
        if view.serve:
            print("the episode has ended; Ctrl-C stops serving it", file=sys.stderr)
        with contextlib.suppress(KeyboardInterrupt):
            process.wait()
    return 0


def _check(view: View) -> None:
    """Check what can be checked before anything slow.

    Raises:
        ValueError: An argument is wrong, or there is no screen.
    """
    if view.file is not None:
        raise ValueError(f"--live runs an episode; it does not go with {view.file}")
    if view.seed < 0:
        raise ValueError(f"--seed {view.seed} must be 0 or more")
    if not 0.0 < view.speed < math.inf:
        raise ValueError(
            f"--speed {view.speed:g} must be positive and finite: simulated seconds "
            "per second"
        )
    if not view.serve and not has_display(sys.platform, os.environ):
        raise ValueError(
            "there is no display to open the viewer on. `gplfd view --live --serve` "
            "serves the episode to a browser on this machine (over ssh, forward the "
            "two ports of the address that it prints)."
        )


def _prepare(view: View) -> _Episode:
    """Look up the door and learn the policy.

    Raises:
        ValueError: There is no such door or policy.
    """
    import numpy as np

    from experiments.teacher import DEMONSTRATED_RADII, Teacher
    from policies.registry import make_agent, policy_named

    policy_named(view.policy)
    [(door, config)] = named_doors([view.door]).items()
    demonstrations = Teacher().demonstrate_doors(
        DEMONSTRATED_RADII, 2, rng=np.random.default_rng(view.seed)
    )
    agent = make_agent(
        view.policy, demonstrations, seed=view.seed, radius=config.radius
    )
    return _Episode(
        door=door, config=config, agent=agent, demonstrations=tuple(demonstrations)
    )


def _show(
    view: View, episode: _Episode, process: subprocess.Popen[bytes], url: str
) -> None:
    """Run the episode and stream it to the viewer at ``url``.

    Raises:
        InterruptedError: The viewer was closed.
    """
    import gymnasium as gym

    from experiments.recording.layout import layout
    from experiments.recording.live import LiveRecording, watched_rollout
    from experiments.recording.stream import open_stream
    from gplfd_env import ENVIRONMENT_ID

    with contextlib.ExitStack() as stack:
        env = stack.enter_context(
            contextlib.closing(gym.make(ENVIRONMENT_ID, door=episode.config))
        )
        stream = open_stream()
        stack.callback(stream.disconnect)
        stream.connect_grpc(url, default_blueprint=layout(live=True))
        model: Any = env.unwrapped.model  # type: ignore[attr-defined]
        log = watched_rollout(
            env,
            episode.agent,
            LiveRecording(stream, model, episode.demonstrations),
            speed=view.speed,
            wanted=lambda: process.poll() is None,
            policy=view.policy,
            door=episode.door,
            door_config=dataclasses.asdict(episode.config),
            seed=view.seed,
        )
        stream.flush(timeout_sec=_FLUSH_TIMEOUT)
    outcome = "opened" if log.success else f"not opened ({log.failure})"
    print(f"{episode.door}: {outcome} in {log.times[-1]:.1f} s", file=sys.stderr)


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
            print(f"watch it at  {address}", file=sys.stderr, flush=True)
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
