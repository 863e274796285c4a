"""The subcommands of ``gplfd``, and how each of them ends.

Exit status: 0 when the command did its work (a door left closed is a result), 1 when a
replay departs from its recording, a task of a study ended in an error or a report is
about errors only, 2 for bad arguments or files. `gplfd` adds 130 for an interruption.
"""

import contextlib
import importlib.metadata
import logging
import os
import re
import shutil
import sys
import textwrap
import warnings
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final, Protocol, TextIO

import docstring_parser
import tyro

from gplfd_experiments.cli.commands.benchmark import Benchmark, benchmark_from
from gplfd_experiments.cli.commands.catalogue import Catalogue
from gplfd_experiments.cli.commands.demos import Demos
from gplfd_experiments.cli.commands.doctor import Doctor
from gplfd_experiments.cli.commands.doors import Doors
from gplfd_experiments.cli.commands.figures import Figures
from gplfd_experiments.cli.commands.learn import Learn
from gplfd_experiments.cli.commands.report import Report
from gplfd_experiments.cli.commands.run import Run
from gplfd_experiments.cli.commands.skill import SkillTests
from gplfd_experiments.cli.commands.speed import Speed
from gplfd_experiments.cli.commands.trials import Trials
from gplfd_experiments.cli.commands.tune import Tune
from gplfd_experiments.cli.commands.view import View
from gplfd_experiments.console.interruption import os_exit_raises
from gplfd_experiments.console.progress import LOG, MessageHandler
from gplfd_experiments.studies.engines import ONE_THREAD

BAD_INPUT: Final = 2
"""Exit status for bad arguments or files."""


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

SUBCOMMANDS: Final = {"demos": ("import", "export", "record", "replay", "inspect")}
"""What follows the name of a command that has subcommands of its own."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Parse ``arguments`` (default: the process's own) and run the command.

    Every command takes ``--debug``: errors come with their tracebacks.

    Returns:
        The exit status.

    Raises:
        SystemExit: From the parser, for ``--help`` (0) and wrong arguments (2).
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    if given == ["--version"]:
        print(f"gplfd {importlib.metadata.version('gplfd')}")
        return 0
    arguments = [one for one in given if one != "--debug"]
    debug, quiet = arguments != given, "--quiet" in arguments
    level = logging.DEBUG if debug else logging.WARNING if quiet else logging.INFO
    with _messages(level), os_exit_raises():
        try:
            return _parsed(arguments).execute()
        except BrokenPipeError:
            raise
        except (ValueError, OSError, ModuleNotFoundError) as error:
            LOG.error(_in_words(error), exc_info=debug)
            return BAD_INPUT


def _parsed(arguments: Sequence[str]) -> Command:
    _check_command(arguments)
    commands = COMMANDS | {"benchmark": benchmark_from(arguments)}
    with _wrapped_help(arguments):
        command: Command = tyro.extras.subcommand_cli_from_dict(
            commands,
            prog="gplfd",
            description="Open doors with policies learned from demonstrations. "
            "`gplfd --version` prints the version, `gplfd doctor` what is missing "
            "here. Every command takes --debug: errors come with their tracebacks.",
            args=arguments,
        )
    # Before NumPy is loaded, unless the user says otherwise. The policies' matrices
    # have about a hundred rows: sharing them out costs ten times the work.
    for variable, number in ONE_THREAD.items():
        os.environ.setdefault(variable, number)
    return command


@contextlib.contextmanager
def _wrapped_help(arguments: Sequence[str]) -> Iterator[None]:
    """Break the lines of help between words, at the width of the terminal only.

    tyro keeps some line breaks of docstrings, and prints each paragraph of a command's
    description on one line. The overview of all commands has the first paragraph of
    each.
    """
    library: Any = docstring_parser
    parse, parse_fields = library.parse, library.parse_from_object

    def fields_of(described: type) -> docstring_parser.Docstring:
        found: docstring_parser.Docstring = parse_fields(described)
        for field in found.params:
            field.description = _joined_lines(field.description or "")
        return found

    asked = {"-h", "--help"} & {*arguments}
    paragraphs = 1 if asked & {*arguments[:1]} else None

    def description_of(text: str) -> docstring_parser.Docstring:
        shown = _joined_lines(text).split("\n\n")[:paragraphs]
        found: docstring_parser.Docstring = parse("\n\n".join(shown))
        return found

    library.parse, library.parse_from_object = description_of, fields_of
    stream: Any = _WrappedLines(sys.stdout) if asked else sys.stdout
    try:
        with contextlib.redirect_stdout(stream):
            yield
    finally:
        library.parse, library.parse_from_object = parse, parse_fields


def _joined_lines(text: str) -> str:
    """Return a text with each paragraph on one line."""
    return "\n\n".join(" ".join(one.split()) for one in re.split(r"\n\s*\n", text))


class _WrappedLines:
    """A stream that breaks long lines between words, at the width of the terminal."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._wrapper = textwrap.TextWrapper(
            shutil.get_terminal_size().columns,
            break_long_words=False,
            break_on_hyphens=False,
        )

    def write(self, text: str) -> int:
        """Write a text; what has colours is wrapped already, and longer by codes."""
        if "\x1b" not in text:
            text = "\n".join(map(self._wrapper.fill, text.split("\n")))
        return self._stream.write(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


def _check_command(arguments: Sequence[str]) -> None:
    """Refuse the name of a command that does not exist; tyro suggests no other.

    Raises:
        ValueError: There is no such command.
    """
    first, second = (*arguments, "", "")[:2]
    for before, name, known in (
        ("", first, tuple(COMMANDS)),
        (f"{first} ", second, SUBCOMMANDS.get(first, ())),
    ):
        if known and name and not name.startswith("-") and name not in known:
            from gplfd_env.validation.named import nearest_name

            raise ValueError(
                f"unknown command '{before}{name}'{nearest_name(name, known)}; give "
                f"gplfd {before}with one of {', '.join(known)}"
            )


@contextlib.contextmanager
def _messages(level: int) -> Iterator[None]:
    """Print messages of a level or above on stderr, and warnings as one line each."""
    handler = MessageHandler()
    handler.setFormatter(logging.Formatter("gplfd: %(message)s"))
    LOG.setLevel(level)
    LOG.addHandler(handler)
    try:
        with warnings.catch_warnings():
            # Without the file and the source line that raised it.
            warnings.showwarning = lambda message, *_, **__: LOG.warning(
                "warning: %s", " ".join(str(message).split())
            )
            yield
    finally:
        LOG.removeHandler(handler)
        LOG.setLevel(logging.NOTSET)


def _in_words(error: Exception) -> str:
    """Return an error as one paragraph."""
    # OSError's own text leads with a number that says nothing to a person.
    if isinstance(error, OSError) and error.strerror and error.filename:
        return f"{error.filename}: {error.strerror}"
    return " ".join(str(error).split())
