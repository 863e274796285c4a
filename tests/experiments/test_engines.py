"""Engines: every item comes back once, whatever happens to the workers."""

import itertools
import multiprocessing
import os
import re
import sys
import time
import warnings
from pathlib import Path
from typing import Any

import dask
import distributed
import pytest

from gplfd_experiments.studies import engines
from gplfd_experiments.studies.engines import Engine, Lost
from gplfd_experiments.studies.runner import run_study
from gplfd_experiments.studies.settings import StudySettings
from gplfd_experiments.studies.tasks import checked, tasks

pytestmark = pytest.mark.slow

# The work of these tests are local functions, which travel to workers by value.


@pytest.fixture(scope="module")
def scheduler():
    """A cluster of two workers on this machine, whose scheduler gives up at once."""
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, memory_limit=None, dashboard_address=":0"
        ) as cluster,
    ):
        yield cluster.scheduler_address


@pytest.fixture(params=["loky", "dask"])
def engine(request):
    if request.param == "dask":
        address = request.getfixturevalue("scheduler")
        return Engine(engine="dask", address=address)
    return Engine(workers=2)


def test_only_the_item_that_kills_its_workers_is_lost(engine, tmp_path):
    """An item whose worker died once, or beside another, is run again."""

    def work(item: int) -> tuple[int, int]:
        import warnings

        warnings.warn("of all workers", stacklevel=1)
        if item == 1 or (item == 3 and not (tmp_path / "killed").exists()):
            (tmp_path / "killed").touch(exist_ok=item == 1)
            os._exit(1)
        time.sleep(0.1)  # so that something else runs when it happens
        return item, os.getpid()

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")
        results = dict(engine.run(work, range(5)))
    assert isinstance(results[1], Lost)
    assert "its worker died" in results[1]
    others = [results[item] for item in (0, 2, 3, 4)]
    assert [item for item, _ in others] == [0, 2, 3, 4]
    assert os.getpid() not in {process for _, process in others}
    assert [str(warning.message) for warning in caught] == ["of all workers"]


def test_an_interruption_ends_quietly_and_leaves_no_lock_taken():
    """The main thread calls nothing whose locks the threads of an engine wait for."""
    called = set[str]()
    for _ in range(2):  # No thread fails if a call was not yet taken up.
        sys.setprofile(lambda frame, *_: called.add(frame.f_code.co_filename))
        results = Engine(workers=2).run(lambda _: time.sleep(0.05), range(9))
        list(itertools.islice(results, 3))
        results.close()
        sys.setprofile(None)
    assert engines.__file__ in called
    locking = re.compile(r"[/\\](futures|loky|multiprocessing)[/\\]")
    assert not list(filter(locking.search, called))


@pytest.mark.filterwarnings("ignore:.*fork")
def test_closing_ends_the_workers_and_no_other_process(tmp_path):
    other = multiprocessing.get_context("fork").Process(target=time.sleep, args=[99])
    other.start()

    def work(item: int) -> int:
        (tmp_path / str(os.getpid())).touch()
        time.sleep(60 * item)
        return item

    results = Engine(workers=2).run(work, [0, 1])
    started = time.monotonic()
    assert next(results) == (0, 0)
    results.close()
    assert time.monotonic() - started < 30.0
    for process in tmp_path.iterdir():
        with pytest.raises(ProcessLookupError):
            os.kill(int(process.name), 0)
    assert other.is_alive()
    other.kill()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"engine": "serial", "workers": 2}, "--workers 2 is for --engine loky"),
        ({"workers": 0}, "--workers 0 must be 1 or more"),
        ({"address": "tcp://a:1"}, "--address tcp://a:1 is for --engine dask"),
        ({"engine": "dask"}, "--engine dask needs the scheduler of a running cluster"),
    ],
)
def test_wrong_options_are_refused(options, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        Engine(**options).check()


def test_an_address_without_a_scheduler_is_an_os_error(monkeypatch):
    def hasty(address: str, timeout: float, **options: Any) -> distributed.Client:
        return client(address, timeout=timeout / 20.0, **options)

    client = distributed.Client
    monkeypatch.setattr(distributed, "Client", hasty)
    engine = Engine(engine="dask", address="tcp://127.0.0.1:9")
    with pytest.raises(
        OSError, match=r"no Dask scheduler with workers answers at tcp://127.0.0.1"
    ):
        next(engine.run(abs, [0]))


@pytest.mark.usefixtures("policies_here")
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
        engine = Engine(engine="dask", address=scheduler)
        (result,) = run_study(folder / "study", tasks(checked(settings)), engine)
        assert result["error"].startswith(f"RuntimeError: {version} (travelling.py")
        assert result["error"].endswith(", line 2, in make)")
