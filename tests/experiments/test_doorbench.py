"""Doors of DoorBench: a spec written for this test, and many ways to spoil it."""

import copy
import json
import math
from operator import attrgetter
from pathlib import Path
from typing import Any

import pytest

from gplfd_env.conventions.constants import SUCCESS_ANGLE
from gplfd_env.doors.config import DoorConfig, door_config
from gplfd_env.doors.motion import links_of
from gplfd_experiments.cli import main as cli
from gplfd_experiments.data.doorbench import read_doorbench

# Only what is read, with numbers of our own.
SPEC: dict[str, Any] = {
    "schema_version": "1.0",
    "id": "lever door",
    "family": "swing_single",
    "extras": [],
    "robot": {"is_push": True},
    "leaf": {"width": 0.80, "thickness": 0.042, "count": 1},
    "hinge": {"side": "left", "axis_tilt_deg": 0},
    "kinematics": {"max_open_deg": 110},
    "operator": {"model": "lever_straight", "height": 1.01},
    "lock": {"engaged": False},
    "closer": {"model": "none"},
    "physics": {
        "mass": {"total_kg": 21.5},
        "hinge": {
            "coulomb_torque_Nm": 0.9,
            "air_damping_Nms_per_rad": 0.15,
            "stick_torque_Nm": 0.5,
        },
        "closer": {
            "spring_preload_Nm": 17.0,
            "spring_stiffness_Nm_per_rad": 6.0,
            "damping_closing": 60.0,
            "damping_opening": 8.0,
            "hold_open_rad": None,
            "backcheck_angle_rad": 1.25,
            "backcheck_damping": 30.0,
            "latch_boost": 1.0,
        },
        "roller": {"coulomb_force_N": 7.0, "viscous_damping_N_s_per_m": 3.5},
        "latch": {
            "throw_m": 0.0127,
            "holding_force_N": 0,
            "bolt_spring_preload_N": 3.5,
            "bolt_spring_rate_N_per_m": 310,
            "backset_m": 0.07,
            "operator_travel": 0.75,
            "operator_dead_travel": 0.05,
            "operator_spring_preload": 0.4,
            "operator_spring_rate": 1.1,
            "operator_grip_offset_m": 0.085,
        },
    },
}


def changed(path: str, value: Any) -> dict[str, Any]:
    """Return the spec with another value at a path of names."""
    spec = copy.deepcopy(SPEC)
    *names, last = path.split("/")
    table = spec
    for name in names:
        table = table[name]
    table[last] = value
    return spec


@pytest.fixture
def read(tmp_path: Path) -> Any:
    def reading(spec: dict[str, Any]) -> Any:
        path = tmp_path / "spec.json"
        path.write_text(json.dumps(spec), encoding="utf-8")
        return read_doorbench(path)

    return reading


def test_a_lever_door_is_read_whole(read):
    found = read(SPEC)
    assert found.name == "lever door"
    assert found.lost == ()
    assert found.door == DoorConfig(
        radius=0.80 - 0.07,
        leaf={"width": 0.80, "backset": 0.07, "thickness": 0.042},
        panel_mass=21.5,
        handle_height=1.01,
        handle="lever",
        latch="spring",
        swing="push",
        hinge_side="left",
        hinge_friction=0.9,
        hinge_damping=0.15,
        stiction=0.5,
        stop_angle=math.radians(110.0),
        closer={
            "preload": 17.0,
            "stiffness": 6.0,
            "damping": 8.0,
            "closing_damping": 52.0,
            "backcheck_damping": 30.0,
            "backcheck_angle": 1.25,
        },
        lockset={
            "handle_length": 0.115,
            "handle_preload": 0.4,
            "handle_stiffness": 1.1,
            "handle_travel": 0.75,
            "dead_travel": 0.05,
            "bolt_throw": 0.0127,
            "bolt_preload": 3.5,
            "bolt_stiffness": 310.0,
        },
    )


