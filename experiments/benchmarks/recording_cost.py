"""What a recording costs beside the episode that it shows."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from experiments.benchmarks.report import Table, Target
from experiments.benchmarks.throughput import Entrant, Pace, measure_paces
from experiments.episodes.rollout import rollout
from experiments.recording import record_episode
from experiments.teacher import DEMONSTRATED_RADII, Teacher
from gplfd_env import ENVIRONMENT_ID
from policies.registry import make_agent

__all__ = ["RecordingCost", "measure_recording"]


@dataclass(frozen=True, kw_only=True, slots=True)
class RecordingCost:
    """CPU time of a rollout and of writing its recording, all threads together."""

    rollout: Pace
    """Per control step: simulation, agent, log and forecasts."""
    recording: Pace
    """Per control step: from the log to a complete file."""
    steps: int
    """Control steps of the episode."""
    bytes: int
    """Size of the file."""

    def tables(self) -> tuple[Table, ...]:
        """Both, per episode."""
        lines = {"rollout": self.rollout, "recording": self.recording}
        return (
            Table(
                title=(
                    f"recording of an episode of {self.steps} control steps, "
                    f"{self.bytes / 1e6:.1f} MB"
                ),
                columns=("", "CPU ms", "CPU µs/step"),
                rows=tuple(
                    (
                        name,
                        f"{1e3 * self.steps * pace.cost:.0f}",
                        f"{1e6 * pace.cost:.0f}",
                    )
                    for name, pace in lines.items()
                ),
            ),
        )

    def targets(self) -> tuple[Target, ...]:
        """Cheap enough to be always on."""
        return (
            Target(
                name="recording: CPU time over the rollout's",
                value=self.recording.cost_ratio(self.rollout),
                high=0.10,
            ),
        )


def measure_recording(repeats: int) -> RecordingCost:
    """Open the medium door and record it, in turns.

    Args:
        repeats: Episodes, all the same.
    """
    demonstrations = Teacher().demonstrate_doors(
        DEMONSTRATED_RADII, per_radius=2, rng=np.random.default_rng(0)
    )
    agent = make_agent("gp", demonstrations)
    env: Any = gym.make(ENVIRONMENT_ID, door="medium")

    def episode() -> Any:
        return rollout(env, agent, policy="gp", door="medium", seed=0)

    log = episode()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "medium.rrd"

        def record() -> None:
            record_episode(path, log, env.unwrapped.model, demonstrations)

        steps = len(log.times)
        paces, _ = measure_paces(
            {
                "rollout": Entrant(begin=env.reset, run=episode, steps=steps),
                "recording": Entrant(begin=env.reset, run=record, steps=steps),
            },
            repeats,
        )
        size = path.stat().st_size
    env.close()
    return RecordingCost(
        rollout=paces["rollout"], recording=paces["recording"], steps=steps, bytes=size
    )
