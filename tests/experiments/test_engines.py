"""Engines: every item comes back once, whatever happens to the workers."""

import os
import re
import signal
import socket
import subprocess
import sys
import time
import warnings
from pathlib import Path

import dask
import distributed
import pytest

from gplfd_experiments.studies.engines import ATTEMPTS, Lost, Serial, engine_named
from gplfd_experiments.studies.engines.processes import Processes
from gplfd_experiments.studies.plan import checked, tasks
from gplfd_experiments.studies.runner import run_study
from gplfd_experiments.studies.settings import StudySettings

pytestmark = pytest.mark.slow

# The work of these tests are local functions, which travel to workers by value.


@pytest.fixture(params=["serial", "loky", "dask"])
def engine(request):
    """Every engine, with two workers if it has any."""
    if request.param == "dask":
        return engine_named("dask", address=request.getfixturevalue("scheduler"))
    return engine_named(request.param, workers=2 if request.param == "loky" else None)


def test_every_item_comes_back_once_with_its_result(engine):
    finished = sorted(engine.run(lambda item: item**2, range(5)))
    assert finished == [(item, item**2) for item in range(5)]
    assert list(engine.run(lambda item: item**2, [])) == []


def test_workers_are_processes_with_one_thread_deaf_to_ctrl_c():
    def look(_: int) -> tuple[int, str | None, bool, bool]:
        import signal

        return (
            os.getpid(),
            os.environ.get("OPENBLAS_NUM_THREADS"),
            signal.getsignal(signal.SIGINT) is signal.SIG_IGN,
            sys.flags.safe_path,
        )

    ((_, (process, threads, deaf, safe)),) = Processes(workers=1).run(look, [0])
    assert process != os.getpid()
    assert (threads, deaf, safe) == ("1", True, True)


def test_a_warning_in_workers_is_given_once_and_here():
    """With its category, or the built-in one that this is derived from."""

    class OwnWarning(FutureWarning):
        pass

    def work(item: int) -> int:
        import warnings

        category = (RuntimeWarning, OwnWarning)[item % 2]
        warnings.warn(f"late\nby {item % 2}", category, stacklevel=1)
        return item

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")
        finished = list(Processes(workers=2).run(work, range(6)))
    assert sorted(finished) == [(item, item) for item in range(6)]
    assert {str(one.message): one.category for one in caught} == {
        "late\nby 0": RuntimeWarning,
        "late\nby 1": FutureWarning,
    }
    assert len(caught) == 2


@pytest.mark.parametrize("engine", ["loky", "dask"], indirect=True)
def test_only_the_item_that_kills_its_workers_is_lost(engine, tmp_path):
    """An item whose worker died once, or beside another, is run again."""

    def work(item: int) -> int:
        if item == 1:
            (tmp_path / f"{time.time_ns()}").touch()
            os._exit(1)
        if item == 3 and not (tmp_path / "killed").exists():
            (tmp_path / "killed").touch()
            os._exit(1)
        time.sleep(0.1)  # so that something else runs when it happens
        return item

    finished = dict(engine.run(work, range(5)))
    lost = finished.pop(1)
    assert isinstance(lost, Lost)
    assert re.search(r"worker.* died in each", lost.reason)
    assert finished == {0: 0, 2: 2, 3: 3, 4: 4}
    if isinstance(engine, Processes):
        assert lost.crashed
        assert f"of {ATTEMPTS} attempts" in lost.reason
        assert len(list(tmp_path.iterdir())) == ATTEMPTS + 1


@pytest.mark.parametrize(
    ("end", "reason", "crashed"),
    [
        (lambda: os._exit(0), "it left Python with exit status 0", True),
        (lambda: os.kill(os.getpid(), signal.SIGSEGV), "crashed (SIGSEGV)", True),
        (lambda: os.kill(os.getpid(), signal.SIGKILL), "killed, possibly out", False),
        (lambda: os.kill(os.getpid(), 40), "(signal 40)", False),
    ],
)
def test_the_end_of_a_worker_tells_who_ended_it(end, reason, crashed):
    ((_, lost),) = Processes(workers=1).run(lambda _: end(), [0])
    assert isinstance(lost, Lost)
    assert reason in lost.reason
    assert lost.crashed == crashed


def test_an_item_in_this_process_cannot_end_it():
    leave = os._exit

    def work(status: int) -> str:
        try:
            os._exit(status)
        except RuntimeError as error:
            return str(error)

    assert list(Serial().run(work, [0])) == [(0, "os._exit(0) was called")]
    assert os._exit is leave


