"""Policies at simulated doors: latched ones with demonstrations, others without."""

import contextlib
import functools
import os
import subprocess
import sys
import warnings

import gymnasium as gym
import numpy as np
import pytest

from gplfd_env import ENVIRONMENT_ID
from gplfd_env.doors.config import DOORS, DoorConfig
from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.episodes.build import learned
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.metrics import episode_metrics
from gplfd_experiments.episodes.rollout import rollouts
from gplfd_experiments.episodes.task import episode_task
from gplfd_experiments.studies.jobs import episode_log
from gplfd_policies import POLICIES, batch_agents
from gplfd_policies.registry.method import TrainingInput

pytestmark = pytest.mark.slow

ROOM = DoorConfig(radius=0.53, handle="lever", latch="spring")
LEVERS = (ROOM, DoorConfig(radius=0.60, handle="lever", latch="spring"))


@functools.cache
def agents_of(policy, kind):
    """Learn once from demonstrations of a kind of doors."""
    like = DoorConfig(**dict(zip(DoorConfig().kind, kind, strict=True)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        shown = Teacher().standard_demonstrations(seed=0, like=like)
        return learned(POLICIES[policy], TrainingInput(demonstrations=shown))


@functools.cache
def opened(policy, *doors, seeds=(0, 0, 0), **options):
    """The logs of a policy at some doors, each opened once."""
    make = agents_of(policy, tuple(doors[0].kind.values()))
    options |= {"autoreset_mode": "Disabled", "num_threads": 1}
    envs = gym.make_vec(ENVIRONMENT_ID, len(doors), door=list(doors), **options)
    with contextlib.closing(envs):
        logs = rollouts(
            envs,
            batch_agents([make() for _ in doors]),
            policies=[policy] * len(doors),
            doors=[f"{door.radius:g}" for door in doors],
            seeds=seeds[: len(doors)],
            forecast_period=None,
        )
        return tuple(logs)


@pytest.mark.parametrize(
    ("policy", "randomization", "force"),
    [
        ("hinge-fit", "hard", 4.0),
        ("mechanism-fit", "hard", 8.0),
        ("oracle", "hard", 6.0),
        ("reflex", "mild", 15.0),
        ("chord", "mild", 20.0),
        ("compliant-pull", "none", 45.0),
    ],
)
def test_policies_without_learning_open_within_a_force(policy, randomization, force):
    """Draws whose base is turned by 2.6° and -2.8°, and whose radii are not nominal."""
    two = (DoorConfig(radius=0.5), DoorConfig(radius=0.5))
    for log in opened(policy, *two, randomization=randomization, seeds=(0, 1)):
        metrics = episode_metrics(log)
        assert metrics["success"]
        assert metrics["force_radial_peak"] < force


def test_three_demonstrated_doors_open_latched_ones_gently():
    for log in opened("gp", *LEVERS):
        metrics = episode_metrics(log)
        assert metrics["success"]
        assert metrics["force_radial_p95"] < 10.0
        assert metrics["slip_max_mm"] < 5.0


def test_doors_of_rooms_are_opened_with_less_force_than_the_standard_allows():
    """ADA 404.2.9 allows 22.2 N; the radii are those of the demonstrations."""
    rooms = [DOORS[name] for name in ("room-584", "room-834")]
    for log in opened("gp", *rooms, base="mobile"):
        metrics = episode_metrics(log)
        assert metrics["success"]
        assert metrics["force_handle_peak"] < 22.2


@pytest.mark.parametrize(
    ("policy", "opens"), [("hinge-fit", False), ("hinge-fit-told", True)]
)
def test_only_a_known_handle_is_turned(policy, opens):
    """A circle fit alone does not open a latch."""
    (log,) = opened(policy, ROOM, **({} if opens else {"max_episode_steps": 400}))
    assert episode_metrics(log)["success"] == opens
    assert (np.degrees(log.opening.door_angle.max()) < 1.0) != opens


def open_a_lever(path):
    options = {"policy": "gp", "seed": 1, "demonstrations_per_door": 1}
    episode_log(episode_task("lever", DOORS["room-834"], **options)).save(path)


@pytest.mark.filterwarnings("ignore:rests", "ignore:3 demon")
def test_another_processor_opens_a_lever_door_alike(tmp_path):
    """Rounding decides when a fingertip touches the lever: docs/reference.md."""
    others = {
        "OPENBLAS_CORETYPE": "Prescott",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA",
    }
    away = [sys.executable, __file__, str(tmp_path / "there.npz")]
    subprocess.run(away, env=os.environ | others, check=True, capture_output=True)
    open_a_lever(tmp_path / "here.npz")
    here, there = (EpisodeLog.load(tmp_path / f"{n}.npz") for n in ("here", "there"))
    assert here.success
    assert there.success
    assert abs(len(here.times) - len(there.times)) <= 1
    steps = min(len(here.times), len(there.times))
    apart = np.abs(
        here.motion.ee_pose[:steps, :3] - there.motion.ee_pose[:steps, :3]
    ).max()
    assert apart < 2e-3  # measured: 0.10 mm here, 1.8 mm at a door with a closer


if __name__ == "__main__":
    open_a_lever(sys.argv[1])