@pytest.mark.parametrize(
    ("path", "value", "line", "field", "expected"),
    [
        ("lock/engaged", True, "lock is engaged", "latch", "spring"),
        ("leaf/count", 2, "its other leaf", "leaf.width", 0.8),
        ("hinge/pivot_offset_m", 0.1, "0.1 m of its leaf beyond", "radius", 0.63),
        ("physics/latch/holding_force_N", 35, "the 35 N with which", "latch", "spring"),
        ("hinge/axis_tilt_deg", 3.0, "tilted by 3°", "hinge_side", "left"),
        ("physics/closer/latch_boost", 1.25, "boost of 1.25", "closer.boost", 0.0),
        ("operator/height", 1.4, "handle_height = 1.4", "handle_height", 1.22),
        ("physics/latch/backset_m", 0.127, "", "leaf.backset", 0.127),
    ],
)
def test_what_is_lost_is_said(path, value, line, field, expected, read):
    found = read(changed(path, value))
    assert attrgetter(field)(found.door) == pytest.approx(expected)
    assert line in " ".join(found.lost)
    assert bool(found.lost) == bool(line)


def operated(model: str, push: bool = True, width: float = 0.9, **latch: Any) -> Any:
    """Return the spec with another handle, which only a pushed side has if it is so."""
    spec = changed("operator/model", model)
    spec["robot"]["is_push"], spec["leaf"]["width"] = push, width
    spec["physics"]["latch"] |= latch
    if model.startswith(("panic", "push_plate")):
        spec["operator"] |= {"sides": "push_side", "far_side": "pull_d"}
    return spec


ROTATED = {
    "operator_travel": 0.35,
    "operator_dead_travel": 0.03,
    "operator_spring_preload": 0.5,
    "operator_spring_rate": 1.2,
    "operator_grip_offset_m": 0.05,
}
PUSHED = {
    "backset_m": 0.0,
    "operator_travel": 0.016,
    "operator_dead_travel": 0.002,
    "operator_spring_preload": 18.0,
    "operator_spring_rate": 1200.0,
    "operator_grip_offset_m": 0.0,
}


@pytest.mark.parametrize(
    ("model", "handle"),
    [
        ("paddle_push_pull", "paddle"),
        ("cold_storage_handle", "paddle"),
        ("handleset_thumb", "handleset"),
        ("thumb_latch_suffolk", "handleset"),
        ("panic_crossbar", "touch-bar"),
    ],
)
def test_handles_with_a_horizontal_axis(model, handle, read):
    door = read(operated(model, **ROTATED)).door
    assert (door.handle, door.latch) == (handle, "spring")
    assert (door.handle_travel, door.lockset.dead_travel, door.handle_arm) == (
        0.35,
        0.03,
        0.05,
    )
    assert door.handle_spring == (0.5, 1.2)


def test_the_straight_travel_of_a_touch_bar_becomes_an_arc_of_its_forces(read):
    door = read(operated("panic_touchbar_rim", **PUSHED)).door
    assert door.handle == "touch-bar"
    assert door.radius == pytest.approx(0.75)
    assert door.handle_arm * math.sin(door.handle_travel) == pytest.approx(
        0.016, rel=0.02
    )
    assert door.handle_arm * door.lockset.dead_travel == pytest.approx(0.002)
    preload, stiffness = door.handle_spring
    assert preload / door.handle_arm == pytest.approx(18.0)
    assert stiffness / door.handle_arm**2 == pytest.approx(1200.0)


def test_the_other_side_of_a_touch_bar(read):
    spec = operated("panic_touchbar_rim", push=False, **PUSHED)
    found = read(spec)
    assert (found.door.handle, found.door.latch) == ("bar", "none")
    assert "its latch" in " ".join(found.lost)
    spec["operator"]["far_side"] = "lever_straight"
    found = read(spec)
    assert (found.door.handle, found.door.latch) == ("lever", "spring")
    assert found.door.handle_spring == DoorConfig(handle="lever").handle_spring
    assert "spring of 'lever_straight'" in " ".join(found.lost)
    spec["operator"]["far_side"] = "none"
    with pytest.raises(ValueError, match="the pull side has no handle"):
        read(spec)


def rolling(family: str, width: float, count: int = 1, **kinematics: Any) -> Any:
    """Return the spec of a leaf on rollers with a pull, or of several."""
    spec = operated("pull_d", width=width, operator_travel=0, throw_m=0, backset_m=0)
    spec["family"], spec["leaf"]["count"] = family, count
    spec["kinematics"] |= kinematics
    return spec


