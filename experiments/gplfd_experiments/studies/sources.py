"""Policies from outside this project: identification, transfer, and their processes.

A task has the name and hash of a user's file and of what it imports from its folder. It
is imported only in the process of the policy, and sent to machines that lack it. What
the policy changes, ends, forks or never returns from is then its own: the state of
NumPy, working folder, random numbers, modules, signals and files of the caller stay.
"""

import atexit
import contextlib
import functools
import math
import os
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Callable, Hashable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from gplfd_experiments.episodes.task import PolicySource, Task
from gplfd_policies.agents.remote import is_address
from gplfd_policies.registry.built_in import POLICIES
from gplfd_policies.registry.catalogue import policy_named, server_policy, split_name
from gplfd_policies.registry.method import Policy

LEARNING_LIMIT, STEP_LIMIT = 900.0, 60.0
"""Longest time of an import or a learning, and of a control step [s]."""
_GRACE: Final = 10.0
"""Time for a policy to end after a TimeoutError was raised in it [s]."""
_HANGS: Final = 124  # Exit status of a process whose policy does not end.
_ENDLESS: Final = (
    f"the policy did not return (limits: {LEARNING_LIMIT:g} s to learn, "
    f"{STEP_LIMIT:g} s for a control step)"
)
_ALARM: Final = getattr(signal, "SIGALRM", None)  # not on Windows
_CHILD: Final = "from gplfd_experiments.studies.sources import child; child()"

_processes: dict[Hashable, "subprocess.Popen[bytes]"] = {}  # They wait for a call.


@atexit.register
def _end() -> None:
    for process in _processes.values():
        process.communicate()


class ProcessEndedError(Exception):
    """The process of a policy ended without a result: the reason, and its status."""


def call_apart(policy: Hashable, function: Callable[..., Any], *arguments: Any) -> Any:
    """Return ``function(*arguments, allow)`` of the process of a policy.

    It calls ``allow(seconds)`` to set the time until its next call, or its end.
    """
    process = _processes.pop(policy, None)
    if process is None:
        paths = os.pathsep.join(folder or os.getcwd() for folder in sys.path)
        process = subprocess.Popen(
            [sys.executable, "-u", "-P", "-c", _CHILD],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": paths},
            start_new_session=True,
        )
    calls: Any = process.stdin
    replies: Any = process.stdout
    try:
        calls.write(pickle.dumps((function, arguments)))
        calls.flush()
        result, texts = pickle.load(replies)
    except (OSError, EOFError) as error:
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(_GRACE)
        hangs = process.poll() is None
        process.kill()
        with contextlib.suppress(ProcessLookupError, AttributeError):
            os.killpg(process.pid, signal.SIGKILL)  # what it has forked
        process.communicate()
        status = _HANGS if hangs else process.returncode
        ended = f"signal {-status}" if status < 0 else f"exit status {status}"
        reason = f"its process ended: {ended}, in the policy's code"
        reason = _ENDLESS if status == _HANGS else reason
        raise ProcessEndedError(reason, status) from error
    _processes[policy] = process
    for text in texts:
        warnings.warn(text, stacklevel=2)
    return result


def child() -> None:
    """Answer the calls on standard input, until it is closed."""
    calls, replies = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    with contextlib.suppress(OSError):
        os.dup2(2, 1)
    if hasattr(os, "register_at_fork"):
        # The caller waits for the end of this process, not of what it has forked.
        os.register_at_fork(after_in_child=replies.close)
    limit, folder = _TimeLimit(), os.getcwd()
    while True:
        try:
            function, arguments = pickle.load(calls)
        except EOFError:
            os._exit(0)  # not after the policy's threads
        os.chdir(folder)  # from where a policy went
        limit.allow(LEARNING_LIMIT)
        with warnings.catch_warnings(record=True) as caught:
            result = function(*arguments, limit.allow)
        limit.allow(math.inf)
        pickle.dump((result, {str(warning.message) for warning in caught}), replies)
        replies.flush()


class _TimeLimit:
    """Raises a TimeoutError in the main thread, and ends the process soon after."""

    def __init__(self) -> None:
        self._process, self._parent = os.getpid(), os.getppid()
        self.allow(math.inf)
        if _ALARM is not None:
            signal.signal(_ALARM, _stop)
        threading.Thread(target=self._watch, daemon=True).start()

    def allow(self, seconds: float) -> None:
        """Set the time until the next call."""
        if os.getpid() != self._process:
            os._exit(0)  # a copy of this process that the policy forked
        self._late, self._until = False, time.monotonic() + seconds

    def _watch(self) -> None:
        while os.getppid() == self._parent:
            if time.monotonic() > self._until:
                if self._late:
                    os._exit(_HANGS)
                self._late, self._until = True, self._until + _GRACE
                if _ALARM is not None:
                    signal.pthread_kill(threading.main_thread().ident or 0, _ALARM)
            time.sleep(0.5)
        os._exit(1)


