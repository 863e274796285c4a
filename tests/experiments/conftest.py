"""A tiny door in MuJoCo, an agent that knows its arc, logs by formula, a browser."""

import contextlib
import dataclasses
import functools
import json
import math
import os
import shlex
import shutil
import subprocess
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
import pytest

from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_env.spatial.arc import handle_pose_on_arc
from gplfd_experiments.analysis.report.document import markdown_page
from gplfd_experiments.analysis.report.page import report
from gplfd_experiments.analysis.results.reading import read_results
from gplfd_experiments.cli import main as cli
from gplfd_experiments.data.teacher import standard_teacher
from gplfd_experiments.episodes.log import PARTS, EpisodeLog, Forecasts, arrays_of
from gplfd_experiments.episodes.metrics import episode_metrics
from gplfd_experiments.studies.store import RESULT_STAMP, STUDY_STAMP
from gplfd_policies.control.steps import AgentStep
from gplfd_policies.movements.trajectory import GaussianTrajectory

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


def minimum_jerk(progress: Any) -> Any:
    s = np.clip(progress, 0.0, 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s**2)


FROM_OUTSIDE = (
    "push_force",
    "person_force",
    "person_energy",
    "stop_force",
    "base_shift",
    "closer_torque",
)


class DoorEnv(gym.Env[Any, Any]):
    """The door follows the commanded rotation exactly; the hand is the handle."""

    def __init__(self, outcome: str = "success", n_steps: int = 30) -> None:
        self.model = mujoco.MjModel.from_xml_string(MODEL)
        self.data = mujoco.MjData(self.model)
        self.door = DoorConfig(radius=0.5)
        self.door_geometry = DoorGeometry.of(self.door)
        self.outcome, self.n_steps = outcome, n_steps
        self.actions: list[Any] = []

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        self.actions = []
        self.data.qpos[:] = 0.0
        return self._state()

    def step(self, action: Any) -> Any:
        self.actions.append(action)
        self.data.qpos[0] = action[4]
        last = len(self.actions) == self.n_steps
        observation, info = self._state()
        info["success"] = last and self.outcome == "success"
        if last and self.outcome not in ("success", "time_limit"):
            info["failure"] = self.outcome
        truncated = last and self.outcome in ("time_limit", "stalled")
        return observation, 0.0, last and not truncated, truncated, info

    def _state(self) -> Any:
        angle = float(self.data.qpos[0])
        pose = handle_pose_on_arc(RADIUS, angle)
        observation = {
            "ee_pose": pose,
            "ee_twist": np.zeros(6),
            "wrench": np.array([-5.0, 0.0, 1.0, 0.0, 0.0, 0.0]),
            "joint_pos": np.zeros(7),
            "joint_vel": np.zeros(7),
            "time": np.array([len(self.actions) * DT]),
        }
        info = {
            "door_angle": angle,
            "handle_angle": 0.0,
            "capability": 3,
            "handle_pose": pose,
            "success": False,
            "failure": "",
            "reason": "",
            "grasped": True,
            "slip": 0.001,
            "force_tangential": 5.0,
            "force_radial": -1.0,
            "force_vertical": 0.0,
            **dict.fromkeys(FROM_OUTSIDE, 0.0),
        }
        return observation, info


class ArcAgent:
    """Opens by minimum jerk in ``n_steps``; its belief narrows as the door opens."""

    phases = np.linspace(0.0, 1.0, 21)

    def __init__(self, n_steps: int = 30, forecasts: bool = True) -> None:
        self.n_steps, self.forecasts = n_steps, forecasts
        self.calls = 0

    def reset(self, observation: Any) -> None:
        self.calls = 0

    def act(self, observation: Any) -> Any:
        self.calls += 1
        phase = min(1.0, self.calls / self.n_steps)
        action = handle_pose_on_arc(RADIUS, FINAL_ANGLE * float(minimum_jerk(phase)))
        seen = float(observation["ee_pose"][4]) / FINAL_ANGLE
        return AgentStep(
            action=action,
            desired=action,
            std=np.full(6, 0.01),
            std_rate=np.full(6, -0.001),
            stiffness=np.full(6, 300.0),
            stiffness_rate=np.full(6, 20.0),
            stability_margin=np.full(6, 80.0),
            contact_margin=np.full(6, 0.01),
            compensated_load=4.0,
            path_lag=2e-3,
            phase=phase,
            observed_phase=seen,
            phase_misfit=0.4,
            predicted_mean=observation["ee_pose"] + 0.002,
            predicted_std=np.full(6, 0.001),
            via_point=self.calls % 3 == 0,
        )

    def forecast(self) -> Any:
        if not self.forecasts:
            return None
        arc = [handle_pose_on_arc(RADIUS, FINAL_ANGLE * phase) for phase in self.phases]
        spread = 0.05 / (1.0 + self.calls) * np.outer(self.phases, np.ones(6)) + 1e-3
        return GaussianTrajectory.from_moments(
            self.phases, np.array(arc), spread, covariance_function=lambda: spread
        )


