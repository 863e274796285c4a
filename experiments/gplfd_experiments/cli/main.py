"""The subcommands of ``gplfd`` and their exit status.

Exit status: 0 if the command finished (a door that stays closed is a result), 1 if a
task of a study ended in an error or a report contains only errors, 2 for bad arguments
or files. `gplfd` adds 130 for an interruption.
"""

import dataclasses
import importlib.metadata
import logging
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Final, TextIO, Union, get_args

import docstring_parser
import tyro
from tqdm import tqdm

from gplfd_experiments.cli.commands import (
    demos,
    export,
    machine,
    run,
    studies,
    submissions,
    teach,
)
from gplfd_experiments.console.progress import LOG

BAD_INPUT: Final = 2  # Exit status for bad arguments or files.

COMMANDS: Final[Mapping[str, type[Any]]] = {
    "run": run.Run,
    "learn": run.Learn,
    "export": export.Export,
    "serve": export.Serve,
    "correct": teach.Correct,
    "skill": studies.SkillTests,
    "benchmark": studies.Benchmark,
    "trials": studies.Trials,
    "report": studies.Report,
    "submit": submissions.Submit,
    "verify": submissions.Verify,
    "figures": studies.Figures,
    "demos": demos.Demos,
    "doors": demos.Doors,
    "view": run.View,
    "list": machine.Catalogue,
    "doctor": machine.Doctor,
}
"""The subcommands by name. Their fields are the options, and their docstrings the help.
`execute` does the work and returns the exit status; bad input raises a ValueError,
OSError or ModuleNotFoundError."""


class _AboveBars(logging.StreamHandler[TextIO]):
    """Writes messages above progress bars; tqdm's own handler loads asyncio."""

    def emit(self, record: logging.LogRecord) -> None:
        with tqdm.external_write_mode(self.stream):
            super().emit(record)


def main(arguments: Sequence[str] | None = None) -> int:
    """Parse arguments (default: the process's own), run the command, return its status.

    The parser raises SystemExit for ``--help`` (0) and wrong arguments (2).
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    if words == ["--version"]:
        print(f"gplfd {importlib.metadata.version('gplfd')}")
        return 0
    debug = "--debug" in words
    words = [word for word in words if word != "--debug"]
    handler = _AboveBars()
    handler.setFormatter(logging.Formatter("gplfd: %(message)s"))
    LOG.addHandler(handler)
    try:
        with warnings.catch_warnings():
            # In one line, without the file and the source line of the warning.
            warnings.showwarning = lambda message, *_, **__: LOG.warning(
                "warning: %s", " ".join(str(message).split())
            )
            command = _parse(words, COMMANDS)
            if not isinstance(command, machine.Doctor):  # which reports what is missing
                from gplfd_env.conventions.opengl import choose_opengl

                choose_opengl()
            if isinstance(command, studies.Benchmark):
                from gplfd_experiments.studies.settings import settings_named

                # The settings of a file are the defaults of the options.
                named = partial(studies.Benchmark, study=settings_named(command.config))
                command = _parse(words, {**COMMANDS, "benchmark": named})
            quiet = getattr(command, "quiet", False)
            level = logging.WARNING if quiet else logging.INFO
            LOG.setLevel(logging.DEBUG if debug else level)
            status: int = command.execute()
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
    finally:
        LOG.removeHandler(handler)
        LOG.setLevel(logging.NOTSET)


def _parse(words: Sequence[str], commands: Mapping[str, Callable[..., Any]]) -> Any:
    """Return the command that the words name, with its options."""
    first, second = (*words, "", "")[:2]
    named: tuple[Any, ...] = (COMMANDS.get(first), demos.SUBCOMMANDS.get(second))
    for record in filter(None, named):
        _prepare(record)
    subcommands = []
    for name, command in commands.items():
        summary = None
        if first in ("", "-h", "--help"):
            summary, *_ = (COMMANDS[name].__doc__ or "").split("\n\n")
        how = tyro.conf.subcommand(name, constructor=command, description=summary)
        subcommands.append(Annotated[Any, how])
    union: Any = Union[tuple(subcommands)]  # noqa: UP007
    return tyro.cli(
        union,
        prog="gplfd",
        description="Open doors with policies learned from demonstrations. `gplfd "
        "--version` prints the version, `gplfd doctor` what is missing here. Every "
        "command takes --debug: errors come with their tracebacks.",
        args=words,
    )


@cache
def _prepare(record: Any) -> None:
    """Join lines of help texts, and name options that may be absent by their type."""
    texts = {
        text.arg_name: " ".join((text.description or "").split())
        for part in reversed(record.__mro__[:-1])
        for text in docstring_parser.parse_from_object(part).params
    }
    for option in dataclasses.fields(record):
        if option.name in texts:
            metadata = {**option.metadata, "help": texts[option.name]}
            option.metadata = MappingProxyType(metadata)
        kind, *_ = parts = (*get_args(option.type), None)
        shared: Any = kind
        if dataclasses.is_dataclass(kind):  # Options that several commands share.
            _prepare(shared)
        elif kind in (Path, int, float, str) and type(None) in parts:
            how = tyro.conf.arg(metavar=kind.__name__.upper())
            record.__annotations__[option.name] = Annotated[option.type, how]
