"""A trajectory as a table."""

import csv
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from gplfd_policies.movements.trajectory import CSV_COLUMNS

TIMES = np.linspace(0.0, 1.0, 40)


def table(path):
    with path.open(encoding="utf-8") as file:
        rows = list(csv.reader(line for line in file if not line.startswith("#")))
    assert ",".join(rows[0]) == CSV_COLUMNS
    return np.array(rows[1:], dtype=np.float64)


def test_rows_are_the_predicted_poses_at_their_times(skill, tmp_path):
    trajectory = skill.predict(TIMES)
    trajectory.to_csv(tmp_path / "new" / "a.csv", duration=8.0)
    found = table(tmp_path / "new" / "a.csv")
    assert_array_equal(found[:, 0], 8.0 * TIMES)
    assert_array_equal(found[:, 1:4], trajectory.mean[:, :3])
    assert_array_equal(found[:, 8:], trajectory.std)
    expected = Rotation.from_rotvec(trajectory.mean[:, 3:].copy())
    apart = (Rotation.from_quat(found[:, 4:8]) * expected.inv()).magnitude()
    assert_allclose(apart, 0.0, atol=1e-15)


def test_quaternions_keep_their_sign_beyond_half_a_turn(skill, tmp_path):
    """Rotations up to one and a half turns, from the identity on."""
    trajectory = skill.predict(TIMES)
    turning = np.array(trajectory.mean)
    turning[:, 3:] = np.outer(3.0 * np.pi * TIMES, [0.6, 0.0, 0.8])
    replace(trajectory, mean=turning).to_csv(tmp_path / "a.csv", duration=1.0)
    quaternions = table(tmp_path / "a.csv")[:, 4:8]
    assert_allclose(np.linalg.norm(quaternions, axis=1), 1.0, atol=1e-15)
    assert (np.vecdot(quaternions[1:], quaternions[:-1]) > 0.9).all()
    assert_array_equal(quaternions[0], [0.0, 0.0, 0.0, 1.0])


def test_the_file_says_frame_and_units(skill, tmp_path):
    skill.predict(TIMES).to_csv(tmp_path / "a.csv", duration=8.0)
    text = (tmp_path / "a.csv").read_text(encoding="utf-8")
    assert text.startswith("# A trajectory of the hand by gplfd, version 1.\n")
    assert "On doors: origin at the closed handle, x pulls, y up" in text
    assert "\ntime [s],x [m],y [m],z [m],qx,qy,qz,qw,std_x [m]," in text
    assert_array_equal(
        np.loadtxt(text.splitlines()[7:], delimiter=","), table(tmp_path / "a.csv")
    )


def test_a_method_without_spread_writes_nan(skill, tmp_path):
    none = np.full((40, 6), np.nan)
    replace(skill.predict(TIMES), std=none).to_csv(tmp_path / "a.csv", duration=8.0)
    assert np.isnan(table(tmp_path / "a.csv")[:, 8:]).all()


def test_what_is_no_table_is_refused(skill, tmp_path):
    good, path = skill.predict(TIMES), tmp_path / "a.csv"
    for duration in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="duration must be positive and finite"):
            good.to_csv(path, duration=duration)
    with pytest.raises(ValueError, match="times of a table must increase strictly"):
        skill.predict(TIMES[::-1]).to_csv(path, duration=8.0)
    lost = replace(good, mean=np.full((40, 6), np.nan))
    with pytest.raises(ValueError, match="poses of a table must be finite"):
        lost.to_csv(path, duration=8.0)
    assert list(tmp_path.iterdir()) == []
