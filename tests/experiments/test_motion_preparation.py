"""What is wrong with a recording is mended, refused or noticed, and said."""

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from gplfd_env.spatial.se3 import handle_pose_on_arc, relative_poses
from gplfd_experiments.data.preparation import (
    ImportSettings,
    PreparedMotion,
    outliers,
    prepare,
)
from gplfd_experiments.data.preparation.frames import doubtful_rotation, find_hinge
from gplfd_experiments.data.preparation.samples import Notes, usable, without_spikes
from gplfd_experiments.data.raw import RawRecording
from gplfd_experiments.data.readers import read_here
from gplfd_experiments.data.teacher.motion import minimum_jerk

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("coarse_cuts")]

ROOT = Path(__file__).parents[2]
RATE = 200.0
ANY = ImportSettings()
AS_RECORDED = ImportSettings(frame="recorded", keep_rests=True, cutoff=0.0, rate=0.0)
RESTS: Any = {"segment": "rests"}
START = np.array([1.2, -0.4, 0.9])
TURN = Rotation.from_rotvec([0.4, -0.2, 1.1])
"""Where a door stands in the world, and how."""


def door(
    *, seconds: float = 2.0, rest: float = 0.0, angle: float = 1.2, radius: float = 0.6
) -> RawRecording:
    """A hand that opens a door, seen from the world, with rests at both ends."""
    times = np.arange(round((seconds + 2.0 * rest) * RATE) + 1) / RATE
    progress = np.clip((times - rest) / seconds, 0.0, 1.0)
    poses = handle_pose_on_arc(radius, angle * minimum_jerk(progress))
    grip = Rotation.from_rotvec([0.3, 0.7, -0.5])
    rotations = TURN * Rotation.from_rotvec(poses[:, 3:]) * grip
    return RawRecording(
        name="door.csv",
        times=times,
        positions=START + TURN.apply(poses[:, :3]),
        unit="m",
        quaternions=rotations.as_quat(scalar_first=True),
    )


def only(
    raw: RawRecording, settings: ImportSettings = AS_RECORDED, **changes: Any
) -> PreparedMotion:
    """Prepare one motion, as recorded but for some settings."""
    (motion,) = prepare([raw], replace(settings, **changes))
    return motion


def texts(motion: PreparedMotion, *, warnings: bool | None = None) -> str:
    return "\n".join(n.text for n in motion.notes if warnings in (None, n.warning))


RAW = door()
TIMES, POSITIONS, WXYZ = np.array(RAW.times), np.array(RAW.positions), RAW.quaternions
GAPPY = RAW.part(np.abs(np.arange(401) - 220) > 40)
FAR = np.r_[TIMES[:-1], 1e9]


def test_as_recorded_is_as_recorded():
    motion = only(RAW)
    assert_array_equal(motion.demonstration.times, RAW.times)
    poses = motion.demonstration.poses
    assert_allclose(poses[:, :3], RAW.positions, rtol=0, atol=1e-15)
    found = Rotation.from_rotvec(poses[:, 3:].copy())
    recorded = Rotation.from_quat(RAW.quaternions, scalar_first=True)
    assert (found * recorded.inv()).magnitude().max() < 1e-9
    assert [note.text[:27] for note in motion.notes] == ["moves on a circle of radius"]
    # Without orientations, it does not turn.
    motion = only(replace(RAW, quaternions=None), ANY)
    assert_array_equal(motion.demonstration.poses[:, 3:], 0.0)


def test_units_become_metres():
    scaled = replace(RAW, positions=POSITIONS / 0.0254, unit="in")
    assert_allclose(only(scaled).demonstration.poses[:, :3], POSITIONS, atol=1e-12)
    assert "although the file states in" in texts(only(scaled, units="m"))


def test_samples_out_of_order_repeated_and_missing():
    rows = np.r_[0:100, 150, 100:200, 199, 199, 200 : len(TIMES)]
    messy = RAW.part(rows)
    positions, quaternions = messy.positions.copy(), np.array(messy.quaternions)
    positions[50], quaternions[60] = np.nan, 0.0
    motion = only(replace(messy, positions=positions, quaternions=quaternions))
    kept = np.delete(np.arange(len(TIMES)), [50, 60])
    assert_array_equal(motion.demonstration.times, TIMES[kept])
    assert_allclose(motion.demonstration.poses[:, :3], POSITIONS[kept])
    said = texts(motion)
    assert "2 of 404 samples missing" in said
    assert "time stamps went back 1 times: sorted" in said
    assert "3 samples with a repeated time stamp left out" in said