@pytest.mark.parametrize("way", [0.76, 1.2])
def test_a_sliding_leaf_takes_the_force_of_its_rollers_on_any_way(way, read):
    spec = rolling("sliding_single", 0.8, travel_m=way)
    spec["extras"] = ["soft_close_damper"]
    spec["hinge"]["side"] = "right"
    found = read(spec)
    door = found.door
    assert (door.motion, door.handle, door.swing) == ("sliding", "bar", "pull")
    assert (door.hinge_side, door.leaf.width) == ("right", 0.8)
    assert door.clear_width == min(way, 1.05)
    assert door.radius == pytest.approx(0.74)
    (link,) = links_of(door)
    along = link.gains[0]  # Metres per rad of the door's angle.
    assert door.hinge_friction / along == pytest.approx(7.0)
    assert door.hinge_damping / along**2 == pytest.approx(3.5)
    assert "soft-close damper" in found.lost[0]
    assert ("clear_width = 1.2" in " ".join(found.lost)) == (way > 1.05)


@pytest.mark.parametrize(
    ("family", "width", "count", "kinematics", "stacks"),
    [
        ("bifold", 0.4, 2, {}, 1),
        ("bifold", 0.4, 4, {}, 2),
        ("accordion", 0.1, 8, {"accordion": True}, 1),
    ],
)
def test_folding_leaves_do_the_work_of_their_rollers_and_hinges(
    family, width, count, kinematics, stacks, read
):
    found = read(rolling(family, width, count, **kinematics))
    door = found.door
    assert (door.motion, door.swing) == ("folding", "pull")
    assert (door.leaf.width, door.leaf.backset) == (pytest.approx(0.8), 0.06)
    assert door.panel_mass == 21.5 / stacks
    # The guided edge goes 85 % of its way, and so far the first leaf turns for it.
    turned = math.acos(0.15)
    assert door.mechanism.roller_friction == 7.0
    assert door.hinge_friction * SUCCESS_ANGLE == pytest.approx(0.9 * turned)
    assert door.stiction * SUCCESS_ANGLE == pytest.approx(0.5 * turned)
    damping = 3.5 * (0.85 * 0.8) ** 2 + 0.15 * turned**2
    assert door.hinge_damping * SUCCESS_ANGLE**2 == pytest.approx(damping)
    told = {1: "8 leaves" if count > 2 else "", 2: "fold to the other jamb"}[stacks]
    assert told in " ".join(found.lost)
    assert "damping grows" in found.lost[-1]
    assert len(found.lost) == 1 + bool(told)


@pytest.mark.parametrize(
    ("spec", "problem"),
    [
        (rolling("bifold", 0.76, 2), "DoorConfig.radius = 1.46 is outside"),
        (rolling("dutch", 0.8, joining_bolt_engaged=False), "halves are not joined"),
        (rolling("rollup", 2.4), "family is 'rollup', not swing_"),
        (changed("schema_version", "2.0"), "schema_version is '2.0', not '1.0'"),
        (changed("operator/model", "hook_lock_slider"), "a pull that turns or slides"),
        (changed("operator/model", "push_button_screen"), "which a gripper with two"),
        (changed("hinge/side", "top"), "at the 'top'"),
        (changed("leaf/width", "wide"), "width = 'wide' must be a number"),
    ],
)
def test_what_is_no_such_door_is_refused(spec, problem, read):
    with pytest.raises(ValueError, match="cannot be imported as a door") as error:
        read(spec)
    assert problem in str(error.value)


def test_the_command_writes_what_an_environment_takes(tmp_path, capsys):
    path, out = tmp_path / "spec.json", tmp_path / "door.json"
    path.write_text(json.dumps(changed("lock/engaged", True)), encoding="utf-8")
    assert cli.main(["doors", "import", str(path), "--out", str(out)]) == 0
    assert "not represented: its lock is engaged" in capsys.readouterr().out
    written = json.loads(out.read_text("utf-8"))
    assert door_config(written) == read_doorbench(path).door
