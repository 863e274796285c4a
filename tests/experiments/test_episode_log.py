import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.metrics import episode_metrics, late_decisions

MakeLog = Callable[..., EpisodeLog]


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


def test_incomplete_file(tmp_path, make_log):
    path = tmp_path / "log.npz"
    make_log().save(path)
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files if name != "wrench"}
    np.savez(path, **arrays)
    with pytest.raises(ValueError, match=r"log\.npz cannot be read .* lacks 'wrench'"):
        EpisodeLog.load(path)


def test_a_file_from_before_wall_times_were_measured_is_read(tmp_path, make_log):
    path = tmp_path / "log.npz"
    make_log().save(path)
    with np.load(path) as archive:
        arrays = {n: archive[n] for n in archive.files if n != "latency_wall_s"}
    np.savez(path, **arrays)
    log = EpisodeLog.load(path)
    assert np.isnan(log.latency_wall_s).all()
    metrics = episode_metrics(log)
    assert metrics.latency_wall_median_ms is metrics.latency_wall_p95_ms is None
    assert late_decisions([metrics.as_json()]) == ""


@pytest.mark.parametrize("header", ["[1]", "{", "[" * 9999, '{"other": 1}'])
def test_wrong_header(tmp_path, make_log, header):
    path = tmp_path / "log.npz"
    make_log().save(path)
    rewrite_header(path, header)
    with pytest.raises(ValueError, match=r"log\.npz cannot be read as a gplfd episode"):
        EpisodeLog.load(path)


@pytest.mark.parametrize("name", ["policy", "door_config", "seed", "dt", "success"])
def test_wrong_header_names_the_field(tmp_path, make_log, name):
    path = tmp_path / "log.npz"
    make_log().save(path)
    with np.load(path) as archive:
        header = json.loads(str(archive["header"]))
    rewrite_header(path, json.dumps(header | {name: None}))
    with pytest.raises(ValueError, match=rf"log\.npz cannot .*: its {name} is None"):
        EpisodeLog.load(path)


def rewrite_header(path: Path, header: str) -> None:
    with np.load(path) as archive:
        arrays = dict(archive) | {"header": np.array(header)}
    np.savez(path, **arrays)
