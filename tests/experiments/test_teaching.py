"""A hand led by a person: what a device means, what is recorded, and replayed."""

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gplfd_env import DoorGeometry
from gplfd_env.doors.config import DOORS, DoorConfig, door_config
from gplfd_env.spatial.se3 import handle_pose_on_arc
from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.episodes.build import learned_agents, open_together, open_watched
from gplfd_experiments.episodes.leading import LedAgent
from gplfd_experiments.episodes.metrics import episode_metrics
from gplfd_experiments.episodes.task import episode_task, named_doors
from gplfd_experiments.teaching.lesson import (
    SPRING,
    CameraView,
    CorrectedSkill,
    CorrectionLesson,
    DemonstrationLesson,
    Lead,
    LeadingPerson,
    Taught,
    TaughtSet,
    checked_input,
    read_taught,
    replay,
)
from gplfd_experiments.workflows.skills import demonstrated_doors
from gplfd_policies import load_skill
from gplfd_policies.agents.agent import as_agent
from gplfd_policies.control.steps import AgentStep
from gplfd_policies.demonstrations.npz import FILE, load_demonstrations
from gplfd_policies.registry.catalogue import policy_named, skill_method
from gplfd_policies.registry.method import TrainingInput

IDLE = np.zeros(9)
TOP = CameraView(
    position=np.array([0.8, 3.0, -0.1]),
    axes=np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]]),
    extent=(0.6, 0.45),
    normal=np.array([0.0, 1.0, 0.0]),
)


def taught(door: DoorConfig, seed: int, name: str = "door") -> Taught:
    """Drag the handle of a door by a mouse, as inexactly as a person does.

    The pointer rests for 0.8 s, follows an arc whose radius is guessed to 8 %, trembles
    by a centimetre meanwhile, and rests for 0.7 s. It is sampled sixty times a second.
    """
    rng = np.random.default_rng(seed)
    lesson, tremor = DemonstrationLesson(name, door, drawn=False), np.zeros(3)
    radius, duration = door.radius * rng.uniform(0.92, 1.08), rng.uniform(3.0, 4.0)
    for step in range(round(100 * duration) + 150):
        share = np.clip((0.01 * step - 0.8) / duration, 0.0, 1.0)
        angle = math.radians(75.0) * share**2 * (3.0 - 2.0 * share)
        if step % 5 in (0, 2, 4) and 0.0 < share < 1.0:
            tremor = 0.9 * tremor + rng.normal(0.0, 0.004, 3)
        if step % 5 in (0, 2, 4):
            point = handle_pose_on_arc(radius, angle)[:3] + tremor
            pointer = lesson.view.place(point)
        lesson.step(np.array([1.0, *pointer, *IDLE[3:]]))
    assert not lesson.over
    return lesson.record()


@pytest.fixture(scope="module")
def small() -> Taught:
    return taught(door_config("small"), 0, "small")


@given(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(-0.5, 0.5))
def test_a_place_in_the_picture_means_the_point_of_the_plane_that_is_seen_there(
    x: float, z: float, height: float
) -> None:
    point = np.array([x, height, z])
    found = TOP.point(*TOP.place(point), level=np.array([9.0, height, 9.0]))
    np.testing.assert_allclose(found, point, atol=1e-12)


def test_the_picture_of_a_door_shows_the_handle_where_the_view_says() -> None:
    lesson = DemonstrationLesson("medium", door_config("medium"), drawn=False)
    view, data = lesson.view, lesson._env.data
    hand = data.site("hand").xpos - data.camera("top").xpos
    right, up, back = data.camera("top").xmat.reshape(3, 3).T @ hand
    fovy = math.radians(float(lesson._env.model.camera("top").fovy[0]))
    u, v = view.place(np.zeros(3))
    half = math.tan(fovy / 2.0)
    assert u == pytest.approx(0.5 * (1.0 - right / back / half * 3 / 4), abs=1e-4)
    assert v == pytest.approx(0.5 * (1.0 + up / back / half), abs=1e-4)


def lead(*samples: np.ndarray, velocity: tuple[float, ...] = (0.0,) * 3) -> list[float]:
    """Return the pull on a hand that stays at the closed handle, after samples [N]."""
    made, hand = Lead(TOP), np.zeros(6)
    observation = {"ee_pose": hand, "ee_twist": np.array([*velocity, 0.0, 0.0, 0.0])}
    for sample in samples:
        action = made.command(sample, observation, np.zeros(3))
    return ((action[:3] - hand[:3]) * SPRING[0]).tolist()


