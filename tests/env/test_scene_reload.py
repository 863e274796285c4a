"""One model for every door: brought from door to door it is as if compiled for it."""

from operator import attrgetter
from typing import Any

import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from hypothesis import example, given, settings
from hypothesis import strategies as st
from mujoco.batch import MODEL_FIELDS
from numpy.testing import assert_allclose, assert_array_equal

import gplfd_env
from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.parts import Closer, Leaf, Lockset
from gplfd_env.doors.variation import Placement
from gplfd_env.robot.tiago import TIAGO_LIKE
from gplfd_env.scene.build import DOOR_FIELDS, build_scene, build_spec, load_scene
from gplfd_env.scene.door import structure_of

pytestmark = [pytest.mark.slow, pytest.mark.bits]

POSE, IMPEDANCE = gplfd_env.ENVIRONMENT_ID, gplfd_env.IMPEDANCE_ENVIRONMENT_ID

doors = st.builds(
    DoorConfig,
    radius=st.floats(0.30, 0.65),
    hinge_friction=st.floats(0.0, 5.0),
    hinge_damping=st.floats(0.0, 5.0),
    closer=st.builds(Closer, stiffness=st.floats(0, 5), preload=st.floats(0, 5)),
    panel_mass=st.floats(1.0, 100.0),
    handle_height=st.floats(0.70, 0.85),
    leaf=st.builds(Leaf, handle_standoff=st.floats(0.06, 0.12)),
)
placements = st.builds(
    Placement,
    base_x=st.floats(-0.02, 0.02),
    base_y=st.floats(-0.02, 0.02),
    base_yaw=st.floats(-0.05, 0.05),
    grasp_height=st.floats(-0.05, 0.05),
    grasp_depth=st.floats(-0.004, 0.004),
)
building_doors = st.builds(
    DoorConfig,
    handle=st.just("lever"),
    latch=st.just("spring"),
    swing=st.sampled_from(["pull", "push"]),
    hinge_side=st.sampled_from(["right", "left"]),
    radius=st.floats(0.40, 0.60),
    leaf=st.builds(
        Leaf, backset=st.floats(0.05, 0.07), thickness=st.floats(0.03, 0.05)
    ),
    stop_angle=st.floats(1.5, 2.5),
    panel_mass=st.floats(5.0, 60.0),
    seal=st.floats(0.1, 3.0),
    closer=st.builds(
        Closer,
        boost=st.floats(0.0, 10.0),
        friction=st.floats(0.0, 5.0),
        closing_damping=st.floats(0.0, 80.0),
        backcheck_damping=st.floats(0.0, 80.0),
        backcheck_angle=st.floats(1.0, 1.4),
    ),
    lockset=st.builds(
        Lockset,
        handle_length=st.floats(0.105, 0.125),
        handle_preload=st.floats(0.3, 0.7),
        handle_travel=st.floats(0.65, 0.96),
        dead_travel=st.floats(0.0, 0.1),
        bolt_throw=st.floats(0.012, 0.019),
        bolt_preload=st.floats(2.5, 8.0),
    ),
)
scenes = st.tuples(doors, placements)
PLAIN = DoorConfig(), Placement()
ODD = (
    DoorConfig(radius=0.31, panel_mass=97, handle_height=0.71, closer={"preload": 4}),
    Placement(base_x=0.02, base_yaw=-0.05, grasp_height=0.03, grasp_depth=0.003),
)


def fields(model: mujoco.MjModel) -> dict[str, Any]:
    """Return everything in a model, options and statistics included, by name."""
    return {name: np.array(attrgetter(name)(model)) for name in sorted(MODEL_FIELDS)}


def assert_equal_bits(first: dict[str, Any], second: dict[str, Any]) -> None:
    assert first.keys() == second.keys()
    for name, value in second.items():
        assert_array_equal(first[name], value, err_msg=name)


def assert_shared(first: dict[str, Any], second: dict[str, Any]) -> None:
    """A batch of both doors may share all other fields of their models."""
    differ = {x for x in first if not np.array_equal(first[x], second[x])}
    assert differ <= {*DOOR_FIELDS}


