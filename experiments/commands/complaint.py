"""How the command line says that an argument or an input file is wrong."""

from __future__ import annotations

import sys

BAD_INPUT = 2
"""Exit status for bad arguments or input files."""


def complain(error: Exception) -> int:
    """Print an error as one paragraph on stderr and return the exit status."""
    # OSError's own text leads with a number that says nothing to a person.
    named = isinstance(error, OSError) and error.strerror and error.filename
    text = f"{error.filename}: {error.strerror}" if named else str(error)  # type: ignore[attr-defined]
    print(f"gplfd: {' '.join(text.split())}", file=sys.stderr)
    return BAD_INPUT