def test_missing_values_of_signals_are_those_of_their_time():
    """Also where the halves of a recording were written in the other order."""
    width = np.asarray(RAW.times)[:, None].copy()
    width[10] = np.nan
    swapped = replace(RAW, signals={"gripper": width}).part(np.r_[200:401, 0:200])
    samples = usable(swapped, AS_RECORDED, Notes())
    assert_allclose(samples.signals["gripper"][:, 0], samples.times, atol=1e-12)


@pytest.mark.parametrize("late", [0.0, -40.0, 1e6])
def test_a_clock_that_restarts_divides_the_recording(late):
    """Also with jitter; a few samples alone are left out."""
    whole = RAW.part(np.r_[7:10, 0:201, 200:401])
    times = np.r_[late + 1e7 + TIMES[7:10], TIMES[:201] + late, TIMES[:201] + late]
    times[204:] -= 1e-3 * (np.arange(201) % 3)
    motions = prepare([replace(whole, times=times)], AS_RECORDED)
    assert [len(motion.demonstration.times) for motion in motions] == [201, 201]
    for motion, span in zip(motions, ("4 to 204", "205 to 405"), strict=True):
        said = f"samples {span}, because the clock restarts"
        assert said in texts(motion, warnings=True)
    motion = only(replace(whole, times=times), recorded_rate=RATE)
    assert len(motion.demonstration.times) == 405
    assert "its time stamps replaced: 200 Hz" in texts(motion, warnings=True)


def test_time_stamps_that_are_coarse_are_noticed():
    note = "which moved: time stamps are coarse; say --recorded-rate 200"
    for scale in (0.05, 50.0, 5e4):  # In seconds, and in a wrong unit.
        coarse = replace(RAW, times=scale * np.floor(TIMES * 20.0))
        assert note in texts(only(coarse, largest_gap=1e5, rate=0.0), warnings=True)
    # A program that stores the same sample again loses nothing.
    again = RAW.part(np.repeat(np.arange(401), 3))
    assert "802 samples with a repeated" in texts(only(again), warnings=False)


def test_the_same_motion_again_is_named():
    other = replace(RAW, positions=1e3 * POSITIONS, unit="mm", times=TIMES + 5.0)
    rounded = replace(RAW, positions=POSITIONS.round(4), quaternions=-WXYZ.round(4))
    motions = prepare([RAW, door(angle=1.1), other, rounded], AS_RECORDED)
    note = "the same motion as 0: leave it out"
    noted = [note in texts(motion, warnings=True) for motion in motions]
    assert noted == [False, False, True, True]


def test_signs_of_quaternions_do_not_matter():
    signs = np.where(np.arange(len(RAW.positions)) % 7 < 3, -1.02, 0.98)
    motion = only(replace(RAW, quaternions=RAW.quaternions * signs[:, None]))
    expected = only(RAW).demonstration.poses
    assert_allclose(motion.demonstration.poses, expected, atol=1e-9)
    assert "quaternions changed sign" in texts(motion, warnings=False)


@pytest.mark.parametrize(
    ("given", "settings", "message"),
    [
        ({"quaternions": 1.5 * WXYZ}, {}, r"quaternion of sample 0 has norm 1\.5"),
        ({"positions": np.ones((401, 3)), "quaternions": None}, RESTS, "csv: .* moves"),
        ({"times": FAR}, RESTS, r"door.csv: .* span 1e\+09 s in steps"),
        ({"positions": 1e10 + POSITIONS}, {}, "csv: only 0 of 401 samples have time"),
        ({"quaternions": None}, {"offset": (0, 0, 0, 1, 0, 0, 0)}, "an offset needs"),
        ({"times": 0.0 * TIMES}, {}, "csv: all samples have the same time stamp"),
        ({"times": 1e-3 * TIMES}, {"rate": 100.0}, r"lasts 0.002 s: .* --time-unit"),
        ({"times": FAR, "notes": ("read in ms",)}, {}, "the unit; read in ms"),
    ],
)
def test_what_cannot_be_used_is_refused(given, settings, message):
    with pytest.raises(ValueError, match=message):
        only(replace(RAW, **given), **settings)


