"""The process around the command: its modules, its streams, its exit statuses.

All of it with the installed script, in a process of its own.
"""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import pytest

from gplfd_experiments.cli.commands.options import next_command

pytestmark = pytest.mark.slow

GPLFD = Path(sys.executable).with_name("gplfd")
STUDY = (
    *("benchmark", "--policies", "oracle", "--doors", "small", "--seeds", "1"),
    *("--no-skill", "--workers", "1", "--out", "study"),
)
RUN = ("run", "--policy", "oracle", "--doors", "small", "--out", "run")
NAMES = ("re", "json", "random", "logging", "loky", "string", "signal", "numpy", "tyro")
"""What users call their files, too."""
MISSED = ("org", "cython", "sksparse", "uarray")
"""Modules that dependencies look for, and that are not installed."""


def gplfd(
    folder: Path,
    *arguments: str,
    command: Sequence[str | Path] = (GPLFD,),
    before: Callable[[], object] | None = None,
    **environment: str,
) -> subprocess.CompletedProcess[str]:
    """Run a command in a folder, after something that is done in its process."""
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return subprocess.run(
        [*command, *arguments],
        cwd=folder,
        env=clean | environment,
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=before,
    )


def lay_out(folder: Path, names: Sequence[str]) -> None:
    """Write modules that leave a mark beside them when they are run."""
    leave = "import os\nopen(os.path.join({!r}, 'ran-{}'), 'w').close()\n"
    for name in names:
        (folder / f"{name}.py").write_text(leave.format(str(folder), name))
    for name in ("experiments", "policies"):
        (folder / name).mkdir()
        (folder / name / "__init__.py").write_text(leave.format(str(folder), name))


def ran(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.glob("ran-*"))


@pytest.mark.parametrize(
    ("command", "names"),
    [
        ((GPLFD,), (*NAMES, *MISSED, "types")),
        # Python itself imports ``types`` before it comes to this package.
        ((sys.executable, "-m", "gplfd"), (*NAMES, *MISSED)),
    ],
    ids=["script", "module"],
)
def test_a_policy_is_all_of_the_working_folder_that_is_run(tmp_path, command, names):
    """With what it imports, and nothing else that lies there."""
    lay_out(tmp_path, names)
    (tmp_path / "beside.py").write_text("NAME = 'oracle'\n")
    (tmp_path / "mine.py").write_text(
        "from beside import NAME\n"
        "from gplfd_policies.registry.catalogue import POLICIES\n"
        "make = POLICIES[NAME].make\n"
    )
    own = ("run", "--policy", "mine:make", "--doors", "small", "--quiet")
    finished = gplfd(tmp_path, *own, command=command)
    assert (finished.returncode, finished.stderr) == (0, "")
    assert ran(tmp_path) == []


def test_the_next_command_can_be_given_as_it_is_printed(tmp_path, monkeypatch):
    environment = tmp_path / "no environment"
    environment.symlink_to(GPLFD.parent)
    monkeypatch.setattr(sys, "argv", [str(environment / "gplfd")])
    runs = {"gplfd": str(GPLFD.parent), f"'{environment}/gplfd'": "/bin:/usr/bin"}
    for program, path in runs.items():
        monkeypatch.setenv("PATH", path)
        assert next_command("view", "a b") == f"{program} view 'a b'"


def test_a_folder_on_the_python_path_hides_no_installed_module(tmp_path):
    lay_out(tmp_path, [name for name in NAMES if name != "re"])
    finished = gplfd(tmp_path, *STUDY, PYTHONPATH=".")
    assert finished.returncode == 0, finished.stderr
    assert ran(tmp_path) == []


def test_a_module_of_the_python_path_is_still_found(tmp_path):
    (tmp_path / "my_folder").mkdir()
    (tmp_path / "my_folder" / "helper.py").write_text("")
    program = "import gplfd.__main__, helper; print(helper.__file__)"
    python = (sys.executable,)
    finished = gplfd(tmp_path, "-c", program, command=python, PYTHONPATH="my_folder")
    assert finished.stdout.strip() == str(tmp_path / "my_folder" / "helper.py")