def test_closing_ends_the_workers(tmp_path):
    def work(item: int) -> int:
        if item == 1:
            (tmp_path / str(os.getpid())).touch()
            time.sleep(60)
        return item

    finished = Processes(workers=2).run(work, [0, 1])
    next(finished)
    deadline = time.monotonic() + 30.0
    while not list(tmp_path.iterdir()) and time.monotonic() < deadline:
        time.sleep(0.01)
    finished.close()
    assert time.monotonic() < deadline
    (process,) = tmp_path.iterdir()
    with pytest.raises(ProcessLookupError):
        os.kill(int(process.name), 0)


PARENT = """\
import sys, time
from gplfd_experiments.studies.engines.processes import Processes

def work(item):
    print("runs", file=sys.stderr, flush=True)
    time.sleep(60)

list(Processes(workers=1).run(work, [0]))
"""


def test_workers_end_with_a_parent_that_is_killed():
    started = time.monotonic()
    parent = subprocess.Popen(
        [sys.executable, "-c", PARENT], stderr=subprocess.PIPE, text=True
    )
    assert parent.stderr is not None
    assert parent.stderr.readline() == "runs\n"
    parent.kill()
    # Ends when the last process with this standard error has ended.
    parent.communicate()
    assert time.monotonic() - started < 60.0


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("serial", {"workers": 2}, "--workers 2 is for --engine loky"),
        ("loky", {"workers": 0}, "--workers 0 must be 1 or more"),
        ("loky", {"address": "tcp://a:1"}, "--address tcp://a:1 is for --engine dask"),
        ("dask", {}, "--engine dask needs the scheduler of a running cluster"),
    ],
)
def test_wrong_options_are_refused(name, options, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        engine_named(name, **options)


def test_without_dask_it_is_said_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    monkeypatch.delitem(
        sys.modules, "gplfd_experiments.studies.engines.cluster", raising=False
    )
    with pytest.raises(ValueError, match=r"pip install 'gplfd\[dask\]'"):
        engine_named("dask", address="tcp://127.0.0.1:1")


@pytest.fixture(scope="module")
def scheduler():
    """A cluster of two workers on this machine, whose scheduler gives up soon."""
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 1}),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, memory_limit=None, dashboard_address=None
        ) as cluster,
    ):
        yield cluster.scheduler_address


def test_a_dask_worker_that_cannot_run_an_item_says_why(scheduler):
    def work(item: int) -> int:
        if item == 1:
            raise ModuleNotFoundError("No module named 'experiments'")
        return os.getpid()

    engine = engine_named("dask", address=scheduler)
    (_, process), (_, failed) = sorted(engine.run(work, range(2)))
    assert "could not run it (ModuleNotFoundError" in failed.reason
    assert process != os.getpid()


def test_a_policy_of_one_s_own_travels_to_the_cluster(scheduler, tmp_path, monkeypatch):
    """Its workers run in other folders, and outlive a version of the file."""
    source = "def make(training):\n    raise RuntimeError({!r})\n"
    settings = StudySettings(policies=("travelling:make",), doors=("small",), seeds=1)
    for version in ("first", "second"):
        folder = tmp_path / version
        folder.mkdir()
        monkeypatch.chdir(folder)
        Path("travelling.py").write_text(source.format(version))
        monkeypatch.delitem(sys.modules, "travelling", raising=False)
        engine = engine_named("dask", address=scheduler)
        (result,) = run_study(folder / "study", tasks(checked(settings)), engine)
        assert result["error"].startswith(f"RuntimeError: {version} (travelling_")
        assert result["error"].endswith(".py, line 2, in make)")


@pytest.fixture
def silent():
    """A server that is no scheduler: it takes every connection and says nothing."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        yield f"tcp://127.0.0.1:{listener.getsockname()[1]}"


@pytest.mark.parametrize(
    ("address", "reason"),
    [
        ("tcp://127.0.0.1:9", "no answer within 0.5 s"),
        ("tls://127.0.0.1:9", "TLS expects a `ssl_context`"),
        ("127.0.0.1", "missing port"),
        ("silent", "no answer within 0.5 s"),
    ],
)
def test_an_address_without_a_scheduler_is_an_os_error(
    monkeypatch, silent, address, reason
):
    from gplfd_experiments.studies.engines import cluster

    monkeypatch.setattr(cluster, "_PATIENCE", 0.5)
    address = silent if address == "silent" else address
    with pytest.raises(OSError, match="no Dask scheduler answers") as raised:
        engine_named("dask", address=address)
    assert address in str(raised.value)
    assert reason in str(raised.value)
