"""Policies and parts of the pipeline in a few words; `gplfd list` loads only these."""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Final

SUMMARIES: Final[Mapping[str, Mapping[str, str]]] = tomllib.loads(
    Path(__file__).with_suffix(".toml").read_text("utf-8")
)
"""Summaries by name, for ``learners``, ``parts`` and ``references``."""
