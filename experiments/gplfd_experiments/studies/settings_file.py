"""Reads and writes the settings of a study as a TOML file."""

import dataclasses
import json
import typing
from pathlib import Path
from typing import Any, Final

from gplfd_env.validation.named import nearest_name
from gplfd_experiments.files.plain_data import (
    check_stamp,
    entry,
    naming,
    read_toml,
    refuse_newer,
    stamp,
)
from gplfd_experiments.studies.settings import PRESETS, StudySettings
from gplfd_policies.arrays.storage import complete_or_absent

KIND: Final = "gplfd study settings"
VERSION: Final = 1
"""Version of the keys and their meanings."""
_STAMP: Final = stamp(KIND, VERSION)


def settings_named(name: str) -> StudySettings:
    """Return the settings of a preset, or those in a file."""
    if name in PRESETS:
        return PRESETS[name]
    path = Path(name)
    if not path.is_file():
        raise ValueError(
            f"--config {name}: there is no such file and no such study"
            f"{nearest_name(name, PRESETS)}; studies: {', '.join(PRESETS)}; or give a "
            "study.toml"
        )
    return read_settings(path)


def read_settings(path: Path) -> StudySettings:
    """Read settings; missing ones have the defaults of `StudySettings`."""
    entries = read_toml(path)
    with naming(path):
        if entries.keys() & _STAMP.keys():
            check_stamp(entries, KIND, VERSION)
        # In a file, a radius may be a number.
        kinds = typing.get_type_hints(StudySettings)
        kinds["doors"] = tuple[str | float, ...]
        values: dict[str, Any] = {}
        for name in (one for one in entries if one not in _STAMP):
            if name not in kinds:
                raise ValueError(
                    f"unknown key {name!r:.80}{nearest_name(name, kinds)}; keys: "
                    f"{', '.join(kinds)}"
                )
            values[name] = entry(entries, name, kinds[name])
        if "doors" in values:
            values["doors"] = tuple(map(str, values["doors"]))
        return StudySettings(**values)


def write_settings(path: Path, settings: StudySettings) -> None:
    """Write all settings, complete or not at all; not over those of a later version."""
    refuse_newer(read_settings, path)
    lines = [f"# gplfd benchmark --config {path.name}"]
    for name, value in (_STAMP | dataclasses.asdict(settings)).items():
        # TOML has the same format as JSON for texts, numbers, lists and truth values,
        # except for one character that must be escaped.
        text = json.dumps(value, allow_nan=False, ensure_ascii=False)
        lines.append(f"{name} = {text}".replace("\x7f", "\\u007f"))
    with complete_or_absent(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")
