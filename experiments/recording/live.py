"""Show an episode while it happens, as a recording of it would show it."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import gymnasium as gym
import mujoco
import numpy as np
import rerun as rr

from experiments.episode_log import EpisodeLog
from experiments.recording.episode import (
    happening,
    page,
    recording_name,
    stage_setting,
)
from experiments.recording.part import Part
from experiments.recording.stages import stage_lane, stages
from experiments.rollout import rollout
from policies.agent import Agent
from policies.demonstrations import Demonstration
from policies.steps import AgentStep
from policies.trajectory import GaussianTrajectory

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
    watched_env = _WatchedEnv(env)
    watched_agent = _WatchedAgent(agent, watched_env)
    started, updated = time.perf_counter(), -math.inf

    def on_step(now: float, angle: float) -> None:
        nonlocal updated
        if watched_agent.n_rows < 2:
            return
        elapsed = time.perf_counter() - started
        if elapsed - updated >= _PERIOD:
            if not wanted():
                raise InterruptedError("nobody watches the episode any more")
            live.show(watched_agent.log_so_far(names))
            updated = elapsed
        time.sleep(max(0.0, now / speed - (time.perf_counter() - started)))

    log = rollout(
        watched_env,
        watched_agent,
        forecast_period=FORECAST_PERIOD,
        on_step=on_step,
        **names,
    )
    live.show(log, ended=True)
    return log


class _WatchedEnv(gym.Wrapper[Any, Any, Any, Any]):
    """Keeps the last information and time."""

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        self.info: Mapping[str, Any] = {}
        self.now = 0.0

    def reset(self, **arguments: Any) -> tuple[Any, dict[str, Any]]:
        observation, info = super().reset(**arguments)
        self.info, self.now = info, float(observation["time"][0])
        return observation, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        observation, reward, ended, truncated, info = super().step(action)
        self.info, self.now = info, float(observation["time"][0])
        return observation, reward, ended, truncated, info


class _WatchedAgent:
    """Keeps what a log of the episode so far needs."""

    def __init__(self, agent: Agent, env: _WatchedEnv) -> None:
        self._agent, self._env = agent, env
        self._rows: dict[str, list[Any]] = {}
        self._forecasts: list[tuple[float, GaussianTrajectory]] = []

    @property
    def n_rows(self) -> int:
        return len(self._rows.get("times", ()))

    def reset(self, observation: Mapping[str, Any]) -> None:
        self._rows, self._forecasts = {}, []
        self._agent.reset(observation)

    def forecast(self) -> GaussianTrajectory | None:
        forecast = self._agent.forecast()
        if forecast is not None:
            self._forecasts.append((self._env.now, forecast))
        return forecast

    def act(self, observation: Mapping[str, Any]) -> AgentStep:
        decision = self._agent.act(observation)
        info = self._env.info
        data: Any = self._env.unwrapped.data  # type: ignore[attr-defined]
        known = {
            "times": self._env.now,
            "qpos": data.qpos,
            "solved": info["success"],
            "latency_s": math.nan,
        }
        for name in _PER_STEP:
            for source in (known, observation, info):
                if name in source:
                    value = source[name]
                    break
            else:
                value = getattr(decision, name)
            self._rows.setdefault(name, []).append(np.copy(value))
        return decision

    def log_so_far(self, names: Mapping[str, Any]) -> EpisodeLog:
        """The episode so far, as if nothing had gone wrong."""
        arrays: dict[str, Any] = {
            name: np.asarray(rows) for name, rows in self._rows.items()
        }
        forecasts = [forecast for _, forecast in self._forecasts]
        phase = forecasts[0].times if forecasts else np.empty(0)
        shape = (len(forecasts), len(phase), 6)
        return EpisodeLog(
            **names,
            **arrays,
            dt=float(np.median(np.diff(arrays["times"]))),
            success=True,
            failure="",
            forecast_times=np.array([when for when, _ in self._forecasts]),
            forecast_phase=phase,
            forecast_mean=np.reshape([one.mean for one in forecasts], shape),
            forecast_std=np.reshape([one.std for one in forecasts], shape),
        )


_PER_STEP: Final = tuple(
    field.name
    for field in dataclasses.fields(EpisodeLog)
    if field.type in ("FloatArray", "BoolArray")
    and not field.name.startswith("forecast_")
)
"""Arrays of a log with a row per step."""