@settings(max_examples=6)
@pytest.mark.parametrize("base", ["fixed", "mobile"])
@given(first=scenes, second=scenes)
@example(first=ODD, second=PLAIN)
@example(first=PLAIN, second=ODD)
def test_a_scene_does_not_remember_the_one_before(base, first, second):
    model = build_scene(first[0], placement=first[1], robot=TIAGO_LIKE.on(base))
    before, data = fields(model), mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_step(model, data, nstep=3)
    load_scene(model, data, second[0], placement=second[1], robot=TIAGO_LIKE.on(base))
    direct = build_scene(second[0], placement=second[1], robot=TIAGO_LIKE.on(base))
    assert_equal_bits(fields(model), fields(direct))
    assert_shared(before, fields(model))


@settings(max_examples=10)
@given(first=building_doors, second=building_doors)
def test_a_building_door_is_not_remembered_and_as_compiled(first, second):
    """To 1e-9 of the largest entry of a field; but for what is settled later.

    The grasp, its keyframe and what follows from it, and dampers by compiled inertia.
    """
    model = build_scene(first)
    before = fields(model)
    load_scene(model, mujoco.MjData(model), second)
    values = fields(model)
    assert_shared(before, values)
    assert_equal_bits(values, fields(build_scene(second)))
    kind = "pose", structure_of(second), TIAGO_LIKE
    compiled = build_spec(second, "contact", Placement(), *kind).compile()
    settled = {"key_qpos", "key_ctrl", "qpos_spring"}
    settled |= {"tendon_solref_lim", "body_iquat", "tendon_range"}
    for name, expected in fields(compiled).items():
        if name not in settled and expected.dtype.kind == "f":
            atol = 1e-9 * np.abs(expected).max(initial=1e-12)
            assert_allclose(values[name], expected, rtol=0, atol=atol, err_msg=name)


HEAVY = {"preset": "heavy", "panel_mass": 30.0}
LEVER = {"handle": "lever", "latch": "spring", "radius": 0.53}
EVERYTHING = {
    "push": {"along": (5.0, 9.0), "upward": 4.0, "start_time": 0.05},
    "person": {"start_time": 0.02, "duration": 0.1, "on": "hand"},
    "stop": {"angle": 0.02, "duration": 0.1},
    "bump": {"forward": (-0.01, 0.01), "left": 0.004, "duration": 0.2},
    "breakaway": {"stiction": 2.0, "seal": 1.0},
}


@pytest.mark.parametrize(
    ("id", "start", "door", "circumstances"),
    [
        (POSE, "grasped", HEAVY, {}),
        (POSE, "grasped", HEAVY, {"randomization": "hard"}),
        (POSE, "approach", LEVER, {}),
        (POSE, "grasped", LEVER, {"disturbance": EVERYTHING}),
        (IMPEDANCE, "grasped", HEAVY, {"randomization": "hard"}),
        (IMPEDANCE, "grasped", "medium", {"disturbance": EVERYTHING}),
    ],
)
def test_an_episode_does_not_depend_on_those_before_it(
    id, start, door, circumstances, make_env
):
    """Same seed after other doors, standoffs, forces and actions: same numbers.

    The actions are drawn from the whole space: under impedance control the gains of
    the last one must not reach into the next episode.
    """
    shared = {"id": id, "start": start}
    used = make_env("small", **shared, disturbance=EVERYTHING)
    fresh = make_env(door, **shared, **circumstances)
    used.action_space.seed(1)
    others = [(0.3, "hard"), (0.52, {"panel_mass": (5.0, 60.0)}), (door, "none")]
    for seed, (other, varied) in enumerate(others):
        used.reset(seed=seed, options={"randomization": varied, "door": other})
        for _ in range(5):
            used.step(used.action_space.sample())
        used.data.xfrc_applied[:] = 3.0
    drawn = {"randomization": "none", "disturbance": "none", **circumstances}
    options = {"door": door, **drawn}
    again = used.reset(seed=7, options=options)
    assert data_equivalence(again, fresh.reset(seed=7), exact=True)
    assert used.variation == fresh.variation
    for _ in range(20):
        action = used.action_space.sample()
        assert data_equivalence(used.step(action), fresh.step(action), exact=True)
    # The choice lasts until the next one.
    assert data_equivalence(used.reset(), fresh.reset(), exact=True)
    assert options == {"door": door, **drawn}, "the caller's own"