@pytest.mark.parametrize(
    ("limit", "cut", "complete"),
    [
        (60_000, "demonstrations.npz", []),
        (400_000, "small.rrd", ["demonstrations.npz", "run.json", "small.npz"]),
    ],
)
def test_a_full_disk_leaves_no_half_of_a_file(tmp_path, limit, cut, complete):
    import resource

    fill = partial(resource.setrlimit, resource.RLIMIT_FSIZE, (limit, limit))
    finished = gplfd(tmp_path, *RUN, before=fill)
    assert finished.returncode == 2
    said = finished.stderr.splitlines()[-1]
    assert said.startswith(f"gplfd: run/{cut}: ")
    assert "Traceback" not in finished.stderr
    assert sorted(path.name for path in (tmp_path / "run").iterdir()) == complete


def test_a_reader_that_has_gone_is_no_traceback(tmp_path):
    reader, writer = os.pipe()
    os.close(reader)
    with open(writer, "wb") as pipe:
        finished = subprocess.run(
            [GPLFD, "list"], stdout=pipe, stderr=subprocess.PIPE, check=False
        )
    assert (finished.returncode, finished.stderr) == (141, b"")


def test_a_terminal_that_knows_only_ascii_gets_question_marks(tmp_path):
    for ascii_only in (
        {"PYTHONIOENCODING": "ascii"},
        {"LC_ALL": "C", "PYTHONUTF8": "0"},
    ):
        finished = gplfd(tmp_path, "list", PYTHONCOERCECLOCALE="0", **ascii_only)
        assert finished.returncode == 0, finished.stderr
        assert "actions within ?1" in finished.stdout


def test_a_policy_that_crashes_python_is_named_with_its_line(tmp_path):
    code = "import ctypes\ndef make(training):\n    ctypes.string_at(0)\n"
    (tmp_path / "mine.py").write_text(code)
    finished = gplfd(tmp_path, "run", "--policy", "mine:make")
    assert finished.returncode == -signal.SIGSEGV
    assert f'File "{tmp_path / "mine.py"}", line 3 in make' in finished.stderr


INTERRUPTED = {
    "import": "signal.raise_signal(signal.SIGINT)",
    "callback of C": (
        "def make(training):\n"
        "    ctypes.CFUNCTYPE(None)(lambda: signal.raise_signal(signal.SIGINT))()\n"
        "    time.sleep(60)"
    ),
    "destructor": (
        "class Last:\n"
        "    def __del__(self):\n"
        "        signal.raise_signal(signal.SIGINT)\n"
        "def make(training):\n"
        "    Last()\n"
        "    time.sleep(60)"
    ),
    "other error": (
        "def make(training):\n"
        "    try:\n"
        "        signal.raise_signal(signal.SIGINT)\n"
        "    except KeyboardInterrupt:\n"
        "        raise ImportError('numpy failed to import') from None"
    ),
    "a loop that catches everything": (
        "def make(training):\n"
        "    while True:\n"
        "        with contextlib.suppress(BaseException):\n"
        "            signal.raise_signal(signal.SIGINT)"
    ),
}
"""Code in which Ctrl-C comes, some of which loses it."""


@pytest.mark.parametrize("moment", INTERRUPTED)
def test_ctrl_c_ends_the_command_with_one_line(tmp_path, moment):
    code = f"import contextlib, ctypes, signal, time\n{INTERRUPTED[moment]}\n"
    (tmp_path / "mine.py").write_text(code)
    finished = gplfd(tmp_path, "run", "--policy", "mine:make", "--quiet")
    assert (finished.returncode, finished.stdout) == (130, "")
    *before, last = finished.stderr.splitlines()
    assert last == "gplfd: interrupted; files already written are complete"
    # What swallows it and complains of something else says so first.
    assert bool(before) is (moment == "other error")
    assert "Traceback" not in finished.stderr
    assert "ignored" not in finished.stderr
