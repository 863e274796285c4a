"""What reports and files say of trials taken together: scores, tiers, rows."""

import csv
import json
import math

import numpy as np
import pyarrow.parquet
import pytest

from gplfd_experiments.analysis.report.trials import aggregate_table, tier_tables
from gplfd_experiments.analysis.results.reading import read_results
from gplfd_experiments.analysis.results.trials import (
    deciding_measure,
    interquartile_mean_in_units,
    scores,
    success_measure,
)
from gplfd_experiments.cli.main import main
from gplfd_experiments.studies.trials.protocol import TIERS, TRIALS

RADIAL = "force_radial_peak"


@pytest.fixture
def heavy(write_study, episode_result):
    """Eight seeds of two trials of a tier; the circle fit fails in one."""
    results = []
    for policy, force in (("gp", 2.0), ("promp", 4.0), ("hinge-fit", 1.0)):
        for seed in range(8):
            for trial, level in (("radius", "between"), ("heavy", "14 N")):
                shut = policy == "hinge-fit" and trial == "heavy"
                task = {"trial": trial, "level": level, "opened": not shut}
                one = episode_result(policy, seed, radial=force, **task)
                one["metrics"]["final_angle_deg"] = 30.0 if shut else 64.0 + seed
                results.append(one)
    for seed in range(8):
        own = {"trial": "heavy", "level": "14 N"}
        results.append(episode_result("gp-fixed", seed, **own))
    return write_study(results)


def test_tiers_have_trials_of_the_protocol_once_each():
    names = [name for names in TIERS.values() for name in names]
    assert len(set(names)) == len(names)
    assert set(names) <= TRIALS.keys()
    assert set(TIERS["forces"]) == {one for one in TRIALS if "forces-" in one}

    # Each has a share, and a measure that is none.
    for name, trial in TRIALS.items():
        assert success_measure(trial) in trial.measures, name
        assert deciding_measure(trial) not in ("success", "grasp_kept"), name
    assert success_measure(TRIALS["locked"]) == "grasp_kept"


def test_scores_are_greater_where_better_and_failures_are_worst(heavy):
    """Of forces only: who stops at an angle has reached that angle."""
    episodes = read_results(heavy).episodes
    forces = scores(episodes, RADIAL)
    np.testing.assert_allclose(forces["gp"][:, 0], -2.0 - 0.01 * np.arange(8))
    # Strata in order: heavy, radius.
    assert np.all(forces["hinge-fit"][:, 0] == -math.inf)
    assert np.all(np.isfinite(forces["hinge-fit"][:, 1]))
    assert np.all(np.isnan(forces["gp-fixed"][:, 1]))
    assert interquartile_mean_in_units(forces["gp"], RADIAL).estimate == pytest.approx(
        2.035
    )
    assert interquartile_mean_in_units(forces["hinge-fit"], RADIAL).estimate == math.inf
    angles = scores(episodes, "final_angle_deg")
    assert np.all(angles["hinge-fit"][:, 0] == 30.0)


def test_the_table_has_the_best_first_and_the_reference_against_all(heavy):
    arrays = scores(read_results(heavy).episodes, RADIAL)
    rows = aggregate_table(arrays, RADIAL, "gp").rows
    assert [row[0] for row in rows] == ["`gp-fixed`", "`gp`", "`promp`", "`hinge-fit`"]
    assert rows[1][1:] == ("2.0\n2.0 to 2.1", "0.50\n0.50 to 0.50")
    assert rows[2][2] == "1.00\n1.00 to 1.00"
    # At one of two doors the circle fit is gentler, and at the other it fails.
    assert rows[3][1:] == ("–", "0.50\n0.50 to 0.50")


def test_a_table_per_tier_has_successes_and_radial_force(heavy):
    title, table = tier_tables(read_results(heavy))
    assert title.text == "**Tier furniture**, 2 of 7 trials"
    assert [row[:3] for row in table.rows] == [
        ("`gp`", "method", "16/16\n0.81–1.00"),
        ("`promp`", "method", "16/16\n0.81–1.00"),
        ("`hinge-fit`", "reference", "8/16\n0.28–0.72"),
    ]
    assert [row[3][:3] for row in table.rows] == ["2.0", "4.0", "–"]


def test_rows_are_the_same_as_csv_and_parquet(heavy, tmp_path, capsys):
    for name in ("rows.csv", "rows.parquet"):
        command = ["report", str(heavy), "--out", str(tmp_path / "page")]
        assert main([*command, "--rows", str(tmp_path / name)]) == 0
    with (tmp_path / "rows.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    table = pyarrow.parquet.read_table(tmp_path / "rows.parquet").to_pylist()
    assert len(rows) == len(table) == 8 * 7
    for text, row in zip(rows, table, strict=True):
        assert text == {name: "" if v is None else str(v) for name, v in row.items()}
    assert main([*command, "--rows", "rows.xlsx"]) == 2
    assert "rows.xlsx must end in .csv or .parquet" in capsys.readouterr().err
    first = next(row for row in table if row["policy"] == "hinge-fit")
    assert (first["trial"], first["success"], first["seed"]) == ("heavy", False, 0)
    assert first["time_to_60_deg"] is None
    assert isinstance(json.loads(first["door_config"]), dict)
