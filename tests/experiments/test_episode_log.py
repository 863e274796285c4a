import dataclasses
import json

import numpy as np
import pytest

from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.metrics import episode_metrics, late_decisions


def test_round_trip_is_exact(tmp_path, make_log):
    log = make_log(predicted_std=np.full((601, 6), np.nan))
    log.save(tmp_path / "log.npz")
    loaded = EpisodeLog.load(tmp_path / "log.npz")
    for field in dataclasses.fields(EpisodeLog):
        one, other = getattr(log, field.name), getattr(loaded, field.name)
        if isinstance(one, np.ndarray):
            assert one.dtype == other.dtype, field.name
            assert one.tobytes() == other.tobytes(), field.name
        else:
            assert one == other, field.name


def test_a_log_is_printed_in_one_line(make_log):
    log = make_log()
    shown = f"EpisodeLog({log.policy} on {log.door}, seed {log.seed}, 601 steps, "
    assert repr(log).startswith(shown)
    assert repr(make_log(success=True, failure="")).endswith(", opened)")
    assert repr(make_log(success=False, failure="stalled")).endswith(", stalled)")


def test_arrays_are_own_and_read_only(make_log):
    wrench = np.zeros((601, 6))
    log = make_log(wrench=wrench)
    wrench[:] = 1.0
    assert np.all(log.wrench == 0.0)
    with pytest.raises(ValueError, match="read-only"):
        log.wrench[0, 0] = 1.0
    with pytest.raises(TypeError):
        log.door_config["radius"] = 1.0  # type: ignore[index]


@pytest.mark.parametrize(
    ("name", "shape"),
    [("std", (600, 6)), ("joint_pos", (601, 6)), ("forecast_mean", (3, 20, 6))],
)
def test_wrong_shape_names_the_array(make_log, name, shape):
    with pytest.raises(ValueError, match=rf"EpisodeLog\.{name} has shape"):
        make_log(**{name: np.zeros(shape)})


@pytest.fixture
def rewritten(tmp_path, make_log):
    """Save a log, change the arrays of its file, and return where it is."""

    def write(change):
        path = tmp_path / "log.npz"
        make_log().save(path)
        with np.load(path) as archive:
            arrays = dict(archive)
        change(arrays)
        np.savez(path, **arrays)
        return path

    return write


def test_a_file_from_before_wall_times_were_measured_is_read(rewritten):
    log = EpisodeLog.load(rewritten(lambda arrays: arrays.pop("latency_wall_s")))
    assert np.isnan(log.latency_wall_s).all()
    metrics = episode_metrics(log)
    assert metrics.latency_wall_median_ms is metrics.latency_wall_p95_ms is None
    assert late_decisions([metrics.as_json()]) == ""


def headed(header):
    """Replace the header by a text, or some of its values."""

    def change(arrays):
        text = header
        if isinstance(header, dict):
            text = json.dumps(json.loads(str(arrays["header"])) | header)
        arrays["header"] = text

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda arrays: arrays.pop("wrench"), "lacks 'wrench'"),
        *((headed(text), "") for text in ("[1]", "{", "[" * 9999, '{"other": 1}')),
        *(
            (headed({name: None}), f"its {name} is None")
            for name in ("policy", "door_config", "seed", "dt", "success")
        ),
    ],
)
def test_a_wrong_file_is_refused(rewritten, change, message):
    said = rf"log\.npz cannot be read as a gplfd episode.*{message}"
    with pytest.raises(ValueError, match=said):
        EpisodeLog.load(rewritten(change))
