"""Leaves that do not only turn about an upright hinge."""

import dataclasses
import math

import mujoco
import numpy as np
import pytest
from numpy.polynomial.polynomial import polyder, polyval
from numpy.testing import assert_allclose
from scipy.optimize import fsolve
from scipy.spatial.transform import Rotation

from gplfd_env.doors.config import DOORS, DoorConfig, door_config
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_env.doors.motion import LeafPath, carried, end_angle, links_of, roller_way
from gplfd_env.doors.parts import Closer
from gplfd_env.doors.variation import Placement
from gplfd_env.robot.placement import base_for, handle_position_w, task_rotation_w
from gplfd_env.robot.tiago import TIAGO_LIKE
from gplfd_env.scene.build import build_scene
from gplfd_experiments.data.teacher.forces import hinge_torque, inertia_and_gravity

pytestmark = pytest.mark.slow

OPENED = math.radians(60.0)
OTHER = tuple(name for name, door in DOORS.items() if door.motion != "hinged")
MIRRORED = {"bifold-closet": "left", "barn-door": "left", "pocket-door": "right",
            "plug-door": "left", "rising-butt": "left"}  # fmt: skip


def doors() -> list[DoorConfig]:
    """Return the presets that are not hinged, and their mirror images."""
    mirrored = [{"preset": name, "hinge_side": side} for name, side in MIRRORED.items()]
    return [DOORS[name] for name in OTHER] + [door_config(one) for one in mirrored]


def moved_scene(door: DoorConfig, angle: float) -> mujoco.MjData:
    """Return a scene whose joints are where the motion says, before any dynamics."""
    model = build_scene(door, robot=TIAGO_LIKE.on("mobile"))
    data = mujoco.MjData(model)
    data.joint("hinge").qpos = angle
    for link in links_of(door):
        data.joint(link.name).qpos = polyval(angle, (0.0, *link.gains))
    mujoco.mj_kinematics(model, data)
    return data


@pytest.mark.parametrize("door", doors(), ids=lambda door: door.motion)
def test_the_scene_moves_the_handle_as_the_geometry_says(door):
    axes = task_rotation_w(door, TIAGO_LIKE.on("mobile"))
    origin = handle_position_w(door, Placement(), TIAGO_LIKE.on("mobile"))
    geometry = DoorGeometry.of(door)
    for angle in np.linspace(0.0, end_angle(door), 5):
        site = moved_scene(door, angle).site("handle")
        pose = geometry.hand_poses(angle)
        assert_allclose(axes.T @ (site.xpos - origin), pose[:3], atol=1e-12)
        turn = Rotation.from_matrix(axes.T @ site.xmat.reshape(3, 3)).as_rotvec()
        assert_allclose(turn, pose[3:], atol=1e-9)


def test_folding_leaves_move_the_handle_on_a_trammel_ellipse():
    """And at a success 85 % of the way between the jambs is free."""
    door = DoorConfig(motion="folding", radius=0.54, leaf={"backset": 0.16})
    angles = np.linspace(0.0, OPENED, 7)
    folded = angles * math.acos(0.15) / OPENED
    x, y, z, *turn = DoorGeometry.of(door).hand_poses(angles).T
    assert_allclose(x, 0.16 * np.sin(folded), atol=1e-12)
    assert_allclose(z, -0.54 * (1.0 - np.cos(folded)), atol=1e-12)
    assert_allclose(turn, [0.0 * angles, -folded, 0.0 * angles], atol=1e-12)
    assert not y.any()


