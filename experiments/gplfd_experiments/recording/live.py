"""Show an episode while it happens, as a recording of it would show it."""

import dataclasses
import math
import time
from collections.abc import Callable, Sequence
from typing import Any, Final

import gymnasium as gym
import mujoco
import rerun as rr

from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.rollout import Progress, rollout
from gplfd_experiments.recording.about import page
from gplfd_experiments.recording.episode import happening, recording_name, stage_setting
from gplfd_experiments.recording.part import Part
from gplfd_experiments.recording.stages import stage_lane, stages
from gplfd_policies.agents.agent import Agent
from gplfd_policies.demonstrations.demonstration import Demonstration

FORECAST_PERIOD: Final = 0.2
"""Simulated time between the forecasts of a live view [s]."""

_PERIOD: Final = 0.05
"""Time between two updates [s]; more often would cost more than it shows."""


class LiveRecording:
    """Sends an episode part by part to a stream.

    What is sent in the end is what `record_episode` would have written.

    Args:
        stream: Connected stream.
        model: Model that the episode runs in.
        demonstrations: What the policy learned from, poses in the task frame.
    """

    def __init__(
        self,
        stream: rr.RecordingStream,
        model: mujoco.MjModel,
        demonstrations: Sequence[Demonstration],
    ) -> None:
        self._stream, self._model = stream, model
        self._demonstrations = demonstrations
        self._rows = self._forecasts = 0
        self._stages: set[str] = set()

    def show(self, log: EpisodeLog, *, ended: bool = False) -> None:
        """Send what is new.

        Args:
            log: The episode so far, two rows or more. Until it has ended it counts as
                neither failed nor solved.
            ended: Whether this is the whole episode.
        """
        stream, page_due = self._stream, ended or self._rows == 0
        if self._rows == 0:
            stream.send_recording_name(recording_name(log))
            stream.send_chunks(stage_setting(log, self._model, self._demonstrations))
        if log.times.size > self._rows:
            part = Part(log=log, first_row=self._rows, first_forecast=self._forecasts)
            stream.send_chunks(happening(part, self._model))
        stream.send_chunks(stage_lane(log, self._stages, ended=ended))
        if page_due:
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
    """Run an episode in real time and show it meanwhile.

    Args:
        env: Door environment; its ``unwrapped.data`` is the MuJoCo state.
        agent: Policy and controller.
        live: What shows the episode.
        speed: Simulated seconds per second; when the computer cannot keep up, the
            episode takes longer. Infinite: as fast as it goes.
        wanted: Asked at every update whether anyone still watches.
        names: The names, configuration and seed that `rollout` wants for the log.

    Returns:
        The log of the episode.

    Raises:
        InterruptedError: Nobody watches any more.
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
