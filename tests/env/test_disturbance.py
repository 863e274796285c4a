"""What happens from outside: pushes, people, stops, a moved base, a stuck hinge."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.integrate import solve_ivp

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.disturbance import Disturbance, Person
from gplfd_env.robot.placement import task_rotation_w
from gplfd_env.robot.tiago import TIAGO_LIKE
from gplfd_env.task.intervention import PersonHand

pytestmark = pytest.mark.slow

REST = np.zeros(6)


def swing(
    person: Person, radius: float, angles: np.ndarray, slips: Any = 0.0
) -> tuple[Any, np.ndarray]:
    """Move what a person touches; return the person's hand and the mean forces."""
    hand = PersonHand(person, radius)
    times = CONTROL_PERIOD * np.arange(angles.size)
    moved = np.broadcast(times, angles, slips)
    return hand, np.array([hand.resistance(*each) for each in moved])


def test_a_held_hand_follows_its_equation_of_motion():
    """Against SciPy's integration of the same linear equation, at constant speed."""
    radius, rate = 0.5, 0.3
    person = Person(on="door", duration=1000.0, start_angle=1e-6)
    angles = rate * CONTROL_PERIOD * np.arange(150)
    hand, force = swing(person, radius, angles)
    assert force[0] == 0.0
    speed = radius * rate

    def motion(t: float, state: np.ndarray) -> list[float]:
        x, v, _ = state
        contact = 75e3 * (speed * t - x) + 80.0 * (speed - v)
        return [v, (contact - 1000.0 * x - 50.0 * v) / 0.6, contact]

    times = CONTROL_PERIOD * np.arange(angles.size)
    begin = [0.0, speed, 0.0]
    exact = solve_ivp(
        motion, (0.0, times[-1]), begin, "LSODA", times, rtol=1e-10, atol=1e-12
    )
    mean = np.diff(exact.y[2]) / CONTROL_PERIOD
    assert_allclose(force[1:], mean, atol=0.01 * mean.max())
    assert hand.energy == pytest.approx(exact.y[2, -1] * speed, rel=2e-3)


def test_a_hand_in_the_way_is_struck_like_a_free_mass():
    """Without arm and damping: peak v √(k m), and it flies off at twice the speed."""
    speed, mass, stiffness = 0.2, 0.6, 75e3
    person = Person(
        on="door", one_sided=True, start_angle=0.1015, arm_stiffness=0.0,
        arm_damping=0.0, contact_damping=0.0,
    )  # fmt: skip
    angles = speed * CONTROL_PERIOD * np.arange(1, 60)
    hand = PersonHand(person, 1.0)
    peaks, impulse = [], 0.0
    for step, angle in enumerate(angles):
        impulse += CONTROL_PERIOD * hand.resistance(step * CONTROL_PERIOD, angle, 0.0)
        peaks.append(hand.peak)
    assert max(peaks) == pytest.approx(speed * math.sqrt(stiffness * mass), rel=0.02)
    assert impulse == pytest.approx(2 * mass * speed, rel=0.02)
    assert np.count_nonzero(peaks) <= 3, "contact lasts π √(m/k) = 9 ms"
    assert hand.energy == pytest.approx(impulse * speed, rel=1e-9)


def test_who_stands_in_the_way_never_pulls():
    angles = 0.3 + 0.1 * np.sin(np.linspace(-1.5, 8.0, 400))
    person = Person(on="door", one_sided=True, start_angle=0.3, duration=1000.0)
    _, force = swing(person, 0.5, angles)
    assert force.max() > 10.0
    assert force.min() == 0.0
    assert_array_equal(force[angles < 0.29], 0.0)
    # Nor by its damping, when what is 0.1 mm in reach goes away: 7.5 N against 20 N.
    sticky = dataclasses.replace(person, contact_damping=400.0, hand_mass=5.0)
    assert PersonHand(sticky, 0.5)._swing(1e-4, -0.05) == 0.0
    assert PersonHand(sticky, 0.5)._swing(1e-4, 0.0) > 0.0


