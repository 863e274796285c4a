import math
import os
import sys
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from rerun.chunk import RrdReader
from scipy.spatial.transform import Rotation

from gplfd_env.spatial.se3 import handle_pose_on_arc
from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.episodes.metrics import share_of_bound
from gplfd_experiments.recording import colours
from gplfd_experiments.recording.episode import mean_radius, record_episode
from gplfd_experiments.recording.motion import (
    N_RINGS,
    N_SIDES,
    tube_triangles,
    tube_vertices,
)
from gplfd_experiments.recording.panels import (
    LEVELS,
    QUANTILE,
    SCALE,
    recent_mean,
    stages,
)
from gplfd_experiments.recording.scene import (
    drawn_scene,
    entity_of_body,
    moved_scene,
    task_frame,
    visual_geoms,
)
from gplfd_policies.demonstrations.demonstration import Demonstration

pytestmark = pytest.mark.slow


def packed(colour):
    return int.from_bytes((*colour, 255))


@pytest.fixture
def record(tmp_path, door_model, columns):
    def record(log):
        demonstrations = Teacher().demonstrate_doors(
            [0.35, 0.65], 1, rng=np.random.default_rng(0)
        )
        path = tmp_path / "episode.rrd"
        record_episode(path, log, door_model, demonstrations)
        return columns(RrdReader(path).stream())

    return record


def test_every_visible_geom_is_drawn_once_in_its_place_and_colour(
    record, make_log, door_model
):
    recording = record(make_log())
    assert sum(map(len, visual_geoms(door_model).values())) == 7
    leaf = "/world/scene/leaf"
    entities = {path for path in recording.entities if "/scene/" in path}
    assert entities == {"/world/scene/world", leaf, f"{leaf}/mesh_6"}
    axis = np.zeros(3)
    up, quaternion = np.array([0.0, 0.0, 1.0]), door_model.geom("bar").quat
    mujoco.mju_rotVecQuat(axis, up, quaternion)
    for component, expected in {
        "Boxes3D:half_sizes": [[0.02, 1.0, 0.25]],
        "Boxes3D:colors": [0x0000FFFF],  # of the material
        "Capsules3D:colors": [0xFF000080],  # of the geom, half transparent
        "Ellipsoids3D:half_sizes": [[0.02] * 3, [0.02, 0.03, 0.04]],
        # MuJoCo centres the capsule at (0, 0, R); Rerun's starts at its lower end.
        "Capsules3D:translations": [0.5 * up - 0.1 * axis],
    }.items():
        (drawn,) = recording[leaf, component][1]
        np.testing.assert_allclose(drawn, expected, atol=1e-6, err_msg=component)
    assert len(recording[f"{leaf}/mesh_6", "Mesh3D:triangle_indices"][1][0]) == 4
    # The floor is infinite: a thin box of 6 m below it.
    for component, expected in (
        ("Boxes3D:centers", [[0.0, 0.0, -0.005]]),
        ("Boxes3D:half_sizes", [[3.0, 3.0, 0.005]]),
    ):
        (drawn,) = recording["/world/scene/world", component][1]
        np.testing.assert_allclose(drawn, expected, atol=1e-6)


def test_leaf_in_the_view_from_above_ends_at_the_handle(record, make_log):
    log = make_log()
    recording, plan = record(log), "/world/task/plan"
    _, hinge = recording[plan, "Transform3D:translation"]
    _, leaf = recording[f"{plan}/leaf", "LineStrips3D:strips"]
    _, turns = recording[f"{plan}/leaf", "Transform3D:quaternion"]
    start, end = np.array(leaf[0][0])
    np.testing.assert_array_equal(start, 0.0)
    handle = hinge[0][0] + Rotation.from_quat(turns[-1][0]).apply(end)
    np.testing.assert_allclose(handle, log.opening.handle_pose[-1, :3], atol=1e-6)


