"""Run an episode and show it live, in a viewer on this machine."""

import contextlib
import dataclasses
import math
import os
import sys
import time
from collections.abc import Callable
from typing import Any, Final

import gymnasium as gym

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
from gplfd_experiments.recording.layout import layout
from gplfd_experiments.recording.live import LiveRecording, stream_to
from gplfd_experiments.recording.mechanism import mechanism_of
from gplfd_experiments.recording.viewer import has_display, viewer_process
from gplfd_policies.agents.agent import Agent
from gplfd_policies.registry.catalogue import policy_named

FORECAST_PERIOD: Final = 0.2
"""Simulated time between the forecasts of a live view [s]."""

_PERIOD: Final = 0.05
"""Time between two updates [s]; more frequent updates are not worth their cost."""


def watched_rollout(
    env: gym.Env[Any, Any],
    agent: Agent,
    live: LiveRecording,
    *,
    speed: float = 1.0,
    wanted: Callable[[], bool] = lambda: True,
    **names: Any,
) -> EpisodeLog:
    """Run an episode in real time, show it live and return its log.

    ``speed`` is in simulated seconds per second; on a slow computer the episode takes
    longer. ``wanted`` is called at every update and returns whether the viewer is open;
    if not, InterruptedError is raised. ``names`` are for `rollout`.
    """
    started, updated = time.perf_counter(), -math.inf

    def on_step(progress: Progress) -> None:
        nonlocal updated
        if progress.steps < 2:
            return
        elapsed = time.perf_counter() - started
        if elapsed - updated >= _PERIOD:
            if not wanted():
                raise InterruptedError("the viewer was closed")
            # A running episode has not failed.
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

    # The random draws determine the content of the view; the episode repeats them.
    env.reset(seed=task.reset_seed)
    inner: Any = env.unwrapped
    model, drawn = inner.model, inner.door
    there = mechanism_of(model, drawn)
    happens = disturbance_named(circumstances["disturbance"])
    kinds = tuple(one for one in KINDS if getattr(happens, one) is not None)
    arrangement = layout(kinds, there, drawn.hinge_side, live=True)

    with contextlib.closing(env), viewer_process(serve=serve) as (process, url):
        try:
            with (
                stream_to(url, arrangement) as stream,
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
