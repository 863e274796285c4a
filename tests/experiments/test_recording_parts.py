"""What a recording shows of handle, latch, closer, base, and from outside."""

import math

import mujoco
import numpy as np
import pytest

from gplfd_env.doors.config import DOORS, door_config
from gplfd_env.robot.mobile_base import BASE_JOINTS
from gplfd_env.robot.tiago import TIAGO_LIKE
from gplfd_env.scene.build import build_scene
from gplfd_experiments.recording.episode import episode_chunks, layout
from gplfd_experiments.recording.parts import (
    ARM,
    KINDS,
    LATCH,
    TITLES,
    bolt_states,
    disturbance_chunks,
    disturbances,
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
    above = "From above, hinge left"
    assert set(full) - set(plain) == {*TITLES.values(), above}
    assert len(full) == len(plain) + len(TITLES)


# --- Disturbances

SHIFT = 1e-4 * np.clip(np.arange(601.0) - 99.0, 0.0, 120.0)


def held(peak: float, first: int = 200, end: int = 450) -> np.ndarray:
    """A force that comes at once and fades."""
    rows = np.arange(601)
    inside = (rows >= first) & (rows < end)
    return np.where(inside, peak * (end - rows) / (end - first), 0.0)


@pytest.fixture
def outside(columns):
    return lambda log: columns(disturbance_chunks(log))


def test_the_curve_is_the_log_s(make_log, outside):
    chunks = outside(make_log(person_force=held(33.0)))
    curve = chunks["/plots/outside/person", "Scalars:scalars"][1]
    np.testing.assert_allclose(np.ravel(curve), held(33.0))
    assert not any("push" in entity for entity, _ in chunks)
    assert list(outside(make_log())) == []
    chunks = outside(make_log(base_shift=SHIFT))
    curve = chunks["/plots/outside/bump", "Scalars:scalars"][1]
    np.testing.assert_allclose(np.ravel(curve), 1e3 * SHIFT)  # mm


def test_a_ball_stands_above_the_hand_while_something_acts(make_log, outside):
    log = make_log(person_force=held(32.0))
    chunks, ball = outside(log), "/world/task/outside/person"
    rows = frames(log)
    labels = chunks[ball, "Points3D:labels"][1]
    acts = [bool(label) for label in labels]
    assert acts == (log.forces.person_force[rows] > 0.0).tolist()
    first = acts.index(True)
    assert labels[first] == [f"person {log.forces.person_force[rows[first]]:.0f} N"]
    place = chunks[ball, "Points3D:positions"][1][first][0]
    above = log.motion.ee_pose[rows[first], :3] + [0.0, 0.30, 0.0]
    np.testing.assert_allclose(place, above, atol=1e-6)
    # A quarter of the force is half the radius.
    radii = np.concatenate(chunks[ball, "Points3D:radii"][1])
    forces = log.forces.person_force[rows[acts]]
    np.testing.assert_allclose(radii / radii[0], np.sqrt(forces / forces[0]), rtol=1e-6)


def test_beginning_and_end_are_told(make_log, outside):
    log = make_log(person_force=held(33.0) + held(20.0, 500, 700))
    times, texts = outside(log)["/outside/log/person", "TextLog:text"]
    assert texts == [
        [KINDS["person"].begins],
        [f"{KINDS['person'].ends}: 33 N at most"],
        [KINDS["person"].begins],
    ]
    np.testing.assert_allclose(times, log.times[[200, 450, 500]])
    log = make_log(base_shift=SHIFT)
    times, texts = outside(log)["/outside/log/bump", "TextLog:text"]
    assert texts[1] == ["the base stops: 12 mm at most"]
    assert times[1] == pytest.approx(log.times[220])


@pytest.mark.parametrize(
    ("peak", "limits"), [(33.0, []), (69.0, []), (70.0, [140]), (150.0, [140, 280])]
)
def test_limits_are_drawn_only_near_them(make_log, peak, limits, outside):
    chunks = outside(make_log(person_force=held(peak)))
    drawn = [
        entity.rpartition("_")[2]
        for entity, component in chunks
        if "allowed" in entity and component == "Scalars:scalars"
    ]
    assert [int(limit) for limit in drawn] == limits


def test_a_policy_without_uncertainty_has_no_empty_panel(titles_of):
    titles = titles_of(layout(drawn=["/plots/angle/door", "/plots/stiffness/along/k"]))
    series = [title for title in titles if "[" in title]
    assert series == [
        "Door angle [deg], lines at 15, 30, 60",
        "2. Stiffness k along [N/m]",
    ]
    assert "Unsmoothed, rates" not in titles


def test_the_layout_has_room_only_for_what_happens(make_log, titles_of):
    plain, disturbed = (
        titles_of(layout([*disturbances(log)]))
        for log in (make_log(), make_log(person_force=held(33.0)))
    )
    assert set(disturbed) - set(plain) == {"From outside: person [N]", "From outside"}
