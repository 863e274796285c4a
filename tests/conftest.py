"""Settings of the whole suite, and what tests need beyond Python packages.

A test that needs a part of the machine says so, ``@pytest.mark.needs("xvfb")``. Where
the part is missing the test is skipped, with what to install; with GPLFD_REQUIRE_ALL=1
in the environment it fails instead. Nothing here imports MuJoCo.
"""

import functools
import gc
import os
import pickle
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import jaxtyping
import pytest
from hypothesis import settings

from gplfd_env.conventions.opengl import choose_opengl

choose_opengl()  # Before a test imports MuJoCo.

# There is hardly garbage before the first test: a fifth of the time of the imports.
gc.disable()

# Modules are compiled once, and not by every process that a test starts.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# The same examples in every run, and no deadline: a first call may compile a scene.
settings.register_profile("suite", derandomize=True, deadline=None, max_examples=50)
settings.load_profile("suite")

_ROOT = Path(__file__).parents[1]
_DRAW = (
    "import mujoco\n"
    "mujoco.Renderer(mujoco.MjModel.from_xml_string('<mujoco/>'), 8, 8).render()"
)


class Part(NamedTuple):
    """What a machine may lack: how to find out, and how to get it."""

    present: Callable[[], bool]
    remedy: str


def _runs(*command: str) -> bool:
    """Whether a command ends well; in a process of its own, which OpenGL may kill."""
    try:
        ran = subprocess.run(
            command, cwd=_ROOT, capture_output=True, check=False, timeout=120
        )
    except (OSError, subprocess.TimeoutExpired):
        return False
    return ran.returncode == 0


PARTS = {
    "opengl": Part(
        lambda: _runs(sys.executable, "-c", _DRAW),
        "OpenGL that draws without a screen: apt-get install libegl1 libegl-mesa0 "
        "libgl1-mesa-dri libopengl0 (other systems: docs/environment.md)",
    ),
    "xvfb": Part(
        lambda: shutil.which("Xvfb") is not None,
        "a virtual display for the window: apt-get install xvfb libgl1-mesa-dri "
        "(other systems: docs/environment.md)",
    ),
    "chromium": Part(
        lambda: bool(shutil.which("chromium") or shutil.which("google-chrome")),
        "a browser for the pages of demos teach and correct: apt-get install chromium",
    ),
    "git": Part(lambda: _runs("git", "--version"), "git: apt-get install git"),
    "clone": Part(
        lambda: _runs("git", "ls-files", "--error-unmatch", "pyproject.toml"),
        "git, and a checkout that it made (git clone) instead of an unpacked archive",
    ),
}


@pytest.fixture(autouse=True)
def _same_environment() -> Iterator[None]:
    """Undo what a command run in this process adds, such as OPENBLAS_NUM_THREADS=1.

    The processes that later tests start would run with it, in some orders of tests.
    """
    before = dict(os.environ)
    yield
    for name in os.environ.keys() - before.keys():
        del os.environ[name]
    os.environ.update(before)


TYPED = (
    *("alignment", "baseline_gmm_gp", "baseline_gmr", "baseline_kmp", "gp_exact"),
    *("baseline_prodmp", "baseline_promp", "baseline_tp_gmm"),
    *("control_errors", "demonstrations", "movements", "own_agent", "records"),
    *("registry", "rests", "rollout", "stiffness", "storage", "trajectory"),
    "user_policies",
)
"""Modules of tests in which types are checked at run time, of every policy's too."""


@pytest.fixture(scope="module", autouse=True)
def _types_are_checked_once(request: pytest.FixtureRequest) -> Iterator[None]:
    """Switch type checks off elsewhere: they take nine tenths of a control step."""
    off = request.path.stem.removeprefix("test_") not in TYPED
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(jaxtyping.config, "jaxtyping_disable", off)
        yield


def remembering(fit: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function that fits nothing twice, but with type checks and without."""
    fitted: dict[bytes, Any] = {}

    def once(*arguments: Any, **options: Any) -> Any:
        key = pickle.dumps((arguments, options, jaxtyping.config.jaxtyping_disable))
        if key not in fitted:
            fitted[key] = fit(*arguments, **options)
        return fitted[key]

    return once


@pytest.fixture(scope="session", autouse=True)
def _learned_once() -> Iterator[None]:
    """Let equal demonstrations share their fits: many tests learn from the same."""
    from gplfd_policies.gp.heteroscedastic import MultiOutputGP
    from gplfd_policies.movements import skill

    shared = [(MultiOutputGP, "fit"), (skill, "fit_deviations")]
    if exports := sys.modules.get("gplfd_experiments.workflows.exports"):
        shared.append((exports, "commanded_path"))
    with pytest.MonkeyPatch.context() as patch:
        for owner, name in shared:
            patch.setattr(owner, name, remembering(getattr(owner, name)))
        yield


@pytest.fixture
def policies_here(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[None]:
    """Call users' policies in this process: one for each takes seconds to start."""
    from gplfd_experiments.studies import jobs, sources

    def call(policy: Any, function: Callable[..., Any], *arguments: Any) -> Any:
        return function(*arguments, lambda seconds: None)

    for module in (jobs, sources):
        monkeypatch.setattr(module, "call_apart", call)
    yield
    # Another test has a file of the same name.
    for name, loaded in list(sys.modules.items()):
        if str(getattr(loaded, "__file__", "")).startswith(str(tmp_path)):
            del sys.modules[name]


@pytest.fixture
def short_episodes(monkeypatch: pytest.MonkeyPatch) -> None:
    """End episodes after 1.5 s, where it does not matter whether a door opens."""
    import gymnasium

    from gplfd_env import ENVIRONMENT_IDS

    for name in ENVIRONMENT_IDS.values():
        monkeypatch.setattr(gymnasium.spec(name), "max_episode_steps", 150)


@pytest.fixture
def run_python(tmp_path: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    """Return a function: runs Python in the test's folder, where it must succeed.

    Keywords are environment variables.
    """

    def run(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
        ran = subprocess.run(
            [sys.executable, *arguments],
            cwd=tmp_path,
            env=os.environ | environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert ran.returncode == 0, ran.stderr
        return ran

    return run


@functools.cache
def _present(part: str) -> bool:
    return PARTS[part].present()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Let processes take whole parts of the suite, which share what is learned."""
    from xdist.scheduler import WorkStealingScheduling

    return WorkStealingScheduling(config, log)


def pytest_collection_finish() -> None:
    # Not frozen: Hypothesis asks who refers to an object, which hides what is frozen.
    gc.enable()


def pytest_configure(config: pytest.Config) -> None:
    if config.getoption("numprocesses", None):
        # A process per core: threads of BLAS would wait for each other's cores.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    config.addinivalue_line(
        "markers", f"needs(*parts): parts of the machine, of {', '.join(PARTS)}"
    )


def pytest_runtest_setup(item: pytest.Item) -> None:
    needed = [part for mark in item.iter_markers("needs") for part in mark.args]
    missing = [PARTS[part].remedy for part in needed if not _present(part)]
    if missing:
        reason = f"needs {'; and '.join(missing)}"
        if os.environ.get("GPLFD_REQUIRE_ALL") == "1":
            pytest.fail(f"{reason} (GPLFD_REQUIRE_ALL=1)", pytrace=False)
        pytest.skip(reason)
