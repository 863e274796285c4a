"""The ``gplfd`` command: one literal dict of subcommands.

Exit status: 0 when the command did its work (a door left closed is a result), 1 when a
replay departs from its recording, 2 for bad arguments or input files, 130 when
interrupted.
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable, Sequence
from typing import Final, Protocol

import tyro

from experiments.commands.benchmark import Benchmark, benchmark_from
from experiments.commands.catalogue import Catalogue
from experiments.commands.complaint import complain
from experiments.commands.demos import Demos
from experiments.commands.figures import Figures
from experiments.commands.report import Report
from experiments.commands.run import Run
from experiments.commands.speed import Speed
from experiments.commands.view import View

INTERRUPTED: Final = 130


class Command(Protocol):
    """A subcommand: its fields are the options."""

    def execute(self) -> int:
        """Do the work and return the exit status."""


_THREADS: Final = (
    *("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"),
    *("MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS"),
)
"""Set to 1 unless the user says otherwise, before NumPy is loaded: the policies'
matrices have about a hundred rows, and sharing them out costs ten times the work."""

COMMANDS: Final[dict[str, Callable[..., Command]]] = {
    "run": Run,
    "benchmark": Benchmark,
    "report": Report,
    "figures": Figures,
    "demos": Demos,
    "view": View,
    "speed": Speed,
    "list": Catalogue,
}
"""The subcommands by name."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Parse ``arguments`` (default: the process's own) and run the command.

    Returns:
        The exit status.

    Raises:
        SystemExit: From the parser, for ``--help`` (0) and wrong arguments (2).
    """
    arguments = sys.argv[1:] if arguments is None else arguments
    try:
        saved = benchmark_from(arguments)
    except (ValueError, OSError) as error:
        return complain(error)
    command: Command = tyro.extras.subcommand_cli_from_dict(
        COMMANDS | {"benchmark": saved},
        prog="gplfd",
        description="Open doors with policies learned from demonstrations.",
        args=arguments,
    )
    for variable in _THREADS:
        os.environ.setdefault(variable, "1")
    with warnings.catch_warnings():
        warnings.showwarning = _show_warning
        try:
            return command.execute()
        except KeyboardInterrupt:
            print(
                "gplfd: interrupted; files already written are complete",
                file=sys.stderr,
            )
            return INTERRUPTED


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    """Print a warning without the source line that raised it."""
    print(f"gplfd: warning: {message}", file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