def test_policy_tube_is_still_before_and_moves_after(record, make_log):
    log = make_log()
    recording = record(log)
    root = "/world/task"
    component = "Mesh3D:vertex_positions"
    before, (first,) = recording[f"{root}/policy_before", component]
    times, tubes = recording[f"{root}/policy_now", component]
    assert before is None
    np.testing.assert_allclose(times, log.forecasts.times)
    assert {len(tube) for tube in tubes} == {N_RINGS * N_SIDES}
    np.testing.assert_allclose(tubes[0], first)
    middle = N_RINGS // 2 * N_SIDES
    ring = slice(middle, middle + N_SIDES)
    width = [np.ptp(np.array(tube)[ring, 1]) for tube in tubes]
    assert width[1] < 0.5 * width[0]
    _, lines = recording[f"{root}/policy_now", "LineStrips3D:strips"]
    np.testing.assert_allclose(lines[1][0], log.forecasts.mean[1, :, :3], atol=1e-6)


def test_curves_and_bands_are_those_of_the_log(record, make_log):
    """A contract: by entity the names of the lines, and their values at every step."""
    ramp = 1e-3 * (np.arange(601) % 10)[:, None] * np.ones(6)
    acting = np.where(np.arange(601) < 200, 0.0, 1.0)
    mean = np.array(make_log().decisions.predicted_mean)
    mean[:100] = np.nan
    modes = {"mode": acting, "mode_probability": 0.5 + 0.4 * acting}
    log = make_log(predicted_mean=mean, std=ramp, **modes)
    # Of the demonstrated doors, of .35 and .65 m, the mean is a geometric one.
    size = 100.0 * log.radius / math.sqrt(0.35 * 0.65)
    turn = np.degrees(log.motion.ee_pose[:, 4])
    curves = {
        "angle/door": {"door": np.degrees(log.opening.door_angle)},
        "misfit/mode": {"active mode": acting, "its probability": 0.5 + 0.4 * acting},
        "uncertainty_raw/along/policy": {"along": 1e3 * ramp[:, 0]},
        "uncertainty_raw/across/policy": {"across": 1e3 * ramp[:, 2]},
        "stiffness/along/policy": {"along": 300.0},
        "turn/motion": {"true": turn, "hand": turn},
        "size/curves": {"policy now": 120.0, "true": size},
        # The log has the force of the door on the hand.
        "expected/force": {"measured": -2.0},
    }
    recording = record(log)
    for panel, lines in curves.items():
        (names,) = recording[f"/plots/{panel}", "SeriesLines:names"][1]
        assert names == list(lines)
        _, values = recording[f"/plots/{panel}", "Scalars:scalars"]
        columns = [np.broadcast_to(line, 601) for line in lines.values()]
        expected = np.stack(columns, axis=1)
        np.testing.assert_allclose(values, expected, rtol=0.02, err_msg=panel)
    # The first panel shows means over time, without the sawtooth of the values.
    _, smooth = recording["/plots/uncertainty/along/policy", "Scalars:scalars"]
    assert np.ptp(np.array(smooth)[100:, 0]) < 2.0 < np.ptp(1e3 * ramp)

    factor = np.exp(1.96 * log.decisions.path_size_std)
    width = 1.96 * log.decisions.expected_force_std[:, 0]
    bands = {
        "turn/belief": {
            "before": (None, math.degrees(1.96 * 0.03)),
            "policy now": (np.degrees(mean[:, 4]), math.degrees(1.96 * 0.004)),
        },
        "size/belief": {
            "±1.96 σ": (60.0 * (factor + 1 / factor), 60.0 * (factor - 1 / factor))
        },
        "expected/belief": {"expected": (5.0, width)},
    }
    for panel, lines in bands.items():
        (names,) = recording[f"/plots/{panel}", "Measurements:names"][1]
        assert names == list(lines)
        _, values = recording[f"/plots/{panel}", "Measurements:values"]
        _, variances = recording[f"/plots/{panel}", "Measurements:variances"]
        for line, (middle, half) in enumerate(lines.values()):
            std = np.sqrt(np.array(variances)[:, line])
            np.testing.assert_allclose(std, np.broadcast_to(half, 601), rtol=1e-4)
            if middle is not None:
                np.testing.assert_allclose(
                    np.array(values)[:, line], np.broadcast_to(middle, 601), rtol=1e-5
                )
    (page,) = recording["/about", "TextDocument:text"][1][0]
    for words in ("medium door", "`gp`", "**seed**: 3", "**modes**", "**panel 4**"):
        assert words in page