def pointer(x: float, z: float) -> np.ndarray:
    return np.array([1.0, *TOP.place(np.array([x, 0.0, z])), *IDLE[3:]])


def test_only_the_motion_of_the_pointer_draws_the_hand_until_it_is_let_go() -> None:
    assert lead(pointer(0.5, 0.3)) == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    moved = lead(pointer(0.5, 0.3), pointer(0.54, 0.2))
    assert moved == pytest.approx([300 * 0.04, 0.0, -300 * 0.1])
    assert lead(pointer(0.5, 0.3), pointer(0.54, 0.2), IDLE) == [0.0, 0.0, 0.0]
    key = np.array([0.0, 0.0, 0.0, 1.0, *IDLE[4:]])
    assert lead(IDLE, key)[0] > 0.0
    assert lead(key, IDLE) == [0.0, 0.0, 0.0]
    with pytest.raises(ValueError, match="9 finite numbers held, u, v"):
        checked_input([math.nan] * 9)


def test_the_pull_is_limited_and_soft_across_the_motion() -> None:
    far = pointer(0.0, 0.0), pointer(3.0, 4.0)
    assert np.linalg.norm(lead(*far)) == pytest.approx(45.0)
    along = lead(pointer(0.0, 0.0), pointer(0.1, 0.02), velocity=(0.2, 0.0, 0.0))
    assert along == pytest.approx([30.0, 0.0, 0.1 * 6.0])


def test_a_demonstration_holds_pose_and_wrench_of_the_hand_on_the_handle(
    small: Taught,
) -> None:
    poses, wrenches = small.recorded.poses, small.recorded.wrenches
    assert wrenches is not None
    angle = np.linalg.norm(poses[:, 3:], axis=1)
    assert math.radians(65.0) < angle[-1] < math.radians(80.0)
    # The hand is on the handle's arc, whatever the pointer did.
    radius = np.hypot(poses[:, 0], poses[:, 2] + 0.35)
    np.testing.assert_allclose(radius, 0.35, atol=0.004)
    # It pulls the door open: its power on the handle is positive.
    power = (wrenches[:-1, :3] * np.diff(poses[:, :3], axis=0)).sum()
    assert power > 0.1
    kept = small.demonstration.times
    assert 0.8 < small.recorded.times[-1] - (kept[-1] - kept[0]) < 2.5


@pytest.mark.bits
def test_the_inputs_alone_give_the_same_demonstration_bit_for_bit(
    small: Taught, tmp_path: Path
) -> None:
    TaughtSet(tmp_path / "set", {}).keep(small)
    (file,) = tmp_path.glob("set/*/*.npz")
    file.with_name("0001 (copy).npz").write_bytes(file.read_bytes())
    (read,) = read_taught(tmp_path / "set")
    again = replay(read)
    assert (again.name, again.door) == ("small", door_config("small"))
    for name in ("times", "poses", "wrenches"):
        ours, theirs = getattr(again.recorded, name), getattr(small.recorded, name)
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.slow
def test_gp_opens_doors_that_were_taught_and_others_gently(
    small: Taught, tmp_path: Path
) -> None:
    kept, doors = TaughtSet(tmp_path / "set", {}), ("small", "large")
    kept.keep(small)
    for seed, door in enumerate(2 * doors):
        if seed:
            kept.keep(taught(door_config(door), seed, door))
    given = load_demonstrations(tmp_path / "set")
    assert given.radii == 2 * (0.35, 0.65)
    asked = named_doors(["small", "0.5"])
    tasks = [episode_task(*one, policy="gp", seed=0) for one in asked.items()]
    make = learned_agents(tasks[0], policy_named("gp"), given)
    for log in open_together(tasks, [make() for _ in tasks]):
        numbers = episode_metrics(log)
        assert numbers["success"], log.door
        assert numbers["force_radial_peak"] < 5.0, log.door


def test_a_set_goes_on_where_it_was_left_and_mends_what_is_missing(
    small: Taught, tmp_path: Path
) -> None:
    folder = tmp_path / "set"
    TaughtSet(folder, {}).keep(small)
    again = dataclasses.replace(small, name="0.35")
    TaughtSet(folder, {}).keep(again)
    (folder / FILE).unlink()  # As if the process had been killed before writing it.
    assert len(TaughtSet(folder, {}).kept) == 2
    assert len(load_demonstrations(folder).demonstrations) == 2
    # It knows by which doors its skill is used.
    assert demonstrated_doors(folder) == ("small", "0.35")
    (tmp_path / "mine.txt").touch()
    with pytest.raises(ValueError, match="is no set of gplfd demos teach"):
        TaughtSet(tmp_path, {})


