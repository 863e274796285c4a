"""What a recording shows of handle, latch, closer and base."""

import math

import mujoco
import numpy as np
import pytest

from gplfd_env.doors.config import DOORS, door_config
from gplfd_env.robot.mobile_base import BASE_JOINTS
from gplfd_env.robot.tiago import TIAGO_LIKE
from gplfd_env.scene.build import build_scene
from gplfd_experiments.recording.episode import episode_chunks
from gplfd_experiments.recording.layout import layout
from gplfd_experiments.recording.parts import (
    ARM,
    LATCH,
    TITLES,
    bolt_states,
    mechanism_of,
)
from gplfd_experiments.recording.stream import frames

ROWS = np.arange(601)
TURN = 0.8 * np.clip(ROWS / 100.0, 0.0, 1.0) * (ROWS < 400)
BOLT = 0.0127 * np.clip(ROWS / 100.0, 0.0, 1.0) * (ROWS < 400)
TORQUE = 20.0 + 1e-2 * ROWS


@pytest.fixture(scope="module")
def model():
    return build_scene(DOORS["heavy-fire"], robot=TIAGO_LIKE.on("mobile"))


@pytest.fixture
def log(make_log, model):
    """A handle that is turned in 1 s and let go after 4 s, before a base that backs."""
    qpos = np.tile(model.key_qpos[0], (601, 1))
    for joint, values in (
        ("handle", TURN),
        ("bolt", BOLT),
        (BASE_JOINTS[0], -1e-3 * ROWS),
        (BASE_JOINTS[2], 1e-4 * ROWS),
        ("hinge", 2e-3 * ROWS),
    ):
        qpos[:, model.joint(joint).qposadr[0]] = values
    door = DOORS["heavy-fire"].as_dict()
    return make_log(qpos=qpos, door_config=door, closer_torque=TORQUE)


@pytest.fixture
def shown(columns):
    return lambda log, model: columns(episode_chunks(log, model, []))


def test_nothing_is_made_of_a_plain_bar_door(make_log, door_model, shown):
    entities = {entity for entity, _ in shown(make_log(), door_model)}
    assert not any(f"/plots/{name}/" in path for path in entities for name in TITLES)
    assert not {LATCH, ARM} & entities


@pytest.mark.parametrize(
    ("door", "base", "parts"),
    [
        ("medium", "fixed", ()),
        ("heavy", "fixed", ("closer",)),
        ("cabinet", "mobile", ("closer", "base")),
        ("room-834", "mobile", ("handle", "latch", "closer", "base")),
        ({"handle": "knob"}, "fixed", ("handle",)),
    ],
)
def test_only_existing_parts_are_shown(door, base, parts):
    config = door_config(door)
    model = build_scene(config, robot=TIAGO_LIKE.on(base))
    assert mechanism_of(model, config) == parts


def test_curves_are_the_log_s_in_the_units_of_the_titles(log, model, shown):
    chunks = shown(log, model)
    curves = {"handle": np.degrees(TURN), "latch": 1e3 * BOLT, "closer": TORQUE}
    for name, values in curves.items():
        curve = chunks[f"/plots/{name}/motion", "Scalars:scalars"][1]
        np.testing.assert_allclose(np.ravel(curve), values, err_msg=name)
    base = np.array(chunks["/plots/base/motion", "Scalars:scalars"][1])
    left = model.key_qpos[0, model.joint(BASE_JOINTS[1]).qposadr[0]]
    expected = np.column_stack([-1e-3 * ROWS, np.full(601, left), 1e-4 * ROWS])
    np.testing.assert_allclose(base, expected)


def test_the_bolt_is_held_back_where_the_door_is_free(log, model, shown):
    """3 mm stand out at the most: 9.7 of 12.7 mm are drawn in after 0.77 s."""
    states = bolt_states(log, model)
    free = math.ceil(100.0 * 9.7 / 12.7)
    expected = [(0, "bolt thrown"), (free, "bolt held back"), (400, "bolt thrown")]
    assert states == expected
    lane = shown(log, model)[LATCH, "StateChange:state"][1]
    assert [state for (state,) in lane] == [state for _, state in expected]


def test_the_arm_joins_box_and_frame_in_every_frame(log, model, shown):
    rows, strips = frames(log), shown(log, model)[ARM, "LineStrips3D:strips"][1]
    data = mujoco.MjData(model)
    assert len(strips) == rows.size
    for frame in (0, -1):
        data.qpos[:] = log.motion.qpos[rows[frame]]
        mujoco.mj_kinematics(model, data)
        ends = [data.site(f"closer_{end}").xpos for end in ("spindle", "foot")]
        np.testing.assert_allclose(strips[frame][0], ends, atol=1e-6)
    plain = build_scene(DOORS["room-834"], robot=TIAGO_LIKE.on("mobile"))
    assert (ARM, "LineStrips3D:strips") not in shown(log, plain)


@pytest.mark.parametrize("swing", ["pull", "push"])
@pytest.mark.parametrize("hinge_side", ["right", "left"])
def test_the_true_arc_is_that_of_the_model_s_handle(make_log, swing, hinge_side):
    """Both ways, both sides, at the place of a lever that is held."""
    door = door_config({"preset": "room-709", "swing": swing, "hinge_side": hinge_side})
    model = build_scene(door, robot=TIAGO_LIKE.on("mobile"))
    log = make_log(door_config=door.as_dict(), qpos=np.zeros((601, model.nq)))
    arc = next(
        chunk.to_record_batch().column("LineStrips3D:strips").to_pylist()[0][0]
        for chunk in episode_chunks(log, model, [])
        if chunk.entity_path == "/world/task/true_arc"
    )
    data = mujoco.MjData(model)
    data.joint("hinge").qpos = math.radians(60.0)
    mujoco.mj_kinematics(model, data)
    task = data.site("task_frame")
    seen = data.site("handle").xpos - task.xpos
    expected = task.xmat.reshape(3, 3).T @ seen
    np.testing.assert_allclose(arc[60], expected, atol=1e-5)


def test_the_layout_has_room_for_what_there_is_and_is_mirrored(titles_of, log):
    assert log.config == DOORS["heavy-fire"]
    plain, full = titles_of(layout()), titles_of(layout((), tuple(TITLES), "left"))
    above = "From above: door at the top, hinge left"
    assert set(full) - set(plain) == {*TITLES.values(), above}
    assert len(full) == len(plain) + len(TITLES)
