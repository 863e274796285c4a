"""Several policies in one recording: each in its place, in its colour, at its time."""

import dataclasses
import math

import numpy as np
import pytest
from rerun.chunk import RrdReader

from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.recording.comparison import (
    COLOURS,
    ROW,
    SPACING,
    record_comparison,
)


@pytest.fixture
def record(tmp_path, door_model, columns):
    demonstrations = Teacher().demonstrate_doors([0.5], 1, rng=np.random.default_rng(0))

    def record(*logs):
        path = tmp_path / "comparison.rrd"
        record_comparison(path, logs, door_model, demonstrations)
        return columns(RrdReader(path).stream())

    return record


def packed(colour):
    return int.from_bytes((*colour, 255))


def test_robots_stand_in_a_row_and_the_same_scene_moves_in_each(record, make_log):
    chunks = record(make_log(), make_log(policy="kmp", qpos=np.zeros((601, 1))))
    for number, policy in enumerate(("gp", "kmp")):
        _, places = chunks[f"/robots/{policy}/world", "Transform3D:translation"]
        np.testing.assert_allclose(places[0], [SPACING * number * ROW], atol=1e-6)
    leaf = "world/scene/leaf"
    _, moving = chunks[f"/robots/gp/{leaf}", "Transform3D:quaternion"]
    _, still = chunks[f"/robots/kmp/{leaf}", "Transform3D:quaternion"]
    turn = 2.0 * math.acos(abs(np.dot(moving[0][0], moving[-1][0])))
    assert turn == pytest.approx(math.radians(66.0), abs=1e-3)
    np.testing.assert_allclose(still[0], still[-1])


def test_curves_are_the_logs_in_the_policys_colour_and_name(record, make_log):
    log, other = make_log(), make_log(policy="kmp", force_radial=np.full(601, -7.0))
    chunks = record(log, other)
    times, values = chunks["/plots/angle/gp", "Scalars:scalars"]
    np.testing.assert_allclose(times, log.times, atol=1e-9)
    np.testing.assert_allclose(np.ravel(values), np.degrees(log.opening.door_angle))
    _, values = chunks["/plots/radial/kmp", "Scalars:scalars"]
    assert np.ravel(values).tolist() == [7.0] * 601
    for policy, colour in zip(("gp", "kmp"), COLOURS, strict=False):
        for panel in ("angle", "radial"):
            entity = f"/plots/{panel}/{policy}"
            assert chunks[entity, "SeriesLines:names"][1] == [[policy]]
            tints = chunks[entity, "SeriesLines:colors"][1]
            assert tints == [[packed(colour)]]
        overlay = f"/overlay/world/task/paths/{policy}"
        assert chunks[overlay, "LineStrips3D:colors"][1] == [[packed(colour)]]


def test_a_policy_may_have_any_name_and_disturbances_are_shown(record, make_log):
    force = np.where(np.arange(601) > 300, 30.0, 0.0)
    chunks = record(make_log(person_force=force), make_log(policy="gp, prior mean"))
    entity = r"/plots/angle/gp\,\ prior\ mean"
    assert chunks[entity, "SeriesLines:names"][1] == [["gp, prior mean"]]
    ball = "/robots/gp/world/task/outside/person"
    assert chunks[ball, "Points3D:labels"][1][-1] == ["person 30 N"]


def test_labels_say_how_it_ended(record, make_log):
    half = np.minimum(make_log().opening.door_angle, math.radians(40.0))
    ended = {"success": False, "failure": "stalled", "solved": np.full(601, False)}
    stuck = make_log(policy="dmp", door_angle=half, **ended)
    lost = dataclasses.replace(stuck, policy="gmr", failure="grasp_lost")
    chunks = record(make_log(), stuck, lost)
    for said in ("gp: opened", "dmp: stuck at 40°", "gmr: let go at 40°"):
        label = f"/robots/{said.partition(':')[0]}/world/task/label"
        assert chunks[label, "Points3D:labels"][1] == [[said]]
    text = chunks["/about", "TextDocument:text"][1][0][0]
    assert "| dmp | stalled | 40° | 3.0 N |" in text


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ([], "0 episodes; a comparison has 1 to 6"),
        ([{}, {}], "policy gp is given twice"),
        ([{}, {"policy": "kmp", "door_config": {"radius": 0.6}}], "another door"),
        ([{"qpos": np.zeros((601, 3))}], "3 generalised positions per step"),
    ],
)
def test_what_cannot_be_compared_is_refused(changes, message, record, make_log):
    with pytest.raises(ValueError, match=message):
        record(*(make_log(**change) for change in changes))