def test_a_person_lets_go_and_slip_counts_for_the_hand_alone():
    angles = 0.2 * CONTROL_PERIOD * np.arange(200)
    _, force = swing(Person(start_angle=0.1, duration=0.5), 0.5, angles)
    held = np.flatnonzero(force)
    assert held[0] == 50
    assert held[-1] - held[0] == 49
    slips = np.minimum(np.arange(50) * 2e-4, 0.004)
    for on, expected in (("hand", 1000.0 * 0.004), ("door", 0.0)):
        # It takes hold at the first of these, going along.
        _, force = swing(Person(on=on), 0.5, np.full(50, 0.3), slips)
        assert np.mean(force[-10:]) == pytest.approx(expected, abs=0.35)


@pytest.fixture
def free_door(start_env: Callable, release_handle: Callable) -> Callable[[Any], Any]:
    """Return a function: an environment whose door swings freely, out of the hand."""

    def start(disturbance: Any) -> Any:
        door = {"hinge_friction": 0.0, "hinge_damping": 0.0}
        env = start_env(door, disturbance=disturbance)
        release_handle(env)
        return env

    return start


def told(env: Any, actions: Any, *names: str) -> list[np.ndarray]:
    """Return entries of the infos of steps, one array for each name."""
    infos = [env.step(action)[-1] for action in actions]
    return [np.array([info[name] for info in infos]) for name in names]


@pytest.mark.parametrize(
    ("profile", "share"), [("half_sine", 2 / math.pi), ("constant", 1)]
)
def test_a_push_on_the_door_gives_it_its_impulse(profile, share, free_door):
    push = {"on": "door", "along": 10.0, "duration": 0.2, "profile": profile}
    env = free_door({"push": {**push, "start_time": 0.05}})
    force, speed = told(env, 30 * [REST], "push_force", "door_velocity")
    mass = np.zeros((env.model.nv, env.model.nv))
    mujoco.mj_fullM(env.model, env.data, mass)
    impulse = share * 10.0 * 0.2
    assert speed[-1] == pytest.approx(impulse * 0.5 / mass[-1, -1], rel=0.01)
    assert_array_equal(np.flatnonzero(force), np.arange(5, 25))


@pytest.mark.parametrize("axis", ["along", "upward", "outward"])
@pytest.mark.parametrize("on", ["hand", "forearm"])
def test_a_push_moves_a_free_hand_against_its_servo(on, axis, free_door):
    push = {"on": on, axis: 15.0, "duration": 10.0, "profile": "constant"}
    env = free_door({"push": push})
    for _ in range(150):
        observation, *_ = env.step(REST)
    moved = observation["ee_pose"][["along", "upward", "outward"].index(axis)]
    # 15 N against 2000 N/m; the posture's spring and the lever to the hand take some.
    low = 0.0055 if on == "hand" else 0.001
    assert low < moved < 0.0085


@pytest.mark.parametrize("on", ["hand", "door"])
def test_a_person_holds_the_opening_door_back(on, start_env, arc_commands):
    person = {"on": on, "start_angle": 0.2, "duration": 0.8, "arm_stiffness": 300.0}
    env, free = start_env(disturbance={"person": person}), start_env()
    commands = arc_commands(0.5)[:950]
    angle, force, energy, success = told(
        env, commands, "door_angle", "person_force", "person_energy", "success"
    )
    (unheld_angle,) = told(free, commands, "door_angle")
    held = force > 0.0
    assert success[-1]
    assert held.sum() == 80
    assert angle[held][0] >= 0.2
    assert np.all(angle[~held & (angle < 0.2)] == unheld_angle[~held & (angle < 0.2)])
    lag = (unheld_angle - angle)[held][-1]
    assert 0.005 < lag < 0.1
    # In the end mostly the arm's spring: k_a times the arc since the hold began.
    stretched = 0.5 * (angle[held][-1] - 0.2)
    assert force[held][-1] == pytest.approx(300.0 * stretched, rel=0.3)
    assert energy[-1] == pytest.approx(150.0 * stretched**2, rel=0.5)
    assert energy[-1] > 150.0 * 0.9 * stretched**2
    assert np.abs(angle[-20:] - unheld_angle[-20:]).max() < 0.01


