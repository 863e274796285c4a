"""A person corrects a policy: who commands, what is kept, replayed, and the page."""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from gplfd_env import DoorGeometry
from gplfd_env.doors.config import DOORS, DoorConfig, door_config
from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.episodes.build import open_watched
from gplfd_experiments.episodes.leading import LedAgent
from gplfd_experiments.episodes.task import EpisodeTask, episode_task
from gplfd_experiments.teaching.lead import Person, View
from gplfd_experiments.teaching.lesson import CorrectionLesson
from gplfd_experiments.teaching.page import Session
from gplfd_experiments.teaching.taught import CorrectedSkill
from gplfd_policies import Skill, load_skill
from gplfd_policies.agents.agent import as_agent
from gplfd_policies.control.steps import AgentStep
from gplfd_policies.registry.catalogue import skill_method
from gplfd_policies.registry.method import TrainingInput

pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore:sensor noise"),
]

GP = skill_method("gp")
IDLE = np.zeros(9)
PULL = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
STIFF = DOORS["oven"].replaced({"radius": 0.36, "closer": {"preload": 4.5}})
TOP = View(
    position=np.array([0.8, 3.0, -0.1]),
    axes=np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]]),
    extent=(0.6, 0.45),
    normal=np.array([0.0, 1.0, 0.0]),
)


def skill_of(door: DoorConfig) -> Skill:
    shown = Teacher().standard_demonstrations(seed=0, like=door)
    learned = GP.learn(TrainingInput(demonstrations=shown))
    assert isinstance(learned, Skill)
    return learned


@pytest.fixture(scope="module")
def bars() -> Skill:
    return skill_of(door_config("small"))


def task_of(door: DoorConfig, name: str) -> EpisodeTask:
    return episode_task(name, door, policy="gp", seed=0)


POLICY = np.array([0.02, 0.0, 0.0, 0.0, 0.1, 0.0])


class Held:
    def act(self, observation: dict[str, np.ndarray]) -> AgentStep:
        return AgentStep(action=POLICY, observed_phase=0.25)


def commands(door: DoorGeometry, *samples: np.ndarray) -> tuple[np.ndarray, Any]:
    """Commands while the hand rises slowly at the closed handle; the correction."""
    person = Person(TOP)
    agent = LedAgent(as_agent(Held()), person)
    agent.inform(door)
    agent.reset({"ee_pose": np.zeros(6)})
    found = []
    for number, sample in enumerate(samples):
        person.take(sample, 0.0)
        seen = {"ee_pose": np.eye(6)[1] * 1e-4 * number, "time": np.ones(1) * number}
        still = {"ee_twist": np.zeros(6), "wrench": np.ones(6)}
        found.append(agent.act(seen | still).action)
    return np.array(found), agent.correction(door="door", seed=0)


def pointer(x: float) -> np.ndarray:
    return np.array([1.0, *TOP.place(np.array([x, 0.0, 0.0])), *IDLE[3:]])


def test_the_policy_commands_until_a_person_takes_the_hand_and_after_it_is_let_go():
    taken = [pointer(0.0), *[pointer(0.05)] * 99]
    found, correction = commands(
        DoorGeometry.of(DoorConfig(radius=0.5)), *[IDLE] * 10, *taken, *[IDLE] * 60
    )
    assert_array_equal(found[:10], np.tile(POLICY, (10, 1)))
    # A spring of 300 N/m, rendered by a servo of 2000 N/m.
    assert_allclose(found[60:110, 0], 0.05 * 300 / 2000, rtol=1e-3)
    # Taken and handed over in 0.4 s without a jump.
    assert np.abs(np.diff(found, axis=0)).max() < 0.1 * 1.9 * 0.01 / 0.4
    assert_array_equal(found[149:], np.tile(POLICY, (21, 1)))
    assert np.flatnonzero(correction.led)[[0, -1]].tolist() == [10, 148]
    assert (correction.by, correction.phase) == ("person", 0.25)
    assert commands(DoorGeometry.of(DoorConfig(radius=0.5)), *[IDLE] * 5)[1] is None


@pytest.mark.parametrize(("handle", "force"), [("bar", 34.0), ("lever", 58.0)])
def test_a_person_pulls_no_more_than_the_synthetic_corrector(handle, force):
    latch = {} if handle == "bar" else {"handle": handle, "latch": "spring"}
    door = DoorGeometry.of(DoorConfig(radius=0.65, **latch))
    for taken in ([pointer(0.0), *[pointer(9.0)] * 60], [PULL] * 200):
        found, _ = commands(door, *taken)
        assert 2000.0 * found[-1, 0] == pytest.approx(force, abs=0.05)


def lead(lesson: CorrectionLesson, since: float = 2.0) -> None:
    """Drag the hand ahead along the path, from a time on [s] and up to 50 degrees."""
    geometry = DoorGeometry.of(lesson.door)
    while not lesson.over:
        angle = np.radians(lesson.state["angle"])
        sample = IDLE.copy()
        if lesson.state["time"] > since and angle < np.radians(50.0):
            ahead = min(1.0, lesson.state["time"] - since)
            point = geometry.hand_poses(max(angle, 0.0) + 0.5 * ahead)[:3]
            sample[:3] = 1.0, *lesson.view.place(point)
        lesson.step(sample)


def test_a_person_s_correction_opens_the_door(tmp_path):
    """At a flap that stays closed without it."""
    skill, task = skill_of(DOORS["oven"]), task_of(STIFF, "flap")
    assert not open_watched(task, GP.follow(skill)).success
    store = CorrectedSkill(GP, skill, tmp_path / "better.npz")
    lesson = CorrectionLesson(task, store, "mouse", drawn=False)
    lead(lesson)
    assert "You led the hand for" in lesson.result()
    store.keep(lesson.record())
    better = load_skill(tmp_path / "better.npz")
    assert open_watched(task, GP.follow(better)).success
    (kept,) = better.corrections
    assert (kept.by, kept.device, kept.door) == ("person", "mouse", "flap")


@pytest.mark.needs("opengl")
def test_the_policy_begins_at_start_is_led_and_goes_on_corrected(
    bars: Skill, tmp_path: Path, visitor: Any
) -> None:
    store = CorrectedSkill(GP, bars, tmp_path / "better.npz")
    lessons = [
        partial(CorrectionLesson, task_of(door_config(name), name), store, "mouse")
        for name in ("small", "medium")
    ]
    somebody = visitor(Session([partial(of, drawn=True) for of in lessons], store))
    assert somebody(times=20)["time"] == 0.0
    alone = [somebody("start"), somebody(times=60)][1]
    assert alone["angle"] > 1.0
    assert alone["hand"] == pytest.approx(alone["target"], abs=0.02)  # No spring.
    told = somebody("stop")
    assert told["phase"] == "ready"
    assert "The hand was not led" in told["message"]
    somebody("start")
    assert somebody(sample=PULL.tolist(), times=40)["phase"] == "leading"
    told = somebody("stop")
    assert (told["phase"], told["kept"]) == ("shown", 0)
    assert "You led the hand for 1.2 s. Keep it?" in told["message"]
    assert somebody("keep")["kept"] == 1
    better = load_skill(store.place)
    assert (better.count, len(better.corrections)) == (bars.count + 1, 1)
    assert store.skill is not bars
    with_it = [somebody("start"), somebody(times=60)][1]
    assert (with_it["door"], with_it["angle"] != alone["angle"]) == ("small", True)
    assert somebody("discard")["door"] == "medium"
    assert somebody("finish")["message"] == f"1 in {store.place}."
