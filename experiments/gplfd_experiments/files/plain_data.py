"""Plain data in JSON and TOML: one error for all damage, types checked by `entry`."""

import contextlib
import json
import math
import tomllib
import types
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

_SHOWN: Final = 60  # Largest number of characters of an invalid value in an error.
_KINDS: Final[Mapping[Any, str]] = {
    str: "a text",
    int: "a whole number",
    float: "a number",
    bool: "true or false",
    types.NoneType: "null",
}


def stamp(kind: str, version: int) -> dict[str, Any]:
    """Return the entries that state the kind of a file, as in archives of arrays."""
    return {"format": kind, "format_version": version}


def check_stamp(entries: Mapping[str, Any], kind: str, version: int) -> None:
    """Raise ValueError for entries of another kind of file or of a later version."""
    if (stated := entry(entries, "format", str)) != kind:
        raise ValueError(f"it holds {stated:.{_SHOWN}}, not {kind}")
    if (later := entry(entries, "format_version", int)) > version:
        raise ValueError(
            f"it has version {later} of {kind}, and this program reads up to "
            f"version {version}; use the gplfd that wrote it, or a later one"
        )


@contextlib.contextmanager
def naming(path: Path) -> Iterator[None]:
    """Put the name of a file before a ValueError of a block."""
    try:
        yield
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def write_json(path: str | Path, value: Any, *, indent: int | None = 2) -> None:
    """Write ``value`` as JSON, complete or not at all; raises as `json_text` does."""
    from gplfd_policies.arrays.storage import complete_or_absent  # loads SciPy

    text = json_text(value, indent=indent) + "\n"
    with complete_or_absent(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def json_text(value: Any, *, indent: int | None = 2) -> str:
    """Return ``value`` as JSON; ValueError for NaN, TypeError for what JSON lacks."""
    return json.dumps(value, indent=indent, allow_nan=False)


def read_json(path: str | Path) -> dict[str, Any]:
    """Read a file that holds one JSON object; raises ValueError for anything else."""
    return _read(Path(path), "JSON", parsed_json)


def read_toml(path: str | Path) -> dict[str, Any]:
    """Read a TOML file; raises ValueError for anything else."""
    return _read(Path(path), "TOML", tomllib.loads)


def _read(
    path: Path, language: str, parse: Callable[[str], dict[str, Any]]
) -> dict[str, Any]:
    from gplfd_policies.arrays.storage import regular_file  # loads SciPy

    content = regular_file(path).read_bytes()
    try:
        return parse(content.decode())
    except ValueError as error:
        raise ValueError(f"{path} cannot be read as {language}: {error}") from error


def parsed_json(text: str) -> dict[str, Any]:
    """Parse one JSON object; raises ValueError for anything else, and for NaN."""

    def no_number(name: str) -> float:
        raise ValueError(f"it holds {name}, which is no number of JSON")

    try:
        values = json.loads(text, parse_constant=no_number)
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    if not isinstance(values, dict):
        raise ValueError(f"it holds {values!r:.{_SHOWN}}, not an object in {{braces}}")
    return values


def entry(entries: Mapping[str, Any], name: str, kind: Any) -> Any:
    """Return an entry of plain data as the required type, or raise ValueError.

    The type is str, int, float, bool, Any, None, a Literal of strings, or of these
    ``tuple[kind, ...]`` or Sequence for a list, ``dict[str, kind]`` or Mapping, or a
    union. A whole number is a float, too; a float is finite.
    """
    if name not in entries:
        raise ValueError(f"it lacks {name}, which must be {_described(kind)}")
    try:
        return _as(entries[name], kind)
    except (TypeError, OverflowError):
        raise ValueError(
            f"{name} = {entries[name]!r:.{_SHOWN}} must be {_described(kind)}"
        ) from None


def _as(value: Any, kind: Any) -> Any:
    """Return plain data as a type, or raise TypeError."""
    if kind is Any or (type(value) is kind and kind is not float):
        return value
    if kind is float and type(value) in (int, float) and math.isfinite(value):
        return float(value)
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if origin is types.UnionType:
        for alternative in inner:
            with contextlib.suppress(TypeError):
                return _as(value, alternative)
    if origin is typing.Literal and type(value) is str and value in inner:
        return value
    if origin in (tuple, Sequence) and type(value) is list:
        return tuple(_as(part, inner[0]) for part in value)
    if origin in (dict, Mapping) and type(value) is dict:
        return {name: _as(part, inner[1]) for name, part in value.items()}
    raise TypeError


def _described(kind: Any) -> str:
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if origin in (types.UnionType, typing.Literal):
        return " or ".join(map(_described, inner))
    if origin in (tuple, Sequence):
        return f"a list in [brackets], each of it {_described(inner[0])}"
    if origin in (dict, Mapping):
        return "an object in {braces}"
    return _KINDS.get(kind, repr(kind))