def test_policy_without_forecasts_or_predictions_can_be_recorded(record, make_log):
    unknown = ("predicted_mean", "predicted_std", "std", "std_rate", "stiffness")
    recording = record(
        make_log(
            **dict.fromkeys(unknown, np.full((601, 6), np.nan)),
            **dict.fromkeys(("forecast_mean", "forecast_std"), np.empty((0, 0, 6))),
            **dict.fromkeys(("forecast_times", "forecast_phases"), np.empty(0)),
            path_size=np.full(601, np.nan),
            expected_force=np.full((601, 3), np.nan),
            via_point=np.zeros(601, dtype=bool),
        )
    )
    paths = " ".join(recording.entities)
    for absent in ("policy_now", "belief", "/plots/stiffness", "/plots/size"):
        assert absent not in paths
    assert {"/plots/angle/door", "/world/task/true_arc"} <= recording.entities


def test_true_size_is_unknown_where_no_arcs_were_demonstrated():
    times = np.linspace(0.0, 1.0, 50)
    line = Demonstration(times=times, poses=np.outer(times, np.eye(6)[0]))
    for demonstrations in [], [line]:
        assert math.isnan(mean_radius(demonstrations))


def test_before_adaptation_is_the_first_forecast_at_the_observed_phase(make_log):
    log = make_log()
    mean, std = log.forecasts.first(log.decisions.observed_phase)
    arc = handle_pose_on_arc(0.5, math.radians(66.0) * 0.5)
    half = int(np.argmin(np.abs(log.decisions.observed_phase - 0.5)))
    np.testing.assert_allclose(mean[half], arc, atol=1e-3)
    np.testing.assert_allclose(std, 0.03)


def test_share_of_bound_is_one_on_the_bound(make_log):
    # The stiffness changes by 20; at -30 a turn of the frame would have it fall by 10.
    for margin, share in ((80.0, 0.2), (0.0, 1.0), (-30.0, 1.0)):
        log = make_log(stability_margin=np.full((601, 6), margin))
        np.testing.assert_allclose(share_of_bound(log), share)


def test_via_points_accumulate_where_they_are_apart(record, make_log):
    log = make_log()
    times, positions = record(log)["/world/task/hand/via_points", "Points3D:positions"]
    counts = [len(points) for points in positions]
    assert counts == list(range(1, len(counts) + 1))
    via_points = log.motion.ee_pose[log.decisions.via_point, :3]
    gaps = np.linalg.norm(via_points[:, None] - positions[-1], axis=2).min(axis=1)
    assert gaps.max() < 0.005  # less than a dot
    assert set(times.round(6)) <= set(log.times[log.decisions.via_point].round(6))


def test_trail_grows_with_the_hand(record, make_log):
    log = make_log()
    times, strips = record(log)["/world/task/hand/trail", "LineStrips3D:strips"]
    assert len(times) < 80
    for time, stretches in zip(times, strips, strict=True):
        row = round(time / log.dt)
        np.testing.assert_allclose(
            stretches[-1][-1], log.motion.ee_pose[row, :3], atol=1e-6
        )
    steps = np.linalg.norm(np.diff(log.motion.ee_pose[:, :3], axis=0), axis=1)
    start, end = np.array(strips[-1]).swapaxes(0, 1)
    np.testing.assert_array_equal(start[1:], end[:-1])
    length = np.linalg.norm(end - start, axis=1).sum()
    assert length == pytest.approx(steps.sum(), abs=0.015)


