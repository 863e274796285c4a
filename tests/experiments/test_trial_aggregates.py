"""What reports and files say of trials taken together: scores and rows."""

import csv
import json
from dataclasses import replace

import pytest

from gplfd_experiments.analysis.report.sections import ordered
from gplfd_experiments.analysis.results.reading import read_results
from gplfd_experiments.analysis.results.trials import (
    of_trials,
    success_measure,
)
from gplfd_experiments.cli.main import main
from gplfd_experiments.studies.trials.protocol import TRACKS, TRIALS

pytestmark = pytest.mark.slow

RADIAL = "force_radial_peak"


@pytest.fixture
def heavy(write_study, episode_result):
    """Eight seeds of two trials of a track; the circle fit fails in one."""
    results = []
    for policy, force in (("gp", 2.0), ("promp", 4.0), ("hinge-fit", 1.0)):
        for seed in range(8):
            for trial, level in (("person", "in the way"), ("heavy", "14 N")):
                shut = policy == "hinge-fit" and trial == "heavy"
                task = {"trial": trial, "level": level, "opened": not shut}
                one = episode_result(policy, seed, radial=force, **task)
                one["metrics"]["final_angle_deg"] = 30.0 if shut else 64.0 + seed
                results.append(one)
    return write_study(results)


def test_tracks_have_the_trials_of_the_protocol():
    assert {n for track in TRACKS.values() for n in track.trials} == TRIALS.keys()
    # Each has a measure that is a share, and one that is not.
    for name, trial in TRIALS.items():
        assert success_measure(trial) in trial.measures, name
        assert set(trial.measures) - {"success", "grasp_kept"}, name
    assert success_measure(TRIALS["locked"]) == "grasp_kept"


def test_who_opens_no_door_is_last_however_gentle(heavy):
    trial = replace(TRIALS["heavy"], measures=(RADIAL, "success"))
    [runs] = ordered(trial, of_trials(read_results(heavy))["heavy"]).values()
    assert [*runs][-1] == "hinge-fit"


def test_rows_have_fields_and_metrics_of_every_task(heavy, tmp_path, capsys):
    command = ["report", str(heavy), "--out", str(tmp_path / "page"), "--rows"]
    assert main([*command, str(tmp_path / "rows.csv")]) == 0
    with (tmp_path / "rows.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 8 * 6
    assert main([*command, "rows.xlsx"]) == 2
    assert "rows.xlsx must end in .csv" in capsys.readouterr().err
    first = next(row for row in rows if row["policy"] == "hinge-fit")
    assert (first["trial"], first["success"], first["seed"]) == ("heavy", "False", "0")
    assert first["time_to_60_deg"] == ""
    assert isinstance(json.loads(first["door_config"]), dict)
