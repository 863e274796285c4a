"""Files of demonstrations: exact, labelled, and refused with one message."""

import dataclasses
import hashlib
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.demonstrations.npz import (
    FIRST_POSE,
    VERSION,
    hash_of,
    load_demonstrations,
    save_demonstrations,
)

RNG = np.random.default_rng(0)
SHOWN = tuple(
    Demonstration(times=np.arange(n) / 60.0, poses=0.1 * RNG.normal(size=(n, 6)))
    for n in (40, 50)
)


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    save_demonstrations(tmp_path / "d.npz", SHOWN, [0.35, None])
    return tmp_path / "d.npz"


def test_round_trip_is_exact_and_says_what_it_holds(saved):
    loaded = load_demonstrations(saved)
    assert loaded.radii == (0.35, None)
    for one, other in zip(SHOWN, loaded.demonstrations, strict=True):
        assert one.times.tobytes() == other.times.tobytes()
        assert one.poses.tobytes() == other.poses.tobytes()
    with np.load(saved) as archive:
        assert str(archive["units"]) == "s, m, rad"
        assert "closed handle" in str(archive["frame"])
        assert int(archive["format_version"]) == VERSION
    # Radii may be unknown altogether, and a folder means the file in it.
    save_demonstrations(saved.with_name("demonstrations.npz"), SHOWN)
    assert load_demonstrations(saved.parent).radii == (None, None)


def test_wrenches_are_kept_where_there_are_any(saved):
    without = saved.read_bytes()
    wrenches = RNG.normal(size=(50, 6))
    felt = dataclasses.replace(SHOWN[1], wrenches=wrenches)
    save_demonstrations(saved, (SHOWN[0], felt), [0.35, None])
    first, second = load_demonstrations(saved).demonstrations
    assert first.wrenches is None
    assert_array_equal(second.wrenches, wrenches)
    # Sets without them are what they were, and so are their hashes.
    digest = hashlib.sha256()
    for one in SHOWN:
        digest.update(np.rint(1e6 * one.times).astype("<i8").tobytes())
        digest.update(np.rint(1e6 * one.poses).astype("<i8").tobytes())
    assert hash_of(SHOWN) == digest.hexdigest()[:16] != hash_of((SHOWN[0], felt))
    save_demonstrations(saved, SHOWN, [0.35, None])
    assert saved.read_bytes() == without
    with np.load(saved) as archive:
        assert not any(name.startswith("wrench") for name in archive)


def test_frame_and_signals_are_kept(saved):
    force = np.full((40, 6), 2.0)
    save_demonstrations(saved, SHOWN, frame=FIRST_POSE, signals=[{"force": force}, {}])
    again = load_demonstrations(saved)
    assert again.frame == FIRST_POSE
    assert again.signals[1] == {}
    assert_array_equal(again.signals[0]["force"], force)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([], [0.5]), "0 demonstrations, 1 radii"),
        ((SHOWN[:1], [-0.5]), r"they must be positive"),
    ],
)
def test_every_demonstration_needs_a_label(tmp_path, arguments, message):
    with pytest.raises(ValueError, match=message):
        save_demonstrations(tmp_path / "d.npz", *arguments)
    with pytest.raises(ValueError, match="2 demonstrations, 2 radii and 1 signals"):
        save_demonstrations(tmp_path / "d.npz", SHOWN, signals=[{}])
    assert list(tmp_path.iterdir()) == []


STILL = {"poses_1": np.zeros((5, 6)), "times_1": np.arange(5.0)}
SHORT = {"signals": ["f"], "f_0": np.zeros((2, 1)), "f_1": np.zeros(2)}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format_version": VERSION + 1}, "has version 3, .* reads version 2"),
        ({"units": "s, mm, deg"}, "units is 's, mm, deg', must be 's, m, "),
        ({"frame": "world"}, "frame is 'world', must be one of"),
        ({"signals": ["force"]}, "it lacks 'force_0'"),
        ({"signals": ["poses"]}, "a signal cannot have the name 'poses'"),
        (SHORT, r"signal 'f' has shape \(2, 1\), must be \("),
        (
            {"wrenches_1": np.full((50, 6), np.nan)},
            r"demonstration 1: wrenches must be finite",
        ),
        ({"poses_1": None}, "it lacks 'poses_1'"),
        ({"radii": None}, "it lacks 'radii'"),
        ({"radii": np.zeros(0)}, "0 demonstrations, 0 radii"),
        ({"radii": [0.5, np.inf]}, "they must be positive"),
        (STILL, "demonstration 1: .* never moves"),
    ],
)
def test_wrong_content(saved, changes, message):
    with np.load(saved) as archive:
        arrays = dict(archive) | changes
    np.savez(saved, **{name: a for name, a in arrays.items() if a is not None})
    with pytest.raises(ValueError, match=rf"d\.npz cannot be read .*{message}"):
        load_demonstrations(saved)
