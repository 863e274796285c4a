"""The settings of a study as a TOML file, to read, keep and run again."""

from __future__ import annotations

import dataclasses
import json
import tomllib
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from experiments.study.settings import PRESETS, StudySettings
from gplfd_env.config import nearest_name
from policies.storage import complete_or_absent


def settings_named(name: str) -> StudySettings:
    """Return the settings of a preset, or those in a file.

    Raises:
        ValueError: There is neither, or the file is wrong.
    """
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
    """Read settings; what the file does not say is as in `StudySettings`.

    Raises:
        ValueError: The file is not TOML, has an unknown key or a value of the wrong
            type.
        OSError: It cannot be read.
    """
    try:
        entries = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} is not a TOML file: {error}") from error
    return settings_from(entries, str(path))


def settings_from(entries: Mapping[str, Any], where: str) -> StudySettings:
    """Return settings from plain values by name.

    Args:
        entries: As TOML gives them.
        where: Named in errors.

    Raises:
        ValueError: An unknown key or a value of the wrong type.
    """
    for name in entries:
        if name not in _READERS:
            raise ValueError(
                f"{where}: unknown key {name!r}{nearest_name(name, _READERS)}; keys: "
                f"{', '.join(_READERS)}"
            )
    values = {}
    for name, value in entries.items():
        try:
            values[name] = _READERS[name](value)
        except TypeError as error:
            raise ValueError(f"{where}: {name} = {value!r} must be {error}") from error
    return StudySettings(**values)


def write_settings(path: Path, settings: StudySettings) -> None:
    """Write all settings, complete or not at all.

    Raises:
        OSError: The file cannot be written.
    """
    lines = [f"# gplfd benchmark --config {path.name}"]
    for name, value in dataclasses.asdict(settings).items():
        # JSON's way of writing texts, numbers, lists and truth values is TOML's, too;
        # but a character that TOML wants escaped and JSON does not.
        text = json.dumps(value, allow_nan=False, ensure_ascii=False)
        text = text.replace("\x7f", "\\u007f")
        lines.append(f"{name} = {text}")
    with complete_or_absent(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _whole(value: object) -> int:
    if not isinstance(value, int) or isinstance(value, bool):
        raise TypeError("a whole number")
    return value


def _number(value: object) -> float:
    if not isinstance(value, int | float) or isinstance(value, bool):
        raise TypeError("a number")
    return float(value)


def _truth(value: object) -> bool:
    if not isinstance(value, bool):
        raise TypeError("true or false")
    return value


def _name(value: object) -> str:
    if not isinstance(value, str):
        raise TypeError("a text")
    return value


def _door(value: object) -> str:
    return value if isinstance(value, str) else repr(_number(value))


def _list_of(read: Callable[[object], Any]) -> Callable[[object], tuple[Any, ...]]:
    def read_all(value: object) -> tuple[Any, ...]:
        try:
            if isinstance(value, list):
                return tuple(read(part) for part in value)
        except TypeError as error:
            raise TypeError(f"a list, each of it {error}") from error
        raise TypeError("a list, in [brackets]")

    return read_all


_READERS: Final[Mapping[str, Callable[[object], Any]]] = MappingProxyType(
    {
        "policies": _list_of(_name),
        "doors": _list_of(_door),
        "seeds": _whole,
        "demonstrations_per_door": _list_of(_whole),
        "teacher_noise": _list_of(_number),
        "randomizations": _list_of(_name),
        "skill": _truth,
    }
)
