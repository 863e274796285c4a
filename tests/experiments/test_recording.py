import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pyarrow as pa
import pytest
import rerun as rr
from rerun.chunk import RrdReader

from experiments.episode_log import EpisodeLog
from experiments.recording import record_episode
from experiments.recording.layout import _policy_views
from experiments.recording.panels import before_adaptation, share_of_bound
from experiments.recording.scene import visual_geoms
from experiments.recording.stages import stages
from experiments.recording.tube import (
    N_RINGS,
    N_SIDES,
    QUANTILE,
    tube_triangles,
    tube_vertices,
)
from experiments.teacher import Teacher
from gplfd_env.task import handle_pose_on_arc

MakeLog = Callable[..., EpisodeLog]


@pytest.fixture(autouse=True)
def strict_rerun(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RERUN_STRICT", "1")
    rr.set_strict_mode(True)


class Recording:
    """The columns of one .rrd by entity and component."""

    def __init__(self, path: Path) -> None:
        self.reader = RrdReader(path)
        self.chunks = list(self.reader.stream())

    @property
    def entities(self) -> set[str]:
        return {chunk.entity_path for chunk in self.chunks}

    def column(self, entity: str, component: str) -> tuple[Any, list[Any]]:
        """Times [s] (None when static) and values of one component, in order."""
        for chunk in self.chunks:
            batch = chunk.to_record_batch()
            if chunk.entity_path != entity or component not in batch.schema.names:
                continue
            values = batch.column(component).to_pylist()
            if chunk.is_static:
                return None, values
            times = batch.column("sim_time").cast(pa.int64()).to_numpy() / 1e9
            return times, values
        raise AssertionError(f"{entity} has no {component}: {sorted(self.entities)}")


@pytest.fixture
def record(
    tmp_path: Path, door_model: mujoco.MjModel
) -> Callable[[EpisodeLog], Recording]:
    def record(log: EpisodeLog) -> Recording:
        demonstrations = Teacher().demonstrate_doors(
            [0.35, 0.65], 1, rng=np.random.default_rng(0)
        )
        path = tmp_path / "episode.rrd"
        record_episode(path, log, door_model, demonstrations)
        return Recording(path)

    return record


def test_every_visible_geom_is_drawn_once_in_its_place_and_colour(
    record: Callable[[EpisodeLog], Recording],
    make_log: MakeLog,
    door_model: mujoco.MjModel,
) -> None:
    recording = record(make_log())
    assert sum(map(len, visual_geoms(door_model).values())) == 7
    leaf = "/world/scene/leaf"
    drawn = {path for path in recording.entities if path.startswith(leaf + "/")}
    kinds = ("boxes", "capsules", "spheres", "ellipsoids", "cylinders", "mesh_6")
    assert drawn == {f"{leaf}/{kind}" for kind in kinds}
    _, sizes = recording.column(f"{leaf}/boxes", "Boxes3D:half_sizes")
    np.testing.assert_allclose(sizes[0], [[0.02, 1.0, 0.25]], atol=1e-6)
    _, colours = recording.column(f"{leaf}/boxes", "Boxes3D:colors")
    assert colours == [[0x0000FFFF]]  # of the material
    _, colours = recording.column(f"{leaf}/capsules", "Capsules3D:colors")
    assert colours == [[0xFF000080]]  # of the geom, half transparent
    # MuJoCo centres the capsule at (0, 0, R); Rerun's starts at its lower end.
    _, start = recording.column(f"{leaf}/capsules", "Capsules3D:translations")
    quaternion = door_model.geom("bar").quat
    axis = np.zeros(3)
    mujoco.mju_rotVecQuat(axis, np.array([0.0, 0.0, 1.0]), quaternion)
    np.testing.assert_allclose(start[0][0], [0.0, 0.0, 0.5] - 0.1 * axis, atol=1e-6)
    _, faces = recording.column(f"{leaf}/mesh_6", "Mesh3D:triangle_indices")
    assert len(faces[0]) == 4


def test_bodies_move_as_forward_kinematics_says(
    record: Callable[[EpisodeLog], Recording],
    make_log: MakeLog,
    door_model: mujoco.MjModel,
) -> None:
    log = make_log()
    recording = record(log)
    leaf = "/world/scene/leaf"
    times, quaternions = recording.column(leaf, "Transform3D:quaternion")
    assert times[0] == 0.0
    assert times[-1] == log.times[-1]
    data = mujoco.MjData(door_model)
    data.qpos[:] = log.qpos[-1]
    mujoco.mj_kinematics(door_model, data)
    w, x, y, z = data.body("leaf").xquat
    np.testing.assert_allclose(quaternions[-1][0], [x, y, z, w], atol=1e-6)
    still, _ = recording.column("/world/scene/world", "Transform3D:quaternion")
    assert still is None


def test_log_of_another_model_is_refused(
    record: Callable[[EpisodeLog], Recording], make_log: MakeLog, tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match=r"has 2 generalised positions .* model has 1"):
        record(make_log(qpos=np.zeros((601, 2))))
    assert list(tmp_path.iterdir()) == []


def test_handle_arc_ends_where_the_handle_is_in_the_world(
    record: Callable[[EpisodeLog], Recording],
    make_log: MakeLog,
    door_model: mujoco.MjModel,
) -> None:
    """The task frame maps the logged arc onto MuJoCo's own handle site."""
    log = make_log()
    recording = record(log)
    task = "/world/task"
    _, origin = recording.column(task, "Transform3D:translation")
    _, rotation = recording.column(task, "Transform3D:quaternion")
    x, y, z, w = rotation[0][0]
    matrix = np.zeros(9)
    mujoco.mju_quat2Mat(matrix, np.array([w, x, y, z]))
    data = mujoco.MjData(door_model)
    data.qpos[0] = math.radians(60.0)
    mujoco.mj_kinematics(door_model, data)
    _, strips = recording.column(f"{task}/true_arc", "LineStrips3D:strips")
    at_60_degrees = matrix.reshape(3, 3) @ strips[0][0][60] + origin[0][0]
    np.testing.assert_allclose(at_60_degrees, data.site("handle").xpos, atol=1e-6)


def test_policy_tube_is_still_before_and_moves_after(
    record: Callable[[EpisodeLog], Recording], make_log: MakeLog
) -> None:
    log = make_log()
    recording = record(log)
    root = "/world/task"
    component = "Mesh3D:vertex_positions"
    before, (first,) = recording.column(f"{root}/policy_before/tube", component)
    times, tubes = recording.column(f"{root}/policy_now/tube", component)
    assert before is None
    np.testing.assert_allclose(times, log.forecast_times)
    assert {len(tube) for tube in tubes} == {N_RINGS * N_SIDES}
    np.testing.assert_allclose(tubes[0], first)
    middle = N_RINGS // 2 * N_SIDES
    ring = slice(middle, middle + N_SIDES)
    width = [np.ptp(np.array(tube)[ring, 1]) for tube in tubes]
    assert width[1] < 0.5 * width[0]


def test_tube_touches_the_ellipse_of_the_normal_quantile() -> None:
    """On a straight path along x the section has half axes 1.96 σ_z and 1.96 σ_y."""
    mean = np.outer(np.linspace(0.0, 1.0, 30), [1.0, 0.0, 0.0])
    vertices, normals = tube_vertices(mean, np.tile([9.0, 0.01, 0.02], (30, 1)))
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    across = vertices / (QUANTILE * np.array([np.inf, 0.01, 0.02]))
    np.testing.assert_allclose(np.linalg.norm(across, axis=1), 1.0)
    triangles = tube_triangles()
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    outward = np.sum(np.cross(b - a, c - a) * normals[triangles[:, 0]], axis=1)
    assert np.all(outward > 0.0) or np.all(outward < 0.0)


def test_tube_of_a_path_that_stands_still_is_finite() -> None:
    vertices, normals = tube_vertices(np.zeros((5, 3)), np.zeros((5, 3)))
    assert np.isfinite(vertices).all()
    assert np.isfinite(normals).all()


def test_bands_are_1_96_sigma_and_predictions_end_where_they_are_unknown(
    record: Callable[[EpisodeLog], Recording], make_log: MakeLog
) -> None:
    mean = np.array(make_log().predicted_mean)
    mean[:100] = np.nan
    recording = record(make_log(predicted_mean=mean))
    times, variances = recording.column(
        "/plots/turn/predicted", "Measurements:variances"
    )
    assert times[0] == pytest.approx(1.0)
    assert variances[0][0] == pytest.approx((1.96 * 0.004 * 180.0 / math.pi) ** 2)
    _, values = recording.column("/plots/turn/motion", "Scalars:scalars")
    np.testing.assert_allclose(values[-1], [66.0, 66.0])


def test_policy_without_forecasts_or_predictions_can_be_recorded(
    record: Callable[[EpisodeLog], Recording], make_log: MakeLog
) -> None:
    nothing = np.full((601, 6), np.nan)
    recording = record(
        make_log(
            predicted_mean=nothing,
            predicted_std=nothing,
            std=nothing,
            std_rate=nothing,
            stiffness=nothing,
            stiffness_rate=nothing,
            stability_margin=nothing,
            via_point=np.zeros(601, dtype=bool),
            forecast_times=np.empty(0),
            forecast_phase=np.empty(0),
            forecast_mean=np.empty((0, 0, 6)),
            forecast_std=np.empty((0, 0, 6)),
        )
    )
    paths = " ".join(recording.entities)
    assert "policy_now" not in paths
    assert "predicted" not in paths
    assert "/plots/stiffness" not in paths
    assert "/plots/angle/door" in recording.entities
    assert "/world/task/true_arc" in recording.entities


def test_before_adaptation_is_the_first_forecast_at_the_observed_phase(
    make_log: MakeLog,
) -> None:
    log = make_log()
    found = before_adaptation(log)
    assert found is not None
    mean, std = found
    arc = handle_pose_on_arc(0.5, math.radians(66.0) * 0.5)
    half = int(np.argmin(np.abs(log.observed_phase - 0.5)))
    np.testing.assert_allclose(mean[half], arc, atol=1e-3)
    np.testing.assert_allclose(std, 0.03)


def test_share_of_bound_is_one_on_the_bound(make_log: MakeLog) -> None:
    np.testing.assert_allclose(share_of_bound(make_log()), 0.2)  # 20 of 100
    on_bound = make_log(stability_margin=np.zeros((601, 6)))
    np.testing.assert_allclose(share_of_bound(on_bound), 1.0)


def test_via_points_accumulate(
    record: Callable[[EpisodeLog], Recording], make_log: MakeLog
) -> None:
    log = make_log()
    times, positions = record(log).column(
        "/world/task/hand/via_points", "Points3D:positions"
    )
    counts = [len(points) for points in positions]
    assert counts == list(range(1, int(log.via_point.sum()) + 1))
    np.testing.assert_allclose(times, log.times[log.via_point])
    np.testing.assert_allclose(positions[-1], log.ee_pose[log.via_point, :3], atol=1e-6)


@pytest.mark.parametrize(
    ("changes", "names"),
    [
        ({}, ["grasp", "open", "hold", "success"]),
        (
            {"success": False, "failure": "time_limit", "solved": np.zeros(601)},
            ["grasp", "open", "hold", "failure"],
        ),
        (
            {
                "success": False,
                "failure": "stalled",
                "solved": np.zeros(601),
                "door_angle": np.zeros(601),
            },
            ["stuck", "failure"],
        ),
        (
            {
                "success": False,
                "failure": "stalled",
                "solved": np.zeros(601),
                "door_angle": np.minimum(np.linspace(0.0, 1.5, 601), 0.6),
            },
            ["grasp", "open", "stuck", "failure"],
        ),
    ],
)
def test_stages(make_log: MakeLog, changes: dict[str, Any], names: list[str]) -> None:
    log = make_log(**changes)
    began = stages(log)
    assert [name for _, name in began] == names
    expected_deg = {"open": 1.0, "hold": 60.0}
    if log.door_angle.max() > 0.0:
        expected_deg["stuck"] = math.degrees(log.door_angle.max()) - 0.5
    for row, name in began:
        if name in expected_deg:
            angle = math.degrees(log.door_angle[row])
            assert angle == pytest.approx(expected_deg[name], abs=0.5)


def test_file_carries_its_layout_and_explains_itself(
    record: Callable[[EpisodeLog], Recording], make_log: MakeLog
) -> None:
    recording = record(make_log(success=False, failure="stalled"))
    assert len(recording.reader.blueprints()) == 1
    _, page = recording.column("/about", "TextDocument:text")
    for words in ("medium door", "`gp`", "not opened** (stalled)", "**seed**: 3"):
        assert words in page[0][0]


def test_bands_are_called_what_they_are(
    record: Callable[[EpisodeLog], Recording], make_log: MakeLog
) -> None:
    """A normal quantile per axis, which is no 95 % band of few demonstrations."""
    titles = [str(view.name) for view in _policy_views(6.0)]
    assert [title for title in titles if "±1.96 σ" in title] == titles[1:]
    assert not any("95" in title for title in titles)
    _, page = record(make_log()).column("/about", "TextDocument:text")
    assert "±1.96 σ per axis (normal quantile" in page[0][0]
    assert "(95 %)" not in page[0][0]
