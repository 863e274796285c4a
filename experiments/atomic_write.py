"""JSON files that are either complete or absent."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any


def write_json(path: str | Path, value: Any) -> None:
    """Write ``value`` as indented JSON, complete or not at all.

    Raises:
        ValueError: The value holds NaN or infinity, which JSON cannot express.
        TypeError: The value holds something that JSON cannot express.
    """
    # Policies load NumPy and SciPy, for which `gplfd run --help` must not wait.
    from policies.storage import complete_or_absent

    text = json.dumps(value, indent=2, allow_nan=False) + "\n"
    with complete_or_absent(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
