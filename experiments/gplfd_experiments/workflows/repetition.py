"""Episodes of a study run again, for their logs, and compared with the stored numbers.

A study keeps numbers, no logs. Its episodes are deterministic: the same task gives the
same numbers but for the times that it takes.
"""

import contextlib
import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np

from gplfd_experiments.analysis.results.records import EpisodeResult
from gplfd_experiments.episodes.build import demonstrations_of, make_environment
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.metrics import episode_metrics
from gplfd_experiments.episodes.task import EpisodeTask
from gplfd_experiments.studies.jobs import episode_logs
from gplfd_policies.demonstrations.demonstration import Demonstration

_FORECAST_PERIOD: Final = 0.2
"""Least time between forecasts in a recording [s]; the study takes more of them."""
_TIMED: Final = ("latency_", "cpu_")
"""Metrics that start so differ from run to run."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Repeated:
    """An episode that was run again."""

    log: EpisodeLog
    """What happened, with as many forecasts as can be seen."""
    model: mujoco.MjModel
    """Model of its scene; how its servos are commanded is not part of it."""
    demonstrations: tuple[Demonstration, ...]
    """What the policy learned from."""
    different: Mapping[str, Any]
    """Stored and repeated value of every metric in which they differ."""


def repeat(episode: EpisodeResult) -> Repeated:
    """Run an episode again as the study did, and compare it with what is stored."""
    task = episode.task
    (log,) = episode_logs([task])
    angle = task.teacher["angle_mean"]
    metrics = episode_metrics(log, demonstrated_angle=angle).as_json()
    return Repeated(
        log=_thinned(log),
        model=model_of(task),
        demonstrations=demonstrations_of(task).demonstrations,
        different=differences(episode.metrics, metrics),
    )


def differences(
    stored: Mapping[str, Any], repeated: Mapping[str, Any]
) -> dict[str, list[Any]]:
    """Return the metrics of the same name that differ, times aside."""
    return {
        name: [stored[name], repeated[name]]
        for name in sorted(stored.keys() & repeated.keys())
        if not name.startswith(_TIMED) and stored[name] != repeated[name]
    }


def model_of(task: EpisodeTask) -> mujoco.MjModel:
    """Return the model of the scene that the task's episode runs in."""
    env = make_environment(task, "pose")
    with contextlib.closing(env):
        env.reset(seed=task.reset_seed)
        return env.unwrapped.model  # type: ignore[attr-defined]


def _thinned(log: EpisodeLog) -> EpisodeLog:
    times = log.forecast_times
    if times.size < 2:
        return log
    every = max(1, round(_FORECAST_PERIOD / float(np.median(np.diff(times)))))
    kept = np.unique(np.append(np.arange(0, times.size, every), times.size - 1))
    return dataclasses.replace(
        log,
        forecast_times=times[kept],
        forecast_mean=log.forecast_mean[kept],
        forecast_std=log.forecast_std[kept],
    )