def log_by_formula(n_steps: int = 601, **changes: Any) -> EpisodeLog:
    """A minimum-jerk opening to 66 degrees in 6 s with constant forces."""
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
        "contact_margin": 0.01 * six,
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
    return log_of(fields | changes)


def log_of(fields: dict[str, Any]) -> EpisodeLog:
    """A log of its fields and arrays by name, forecasts with the prefix forecast_."""
    names = {field.name for field in dataclasses.fields(EpisodeLog)} - PARTS.keys()
    forecasts = {name: fields[f"forecast_{name}"] for name in arrays_of(Forecasts)}
    parts: dict[str, Any] = {
        part: record.of(forecasts if part == "forecasts" else fields)
        for part, record in PARTS.items()
    }
    return EpisodeLog(**{name: fields[name] for name in names}, **parts)


class Page:
    """A page, driven through the pipe of the DevTools protocol.

    Errors of its scripts are in `errors`.
    """

    def __init__(self, answers: Any, calls: Any) -> None:
        self._out, self._in = answers, calls
        self._rest, self._number, self._session = b"", 0, {}
        self.errors: list[str] = []
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        session = self.call("Target.attachToTarget", targetId=target, flatten=True)
        self._session = {"sessionId": session["sessionId"]}
        self.call("Runtime.enable")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        self._in.write(json.dumps(message | self._session).encode() + b"\0")
        self._in.flush()
        while True:
            while b"\0" not in self._rest:
                part = self._out.read1(65536)
                assert part, "the browser has ended"
                self._rest += part
            text, self._rest = self._rest.split(b"\0", 1)
            answer = json.loads(text)
            if answer.get("method") == "Runtime.exceptionThrown":
                self.errors.append(str(answer["params"]["exceptionDetails"]))
            if answer.get("id") == self._number:
                assert "error" not in answer, answer
                return answer["result"]

    def value(self, script: str) -> Any:
        """Return the value of an expression, a promise's when it is fulfilled."""
        found = self.call(
            "Runtime.evaluate",
            expression=script,
            awaitPromise=True,
            returnByValue=True,
            userGesture=True,
        )
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def wait(self, condition: str, seconds: float = 20.0) -> None:
        """Wait until an expression is true."""
        loop = f"""new Promise((done, fail) => {{
            const until = performance.now() + {1000 * seconds};
            const test = () => ({condition}) ? done(1) :
                performance.now() > until ? fail(document.body.innerText)
                : setTimeout(test, 20);
            test(); }})"""
        self.value(loop)

    def mouse(self, kind: str, x: float, y: float, **more: Any) -> None:
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)


@contextlib.contextmanager
def run_browser(folder: Path) -> Iterator[Page]:
    """Run a headless Chromium with a profile in a folder; yield an empty page."""
    command = [
        shutil.which("chromium") or "google-chrome",
        "--headless=new",
        "--no-sandbox",
        "--disable-dev-shm-usage",
        "--disable-gpu",
        "--remote-debugging-pipe",
        f"--user-data-dir={folder}",
        "--window-size=1000,1000",
        "about:blank",
    ]
    down, up = os.pipe(), os.pipe()
    with (folder / "log").open("wb") as log:
        # The protocol is spoken on the files 3 and 4.
        process = subprocess.Popen(
            ["bash", "-c", f"exec {shlex.join(command)} 3<&{down[0]} 4>&{up[1]}"],
            pass_fds=(down[0], up[1]),
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
        )
    os.close(down[0])
    os.close(up[1])
    try:
        with os.fdopen(up[0], "rb") as answers, os.fdopen(down[1], "wb") as calls:
            yield Page(answers, calls)
    finally:
        process.terminate()
        process.wait(10)


@pytest.fixture(scope="session")
def browser() -> Callable[[Path], contextlib.AbstractContextManager[Page]]:
    """Give a page in a Chromium whose profile is in a folder."""
    return run_browser


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
        *_, said = printed.err.splitlines()
        assert said.startswith("gplfd: ")
        return said.removeprefix("gplfd: ")

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

    monkeypatch.setitem(style._STYLE, "savefig.dpi", 30)  # type: ignore[index]


@pytest.fixture
def door_model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(MODEL)


@pytest.fixture
def door_env() -> type[DoorEnv]:
    return DoorEnv


@pytest.fixture
def arc_agent() -> type[ArcAgent]:
    return ArcAgent


@pytest.fixture(scope="session")
def make_log() -> Callable[..., EpisodeLog]:
    return log_by_formula


@pytest.fixture(scope="session")
def formula_log() -> Callable[..., EpisodeLog]:
    """`make_log` for fixtures of a larger scope."""
    return log_by_formula


@functools.cache
def measured() -> dict[str, Any]:
    return episode_metrics(log_by_formula()).as_json()


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
        **dict.fromkeys(("via_error_position_m", "via_far_change", "cpu_adapt_s")),
        "prior_mean_used": None,
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
        return markdown_page(report(found, folder, folder, reference))

    return text


@pytest.fixture
def episode_result() -> Callable[..., dict[str, Any]]:
    return episode_file


@pytest.fixture
def learning_result() -> Callable[..., dict[str, Any]]:
    return learning_test_file
