"""A tiny door in MuJoCo, logs by formula, results of studies, and commands."""

import dataclasses
import functools
import json
import math
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from gplfd_env.doors.config import DoorConfig
from gplfd_env.spatial.se3 import handle_pose_on_arc
from gplfd_experiments.analysis.report.document import markdown_page
from gplfd_experiments.analysis.report.page import report
from gplfd_experiments.analysis.results.reading import read_results
from gplfd_experiments.cli import main as cli
from gplfd_experiments.data import importing, readers
from gplfd_experiments.data.preparation import frames
from gplfd_experiments.data.teacher import standard_teacher
from gplfd_experiments.data.teacher.motion import minimum_jerk
from gplfd_experiments.episodes.log import PARTS, EpisodeLog, arrays_of
from gplfd_experiments.episodes.metrics import episode_metrics
from gplfd_experiments.studies.store import RESULT_STAMP, STUDY_STAMP

RADIUS = 0.5
FINAL_ANGLE = math.radians(66.0)
DT = 0.01

MODEL = f"""
<mujoco>
  <asset>
    <mesh name="wedge" vertex="0 0 0  0.1 0 0  0 0.1 0  0 0 0.1"/>
    <material name="blue" rgba="0 0 1 1"/>
  </asset>
  <worldbody>
    <geom name="floor" type="plane" size="0 0 0.1" rgba="0.5 0.5 0.5 1"/>
    <body name="frame" pos="0.7 0.6 0.85" quat="0.5 0.5 0.5 0.5">
      <site name="task_frame"/>
      <body name="leaf" pos="0 0 {-RADIUS}">
        <joint name="hinge" type="hinge" axis="0 1 0" damping="1"/>
        <geom name="panel" type="box" pos="-0.07 0 0.25" size="0.02 1 0.25" mass="9"
              material="blue"/>
        <geom name="bar" type="capsule" size="0.01 0.1" pos="0 0 {RADIUS}"
              quat="0.707 0.707 0 0" rgba="1 0 0 0.5"/>
        <geom name="knob" type="sphere" size="0.02"/>
        <geom name="egg" type="ellipsoid" size="0.02 0.03 0.04"/>
        <geom name="pin" type="cylinder" size="0.01 0.05"/>
        <geom name="latch" type="mesh" mesh="wedge"/>
        <geom name="collision" type="box" size="1 1 1" group="3"/>
        <geom name="invisible" type="box" size="1 1 1" rgba="0 0 0 0"/>
        <site name="handle" pos="0 0 {RADIUS}"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


FROM_OUTSIDE = (
    *("push_force", "person_force", "person_energy", "stop_force", "base_shift"),
    "closer_torque",
)


def log_by_formula(n_steps: int = 601, **changes: Any) -> EpisodeLog:
    """A minimum-jerk opening to 66 degrees in 6 s with constant forces.

    Changes are fields and arrays by name, forecasts with the prefix forecast_.
    """
    times = DT * np.arange(n_steps)
    angle = FINAL_ANGLE * minimum_jerk(times / times[-1])
    pose = np.array([handle_pose_on_arc(RADIUS, phi) for phi in angle])
    six = np.ones((n_steps, 6))
    one = np.ones(n_steps)
    phases = np.linspace(0.0, 1.0, 21)
    arc = np.array([handle_pose_on_arc(RADIUS, FINAL_ANGLE * s) for s in phases])
    solved = (np.arange(n_steps) == n_steps - 1) & (angle[-1] > 1.0)
    fields: dict[str, Any] = {
        "policy": "gp",
        "door": "medium",
        "door_config": {"radius": RADIUS, "hinge_friction": 0.5},
        "seed": 3,
        "dt": DT,
        "success": True,
        "failure": "",
        "reason": "",
        "times": times,
        "ee_pose": pose,
        "ee_twist": 0.0 * six,
        "wrench": 2.0 * six,
        "joint_pos": np.zeros((n_steps, 7)),
        "joint_vel": np.zeros((n_steps, 7)),
        "qpos": angle[:, None],
        "door_angle": angle,
        "handle_angle": 0.0 * one,
        "capability": 3.0 + np.searchsorted(np.radians([15, 30, 60]), angle),
        "handle_pose": pose,
        "solved": solved,
        "grasped": np.full(n_steps, True),
        "slip": 0.002 * one,
        "force_tangential": 8.0 * one,
        "force_radial": -3.0 * one,
        "force_vertical": 0.0 * one,
        **dict.fromkeys(FROM_OUTSIDE, 0.0 * one),
        "action": pose,
        "desired": pose,
        "frame": np.tile(np.eye(3), (n_steps, 1, 1)),
        "std": 0.01 * six,
        "std_rate": -0.002 * six,
        "stiffness": 300.0 * six,
        "stiffness_rate": 20.0 * six,
        "stability_margin": 80.0 * six,
        "compensated_load": 4.0 * one,
        "path_lag": 2e-3 * one,
        "phase": times / times[-1],
        "observed_phase": angle / FINAL_ANGLE,
        "phase_misfit": 0.4 * one,
        "path_size": 1.2 * one,
        "path_size_std": 0.3 - 0.2 * angle,
        **dict.fromkeys(("heading", "heading_std"), 0.02 * one),
        "predicted_mean": pose + 0.003,
        "predicted_std": 0.004 * six,
        "expected_force": np.tile([5.0, 0.5, -0.5], (n_steps, 1)),
        "expected_force_std": np.tile(2.0 - angle[:, None], 3),
        **dict.fromkeys(("mode", "mode_probability"), np.nan * one),
        "via_point": np.arange(n_steps) % 10 == 0,
        "latency_s": 1e-3 * one,
        "latency_wall_s": 2e-3 * one,
        "forecast_times": np.array([0.0, 2.0, 4.0]),
        "forecast_phases": phases,
        "forecast_mean": np.stack([arc] * 3),
        "forecast_std": np.stack([np.full((21, 6), 0.03), *[0.01 * arc + 1e-3] * 2]),
    }
    fields |= changes
    names = {field.name for field in dataclasses.fields(EpisodeLog)} - PARTS.keys()
    forecasts = {n: fields[f"forecast_{n}"] for n in arrays_of(PARTS["forecasts"])}
    parts: dict[str, Any] = {
        part: record.of(forecasts if part == "forecasts" else fields)
        for part, record in PARTS.items()
    }
    return EpisodeLog(**{name: fields[name] for name in names}, **parts)


@pytest.fixture
def gplfd(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., int]:
    """Run the command in an empty folder; parser errors become exit statuses."""
    monkeypatch.chdir(tmp_path)
    for library in ("OPENBLAS_NUM", "OMP_NUM", "MKL_NUM", "VECLIB_MAXIMUM"):
        monkeypatch.setenv(f"{library}_THREADS", "1")

    def run(*arguments: str) -> int:
        try:
            return cli.main(arguments)
        except SystemExit as error:
            return int(error.code or 0)

    return run


@pytest.fixture
def refused(
    gplfd: Callable[..., int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> Callable[..., str]:
    """Run a command that fails with status 2, no file and one last line; return it."""

    def run(*arguments: str) -> str:
        before = sorted(tmp_path.rglob("*"))
        assert gplfd(*arguments) == 2
        printed = capsys.readouterr()
        assert sorted(tmp_path.rglob("*")) == before
        assert printed.out == ""
        assert "Traceback" not in printed.err
        *_, message = printed.err.splitlines()
        assert message.startswith("gplfd: ")
        return message.removeprefix("gplfd: ")

    return run


class Columns:
    """Chunks of a recording: times [s] (None when static) and values of a component.

    By entity and component; of several chunks with the same, the first.
    """

    def __init__(self, chunks: Iterable[Any]) -> None:
        self.chunks = list(chunks)
        self.entities = {chunk.entity_path for chunk in self.chunks}

    def __iter__(self) -> Iterator[tuple[str, str]]:
        for chunk in self.chunks:
            names = chunk.to_record_batch().schema.names
            yield from ((chunk.entity_path, name) for name in names if ":" in name)

    def __getitem__(self, key: tuple[str, str]) -> tuple[Any, list[Any]]:
        entity, component = key
        for chunk in self.chunks:
            if chunk.entity_path != entity:
                continue
            batch = chunk.to_record_batch()
            if component in batch.schema.names:
                values = batch.column(component).to_pylist()
                if chunk.is_static:
                    return None, values
                times = batch.column("sim_time").cast("int64").to_numpy() / 1e9
                return times, values
        raise KeyError(f"{entity} has no {component}: {sorted(self.entities)}")


@pytest.fixture
def columns(monkeypatch: pytest.MonkeyPatch) -> type[Columns]:
    """What reads chunks back; Rerun is strict meanwhile."""
    import rerun

    monkeypatch.setenv("RERUN_STRICT", "1")
    rerun.set_strict_mode(True)
    return Columns


@pytest.fixture
def titles_of() -> Callable[[Any], list[str]]:
    """The titles of all views in a layout's container."""

    def titles(part: Any) -> list[str]:
        inside = getattr(part, "contents", None)
        if isinstance(inside, list | tuple) and not hasattr(part, "class_identifier"):
            return [title for one in inside for title in titles(one)]
        return [str(part.name)]

    return titles


