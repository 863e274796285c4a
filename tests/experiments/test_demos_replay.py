"""A replay tells whether it is the recording, and otherwise where it departs."""

import dataclasses
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from gplfd_env import ENVIRONMENT_ID
from gplfd_env.spatial.arc import handle_pose_on_arc
from gplfd_experiments.data.minari import RecordedEpisode, Recorder
from gplfd_experiments.data.replay import changes_since, compare, replay
from gplfd_experiments.files.provenance import versions

STORED = Path(__file__).with_name("data") / "door-opening-v0"
RECORD_AGAIN = (
    "gplfd demos record --doors medium --max-steps 80 "
    "--out tests/experiments/data/door-opening-v0 --overwrite"
)
"""From the checkout's root; done whenever scene, task or robot change on purpose."""

TOLERANCE = 1e-7
"""Largest difference [SI] of any compared number where another processor or another
MuJoCo computes. Rounding differences of other processors stay below 1e-10 in this
episode; a door that is 1 g heavier is above."""

N_STEPS = 10


def record(**arguments: Any) -> RecordedEpisode:
    recorder = Recorder(gym.make(ENVIRONMENT_ID, **arguments))
    recorder.reset(seed=1, options={"door": {"radius": 0.45}})
    for step in range(N_STEPS):
        recorder.step(handle_pose_on_arc(0.45, 0.02 * (step + 1)))
    return recorder.episode


@pytest.fixture(scope="module")
def episode() -> RecordedEpisode:
    return record()


Change = Callable[[RecordedEpisode], RecordedEpisode]


def with_states(episode: RecordedEpisode, states: Any, **more: Any) -> RecordedEpisode:
    infos = {**episode.infos, "physics_state": states}
    return dataclasses.replace(episode, infos=infos, **more)


def state(row: int, part: str, amount: float) -> Change:
    """Add to the last number of a part of the physics state."""

    def change(episode: RecordedEpisode) -> RecordedEpisode:
        states = episode.states.copy()
        parts = list(episode.state_layout)
        lengths = list(episode.state_layout.values())
        states[row, sum(lengths[: parts.index(part) + 1]) - 1] += amount
        return with_states(episode, states)

    return change


def one_bit(episode: RecordedEpisode) -> RecordedEpisode:
    states = episode.states.copy()
    states[3, 2] = np.nextafter(states[3, 2], 1.0)
    return with_states(episode, states)


def observed(episode: RecordedEpisode) -> RecordedEpisode:
    """Noise that only the agent sees."""
    pose = episode.observations["ee_pose"].copy()
    pose[2, 0] += 1e-3
    seen = {**episode.observations, "ee_pose": pose}
    return dataclasses.replace(episode, observations=seen)


def rewarded(episode: RecordedEpisode) -> RecordedEpisode:
    rewards = episode.rewards + (np.arange(N_STEPS) == N_STEPS - 1)
    return dataclasses.replace(episode, rewards=rewards)


def wider(episode: RecordedEpisode) -> RecordedEpisode:
    """Another layout of the physics state."""
    states = np.hstack([episode.states, np.zeros((N_STEPS + 1, 1))])
    layout = {**episode.state_layout, "userdata": 1}
    return with_states(episode, states, state_layout=layout)


def test_the_first_departure_is_named_with_field_and_distance(episode):
    other = state(7, "qvel", 1e-9)(state(4, "warmstart", 0.5)(episode))
    text = str(compare(episode, other))
    assert "departs at step 4 of 10: warmstart by 0.5" in text
    assert "at most: qvel by 1e-09, warmstart by 0.5" in text


@pytest.mark.parametrize(
    ("change", "step", "fields"),
    [
        (one_bit, 3, {"qpos": pytest.approx(0.0, abs=1e-15)}),
        (state(6, "qpos", math.nan), 6, {"qpos": math.inf}),
        (observed, 2, {"observed ee_pose": pytest.approx(1e-3)}),
        (rewarded, N_STEPS, {"rewards": pytest.approx(1.0)}),
        (wider, 0, {"userdata": math.inf}),
    ],
)
def test_what_differs_is_a_departure_at_its_step(episode, change, step, fields):
    other = change(episode)
    assert str(compare(other, other)) == f"bit-exact over {N_STEPS} steps"
    for first, second in ((episode, other), (other, episode)):
        departure = compare(first, second).departure
        assert departure is not None
        assert (departure.step, departure.fields) == (step, fields)


class Heavier(gym.Wrapper[Any, Any, Any, Any]):
    """A door leaf that is 1 g heavier than it says."""

    def reset(self, **arguments: Any) -> Any:
        result = self.env.reset(**arguments)
        model: Any = self.env.unwrapped.model  # type: ignore[attr-defined]
        leaf = int(np.argmax(model.body_mass * (model.body_weldid > 0)))
        model.body_inertia[leaf] *= 1.0 + 1e-3 / model.body_mass[leaf]
        model.body_mass[leaf] += 1e-3
        return result


def test_another_model_is_named_and_departs(episode):
    comparison = compare(episode, replay(episode, Heavier(gym.make(ENVIRONMENT_ID))))
    assert comparison.model_parts == ("body",)
    assert str(comparison).startswith("the model differs in body; departs at step 1")


def test_a_replay_that_ends_early_says_so(episode):
    short = gym.make(ENVIRONMENT_ID, max_episode_steps=N_STEPS - 3)
    comparison = compare(episode, replay(episode, short))
    assert not comparison.exact
    assert comparison.departure is not None
    assert comparison.departure.fields == {"truncations": 1.0}
    assert f"ended after {N_STEPS - 3} of {N_STEPS} steps" in str(comparison)
    # Steps that were recorded beyond the end are not taken again.
    beyond = record(max_episode_steps=N_STEPS - 2)
    again = replay(beyond, gym.make(ENVIRONMENT_ID, max_episode_steps=N_STEPS - 2))
    comparison = compare(beyond, again)
    assert not comparison.exact
    assert str(comparison) == f"ended after {N_STEPS - 2} of {N_STEPS} steps"


def test_changed_versions_and_processors_are_told():
    origin = {
        "versions": {**versions(), "mujoco": "3.9.0"},
        "arithmetic": {"machine": "z80"},
    }
    changes = changes_since(origin)
    assert changes["mujoco"] == ("3.9.0", versions()["mujoco"])
    assert changes["machine"][0] == "z80"
    assert changes["C library"][0] == "unknown"
    assert "numpy" not in changes
