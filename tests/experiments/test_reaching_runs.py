"""The synthetic human reaches, and runs begin before the handle."""

import json

import gymnasium as gym
import numpy as np
import pytest

from gplfd_env import GRIPPER_ENVIRONMENT_ID
from gplfd_env.doors.config import DOORS
from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.episodes.build import demonstrations_of
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.metrics import episode_metrics
from gplfd_experiments.episodes.task import episode_task
from gplfd_experiments.recording.panels import stages
from gplfd_policies import POLICIES, TrainingInput, as_agent
from gplfd_policies.agents.reaching import (
    GRASPED,
    ReachingAgent,
    learn_reach,
    openings,
    reaches,
)
from gplfd_policies.demonstrations.npz import (
    LabelledDemonstrations,
    hash_of,
    load_demonstrations,
    save_demonstrations,
)

pytestmark = pytest.mark.slow


def shown(door: str, *, seed: int, start: str) -> LabelledDemonstrations:
    """Return what is demonstrated to a policy that is to open a door."""
    config = DOORS[door]
    return demonstrations_of(
        episode_task(door, config, policy="gp", seed=seed, start=start)
    )


SHOWN = shown("small", seed=0, start="approach")
RUN = ("run", "--policy", "oracle", "--doors", "small", "--start", "approach")


def test_a_reach_ends_at_the_handle_at_time_zero():
    ends = []
    for seed in range(20):
        reach = Teacher().demonstrate_reach(np.random.default_rng(seed))
        assert reach.times[-1] == 0.0
        assert not reach.poses[-1].any()
        assert -3.2 < reach.times[0] < -1.0
        gripping = reach.times > -0.2
        assert np.abs(reach.poses[gripping, :3]).max() < 0.01
        ends.append(np.linalg.norm(reach.poses[0, :3]))
    assert 0.09 < min(ends) < 0.13
    assert 0.22 < max(ends) < 0.26


@pytest.mark.parametrize("door", ["medium", "room-834"])
def test_who_reaches_opens_as_who_does_not(door):
    plain = shown(door, seed=3, start="grasped")
    whole = shown(door, seed=3, start="approach")
    assert plain.radii == whole.radii
    assert hash_of(openings(whole)) == hash_of(plain.demonstrations)
    assert openings(plain) == plain.demonstrations
    starts = {tuple(reach.poses[0]) for reach in reaches(whole)}
    assert len(starts) == 6


def test_a_run_reaches_and_keeps_what_it_learned_from(gplfd, tmp_path):
    assert gplfd(*RUN, "--out", "run") == 0
    (metrics,) = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert metrics["success"]
    assert metrics["slip_max_mm"] < 3.0
    log = EpisodeLog.load(tmp_path / "run" / "small.npz")
    assert np.linalg.norm(log.motion.ee_pose[0, :3]) == pytest.approx(0.15)
    names = [name for _, name in stages(log)]
    assert names == ["reach", "grasp", "open", "hold", "success"]
    kept = load_demonstrations(tmp_path / "run")
    assert all(set(one) == {GRASPED} for one in kept.signals)
    file = ("--demonstrations", "run/demonstrations.npz")
    assert hash_of(reaches(kept)) == hash_of(reaches(SHOWN))
    assert gplfd(*RUN[:-2], *file, "--out", "grasped") == 0
    plain = EpisodeLog.load(tmp_path / "grasped" / "small.npz")
    assert stages(plain)[0] == (0, "grasp")


def test_a_run_finds_a_handle_that_was_detected(gplfd, tmp_path):
    assert gplfd(*RUN, "--randomization", "detector", "--out", "run") == 0
    log = EpisodeLog.load(tmp_path / "run" / "small.npz")
    assert log.success
    assert np.linalg.norm(log.opening.handle_pose[0, :3]) > 0.003


def test_it_closes_a_gripper_that_is_commanded():
    policy = as_agent(POLICIES["oracle"].make(TrainingInput(demonstrations=())))
    agent = ReachingAgent(learn_reach(reaches(SHOWN)), policy)
    env = gym.make(GRIPPER_ENVIRONMENT_ID, door="small", start="approach")
    observation, info = env.reset(seed=0)
    agent.inform(env.unwrapped.door_geometry)  # type: ignore[attr-defined]
    agent.reset(observation)
    ended = False
    while not ended:
        pose = agent.act(observation).action
        action = np.append(pose, agent.gripper_width)
        observation, _, terminated, truncated, info = env.step(action)
        ended = terminated or truncated
    env.close()
    assert info["stage"] == "held"


def test_what_a_policy_says_is_measured_once_it_acts(make_log):
    plain, late = make_log(), {}
    reaching = plain.times[:, None] < 1.0
    for name in ("stiffness", "stiffness_rate", "stability_margin"):
        late[name] = np.where(reaching, np.nan, getattr(plain.decisions, name))
    all_along, measured = episode_metrics(plain), episode_metrics(make_log(**late))
    names = [name for name in measured if name.startswith((*late, "governed_share"))]
    assert len(names) > 1
    for name in names:
        assert measured[name] == pytest.approx(all_along[name], rel=0.2)


def test_what_cannot_teach_reaching_is_refused(refused, tmp_path):
    save_demonstrations(tmp_path / "plain.npz", SHOWN.demonstrations)
    plain = refused(*RUN, "--demonstrations", "plain.npz")
    assert "do not record when the hand takes hold" in plain
    assert "--skill contains no reaching" in refused(*RUN, "--skill", "some.skill")
    uncertain = ("--randomization", "detector")
    assert "needs start=" in refused(*RUN[:-2], *uncertain)