def test_a_stop_bears_the_pull_and_gives_way(start_env):
    env = start_env(disturbance={"stop": {"angle": 0.1, "duration": 1.5}})
    pulls = np.zeros((400, 6))
    pulls[:, 0] = np.minimum(0.0002 * np.arange(400), 0.07)
    angle, stop, pull = told(env, pulls, "door_angle", "stop_force", "force_tangential")
    touched = int(np.argmax(angle >= 0.1 - math.radians(0.5)))
    blocked = slice(touched + 50, touched + 150)
    assert np.abs(angle[blocked] - 0.1).max() < math.radians(0.5)
    # What is left of the pull once the hinge's friction of 0.5 N m bears its part.
    assert_allclose(stop[blocked], pull[blocked] - 1.0, atol=1.2)
    assert stop[blocked][-1] > 5.0
    assert_array_equal(stop[touched + 152 :], 0.0)
    assert angle[-1] > angle[blocked].max() + 0.004


def test_a_locked_door_stays_closed(make_env):
    """The next episode's door is what its own disturbance says."""
    env = make_env(disturbance="locked")
    pulls = 100 * [np.array([0.008, 0, 0, 0, 0, 0])]
    for disturbance, locked in (("locked", True), ("none", False)):
        env.reset(seed=0, options={"disturbance": disturbance})
        angle, stop = told(env, pulls, "door_angle", "stop_force")
        assert (abs(angle[-1]) < math.radians(0.5)) == locked
        assert (stop[-1] > 10.0) == locked


def test_a_bumped_robot_misjudges_its_own_frame(free_door):
    bump = {"forward": 0.02, "left": -0.01, "start_time": 0.1, "duration": 0.2}
    env = free_door({"bump": bump})
    shift = task_rotation_w(DoorConfig(), TIAGO_LIKE).T @ [0.02, -0.01, 0.0]
    handle, twist = [], []
    for _ in range(150):
        observation, *_, info = env.step(REST)
        handle.append(info["handle_pose"][:3])
        twist.append(observation["ee_twist"][:3])
    # It still takes itself to be where it began; truly it has moved with its base.
    assert_allclose(observation["ee_pose"][:3], 0.0, atol=5e-4)
    assert_allclose(env._sensed[env._episode.reader.ee_pose][:3], shift, atol=5e-4)
    assert_allclose(handle[5], 0.0, atol=1e-6)
    assert_allclose(handle[-1], -shift, atol=1e-6)
    assert info["base_shift"] == pytest.approx(np.hypot(0.02, 0.01))
    assert_allclose(np.sum(twist, axis=0) * CONTROL_PERIOD, 0.0, atol=1e-3)


def test_a_stuck_hinge_breaks_away_once(start_env):
    """Stiction 4 N m on a radius of 0.5 m: 8 N more than the 1 N of friction."""
    env = start_env(disturbance={"breakaway": {"stiction": 4.0}})
    pulls = np.zeros((300, 6))
    pulls[:, 0] = 0.00005 * np.arange(300)
    angle, force = told(env, pulls, "door_angle", "force_tangential")
    moved = int(np.argmax(angle > math.radians(0.5)))
    assert force[:moved].max() == pytest.approx(9.0, abs=1.0)
    assert force[-50:].max() < 3.0
    assert env.model.joint("hinge").frictionloss[0] == 0.5
    env.reset()
    env.step(REST)
    assert env.model.joint("hinge").frictionloss[0] == 4.5, "and again next time"


def test_ranges_of_disturbances_are_drawn_evenly():
    disturbance = Disturbance(push={"along": (5.0, 15.0), "outward": 3.0})
    rngs = np.random.default_rng(0).spawn(400)
    drawn = [disturbance.drawn(rng).push for rng in rngs]
    along = np.sort([push.along for push in drawn])
    assert_allclose(along, np.linspace(5.0, 15.0, 400), atol=0.7)
    assert {push.outward for push in drawn} == {3.0}
