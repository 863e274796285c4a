"""The subcommands of ``gplfd`` and their exit status.

Exit status: 0 if the command finished (a door that stays closed is a result), 1 if a
replay differs from its recording, a task of a study ended in an error or a report
contains only errors, 2 for bad arguments or files. `gplfd` adds 130 for an
interruption.
"""

import dataclasses
import importlib.metadata
import logging
import os
import re
import shutil
import sys
import textwrap
import typing
import warnings
from collections.abc import Sequence
from contextlib import redirect_stdout
from types import MappingProxyType
from typing import Annotated, Any, Final, TextIO, Union

import docstring_parser
import tyro
from tqdm.contrib.logging import logging_redirect_tqdm

from gplfd_experiments.cli.commands.demos import SUBCOMMANDS, Demos, Doors
from gplfd_experiments.cli.commands.export import Export
from gplfd_experiments.cli.commands.machine import Catalogue, Doctor, Speed
from gplfd_experiments.cli.commands.run import Gallery, Learn, Run, View
from gplfd_experiments.cli.commands.serve import Serve
from gplfd_experiments.cli.commands.studies import (
    Benchmark,
    Figures,
    Report,
    SkillTests,
    Trials,
    Tune,
    benchmark_from,
)
from gplfd_experiments.cli.commands.teach import Correct
from gplfd_experiments.console.interruption import os_exit_raises
from gplfd_experiments.console.progress import LOG
from gplfd_experiments.studies.engines import ONE_THREAD

BAD_INPUT: Final = 2
"""Exit status for bad arguments or files."""


COMMANDS: Final[dict[str, type[Any]]] = {
    "run": Run,
    "learn": Learn,
    "export": Export,
    "serve": Serve,
    "correct": Correct,
    "skill": SkillTests,
    "benchmark": Benchmark,
    "trials": Trials,
    "tune": Tune,
    "report": Report,
    "figures": Figures,
    "demos": Demos,
    "doors": Doors,
    "view": View,
    "gallery": Gallery,
    "speed": Speed,
    "list": Catalogue,
    "doctor": Doctor,
}
"""The subcommands by name. Their fields are the options; `execute` does the work and
returns the exit status, and bad input raises a ValueError, OSError or
ModuleNotFoundError."""

_HELP: Final = frozenset({"-h", "--help"})


def main(arguments: Sequence[str] | None = None) -> int:
    """Parse ``arguments`` (default: the process's own) and run the command.

    Every command accepts ``--debug``, which prints errors with tracebacks. Returns the
    exit status; the parser raises SystemExit for ``--help`` (0) and wrong arguments
    (2).
    """
    given = list(sys.argv[1:] if arguments is None else arguments)
    if given == ["--version"]:
        print(f"gplfd {importlib.metadata.version('gplfd')}")
        return 0
    arguments = [one for one in given if one != "--debug"]
    debug, quiet = arguments != given, "--quiet" in arguments

    # Messages go to stderr, each on a line of its own above progress bars.
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("gplfd: %(message)s"))
    LOG.setLevel(logging.DEBUG if debug else logging.WARNING if quiet else logging.INFO)
    LOG.addHandler(handler)
    try:
        with logging_redirect_tqdm([LOG]):
            return _status(arguments, debug)
    finally:
        LOG.removeHandler(handler)
        LOG.setLevel(logging.NOTSET)


def _status(arguments: Sequence[str], debug: bool) -> int:
    """Run the command that the arguments name, and log the error that ends it."""
    try:
        with warnings.catch_warnings(), os_exit_raises():
            # In one line, without the file and the source line of the warning.
            warnings.showwarning = lambda message, *_, **__: LOG.warning(
                "warning: %s", " ".join(str(message).split())
            )
            status: int = _parsed(arguments).execute()
            return status
    except BrokenPipeError:
        raise
    except (ValueError, OSError, ModuleNotFoundError) as error:
        text = " ".join(str(error).split())
        # The text of an OSError begins with an error number.
        if isinstance(error, OSError) and error.strerror and error.filename:
            text = f"{error.filename}: {error.strerror}"
        LOG.error(text, exc_info=debug)
        return BAD_INPUT


def _parsed(arguments: Sequence[str]) -> Any:
    """Return the command that the arguments name, with its options."""
    # tyro suggests no correction for a wrong name.
    first, second = (*arguments, "", "")[:2]
    inner = SUBCOMMANDS if first == "demos" else {}
    for before, name, known in (("", first, COMMANDS), (f"{first} ", second, inner)):
        if known and name and not name.startswith("-") and name not in known:
            from gplfd_env.validation.named import nearest_name

            raise ValueError(
                f"unknown command '{before}{name}'{nearest_name(name, known)}; give "
                f"gplfd {before}with one of {', '.join(known)}"
            )
    for chosen in (COMMANDS.get(first), inner.get(second)):
        if chosen is not None:
            _join_help(chosen)
    options = []
    for name, make in (COMMANDS | {"benchmark": benchmark_from(arguments)}).items():
        # Without the line breaks of the source. The overview of all commands shows the
        # first paragraph of each.
        paragraphs = re.split(r"\n\s*\n", COMMANDS[name].__doc__ or "")
        shown = paragraphs[:1] if first in _HELP else paragraphs
        text = "\n\n".join(" ".join(one.split()) for one in shown)
        how = tyro.conf.subcommand(name, constructor=make, description=text)
        options.append(Annotated[Any, how])
    union: Any = Union[tuple(options)]  # noqa: UP007
    stream: Any = sys.stdout
    if _HELP.intersection(arguments):
        stream = _WrappedLines(sys.stdout)
    with redirect_stdout(stream):
        command: Any = tyro.cli(
            union,
            prog="gplfd",
            description="Open doors with policies learned from demonstrations. "
            "`gplfd --version` prints the version, `gplfd doctor` what is missing "
            "here. Every command takes --debug: errors come with their tracebacks.",
            args=arguments,
        )
    # Before NumPy is loaded, unless the user sets it. The policies' matrices have about
    # a hundred rows: with several threads they take ten times as long.
    for variable, number in ONE_THREAD.items():
        os.environ.setdefault(variable, number)
    return command


def _join_help(command: Any) -> None:
    """Let tyro show the docstrings of options without the line breaks of the source.

    tyro prefers the help in the metadata of a field.
    """
    texts = {
        one.arg_name: one.description or ""
        for part in reversed(command.__mro__)
        if dataclasses.is_dataclass(part)
        for one in docstring_parser.parse_from_object(part).params
    }
    for field in dataclasses.fields(command):
        if field.name in texts:
            text = " ".join(texts[field.name].split())
            field.metadata = MappingProxyType({"help": text})
        # Options that several commands share are fields of a field.
        for part in typing.get_args(field.type)[:1]:
            if dataclasses.is_dataclass(part):
                _join_help(part)


class _WrappedLines:
    """A stream that breaks long lines between words, at the width of the terminal.

    tyro prints each paragraph of a command's description on one line.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._wrapper = textwrap.TextWrapper(
            shutil.get_terminal_size().columns,
            break_long_words=False,
            break_on_hyphens=False,
        )

    def write(self, text: str) -> int:
        """Write a text; coloured text is wrapped already, and contains colour codes."""
        if "\x1b" not in text:
            text = "\n".join(map(self._wrapper.fill, text.split("\n")))
        return self._stream.write(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)