@pytest.mark.parametrize(
    ("failure", "most", "expected"),
    [
        ("", 1.5, {"grasp": 0.0, "open": 1.0, "hold": 60.0, "success": 85.9}),
        ("time_limit", 1.5, {"grasp": 0.0, "open": 1.0, "hold": 60.0, "failure": 85.9}),
        ("stalled", 0.0, {"stuck": 0.0, "failure": 0.0}),
        ("stalled", 0.6, {"grasp": 0.0, "open": 1.0, "stuck": 33.9, "failure": 34.4}),
    ],
)
def test_stages_begin_at_their_angles(make_log, failure, most, expected):
    opening = np.minimum(np.linspace(0.0, 1.5, 601), most)
    solved = np.zeros(601) if failure else make_log().opening.solved
    outcome = {"failure": failure, "success": not failure, "solved": solved}
    began = stages(make_log(door_angle=opening, **outcome))
    angles = {name: math.degrees(opening[row]) for row, name in began}
    assert list(angles) == list(expected)
    assert angles == pytest.approx(expected, abs=0.5)


def test_a_file_has_its_layout_and_few_chunks(record, make_log, tmp_path):
    # Time is spent per chunk, 0.1 ms each to make and to write.
    assert len(record(make_log()).chunks) <= 94
    reader = RrdReader(tmp_path / "episode.rrd")
    (blueprint,) = reader.blueprints()
    batches = {
        chunk.entity_path: chunk.to_record_batch()
        for chunk in reader.stream(store=blueprint)
    }
    origins = [
        batch.column("ViewBlueprint:space_origin").to_pylist()[0][0]
        for batch in batches.values()
        if "ViewBlueprint:space_origin" in batch.schema.names
    ]
    assert len(origins) == 24  # twenty of series, two 3-D, lanes and page
    # σ across the path is a tenth of σ along it: each has its own axis, without legend.
    assert {"/plots/uncertainty/along", "/plots/uncertainty/across"} < {*origins}
    legends = [
        batch.column("PlotLegend:visible").to_pylist()[0]
        for batch in batches.values()
        if "PlotLegend:visible" in batch.schema.names
    ]
    assert legends == [[False]] * 20


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
def test_a_full_disk_is_an_error_that_names_the_file(
    make_log, door_model, tmp_path, monkeypatch
):
    """Rerun's own thread for files hangs or ends there, by how much was written."""
    path = tmp_path / "episode.rrd"

    def full(self: Path, **_: Any) -> None:
        self.symlink_to("/dev/full")

    monkeypatch.setattr(Path, "touch", full)
    with pytest.raises(OSError, match="No space left") as caught:
        record_episode(path, make_log(), door_model, [])
    assert caught.value.filename == str(path)
    assert not [*tmp_path.iterdir()]


@pytest.mark.skipif(sys.platform != "linux", reason="counts threads in /proc")
def test_recordings_leave_no_threads_behind(record, make_log):
    record(make_log())
    before = len(os.listdir("/proc/self/task"))
    for _ in range(3):
        record(make_log())
    assert len(os.listdir("/proc/self/task")) <= before + 2


def test_colours_say_how_stiff_the_hand_is(record, make_log):
    """Half of the episode soft, half stiff; trail, tube, ball and lane agree."""
    stiffness = np.full((601, 6), 100.0)
    stiffness[300:] = 500.0
    log = make_log(stiffness=stiffness)
    recording = record(log)
    soft, stiff = (packed(SCALE[level]) for level in (100.0, 500.0))
    times, tints = recording["/world/task/hand/trail", "LineStrips3D:colors"]
    assert set(tints[np.flatnonzero(times < 3.0)[-1]]) == {soft}
    assert (tints[-1][0], tints[-1][-1]) == (soft, stiff)
    times, labels = recording["/world/task/hand/stiffness", "Points3D:labels"]
    assert (labels[0], labels[-1]) == (["100 N/m"], ["500 N/m"])
    _, tints = recording["/world/task/hand/stiffness", "Points3D:colors"]
    assert (tints[0], tints[-1]) == ([soft], [stiff])
    times, tubes = recording["/world/task/policy_now", "Mesh3D:albedo_factor"]
    opaque = [(tint[0] | 0xFF) for tint in tubes]
    assert opaque == [soft if time < 3.0 else stiff for time in times]
    times, states = recording["/stage/stiffness", "StateChange:state"]
    assert [state for (state,) in states] == list(LEVELS)
    assert times[1] == pytest.approx(3.0, abs=0.25)


