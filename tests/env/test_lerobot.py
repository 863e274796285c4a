"""Doors in LeRobot: registration, observations, seeds, and actions at waypoints.

Where LeRobot is not installed, a stand-in takes the place of its base class.
"""

import dataclasses
import importlib.util
import sys
from types import ModuleType, SimpleNamespace
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from gplfd_env.doors.config import DOORS
from gplfd_env.envs.waypoints import Condition, WaypointDoor, Waypoints, seen, state_of
from gplfd_env.wrappers import action_of
from gplfd_experiments.episodes.task import episode_task
from gplfd_experiments.studies.trials.protocol import named_trials, trial_tasks

MEDIUM = Condition(name="medium", door="medium", arguments={"door": "medium"})
HAND = np.array([0.01, 0.02, -0.03, 0.0, 0.2, 0.0])


@dataclasses.dataclass
class StandIn:
    """What `lerobot.envs.EnvConfig` of version 0.6.1 has."""

    task: str | None = None
    fps: int = 30
    features: dict[str, Any] = dataclasses.field(default_factory=dict)
    features_map: dict[str, str] = dataclasses.field(default_factory=dict)
    max_parallel_tasks: int = 1
    disable_env_checker: bool = True
    known: ClassVar[dict[str, type]] = {}

    @classmethod
    def register_subclass(cls, name):
        return lambda subclass: cls.known.setdefault(name, subclass)


@pytest.fixture
def plugin(monkeypatch):
    if importlib.util.find_spec("lerobot") is None:
        configs, envs = ModuleType("lerobot.configs"), ModuleType("lerobot.envs")
        configs.FeatureType = SimpleNamespace(
            ACTION="ACTION", STATE="STATE", ENV="ENV", VISUAL="VISUAL"
        )
        configs.PolicyFeature = SimpleNamespace
        envs.EnvConfig = StandIn
        modules = {"lerobot": ModuleType("lerobot"), "lerobot.configs": configs}
        for name, module in (modules | {"lerobot.envs": envs}).items():
            monkeypatch.setitem(sys.modules, name, module)
        monkeypatch.setattr(StandIn, "known", {})
    monkeypatch.delitem(sys.modules, "gplfd_env.lerobot", raising=False)
    yield importlib.import_module("gplfd_env.lerobot")
    sys.modules.pop("gplfd_env.lerobot", None)


def test_the_plugin_has_what_lerobot_asks_for(plugin):
    assert plugin.__path__  # LeRobot imports all modules below it.
    config = plugin.DoorEnvConfig(cameras="overview, hand_camera", action="stiffness")
    assert {name: tuple(f.shape) for name, f in config.features.items()} == {
        "action": (13,),
        "agent_pos": (7,),
        "environment_state": (6,),
        "pixels/overview": (240, 320, 3),
        "pixels/hand_camera": (240, 320, 3),
    }
    assert config.features_map["agent_pos"] == "observation.state"
    assert config.features_map["pixels/overview"] == "observation.images.overview"
    assert set(config.gym_kwargs) == {"rate", "form", "cameras", "size"}


def test_suites_are_tracks_and_tasks_their_conditions(plugin):
    suites = plugin.conditions("radius/between, radius/beyond/0.3, small, 0.42")
    names = [condition.name for group in suites.values() for condition in group]
    named = "radius/between/0.42 radius/between/0.58 radius/beyond/0.3 small 0.42"
    assert sorted(names) == sorted(named.split())
    for name, door in DOORS.items():  # as `gplfd benchmark` opens it
        task = episode_task(name, door, policy="oracle", seed=0)
        assert plugin.conditions(name)["doors"][0].arguments["base"] == task.base
    (track,) = set(suites) - {"doors"}
    assert "radius/between" in plugin.conditions(track)[track][0].name
    with pytest.raises(ValueError, match="unknown --env"):
        plugin.conditions("radios")


def test_a_seed_resets_the_door_as_in_the_trials(plugin):
    tasks = trial_tasks(named_trials(("radius", "motions")), only=["oracle"], seeds=1)
    suites = plugin.conditions("radius, motions")
    conditions = {c.name: c for group in suites.values() for c in group}
    for task in tasks:
        condition = conditions.pop(f"{task.trial}/{task.level}/{task.door}")
        assert condition.reset_seed(task.seed) == task.reset_seed
        assert condition.arguments["randomization"] == task.randomization
    assert not conditions