# --- Corrections

POLICY = np.array([0.02, 0.0, 0.0, 0.0, 0.1, 0.0])


class Held:
    """A policy that commands one pose."""

    def act(self, observation: dict[str, np.ndarray]) -> AgentStep:
        return AgentStep(action=POLICY, observed_phase=0.25)


def commands(door: DoorGeometry, *samples: np.ndarray) -> tuple[np.ndarray, Any]:
    """Commands while the hand rises slowly at the closed handle; the correction."""
    person = LeadingPerson(TOP)
    agent = LedAgent(as_agent(Held()), person)
    agent.inform(door)
    agent.reset({"ee_pose": np.zeros(6)})
    actions = []
    for number, sample in enumerate(samples):
        person.take(sample, 0.0)
        seen = {"ee_pose": np.eye(6)[1] * 1e-4 * number, "time": np.ones(1) * number}
        still = {"ee_twist": np.zeros(6), "wrench": np.ones(6)}
        actions.append(agent.act(seen | still).action)
    return np.array(actions), agent.correction(door="door", seed=0)


def test_the_policy_commands_until_a_person_takes_the_hand_and_after() -> None:
    door = DoorGeometry.of(DoorConfig(radius=0.5))
    taken = [pointer(0.0, 0.0), *[pointer(0.05, 0.0)] * 99]
    found, correction = commands(door, *[IDLE] * 10, *taken, *[IDLE] * 60)
    np.testing.assert_array_equal(found[:10], np.tile(POLICY, (10, 1)))
    # A spring of 300 N/m, rendered by a servo of 2000 N/m.
    np.testing.assert_allclose(found[60:110, 0], 0.05 * 300 / 2000, rtol=1e-3)
    # Taken and handed over in 0.4 s without a jump.
    assert np.abs(np.diff(found, axis=0)).max() < 0.1 * 1.9 * 0.01 / 0.4
    np.testing.assert_array_equal(found[149:], np.tile(POLICY, (21, 1)))
    assert np.flatnonzero(correction.led)[[0, -1]].tolist() == [10, 148]
    assert (correction.by, correction.phase) == ("person", 0.25)
    assert commands(door, *[IDLE] * 5)[1] is None


@pytest.mark.parametrize(("handle", "force"), [("bar", 34.0), ("lever", 58.0)])
def test_a_person_pulls_no_more_than_the_synthetic_corrector(
    handle: str, force: float
) -> None:
    latch = {} if handle == "bar" else {"handle": handle, "latch": "spring"}
    door = DoorGeometry.of(DoorConfig(radius=0.65, **latch))
    for taken in ([pointer(0.0, 0.0), *[pointer(9.0, 0.0)] * 60], [np.eye(9)[3]] * 200):
        found, _ = commands(door, *taken)
        assert 2000.0 * found[-1, 0] == pytest.approx(force, abs=0.05)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:sensor noise")
def test_a_person_s_correction_opens_the_door(tmp_path: Path) -> None:
    """At a flap that stays closed without it, as `test_correcting` shows."""
    gp, oven = skill_method("gp"), DOORS["oven"]
    shown = Teacher().standard_demonstrations(seed=0, like=oven)
    skill = gp.learn(TrainingInput(demonstrations=shown))
    stiff = oven.replaced({"radius": 0.36, "closer": {"preload": 4.5}})
    task = episode_task("flap", stiff, policy="gp", seed=0)
    store = CorrectedSkill(gp, skill, tmp_path / "better.npz")
    lesson = CorrectionLesson(task, store, "mouse", drawn=False)
    # Drag the hand ahead along the path, from 2 s on and up to 50 degrees.
    geometry = DoorGeometry.of(lesson.door)
    while lesson.state["time"] < 7.0:
        angle, ahead = np.radians(lesson.state["angle"]), lesson.state["time"] - 2.0
        sample = IDLE.copy()
        if ahead > 0.0 and angle < np.radians(50.0):
            point = geometry.hand_poses(max(angle, 0.0) + 0.5 * min(1.0, ahead))[:3]
            sample[:3] = 1.0, *lesson.view.place(point)
        lesson.step(sample)
    assert "You led the hand for" in lesson.result()
    store.keep(lesson.record())
    better = load_skill(tmp_path / "better.npz")
    assert open_watched(task, gp.follow(better)).success
    (kept,) = better.corrections
    assert (kept.by, kept.device, kept.door) == ("person", "mouse", "flap")