@pytest.fixture
def small_plots(monkeypatch: pytest.MonkeyPatch) -> None:
    """Write plots with few dots per inch: their pixels are of no interest."""
    from gplfd_experiments.analysis.figures import style

    monkeypatch.setitem(style._STYLE, "savefig.dpi", 30)


@pytest.fixture
def coarse_cuts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Look for reaches in recordings in coarse steps: it takes most of an import."""
    monkeypatch.setattr(frames, "_CUTS", frames._CUTS[::5])


@pytest.fixture
def no_picture() -> Iterator[None]:
    """Leave the picture of an import empty: drawing takes longer than all else."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(importing, "draw", lambda motions, path: path.touch())
        yield


@pytest.fixture
def reads_here() -> Iterator[None]:
    """Read files in this process, without limits: another takes a second to start."""

    def read(paths: Iterable[str | Path], settings: Any) -> Iterator[Any]:
        return (readers.read_here(Path(path), settings) for path in paths)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(importing, "read_files", read)
        yield


@pytest.fixture
def door_model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(MODEL)


@pytest.fixture(scope="session")
def make_log() -> Callable[..., EpisodeLog]:
    return log_by_formula


@functools.cache
def measured() -> dict[str, Any]:
    return episode_metrics(log_by_formula())


def episode_file(
    policy: str,
    seed: int = 0,
    radius: float = 0.5,
    *,
    radial: float = 1.0,
    opened: bool = True,
    **task: Any,
) -> dict[str, Any]:
    """What the file of an episode says; its numbers grow a little with the seed."""
    return {
        **RESULT_STAMP,
        "task": {
            "kind": "episode",
            "policy": policy,
            "door": f"{radius:g}",
            "door_config": DoorConfig(radius=radius).as_dict(),
            "seed": seed,
            "demonstrations_per_door": 2,
            "teacher": standard_teacher(),
            "randomization": "none",
            **task,
        },
        "versions": {"gplfd": "0.1.0"},
        "git": {"commit": "0123456789abcdef", "dirty": False},
        "metrics": {
            **measured(),
            "policy": policy,
            "seed": seed,
            "radius": radius,
            "success": opened,
            "failure": "" if opened else "stalled",
            "final_angle_deg": 64.0 if opened else 31.5 + seed,
            "time_to_60_deg": 5.0 + 0.01 * seed if opened else None,
            "force_tangential_peak": 2.0,
            "force_radial_peak": radial + 0.01 * seed,
            "prediction_error_position": 1e-4,
            "governed_share": 0.055,
            "latency_median_ms": 0.2,
        },
    }