def test_without_stiffness_and_uncertainty_colours_and_tube_are_plain(record, make_log):
    log = make_log(
        stiffness=np.full((601, 6), np.nan), forecast_std=np.full((3, 21, 6), np.nan)
    )
    recording = record(log)
    _, tints = recording["/world/task/hand/trail", "LineStrips3D:colors"]
    assert set(tints[-1]) == {packed(colours.HAND)}
    _, tubes = recording["/world/task/policy_now", "Mesh3D:albedo_factor"]
    assert {tint[0] | 0xFF for tint in tubes} == {packed(colours.ADAPTED)}
    _, tubes = recording["/world/task/policy_now", "Mesh3D:vertex_positions"]
    assert len(tubes) == 3
    assert np.isfinite(tubes).all()
    assert {"/stage/stiffness", "/world/task/hand/stiffness"}.isdisjoint(
        recording.entities
    )


def test_a_recent_mean_knows_no_future_and_no_missing_rows():
    values = np.random.default_rng(0).normal(size=(100, 2))
    values[:10] = np.nan
    values[40, 1] = np.nan
    whole = recent_mean(values, 0.01)
    np.testing.assert_array_equal(recent_mean(values[:60], 0.01), whole[:60])
    np.testing.assert_array_equal(np.isnan(whole), np.isnan(values))
    np.testing.assert_allclose(whole[50], np.nanmean(values[26:51], axis=0))
    np.testing.assert_allclose(whole[12], values[10:13].mean(axis=0))


FIXED = """
<mujoco><worldbody>
  <geom type="box" size="1 1 1" pos="0 0 -1"/>
  <body name="post" pos="1 2 3" quat="0.8 0 0 0.6">
    <geom type="box" size="0.1 0.1 0.1" pos="0.5 0 0"/>
    <site name="task_frame" pos="0.5 0 0" quat="0.6 0.8 0 0"/>
    <body name="slide" pos="0 0 1"><joint type="slide"/>
      <body name="hook" pos="0 1 0" quat="0.6 0 0.8 0">
        <body pos="0 0 1"><geom type="box" size="0.1 0.1 0.1" pos="0 0.5 0"/></body>
      </body>
    </body>
  </body>
</worldbody></mujoco>
"""


def test_geoms_of_fixed_bodies_are_drawn_where_their_carrier_has_them(columns):
    """The pose on the carrier, moved by the carrier's, is MuJoCo's own."""
    model = mujoco.MjModel.from_xml_string(FIXED)
    data = mujoco.MjData(model)
    data.qpos[0] = 0.3
    mujoco.mj_kinematics(model, data)
    slide = model.body("slide").id
    assert visual_geoms(model) == {0: [0, 1], slide: [2]}
    drawn = columns(drawn_scene(model))
    for body, geoms in visual_geoms(model).items():
        entity = entity_of_body(model, body)
        _, (centres,) = drawn[entity, "Boxes3D:centers"]
        _, (quaternions,) = drawn[entity, "Boxes3D:quaternions"]
        turn = data.xmat[body].reshape(3, 3)
        world = data.xpos[body] + np.array(centres) @ turn.T
        np.testing.assert_allclose(world, data.geom_xpos[geoms], atol=1e-6)
        turned = turn @ Rotation.from_quat(quaternions).as_matrix()
        matrices = data.geom_xmat[geoms].reshape(-1, 3, 3)
        np.testing.assert_allclose(turned, matrices, atol=1e-6)
    origin, rotation = task_frame(model)
    site = data.site("task_frame")
    np.testing.assert_allclose(origin, site.xpos)
    np.testing.assert_allclose(rotation.as_matrix().ravel(), site.xmat, atol=1e-12)


