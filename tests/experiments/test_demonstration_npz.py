from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gplfd_experiments.data.teacher import Teacher
from gplfd_policies.arrays.storage import write_archive
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.demonstrations.npz import (
    FIRST_POSE,
    KIND,
    VERSION,
    load_demonstrations,
    save_demonstrations,
)


@pytest.fixture
def saved(tmp_path: Path) -> Path:
    path = tmp_path / "d.npz"
    demonstrations = Teacher().demonstrate_doors(
        [0.35, 0.5], 1, rng=np.random.default_rng(0)
    )
    save_demonstrations(path, demonstrations, [0.35, None])
    return path


def rewrite(path: Path, **changes: Any) -> None:
    with np.load(path) as archive:
        arrays = dict(archive) | changes
    np.savez(path, **{name: a for name, a in arrays.items() if a is not None})


def test_round_trip_is_exact(tmp_path: Path, saved: Path) -> None:
    loaded = load_demonstrations(saved)
    assert loaded.radii == (0.35, None)
    again = tmp_path / "again.npz"
    save_demonstrations(again, loaded.demonstrations, loaded.radii)
    for one, other in zip(
        loaded.demonstrations, load_demonstrations(again).demonstrations, strict=True
    ):
        assert one.times.tobytes() == other.times.tobytes()
        assert one.poses.tobytes() == other.poses.tobytes()


def test_radii_may_be_unknown_altogether(saved: Path) -> None:
    loaded = load_demonstrations(saved)
    save_demonstrations(saved, loaded.demonstrations)
    with np.load(saved) as archive:
        np.testing.assert_array_equal(archive["radii"], [np.nan, np.nan])
    again = load_demonstrations(saved)
    assert again.radii == (None, None)
    assert len(again.demonstrations) == 2


def test_file_says_what_it_holds(saved: Path) -> None:
    with np.load(saved) as archive:
        assert str(archive["units"]) == "s, m, rad"
        assert "closed handle" in str(archive["frame"])
        assert int(archive["format_version"]) == VERSION


def test_frame_and_signals_are_kept(saved: Path) -> None:
    shown = load_demonstrations(saved).demonstrations
    force = [np.full((len(one.times), 6), float(n)) for n, one in enumerate(shown)]
    signals: list[dict[str, Any]] = [{"force": force[0]}, {}]
    save_demonstrations(saved, shown, frame=FIRST_POSE, signals=signals)
    again = load_demonstrations(saved.parent / saved.name)
    assert again.frame == FIRST_POSE
    assert again.signals[1] == {}
    np.testing.assert_array_equal(again.signals[0]["force"], force[0])
    with pytest.raises(ValueError, match="2 demonstrations and 1 of signals"):
        save_demonstrations(saved, shown, signals=signals[:1])


def test_a_folder_means_the_file_in_it(saved: Path) -> None:
    saved.rename(saved.with_name("demonstrations.npz"))
    assert len(load_demonstrations(saved.parent).demonstrations) == 2


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"there is no file .*nothing\.npz"):
        load_demonstrations(tmp_path / "nothing.npz")


@pytest.mark.parametrize("fraction", [0.0, 0.3, 0.9])
def test_cut_file(saved: Path, fraction: float) -> None:
    whole = saved.read_bytes()
    saved.write_bytes(whole[: int(fraction * len(whole))])
    with pytest.raises(ValueError, match=r"d\.npz cannot be read as gplfd demonst"):
        load_demonstrations(saved)


def test_foreign_files(tmp_path: Path, saved: Path) -> None:
    np.savez(tmp_path / "foreign.npz", a=np.zeros(3))
    with pytest.raises(ValueError, match="holds something else"):
        load_demonstrations(tmp_path / "foreign.npz")
    write_archive(saved, kind="a gplfd episode log", version=1, arrays={})
    with pytest.raises(ValueError, match="it holds a gplfd episode log"):
        load_demonstrations(saved)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"units": np.array("s, mm, deg")}, "units is 's, mm, deg', must be 's, m, "),
        ({"frame": np.array("world")}, "frame is 'world', must be one of"),
        ({"signals": np.zeros(2)}, "signals must be a list of names"),
        ({"signals": np.array(["force"])}, "it lacks 'force_0'"),
        (
            {"signals": np.array(["f"]), "f_0": np.zeros((2, 1)), "f_1": np.zeros(2)},
            r"signal 'f' has shape \(2, 1\), must be \(",
        ),
        ({"poses_1": None}, "it lacks 'poses_1'"),
        ({"radii": None}, "it lacks 'radii'"),
        ({"radii": np.zeros(0)}, "0 demonstrations and 0 radii"),
        ({"radii": np.array(0.5)}, r"radii has shape \(\)"),
        ({"radii": np.array([0.5])}, "it holds 'times_1', which does not belong"),
        ({"radii": np.array([0.5, np.inf])}, "radius is inf; it must be positive"),
        ({"radii": np.array([0.5, -0.4])}, "radius is -0.4; it must be positive"),
        ({"radii": np.array([0.5, 0.0])}, "radius is 0.0; it must be positive"),
        ({"radii": np.array([True, True])}, "radii holds bool, must hold numbers"),
        ({"radii": np.array(["0.5", "0.4"])}, "radii holds <U3, must hold numbers"),
        ({"times_1": np.array(["0", "1"])}, "times_1 holds <U1, must hold numbers"),
        ({"units": np.zeros(3)}, r"units is '\[0. 0. 0.\]', must be 's, m, rad'"),
        ({"radii": np.array([0.5, 0.4j])}, "'radii' holds complex128, not numbers"),
        (
            {"poses_1": np.zeros((5, 6)), "times_1": np.arange(5.0)},
            "demonstration 1: .* never moves",
        ),
    ],
)
def test_wrong_content(saved: Path, changes: dict[str, Any], message: str) -> None:
    rewrite(saved, **changes)
    with pytest.raises(ValueError, match=message):
        load_demonstrations(saved)


def test_other_version(saved: Path) -> None:
    write_archive(saved, kind=KIND, version=VERSION + 1, arrays={})
    with pytest.raises(ValueError, match=r"has version 3, .* reads version 2"):
        load_demonstrations(saved)


def test_every_demonstration_needs_a_label(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="0 demonstrations and 1 radii"):
        save_demonstrations(tmp_path / "d.npz", [], [0.5])
    with pytest.raises(ValueError, match="0 demonstrations and 0 radii"):
        save_demonstrations(tmp_path / "d.npz", [])
    with pytest.raises(ValueError, match=r"radius is -0\.5; it must be positive"):
        save_demonstrations(tmp_path / "d.npz", [moving()], [-0.5])
    assert list(tmp_path.iterdir()) == []


def moving() -> Demonstration:
    return Demonstration(times=np.arange(2.0), poses=np.eye(2, 6))
