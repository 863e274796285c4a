"""What makes a door look like one: seen, without weight and contact."""

import mujoco
import numpy as np
import pytest

from gplfd_env.conventions.constants import Base
from gplfd_env.doors.config import DOORS, DoorConfig, door_config
from gplfd_env.scene.build import build_scene, build_spec, load_scene
from gplfd_env.scene.visuals import CLOSER_ARM, CLOSER_PARTS, GROUP

LEVER = DOORS["room-834"]
CLOSED_BY = DOORS["heavy-fire"]
WALLS = {"wall_hinge", "wall_lock"}


def looks(model: mujoco.MjModel) -> set[str]:
    names = [model.geom(index).name for index in range(model.ngeom)]
    return {name for name in names if model.geom(name).group[0] == GROUP}


@pytest.mark.parametrize("base", ["fixed", "mobile"])
@pytest.mark.parametrize("door", ["medium", "room-834", "heavy-fire", "wardrobe"])
def test_a_scene_without_its_looks_weighs_and_touches_the_same(
    door: str, base: Base
) -> None:
    """Compiled again without them, every body has the same mass, bit for bit.

    Before a base that drives the walls are solid; before one that stands still they
    are only to be seen.
    """
    spec = build_spec(door_config(door), base=base)
    dressed = spec.compile()
    seen = looks(dressed) | (WALLS if base == "fixed" else set())
    for geom in [one for one in spec.geoms if one.name in seen]:
        spec.delete(geom)
    for tendon in [one for one in spec.tendons if one.name == CLOSER_ARM]:
        spec.delete(tendon)
    bare = spec.compile()
    for field in ("body_mass", "body_inertia", "body_ipos", "body_iquat", "dof_M0"):
        np.testing.assert_array_equal(getattr(dressed, field), getattr(bare, field))
    assert (dressed.nq, dressed.nv, dressed.nu) == (bare.nq, bare.nv, bare.nu)
    for name in seen:
        assert dressed.geom(name).contype == dressed.geom(name).conaffinity == 0
    assert dressed.ngeom - bare.ngeom == len(seen)


@pytest.mark.parametrize("door", DOORS)
def test_every_door_stands_in_a_wall(door: str) -> None:
    for base in ("fixed", "mobile"):
        model = build_scene(DOORS[door], base=base)
        for wall in WALLS:
            assert model.geom(wall).rgba[3] == 1.0
            assert model.geom(wall).size[2] > 0.5


def test_no_wall_hides_the_arm_of_a_robot_that_stands_still_and_pushes() -> None:
    """It reaches through beside the lock; the scene is loaded in place."""
    model = build_scene(DOORS["medium"])
    load_scene(model, mujoco.MjData(model), DoorConfig(swing="push"))
    assert model.geom("wall_lock").size[2] < 0.01
    assert model.geom("wall_hinge").size[2] > 0.5


def test_a_door_with_a_bar_has_no_looks_of_its_own() -> None:
    assert looks(build_scene(DOORS["medium"])) == set()
    assert looks(build_scene(DOORS["wardrobe"])) == set(CLOSER_PARTS)


@pytest.mark.parametrize("handle", ["lever", "knob"])
@pytest.mark.parametrize("hinge_side", ["right", "left"])
def test_the_far_handle_is_the_near_one_in_the_mirror(
    handle: str, hinge_side: str
) -> None:
    door = door_config(
        {"preset": "room-834", "handle": handle, "hinge_side": hinge_side}
    )
    model = build_scene(door, base="mobile")
    data = mujoco.MjData(model)
    data.joint("handle").qpos = 0.5
    mujoco.mj_kinematics(model, data)
    axes = data.body("door").xmat.reshape(3, 3)
    near, far, leaf = (
        axes.T @ (data.geom(name).xpos - data.body("door").xpos)
        for name in ("handle_bar", "far_handle", "leaf")
    )
    np.testing.assert_allclose(far[1:], near[1:], atol=1e-9)
    assert near[0] + far[0] == pytest.approx(2.0 * leaf[0])
    assert model.geom("far_handle").size[0] == model.geom("handle_bar").size[0]


def test_only_a_hydraulic_closer_is_seen() -> None:
    """A lever's seal has tendons, too: the scene is the same, and loaded in place."""
    model = build_scene(LEVER, base="mobile")
    data = mujoco.MjData(model)
    for door, seen in ((LEVER, 0.0), (CLOSED_BY, 1.0), (LEVER, 0.0)):
        load_scene(model, data, door, base="mobile")
        assert [model.geom(part).rgba[3] for part in CLOSER_PARTS] == [seen, seen]
        assert model.tendon_rgba[model.tendon(CLOSER_ARM).id, 3] == seen
        width = model.tendon_width[model.tendon(CLOSER_ARM).id]
        assert (width > 1e-3) == (seen > 0.0)


@pytest.mark.parametrize("hinge_side", ["right", "left"])
def test_the_closer_s_arm_ends_at_its_box_however_far_the_door_is_open(
    hinge_side: str,
) -> None:
    fields = {name: getattr(CLOSED_BY, name) for name in CLOSED_BY.as_dict()}
    door = DoorConfig(**{**fields, "hinge_side": hinge_side})
    model = build_scene(door, base="mobile")
    data = mujoco.MjData(model)
    for angle in (0.0, 0.8, 1.6):
        data.joint("hinge").qpos = angle
        mujoco.mj_kinematics(model, data)
        spindle, foot = data.site("closer_spindle").xpos, data.site("closer_foot").xpos
        assert np.linalg.norm(spindle - data.geom("closer_box").xpos) < 0.13
        np.testing.assert_array_equal(foot, data.geom("closer_shoe").xpos)
        assert 0.05 < np.linalg.norm(spindle - foot) < 0.65