def filled(value: float) -> Any:
    """Times, positions or quaternions in which a program fills what is missing."""
    return lambda array: np.r_[
        array[:150], np.full_like(array[150:170], value), array[170:]
    ]


TWICE = np.minimum(np.arange(1.0, 202.0), 2.0)[:, None]
LEVEL = np.r_[np.full(100, 0.9), np.full(50, -1.0), np.full(251, 0.9)]
"""Heights of a plane but for some that a program fills."""


def moved(samples: slice, by: Any) -> dict[str, Any]:
    positions = POSITIONS.copy()
    positions[samples] += by
    return {"positions": positions}


@pytest.mark.parametrize(
    ("given", "kept", "warning", "note"),
    [
        (moved(np.s_[100:103], [0.23, 0, 0]), 398, True, "3 samples of short jumps"),
        (moved(np.s_[200:], [0, 0.3, 0]), 401, True, "1 jumps of the tracker, at 0.99"),
        (moved(np.s_[200:], 0.3 * TWICE), 401, True, "2 jumps of the tracker, at 0.99"),
        ({"unit": None}, 401, False, "no unit given: taken as metres"),
        ({"positions": 1e3 * POSITIONS}, 401, True, "m: is the unit right?"),
        ({"positions": 1e-3 * POSITIONS}, 401, True, "m: is the unit right?"),
        ({"times": filled(-9999.0)}, 381, True, "20 samples with -9999 in t are"),
        (
            {"positions": np.column_stack([POSITIONS[:, :2], LEVEL])},
            351,
            True,
            "50 samples with -1 in z are",
        ),
        (moved(np.s_[::2], [0.2, 0, 0]), 401, True, "moves at 40 m/s: are several so"),
        ({"times": filled(1e35)}, 381, True, "20 samples with 1e+35 in t are taken"),
        ({"positions": filled(1e20)}, 381, True, "20 samples with 1e+20 in z are"),
        (
            {"positions": filled(-9999.0), "quaternions": filled(-9999.0)},
            381,
            True,
            "20 samples with -9999 in x are taken as missing",
        ),
    ],
)
def test_what_is_mended_or_suspicious_is_said(given, kept, warning, note):
    changed = {n: v(getattr(RAW, n)) if callable(v) else v for n, v in given.items()}
    motion = only(replace(RAW, **changed))
    assert len(motion.demonstration.times) == kept
    assert note in texts(motion, warnings=warning)