def learning_test_file(policy: str, seed: int = 0, **metrics: Any) -> dict[str, Any]:
    """What the file of a learning test says."""
    episode = episode_file(policy, seed)
    for name in ("door", "door_config", "randomization"):
        del episode["task"][name]
    episode["task"] |= {"kind": "skill", "held_out": "demonstration"}
    episode["metrics"] = {
        "rmse_position_m": 0.02,
        "rmse_rotation_rad": 0.03,
        "nlpd": -2.0,
        "coverage_50": 0.5,
        "coverage_90": 0.85,
        "coverage_95": 0.9,
        "log_dimensionless_jerk": -5.0,
        "cpu_fit_s": 0.1,
        "cpu_predict_s": 0.001,
        "spread_followed": 0.9,
        **metrics,
    }
    return episode


@pytest.fixture
def write_study(tmp_path: Path) -> Callable[..., Path]:
    """Write results into a study's folder, and what study.json says."""

    def write(results: Iterable[Any], **study: Any) -> Path:
        folder = tmp_path / "study"
        (folder / "tasks").mkdir(parents=True, exist_ok=True)
        for number, result in enumerate(results):
            path = folder / "tasks" / f"{number:04}.json"
            path.write_text(json.dumps(result))
        command = ["gplfd", "benchmark", "--seeds", "8"]
        header = {**STUDY_STAMP, "command": command, "created": "2020-02-02", **study}
        (folder / "study.json").write_text(json.dumps(header))
        return folder

    return write


@pytest.fixture
def page_of(write_study: Callable[..., Path]) -> Callable[..., str]:
    """The page of some results as Markdown, without plots, which take their time."""

    def text(results: Iterable[Any], reference: str = "gp") -> str:
        folder = write_study(results)
        found = read_results(folder)
        return markdown_page(report(found, reference))

    return text


@pytest.fixture
def episode_result() -> Callable[..., dict[str, Any]]:
    return episode_file


@pytest.fixture
def learning_result() -> Callable[..., dict[str, Any]]:
    return learning_test_file