def _stop(*_: object) -> None:
    raise TimeoutError(_ENDLESS)


Files = Mapping[str, bytes]
"""Contents of users' files, when the study was planned, by the name of their policy."""

NO_FILES: Final[Files] = {}
"""Location of every policy on this machine."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Choice:
    """What the plan of a study needs to know of a policy."""

    source: PolicySource | None
    learns: bool
    """Whether it learns a movement."""
    accepts_prior_mean: bool
    file: bytes
    """Content of the user's file; b"" for another policy."""


def chosen(name: str) -> Choice:
    """Return a policy as first found by this process."""
    return _chosen(name, Path.cwd())


@functools.cache
def _chosen(name: str, folder: Path) -> Choice:
    if is_address(name):
        return _choice(server_policy(name, "{}"))
    if split_name(name)[0] in POLICIES:
        return _choice(policy_named(name))
    try:
        choice: Choice | str = call_apart((name, folder), _found, name)
    except ProcessEndedError as error:
        choice = f"policy {name!r}: {error.args[0]}"
    if isinstance(choice, str):
        raise ValueError(choice)
    return choice


def _found(name: str, _: Callable[[float], None]) -> Choice | str:
    """Return a policy in its own process, or what is wrong with it."""
    try:
        return _choice(policy_named(name))
    except ValueError as error:
        return str(error)


def _choice(policy: Policy) -> Choice:
    source, method = source_of(policy), policy.method
    sent = source is not None and source["kind"] == "module" and "sha256" in source
    return Choice(
        source=source,
        learns=method is not None,
        accepts_prior_mean=method is not None and method.learner.accepts_prior_mean,
        file=Path(policy.origin.file).read_bytes() if sent and policy.origin else b"",
    )


def policy_fields(name: str) -> dict[str, Any]:
    """Return the fields of a task that identify a policy and its content."""
    source = _stated(name) if is_address(name) else chosen(name).source
    return {"policy": name, "policy_source": source}


@functools.cache
def _stated(address: str) -> PolicySource | None:
    """Return address and metadata of a server, which must answer."""
    return source_of(policy_named(address))


def source_of(policy: Policy) -> PolicySource | None:
    """Return the identification of a policy's content; None for a built-in policy."""
    origin = policy.origin
    if origin is None or origin.kind == "built-in":
        return None
    names = ("kind", "distribution", "version", "file", "sha256", "metadata")
    source = {name: getattr(origin, name) for name in names}
    source["file"] = Path(origin.file).name
    return {name: text for name, text in source.items() if text}


def files_of(study: Iterable[Task]) -> Files:
    """Return the users' files that tasks were planned with."""
    names = dict.fromkeys(task.policy for task in study if task.policy_source)
    return {name: file for name in names if (file := chosen(name).file)}


def in_own_process(task: Task) -> bool:
    """Return whether a policy is a user's code, and not this project's or a server."""
    return (task.policy_source or {"kind": "server"})["kind"] != "server"


def policy_of(task: Task, files: Files) -> Policy:
    """Return the policy of a task in this process, possibly on another machine."""
    planned = task.policy_source or {}
    if planned.get("kind") == "server":  # What it answers is its episodes' matter.
        return server_policy(task.policy, planned["metadata"])
    try:
        policy = policy_named(task.policy)
        if (here := source_of(policy)) != task.policy_source:
            raise ValueError(
                f"policy {task.policy!r} is not the one that the task was planned "
                f"with: that was {task.policy_source}, here is {here}"
            )
        return policy
    except ValueError:
        if task.policy not in files:
            raise
        policy = _sent(task.policy, planned["file"], files[task.policy])
        if (source_of(policy) or {}).get("sha256") != planned.get("sha256"):
            raise  # It imports other files, which differ on this machine.
        return policy


@functools.cache
def _sent(name: str, file: str, content: bytes) -> Policy:
    """Load a policy from the file of another machine."""
    path = Path(tempfile.mkdtemp(prefix="gplfd-"), file)
    path.write_bytes(content)
    return policy_named(f"{path}:{name.rpartition(':')[2]}")