MESH = """
<mujoco><asset><mesh name="m" vertex="0 0 0  1 0 0  0 1 0  0 0 1"/></asset><worldbody>
  <body name="arm"><joint/><geom type="mesh" mesh="m"/></body></worldbody></mujoco>
"""


def test_a_body_of_meshes_alone_sends_no_empty_chunk():
    """Rerun drops such chunks with a warning each."""
    chunks = [*drawn_scene(mujoco.MjModel.from_xml_string(MESH))]
    assert [chunk.entity_path for chunk in chunks][1:] == ["/world/scene/arm/mesh_0"]


SLIDES = """
<mujoco><worldbody>
  <body name="a"><joint type="slide" axis="1 0 0"/><geom size="0.1"/></body>
  <body name="b"><joint type="slide" axis="0 1 0"/><geom size="0.1"/></body>
</worldbody></mujoco>
"""


def test_every_body_moves_by_its_own_joint(make_log, columns):
    """And between frames as in a video."""
    model = mujoco.MjModel.from_xml_string(SLIDES)
    log = make_log(qpos=np.outer(np.linspace(0.0, 1.0, 601), [1.0, 2.0]))
    moved = columns(moved_scene(model, log))
    for name, end in (("a", [1.0, 0.0, 0.0]), ("b", [0.0, 2.0, 0.0])):
        times, places = moved[f"/world/scene/{name}", "Transform3D:translation"]
        np.testing.assert_allclose([places[0][0], places[-1][0]], [[0.0] * 3, end])
        assert np.diff(times).max() <= 1.0 / 30.0


def test_tube_touches_the_ellipse_of_the_normal_quantile():
    """On a straight path along x the section has half axes 1.96 σ_z and 1.96 σ_y."""
    mean = np.outer(np.linspace(0.0, 1.0, 30), [1.0, 0.0, 0.0])
    vertices, normals = tube_vertices(mean, np.tile([9.0, 0.01, 0.02], (30, 1)))
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, rtol=1e-6)
    across = vertices / (QUANTILE * np.array([np.inf, 0.01, 0.02]))
    np.testing.assert_allclose(np.linalg.norm(across, axis=1), 1.0, rtol=1e-6)
    triangles = tube_triangles()
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    outward = np.sum(np.cross(b - a, c - a) * normals[triangles[:, 0]], axis=1)
    assert np.all(outward > 0.0) or np.all(outward < 0.0)


@pytest.mark.parametrize("height", [0.0, 1.0])
def test_tube_of_a_path_without_a_direction_is_finite(height):
    """One that stands still, and one straight upwards."""
    mean = np.outer(np.linspace(0.0, height, 5), [0.0, 1.0, 0.0])
    vertices, normals = tube_vertices(mean, np.zeros((5, 3)))
    assert np.isfinite(vertices).all()
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, rtol=1e-6)


def test_tube_of_a_path_that_waits_keeps_its_direction():
    """Noise at the end of a path along x does not turn the last section."""
    mean = np.zeros((40, 3))
    mean[:20, 0], mean[20:, 0] = np.linspace(0.0, 1.0, 20), 1.0
    mean[20:, 2] = 1e-4 * np.random.default_rng(0).normal(size=20)
    vertices, _ = tube_vertices(mean, np.full((40, 3), 0.1))
    last = vertices[-N_SIDES:]
    np.testing.assert_allclose(last[:, 0], 1.0, atol=1e-3)


def test_tubes_of_many_paths_are_those_of_each():
    rng = np.random.default_rng(0)
    means = np.cumsum(rng.normal(size=(3, 40, 3)), axis=1)
    means[1, 10:20] = means[1, 10]  # it waits for a while
    stds = rng.uniform(0.01, 0.02, means.shape)
    together = tube_vertices(means, stds)
    for number, (mean, std) in enumerate(zip(means, stds, strict=True)):
        for all_of_them, alone in zip(together, tube_vertices(mean, std), strict=True):
            np.testing.assert_allclose(all_of_them[number], alone)