def test_a_sliding_leaf_has_made_85_percent_of_its_way_at_a_success():
    for motion, out in (("sliding", 0.0), ("parallel-sliding", 0.06)):
        mechanism = {"clear_width": 0.6} | ({"offset": out} if out else {})
        door = DoorConfig(motion=motion, radius=0.7, mechanism=mechanism)
        opened, stopped = DoorGeometry.of(door).hand_poses([OPENED, end_angle(door)])
        assert_allclose(opened[2], -0.85 * 0.6, rtol=1e-6)
        assert_allclose(stopped, [out, 0.0, -0.6, 0.0, 0.0, 0.0], atol=1e-5)
    # First straight out, then along.
    begin, end = (DoorGeometry.of(door).direction(angle) for angle in (1e-5, OPENED))
    assert_allclose(begin, [1.0, 0.0, 0.0], atol=1e-3)
    assert_allclose(end, [0.0, 0.0, -1.0], atol=5e-3)


def test_a_concealed_hinge_is_a_four_bar():
    """The displacement of the leaf keeps the lengths of both links."""
    fixed = np.array([[-13.0, -8.5], [-48.0, -5.5]])
    moving = np.array([[-22.5, 34.5], [-1.0, 16.0]])
    lengths = np.linalg.norm(moving - fixed, axis=1)
    door = DoorConfig(motion="concealed-hinge", radius=0.4)
    links = {link.name: link for link in links_of(door)}
    shift = np.zeros(2)
    for angle in np.linspace(0.0, math.radians(100.0), 21):
        turn = np.array(
            [[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]]
        )
        shift = fsolve(
            lambda at, turn=turn: (
                np.linalg.norm(moving @ turn.T + at - fixed, axis=1) - lengths
            ),
            shift,
        )
        out = polyval(angle, (0.0, *links["out"].gains))
        # The link "along" goes to the hinge.
        along = -polyval(angle, (0.0, *links["along"].gains))
        assert_allclose([1e3 * out, 1e3 * along], shift, atol=0.01)


@pytest.mark.parametrize("door", doors(), ids=lambda door: door.motion)
def test_forces_are_split_along_the_path(door):
    """Along it, as the geometry tells its direction; the rest is across."""
    path, geometry = LeafPath.of(door), DoorGeometry.of(door)
    axes = task_rotation_w(door, TIAGO_LIKE.on("mobile"))
    site = "leaf_axes" if door.motion == "flap" else "handle"
    for angle in np.linspace(0.01, 0.95 * end_angle(door), 5).tolist():
        frame = axes.T @ moved_scene(door, angle).site(site).xmat.reshape(3, 3)
        force = geometry.direction(angle) * 10.0
        normal, outwards = (
            path.swing_sign * (frame[:, 0] @ force),
            path.hinge_sign * (frame[:, 2] @ force),
        )
        along, across = path.split(angle, normal, outwards)
        rising = door.motion == "rising-butt"
        assert along == pytest.approx(10.0, abs=0.01 if rising else 2e-3)
        assert across == pytest.approx(0.0, abs=0.15)


@pytest.mark.parametrize("door", doors()[: len(OTHER)], ids=lambda door: door.motion)
def test_a_leaf_without_friction_keeps_its_energy(door):
    """And never gains any: no joint that ties it does work."""
    door = dataclasses.replace(
        door,
        hinge_friction=0.0,
        hinge_damping=0.0,
        closer=Closer(),
        mechanism=dataclasses.replace(door.mechanism, strut_stiffness=0.0),
    )
    model = build_scene(door, robot=TIAGO_LIKE.on("mobile"))
    # Out of the hand.
    model.geom_conaffinity[model.geom("handle_bar").id] = 0
    data = mujoco.MjData(model)
    data.joint("hinge").qpos, data.joint("hinge").qvel = 0.3, 0.5
    for link in links_of(door):
        data.joint(link.name).qpos = polyval(0.3, (0.0, *link.gains))
        slope = polyval(0.3, polyder([0.0, *link.gains]))
        data.joint(link.name).qvel = 0.5 * slope
    angles, rates = [], []
    for _ in range(150):
        mujoco.mj_step(model, data)
        angles.append(float(data.joint("hinge").qpos[0]))
        rates.append(float(data.joint("hinge").qvel[0]))
    path = np.linspace(0.0, 1.2, 2401)
    inertia, torque = inertia_and_gravity(door, path)
    height = np.concatenate([[0.0], np.cumsum(0.5 * (torque[1:] + torque[:-1]))])
    potential = np.interp(angles, path, height * path[1])
    energy = 0.5 * np.interp(angles, path, inertia) * np.square(rates) + potential
    assert angles[-1] != pytest.approx(0.3, abs=0.02)
    scale = energy[0] - potential[0] + 2.0 * np.ptp(potential)
    assert energy.max() - energy[0] < 0.03 * scale
    assert energy.min() - energy[0] > -0.05 * scale


