"""The reference agents at simulated doors."""

import contextlib
from typing import Any

import gymnasium as gym
import pytest

from gplfd_env import ENVIRONMENT_ID
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.metrics import episode_metrics
from gplfd_experiments.episodes.rollout import rollouts
from gplfd_policies import batch_agents, make_agent


def opened(
    policy: str, doors: tuple[float, ...], seeds: tuple[int, ...], randomization: str
) -> tuple[EpisodeLog, ...]:
    envs: Any = gym.make_vec(
        ENVIRONMENT_ID,
        num_envs=len(doors),
        door=list(doors),
        randomization=randomization,
        autoreset_mode="Disabled",
        num_threads=1,
    )
    with contextlib.closing(envs):
        return rollouts(
            envs,
            batch_agents([make_agent(policy, ()) for _ in doors]),
            policy=policy,
            doors=[f"{door:g}" for door in doors],
            seeds=seeds,
            forecast_period=None,
        )


@pytest.mark.parametrize(
    ("policy", "randomization", "force"),
    [
        ("hinge-fit", "hard", 4.0),
        ("oracle", "hard", 6.0),
        ("reflex", "mild", 15.0),
        ("chord", "mild", 20.0),
        ("compliant-pull", "none", 45.0),
    ],
)
def test_doors_are_opened_within_a_force(
    policy: str, randomization: str, force: float
) -> None:
    """Draws whose base is turned by 2.6° and -2.8°, and whose radii are not nominal."""
    for log in opened(policy, (0.5, 0.5), (0, 1), randomization):
        metrics = episode_metrics(log)
        assert metrics.success
        assert metrics.force_radial_peak < force