def test_episodes_end_with_their_success_in_a_vector_environment(plugin):
    config = plugin.DoorEnvConfig(task="medium", fps=10)
    envs = config.create_envs(2)["doors"][0]
    assert envs.call("_max_episode_steps") == (150, 150)
    assert envs.call("task_description") == ("open the door",) * 2
    observation, info = envs.reset(seed=[3, 4])
    assert observation["agent_pos"].shape == (2, 7)
    assert observation["environment_state"].dtype == np.float32
    assert not info["is_success"].any()
    # Far away at once: the grasp is lost.
    action = np.tile(state_of(np.array([0.5, 0.5, 0.5, 0.0, 0.0, 0.0])), (2, 1))
    ended = np.zeros(2, dtype=bool)
    for _ in range(30):
        _, _, terminated, truncated, info = envs.step(action)
        ended |= terminated | truncated
        if ended.all():
            break
    assert ended.all()
    assert not np.any(info["final_info"]["is_success"])
    envs.close()


def test_an_action_reaches_the_door_as_commands_of_every_period():
    door = WaypointDoor(MEDIUM, rate=20)
    door.reset(seed=1, options={"lerobot_new_rollout": True})
    env = gym.make("gplfd/DoorOpening-v1", door="medium")
    observation, _ = env.reset(seed=1)
    start = observation["ee_pose"]
    goal = start + np.array([0.01, 0.0, 0.0, 0.0, 0.01, 0.0])
    stepped = door.step(state_of(goal))
    for share in np.arange(1, 6) / 5:
        observation, *_ = env.step(start + share * (goal - start))
    for name, values in seen(observation).items():
        assert_allclose(stepped[0][name], values, atol=1e-6)


@pytest.mark.parametrize("form", ["pose", "relative", "stiffness"])
def test_forms_of_actions_mean_the_same_pose(form):
    goal = HAND + np.array([0.01, 0.0, 0.02, 0.0, 0.05, 0.0])
    action = action_of(goal, HAND) if form == "relative" else state_of(goal)
    stiffness = np.full(6, 50.0)
    waypoints = Waypoints(25, form)
    waypoints.reset(HAND)
    action = np.append(action, stiffness) if form == "stiffness" else action
    commands = waypoints.commands(action, HAND)
    assert_allclose(commands[-1][:6], goal, atol=1e-12)
    assert_allclose(commands[0][:6], HAND + (goal - HAND) / 4, atol=1e-12)
    # The next one begins where this one led, wherever the hand has come to.
    after, moved = goal + 0.002, HAND + 0.005
    action = action_of(after, moved) if form == "relative" else state_of(after)
    action = np.append(action, stiffness) if form == "stiffness" else action
    further = waypoints.commands(action, moved)
    assert_allclose(further[-1][:6], after, atol=1e-12)
    assert_allclose(further[0][:6], goal + (after - goal) / 4, atol=1e-12)
    if form == "stiffness":
        assert waypoints.control == "impedance"
        assert_array_equal(commands[:, 6:], np.tile(stiffness, (4, 1)))


def test_what_is_no_action_and_no_rate_is_refused():
    with pytest.raises(ValueError, match="fps = 30 must divide"):
        Waypoints(30)
    with pytest.raises(ValueError, match="'pose' is 7 finite numbers"):
        Waypoints(20).commands(np.full(7, np.nan), HAND)
    for early in (lambda door: door.step(np.zeros(7)), WaypointDoor.render):
        with pytest.raises(gym.error.ResetNeeded):
            early(WaypointDoor(MEDIUM))


@pytest.mark.needs("opengl")
def test_cameras_open_at_the_first_reset():
    door = WaypointDoor(MEDIUM, cameras=("overview", "hand_camera"), size=(64, 48))
    assert not door._cameras
    observation, _ = door.reset(seed=0)
    assert door.observation_space.contains(observation)
    assert observation["pixels"]["hand_camera"].shape == (48, 64, 3)
    assert door.render().std() > 0.0
    door.close()