def test_rollers_take_the_work_of_their_way_along_the_rail():
    """Their force at the handle begins with nothing: the edge is moved across first."""
    bare = {"hinge_friction": 0.0, "hinge_damping": 0.0, "stiction": 0.0}
    door = dataclasses.replace(
        DOORS["bifold-closet"], mechanism={"roller_friction": 12.0}, **bare
    )
    angles, step, edge = np.linspace(0.0, 1.1, 12), 1e-6, np.zeros((12, 6))
    edge[:, 2] = door.hinge_sign * door.leaf.backset
    ends = (carried(links_of(door), angles + s, edge)[:, 2] for s in (-step, step))
    slopes = np.subtract(*ends) / (2.0 * step)
    assert_allclose(roller_way(door, angles), slopes, atol=1e-8)
    assert roller_way(door, np.array([0.0])) == 0.0

    model = build_scene(door, robot=TIAGO_LIKE.on("mobile"))
    model.geom_conaffinity[model.geom("handle_bar").id] = 0  # Out of the hand.
    for angle in (0.1, 0.3, 0.9):
        torque = 12.0 * float(roller_way(door, np.array([angle]))[0])
        for share, moves in ((0.9, False), (1.1, True)):
            data = mujoco.MjData(model)
            mujoco.mj_resetDataKeyframe(model, data, 0)
            data.joint("hinge").qpos = angle
            for link in links_of(door):
                data.joint(link.name).qpos = polyval(angle, (0.0, *link.gains))
            for _ in range(200):
                data.joint("hinge").qfrc_applied = share * torque
                mujoco.mj_step(model, data)
            assert (data.joint("hinge").qpos[0] - angle > 3e-3) == moves


@pytest.mark.parametrize("door", doors(), ids=lambda door: door.motion)
def test_every_motion_is_opened_by_its_path_with_the_force_it_needs(door, make_env):
    env = make_env(door=door, base=base_for(door, TIAGO_LIKE))
    env.reset(seed=0)
    path, rows = env.unwrapped.door_geometry, []
    for step in range(560):
        share = min(step / 450, 1.0)
        share = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
        angle = min(math.radians(67.0), end_angle(door) - 0.02) * share
        *_, terminated, _, info = env.step(path.easy_hand_poses(angle))
        rows.append((info["door_angle"], info["force_tangential"]))
        if terminated:
            break
    assert info["success"], info["reason"]
    assert info["opening"] == pytest.approx(info["door_angle"] / OPENED)
    assert info["slip"] < 0.012
    angles, forces = np.array(rows).T
    geometry, step = DoorGeometry.of(door), 1e-5
    ends = (geometry.hand_poses(angles + sign * step)[:, :3] for sign in (1.0, -1.0))
    gains = np.linalg.norm(np.subtract(*ends), axis=1) / (2.0 * step)
    expected = hinge_torque(door, angles, 100.0) / gains
    moving = slice(150, 420)
    # A base that starts and stops adds a few newtons for a moment.
    assert np.median(np.abs(forces - expected)[moving]) < 2.0


def test_what_is_not_defined_is_refused(make_env):
    with pytest.raises(ValueError, match="'folding' is out of reach with base='fixed'"):
        make_env(door="bifold-closet")
    with pytest.raises(ValueError, match="no disturbance of a door with motion = 'sl"):
        make_env(door="barn-door", base="mobile", disturbance="stop")
