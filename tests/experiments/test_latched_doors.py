"""Doors with a handle that must be turned first: a demonstration is worth something."""

import contextlib
import os
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from gplfd_env import ENVIRONMENT_ID
from gplfd_env.conventions.constants import Base
from gplfd_env.doors.config import DOORS, DoorConfig
from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.episodes.build import learned
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.metrics import episode_metrics
from gplfd_experiments.episodes.rollout import rollouts
from gplfd_policies import POLICIES, batch_agents
from gplfd_policies.registry.method import TrainingInput

ROOM = DoorConfig(radius=0.53, handle="lever", latch="spring")


def opened(
    policy: str, *doors: DoorConfig, base: Base = "fixed"
) -> tuple[EpisodeLog, ...]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        shown = Teacher().standard_demonstrations(seed=0, like=doors[0])
        make = learned(POLICIES[policy], TrainingInput(demonstrations=shown))
        agents = batch_agents([make() for _ in doors])
    envs: Any = gym.make_vec(
        ENVIRONMENT_ID,
        num_envs=len(doors),
        door=list(doors),
        base=base,
        autoreset_mode="Disabled",
        num_threads=1,
    )
    with contextlib.closing(envs):
        return rollouts(
            envs,
            agents,
            policy=policy,
            doors=[f"{door.radius:g}" for door in doors],
            seeds=[0] * len(doors),
            forecast_period=None,
        )


def test_demonstrations_of_three_doors_open_latched_ones_gently() -> None:
    doors = (ROOM, DoorConfig(radius=0.60, handle="lever", latch="spring"))
    for log in opened("gp", *doors):
        metrics = episode_metrics(log)
        assert metrics.success
        assert metrics.force_radial_p95 < 10.0
        assert metrics.slip_max_mm < 5.0


def test_doors_of_rooms_are_opened_with_less_force_than_the_standard_allows() -> None:
    """ADA 404.2.9 allows 22.2 N; the radii are those of the demonstrations."""
    rooms = [DOORS[name] for name in ("room-584", "room-709", "room-834")]
    for log in opened("gp", *rooms, base="mobile"):
        metrics = episode_metrics(log)
        assert metrics.success
        assert metrics.force_handle_peak < 22.2


def test_a_handle_that_turns_further_than_those_shown_is_turned_to_its_stop() -> None:
    """0.95 instead of 0.80 rad, as gently; and a closer that asks for 45 N."""
    further = DOORS["room-834"].replaced({"handle_travel": 0.95, "bolt_throw": 0.019})
    gentle, heavy = opened("gp", further, DOORS["office-closer-2"], base="mobile")
    assert gentle.success
    assert heavy.success
    assert gentle.handle_angle.max() > 0.8
    assert episode_metrics(gentle).force_handle_peak < 22.2


def test_a_handle_is_turned_alone_as_in_company() -> None:
    (alone,) = opened("gp", ROOM)
    _, beside = opened("gp", DOORS["room-834"], ROOM)
    for name in ("ee_pose", "wrench", "action", "observed_phase"):
        np.testing.assert_array_equal(getattr(alone, name), getattr(beside, name))


def test_a_circle_fit_does_not_open_a_latch() -> None:
    (log,) = opened("hinge-fit", ROOM)
    assert not log.success
    assert np.degrees(log.door_angle.max()) < 1.0


@pytest.mark.parametrize("policy", ["oracle", "hinge-fit-told"])
def test_who_is_told_the_handle_opens_it(policy: str) -> None:
    (log,) = opened(policy, ROOM)
    assert episode_metrics(log).success


@pytest.mark.bits
def test_another_processor_opens_a_lever_door_alike(tmp_path: Path) -> None:
    """Rounding decides when a fingertip touches the lever: docs/reproducibility.md."""
    others = {
        "OPENBLAS_CORETYPE": "Prescott",
        "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA",
    }
    own = {name: value for name, value in os.environ.items() if name not in others}
    command = ["run", "--doors", "room-834", "--seed", "1", "--quiet"]
    running = [
        subprocess.Popen(
            [sys.executable, "-m", "gplfd", *command, "--out", str(tmp_path / name)],
            env=own | variables,
            stdout=subprocess.DEVNULL,
        )
        for name, variables in (("here", {}), ("there", others))
    ]
    assert [each.wait() for each in running] == [0, 0]
    here, there = (
        EpisodeLog.load(tmp_path / name / "room-834.npz") for name in ("here", "there")
    )
    assert here.success
    assert there.success
    assert abs(len(here.times) - len(there.times)) <= 1
    steps = min(len(here.times), len(there.times))
    apart = np.abs(here.ee_pose[:steps, :3] - there.ee_pose[:steps, :3]).max()
    assert apart < 2e-3  # measured: 0.10 mm here, 1.8 mm at a door with a closer
