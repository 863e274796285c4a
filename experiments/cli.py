"""The subcommands of ``gplfd``, and how each of them ends.

Exit status: 0 when the command did its work (a door left closed is a result), 1 when a
replay departs from its recording, a task of a study ended in an error or a report is
about errors only, 2 for bad arguments or files. `gplfd` adds 130 for an interruption.
"""

import contextlib
import importlib.metadata
import logging
import os
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import Final, Protocol

import tyro

from gplfd.experiments.commands.benchmark import Benchmark, benchmark_from
from gplfd.experiments.commands.catalogue import Catalogue
from gplfd.experiments.commands.demos import Demos
from gplfd.experiments.commands.doctor import Doctor
from gplfd.experiments.commands.doors import Doors
from gplfd.experiments.commands.figures import Figures
from gplfd.experiments.commands.learn import Learn
from gplfd.experiments.commands.report import Report
from gplfd.experiments.commands.run import Run
from gplfd.experiments.commands.skill import SkillTests
from gplfd.experiments.commands.speed import Speed
from gplfd.experiments.commands.trials import Trials
from gplfd.experiments.commands.tune import Tune
from gplfd.experiments.commands.view import View
from gplfd.experiments.study.engines import ONE_THREAD

BAD_INPUT: Final = 2
"""Exit status for bad arguments or files."""

_LOG: Final = logging.getLogger("gplfd")


class Command(Protocol):
    """A subcommand: its fields are the options."""

    def execute(self) -> int:
        """Do the work and return the exit status.

        Raises:
            ValueError: An argument or the content of a file is wrong.
            OSError: A file cannot be read or written, or a service not be reached.
            ModuleNotFoundError: An optional library is missing.
        """


COMMANDS: Final[dict[str, Callable[..., Command]]] = {
    "run": Run,
    "learn": Learn,
    "skill": SkillTests,
    "benchmark": Benchmark,
    "trials": Trials,
    "tune": Tune,
    "report": Report,
    "figures": Figures,
    "demos": Demos,
    "doors": Doors,
    "view": View,
    "speed": Speed,
    "list": Catalogue,
    "doctor": Doctor,
}
"""The subcommands by name."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Parse ``arguments`` (default: the process's own) and run the command.

    Returns:
        The exit status.

    Raises:
        SystemExit: From the parser, for ``--help`` (0) and wrong arguments (2).
    """
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    if arguments == ["--version"]:
        print(f"gplfd {importlib.metadata.version('gplfd')}")
        return 0
    with _messages(quiet="--quiet" in arguments):
        try:
            return _parsed(arguments).execute()
        except BrokenPipeError:
            raise
        except (ValueError, OSError, ModuleNotFoundError) as error:
            _LOG.error(_in_words(error))
            return BAD_INPUT


def _parsed(arguments: Sequence[str]) -> Command:
    commands = COMMANDS | {"benchmark": benchmark_from(arguments)}
    command: Command = tyro.extras.subcommand_cli_from_dict(
        commands,
        prog="gplfd",
        description="Open doors with policies learned from demonstrations. "
        "`gplfd --version` prints the version, `gplfd doctor` what is missing here.",
        args=arguments,
    )
    # Before NumPy is loaded, unless the user says otherwise. The policies' matrices
    # have about a hundred rows: sharing them out costs ten times the work.
    for variable, number in ONE_THREAD.items():
        os.environ.setdefault(variable, number)
    return command


@contextlib.contextmanager
def _messages(*, quiet: bool) -> Iterator[None]:
    """Print what is logged on stderr: progress unless quiet, warnings, errors."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(logging.Formatter("gplfd: %(message)s"))
    _LOG.setLevel(logging.WARNING if quiet else logging.INFO)
    _LOG.addHandler(handler)
    try:
        with warnings.catch_warnings():
            # Without the source line that raised it.
            warnings.showwarning = lambda message, *_, **__: _LOG.warning(
                "warning: %s", message
            )
            yield
    finally:
        _LOG.removeHandler(handler)
        _LOG.setLevel(logging.NOTSET)


def _in_words(error: Exception) -> str:
    """Return an error as one paragraph."""
    # OSError's own text leads with a number that says nothing to a person.
    if isinstance(error, OSError) and error.strerror and error.filename:
        return f"{error.filename}: {error.strerror}"
    return " ".join(str(error).split())