@pytest.mark.parametrize(("unit", "s"), [("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9)])
def test_a_wrong_unit_of_time_is_noticed(tmp_path, unit, s):
    table = np.column_stack([np.asarray(RAW.times) / s, RAW.positions])
    lines = [",".join(map(repr, row)) for row in table.tolist()]
    (tmp_path / "a.csv").write_text("\n".join(["t,x [m],y [m],z [m]", *lines]))
    (read,) = read_here(tmp_path / "a.csv", ANY)
    assert f"are times in {unit}? say --time-unit {unit}" in read.notes[0]
    (read,) = read_here(tmp_path / "a.csv", ImportSettings(time_unit=unit))
    assert read.notes == ()
    assert_allclose(np.asarray(read.times), np.asarray(RAW.times), rtol=0, atol=1e-12)


def test_samples_that_would_be_made_are_counted_first():
    """Of all recordings together; a few samples may span any time."""
    slow = replace(door(), times=3e4 * np.linspace(0.0, 1.0, 401))
    settings = replace(AS_RECORDED, rate=10.0, largest_gap=1e4)
    assert len(only(slow, replace(settings, rate=1.0)).demonstration.times) == 30001
    with pytest.raises(ValueError, match="300,001 samples, but at most 99,997 more"):
        prepare([slow] * 4, settings)


@pytest.mark.parametrize("shift", [-1, 1])
def test_a_wrong_order_of_quaternions_is_noticed_on_a_door(shift):
    wrong = replace(RAW, quaternions=np.roll(RAW.quaternions, shift, axis=1))
    assert "is the order correct?" in texts(only(wrong), warnings=True)


def test_a_changed_order_is_noticed_in_recordings_of_people():
    """Of nine who open a box, 15 of 18 are found, and none as they are."""
    found, wrongly = 0, 0
    for file in sorted((ROOT / "examples/recordings/openbox").glob("*.csv")):
        (raw,) = read_here(file, ANY)
        opened = without_spikes(
            usable(raw, ImportSettings(recorded_rate=20.0), Notes()), Notes()
        ).poses
        wrongly += doubtful_rotation(opened) is not None
        for shift in (-1, 1):
            changed = np.roll(opened[:, 3:], shift, axis=1)
            changed = np.hstack([opened[:, :3], changed])
            found += doubtful_rotation(changed) is not None
    assert (found, wrongly) == (15, 0)


def test_one_that_is_unlike_the_others_is_named():
    alike = [door(angle=1.2 + 0.01 * number) for number in range(5)]
    motions = prepare([*alike, door(angle=2.4)], ANY)
    odd = [n for n, one in enumerate(motions) if "unlike the others" in texts(one)]
    assert odd == [5]
    assert texts(motions[5]).splitlines()[-1] == (
        "unlike the others: 665 mm from the median motion, most along -z, at 100 % of "
        "the path (usual: 9 mm); 67 deg from the median motion, most about +y, at "
        "100 % of the path (usual: 1 deg)"
    )
    # Repetitions by hand that differ by less are alike, however equal the others are.
    assert not outliers([np.zeros((9, 6))] * 4 + [np.full((9, 6), 0.01)])


def test_the_filter_halves_its_cutoff_and_keeps_slow_motion():
    raw = door(seconds=4.0)
    wave = np.sin(2.0 * math.pi * 10.0 * raw.times)
    shaken = replace(raw, positions=raw.positions + 0.01 * wave[:, None])
    rest = only(shaken, cutoff=10.0).demonstration.poses - only(raw).demonstration.poses
    middle = rest[200:-200, 0]
    # A Butterworth filter has 1/√2 at its cut-off; forwards and backwards, a half.
    assert 0.0045 < np.abs(middle).max() < 0.0055
    still = only(raw, cutoff=10.0).demonstration.poses - only(raw).demonstration.poses
    assert np.abs(still).max() < 2e-4


def test_gaps_are_bridged_or_refused():
    bridged = only(GAPPY, rate=100.0)
    assert "1 gaps bridged, the longest of 0.41 s" in texts(bridged)
    with pytest.raises(ValueError, match=r"no sample for 0\.41 s from 0\.90 s on;"):
        only(GAPPY, largest_gap=0.3)


def test_rests_at_the_ends_are_cut():
    motion = only(door(rest=1.0), keep_rests=False)
    span = np.ptp(motion.demonstration.times)
    assert 1.6 < span < 2.3
    assert "cut" in texts(motion)


def test_repetitions_lie_between_rests_and_motions_back_are_left_out():
    """A door is opened, closed and opened again, resting in between."""
    once = door(rest=0.5)
    there = np.arange(len(once.positions))
    whole = once.part(np.r_[there, there[::-1], there])
    whole = replace(whole, times=np.arange(3 * len(there)) / RATE)
    motions = prepare([whole], ImportSettings(segment="rests"))
    assert [one.name for one in motions] == ["door.csv #1", "door.csv #2"]
    assert "2 repetitions between rests, 1 other motions left out" in texts(motions[0])
    first, second = (one.demonstration.poses for one in motions)
    assert_allclose(first[-1], second[-1], atol=5e-3)
    grip = Rotation.from_quat(RAW.quaternions, scalar_first=True)[0]
    end = grip.inv().apply(RAW.positions[-1] - RAW.positions[0])
    assert_allclose(first[-1, :3], end, atol=5e-3)


def test_poses_are_composed_and_not_subtracted():
    recorded = only(RAW).demonstration.poses
    relative = only(RAW, frame="first-pose").demonstration
    assert_allclose(relative.poses, relative_poses(recorded, recorded[0]), atol=1e-12)
    frame = (*START.tolist(), *TURN.as_quat(scalar_first=True).tolist())
    poses = only(RAW, frame=frame).demonstration.poses
    expected = handle_pose_on_arc(0.6, 1.2 * minimum_jerk(TIMES / 2.0))
    assert_allclose(poses[:, :3], expected[:, :3], atol=1e-12)
    # An offset is in the frame of the hand.
    poses = only(RAW, offset=(0.1, 0.0, 0.02, 1.0, 0.0, 0.0, 0.0)).demonstration.poses
    rotations = Rotation.from_quat(WXYZ, scalar_first=True)
    expected = POSITIONS + rotations.apply([0.1, 0.0, 0.02])
    assert_allclose(poses[:, :3], expected, atol=1e-12)


@pytest.mark.parametrize(("angle", "radius"), [(1.2, 0.6), (0.5, 0.35), (-1.0, 0.9)])
def test_a_hinge_is_found_and_gives_the_doors_task_frame(angle, radius):
    raw = door(angle=angle, radius=radius)
    # However it stood in the world, it is a door that is pulled open about +y.
    angles = abs(angle) * minimum_jerk(np.asarray(door().times) / 2.0)
    expected = handle_pose_on_arc(radius, angles)
    without = only(replace(raw, quaternions=None), frame="hinge")
    for motion in (only(raw, frame="hinge"), without):
        assert motion.radius == pytest.approx(radius, abs=1e-9)
        assert_allclose(motion.demonstration.poses, expected, atol=1e-7)
        assert f"hinge at {radius:.3f} m, opened to" in texts(motion)
    assert "the hand is assumed to rotate with the door" in texts(without)


def test_a_hinge_is_found_in_noise():
    positions = door(radius=0.55).positions
    noise = np.random.default_rng(0).normal(scale=1e-3, size=positions.shape)
    hinge = find_hinge(positions + noise)
    assert hinge.radius == pytest.approx(0.55, abs=2e-3)
    assert hinge.residual < 3e-3


@pytest.mark.parametrize("angle", [1.2, -1.2])
def test_a_door_that_is_closed_again_is_noticed(angle):
    raw = door(angle=angle)
    there_and_back = raw.part(np.r_[0:401, 399:-1:-1])
    times = np.arange(801) / RATE
    motion = only(replace(there_and_back, times=times), frame="hinge")
    said = "opened to 69° after 2.00 s, then closed to 0°: to learn to open, cut there"
    assert f"{said} (--segment 0.00-2.00)" in texts(motion, warnings=True)
    # It is opened about +y all the same, in whichever direction noise ends.
    assert_allclose(motion.demonstration.poses[400, 4], 1.2, atol=1e-7)
    assert not texts(only(raw, frame="hinge"), warnings=True)


def test_what_is_about_no_hinge_is_refused():
    with pytest.raises(ValueError, match="no hinge: it has fewer than three samples"):
        find_hinge(np.eye(2, 3))
    line = np.linspace(0.0, 1.0, 100)
    straight = np.column_stack([line, 0.01 * line**2, 0.0 * line])
    with pytest.raises(ValueError, match="no hinge: it is an arc of "):
        find_hinge(straight)
    bent = np.column_stack([np.sin(9.0 * line), line, np.cos(4.0 * line)])
    with pytest.raises(ValueError, match=r"no hinge: .* off a circle"):
        find_hinge(bent)


@pytest.mark.parametrize("last", [False, True])
@pytest.mark.parametrize("way", [(0.05, 0, 0), (0, 0.1, 0), (0.1, 0, 0.1)])
def test_reach_and_retreat_are_no_part_of_the_circle(way, last, monkeypatch):
    monkeypatch.undo()  # in fine steps
    line = np.linspace(1.0, 0.0, 100)[:, None] * TURN.apply(way)
    part = RAW.part(np.r_[0:401, [400] * 100] if last else np.r_[[0] * 100, 0:401])
    positions = part.positions.copy()
    positions[401 if last else 0 :][:100] += line[::-1] if last else line
    raw = replace(part, positions=positions, times=np.arange(501) / RATE)
    motion = only(raw, frame="hinge")
    assert motion.radius == pytest.approx(0.6, abs=5e-3)
    turned = motion.demonstration.poses[-1, 4]
    assert turned == pytest.approx(1.2, abs=0.05)
    assert "off the circle of the hinge" in texts(motion, warnings=True)


def test_a_hinge_unlike_a_door_or_the_hands_rotation_is_doubted():
    assert "right? doors have a radius" in texts(
        only(door(radius=0.2), frame="hinge"), warnings=True
    )
    rotations = Rotation.from_quat(WXYZ, scalar_first=True)
    since = (rotations * rotations[0].inv()).as_rotvec()
    slower = Rotation.from_rotvec(0.7 * since) * rotations[0]
    quaternions = slower.as_quat(scalar_first=True)
    motion = only(replace(RAW, quaternions=quaternions), frame="hinge")
    assert "right? the hand turned by 48°" in texts(motion, warnings=True)


@pytest.mark.parametrize("frame", ["first-pose", "recorded"])
def test_a_circle_without_its_hinge_is_noticed_once(frame):
    motions = prepare([door(), door(angle=1.0)], ImportSettings(frame=frame))
    said = "moves on a circle of radius 0.60 m, as 1 more do"
    assert [said in texts(motion, warnings=True) for motion in motions] == [True, False]


def test_orientations_that_contradict_the_path_are_noticed():
    rotations = Rotation.from_quat(WXYZ, scalar_first=True)
    wrong = rotations.inv().as_quat(scalar_first=True)
    raw = replace(RAW, quaternions=wrong, reading="matrices")
    assert "was it read rightly, as matrices" in texts(only(raw), warnings=True)
    raw = replace(RAW, reading="matrices")
    assert "read rightly" not in texts(only(raw))


@pytest.mark.parametrize("lost", ["positions", "quaternions"])
def test_where_a_tracker_lost_the_hand_samples_are_missing(lost):
    values = np.array(getattr(RAW, lost))
    values[100:120] = 0.0 if lost == "positions" else (1.0, 0.0, 0.0, 0.0)
    motion = only(replace(RAW, **{lost: values}))
    assert "20 of 401 samples missing" in texts(motion)
    # A motion that begins at zero loses none.
    relative = replace(RAW, positions=POSITIONS - POSITIONS[0])
    assert len(only(relative).demonstration.times) == 401


FRAME_POSE = (0.3, -0.2, 0.5, 0.5, 0.5, -0.5, 0.5)
SENSOR_POSE = (0.02, -0.01, -0.12, 0.8, 0.0, 0.6, 0.0)
OFFSET = (0.1, 0.05, -0.03, 0.6, 0.0, 0.0, 0.8)


def matrix(pose: Any) -> Any:
    """Homogeneous matrices of poses with quaternions, (..., 4, 4)."""
    pose = np.asarray(pose, dtype=float)
    transform = np.zeros((*pose.shape[:-1], 4, 4))
    transform[..., :3, :3] = Rotation.from_quat(
        pose[..., 3:], scalar_first=True
    ).as_matrix()
    transform[..., :3, 3], transform[..., 3, 3] = pose[..., :3], 1.0
    return transform


def power(wrenches: Any, body: Any, axes: Any, twists: Any) -> Any:
    """Of wrenches about the origin of a body, when points x move by v + ω × x."""
    velocities = twists[:, :3] + np.cross(twists[:, 3:], body[:, :3, 3])
    both = np.stack([velocities, twists[:, 3:]], axis=1)
    return np.sum(wrenches * (both @ axes).reshape(-1, 6), axis=1)


@pytest.mark.parametrize("frame", ["recorded", "first-pose", "hinge", FRAME_POSE])
@pytest.mark.parametrize("acts_on", ["hand", "object"])
def test_the_power_of_a_wrench_is_the_same_in_every_frame(frame, acts_on):
    """Virtual work: for any motion of the hand, and the opposite of the environment."""
    rng = np.random.default_rng(3)
    felt, twists = rng.normal(size=(2, 401, 6))
    raw, sensor = replace(RAW, wrenches=felt), {"force_sensor": SENSOR_POSE}
    # Of a hinge, only the frame of the hand itself is known here.
    offset = None if frame == "hinge" else OFFSET
    motion = only(raw, **sensor, force_on=acts_on, offset=offset, frame=frame)
    hand = matrix(np.hstack([POSITIONS, np.asarray(WXYZ)]))
    sensed = hand @ matrix(SENSOR_POSE)
    held = hand if offset is None else hand @ matrix(offset)
    bases = {"recorded": np.eye(3), "first-pose": held[0, :3, :3]}
    bases["hinge"] = TURN.as_matrix()
    axes = bases[frame] if isinstance(frame, str) else matrix(frame)[:3, :3]
    measured = power(felt, sensed, sensed[:, :3, :3], twists)
    found = power(motion.demonstration.wrenches, held, axes, twists)
    sign = -1.0 if acts_on == "hand" else 1.0
    assert_allclose(found, sign * measured, rtol=0, atol=1e-9)


@pytest.mark.parametrize("axes", ["hand", "recorded"])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_weight_and_bias_are_removed_exactly(axes, sign):
    """Two equal springs, of which one sensor carries a tool and is not tared."""
    rng = np.random.default_rng(4)
    raw = door(rest=1.0)
    pose = SENSOR_POSE if axes == "hand" else (*SENSOR_POSE[:3], 1.0, 0.0, 0.0, 0.0)
    hand = matrix(np.hstack([raw.positions, np.asarray(raw.quaternions)]))
    sensor = hand @ matrix(pose)
    turned = sensor[:, :3, :3] if axes == "hand" else np.eye(3)[None]
    applied = rng.normal(size=(len(hand), 6)) * (np.asarray(raw.times) > 0.5)[:, None]
    centre, down = np.array([0.01, 0.02, 0.15]), np.array([0.6, 0.0, -0.8])
    arms = np.einsum("nij,j->ni", sensor[:, :3, :3], centre)
    load = 7.0 * np.hstack([np.tile(down, (len(hand), 1)), np.cross(arms, down)])
    about = applied - np.hstack(
        [0.0 * arms, np.cross(sensor[:, :3, 3] - hand[:, :3, 3], applied[:, :3])]
    )
    felt = (about + load).reshape(-1, 2, 3) @ turned
    felt = felt.reshape(-1, 6) + np.array([3.0, -2.0, 1.0, 0.1, 0.2, 0.3])
    motion = only(
        replace(raw, wrenches=sign * felt),
        force_on="hand" if sign > 0.0 else "object",
        force_axes=axes,
        force_sensor=pose,
        force_rest=0.5,
        tool_weight=7.0,
        tool_centre=tuple(centre),
        gravity=tuple(2.0 * down),
    )
    assert_allclose(motion.demonstration.wrenches, -applied, rtol=0, atol=1e-12)
    assert "weight of 7 N subtracted from the forces" in texts(motion)
    assert "bias of 3.74 N and 0.374 N m subtr" in texts(motion)


HELD: Any = {"force_axes": "recorded", "force_on": "object"}


def test_forces_are_cut_filtered_and_resampled_as_positions():
    raw = door(rest=1.0)
    positions = np.array(raw.positions)
    raw = replace(raw, wrenches=np.hstack([positions, positions]))
    for segments in ("none", ((1.2, 2.6),)):
        settings = ImportSettings(frame="recorded", **HELD, segment=segments)
        shown = only(raw, settings).demonstration
        assert shown.wrenches is not None
        assert_allclose(shown.wrenches, np.tile(shown.poses[:, :3], 2), atol=1e-12)


def test_missing_forces_are_interpolated_or_left_out():
    line = np.outer(TIMES, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    wrenches = line.copy()
    wrenches[100:120, 2], wrenches[0, 0], wrenches[300] = np.nan, np.inf, 1e300
    motion = only(replace(RAW, wrenches=wrenches), **HELD)
    found = motion.demonstration.wrenches
    assert found is not None
    assert_allclose(found[1:], line[1:], atol=1e-12)
    assert_array_equal(found[0], found[1])
    assert "forces of 22 samples interpolated" in texts(motion, warnings=False)
    wrenches[100:220] = np.nan
    motion = only(replace(RAW, wrenches=wrenches), **HELD)
    assert motion.demonstration.wrenches is None
    said = "none for 0.61 s from 0.49 s on; .* --largest-gap 0.62"
    assert re.search(said, texts(motion, warnings=True))


def test_forces_that_cannot_be_converted_are_left_out():
    felt = np.ones((401, 6))
    flat = replace(RAW, quaternions=None, wrenches=felt)
    motion = only(flat)
    assert motion.demonstration.wrenches is None
    assert "say --force-axes recorded if" in texts(motion, warnings=True)
    motion = only(flat, **HELD)
    assert_array_equal(motion.demonstration.wrenches, felt)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"force_on": "door"}, "force_on = 'door' is not one of 'hand', 'object'"),
        ({"force_sensor": (0, 0, 0, 1, 1, 0, 0)}, "force_sensor = .* a unit quatern"),
        ({"force_sensor": SENSOR_POSE, "force_axes": "recorded"}, "turned in the hand"),
        ({"gravity": (0.0, -1.0)}, "gravity = .* must be three numbers x,y,z"),
        ({"rate": math.inf}, "rate = inf is outside"),
        ({"frame": "world"}, "must be one of first-pose, recorded, hinge"),
        ({"segment": "fast"}, "must be none, rests, or times"),
        ({"segment": ((2.0, 1.0),)}, "each start before its end"),
    ],
)
def test_settings_that_make_no_sense(settings, message):
    with pytest.raises(ValueError, match=message):
        ImportSettings(**settings)
