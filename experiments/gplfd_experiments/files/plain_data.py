"""Plain data in untrusted text files, JSON and TOML, with one error for all damage.

A file may be truncated, edited by hand, or malicious. Data that is read has a limited
size and depth, finite numbers, and text that can be written again. Other properties are
checked when `entry` returns a value as the required type.
"""

import contextlib
import json
import sys
import tomllib
import types
import typing
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

from gplfd_policies.arrays.storage import complete_or_absent, regular_file

_LARGEST: Final = 2**24  # Largest size of a file [bytes]; a result has a few thousand.
_DEEPEST: Final = 32  # Largest nesting of lists and tables; a study has four levels.
_SHOWN: Final = 60  # Largest number of characters of an invalid value in an error.
_KINDS: Final[Mapping[Any, str]] = types.MappingProxyType(
    {
        str: "a text",
        int: "a whole number",
        float: "a number",
        bool: "true or false",
        types.NoneType: "null",
    }
)


class NewerFormatError(ValueError):
    """A file was written by a later version of this package."""


def stamp(kind: str, version: int) -> dict[str, Any]:
    """Return the entries that state the kind of a file, as in archives of arrays."""
    return {"format": kind, "format_version": version}


def check_stamp(entries: Mapping[str, Any], kind: str, version: int) -> None:
    """Check that the entries are of a kind of file, in a version up to the given one.

    Raises NewerFormatError for a later version, and ValueError for another kind or
    without a version.
    """
    if (found := entry(entries, "format", str)) != kind:
        raise ValueError(f"it holds {found:.{_SHOWN}}, not {kind}")
    found_version: int = entry(entries, "format_version", int)
    if found_version > version:
        raise NewerFormatError(
            f"it has version {found_version} of {kind}, and this program reads up to "
            f"version {version}; use the gplfd that wrote it, or a later one"
        )
    if found_version < 1:
        raise ValueError(f"format_version = {found_version} must be 1 or more")


def refuse_newer(read: Callable[[Path], object], path: Path) -> None:
    """Raise NewerFormatError if a later version wrote the file to be replaced."""
    try:
        read(path)
    except NewerFormatError:
        raise
    except (OSError, ValueError):
        pass


@contextlib.contextmanager
def naming(path: Path) -> Iterator[None]:
    """Put the name of a file before a `ValueError` or `NewerFormatError` of a block."""
    try:
        yield
    except ValueError as error:
        newer = isinstance(error, NewerFormatError)
        kind = NewerFormatError if newer else ValueError
        raise kind(f"{path}: {error}") from error


def write_json(path: str | Path, value: Any, *, indent: int | None = 2) -> None:
    """Write ``value`` as JSON, complete or not at all.

    Raises ValueError for NaN or infinity, TypeError for other values that JSON lacks.
    """
    text = json_text(value, indent=indent) + "\n"
    with complete_or_absent(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def json_text(value: Any, *, indent: int | None = 2) -> str:
    """Return ``value`` as JSON; raises what `write_json` raises of a value."""
    return json.dumps(value, indent=indent, allow_nan=False)


def read_json(path: str | Path) -> dict[str, Any]:
    """Read a file that holds one JSON object.

    Raises ValueError if it is not an object, or has a repeated key, NaN, infinite
    numbers, deep nesting, or many megabytes.
    """
    return _read(Path(path), "JSON", parsed_json)


def read_toml(path: str | Path) -> dict[str, Any]:
    """Read a TOML file; raises what `read_json` raises."""
    return _read(Path(path), "TOML", partial(_parsed, tomllib.loads))


def parsed_json(text: str) -> dict[str, Any]:
    """Parse one JSON object; raises the ValueError that `read_json` raises."""

    def once_each(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        # Otherwise the last value of a repeated name would be used.
        values = dict(pairs)
        if len(values) < len(pairs):
            twice, _ = Counter(name for name, _ in pairs).most_common(1)[0]
            raise ValueError(f"it holds {twice!r:.{_SHOWN}} twice")
        return values

    return _parsed(partial(json.loads, object_pairs_hook=once_each), text)


def entry(entries: Mapping[str, Any], name: str, kind: Any) -> Any:
    """Return an entry of plain data as the required type, or raise ValueError.

    The type is str, int, float, bool, Any, None, a Literal of strings, or of these
    ``tuple[kind, ...]`` or Sequence for a list, ``dict[str, kind]`` or Mapping, or a
    union. A whole number is a float, too.
    """
    if name not in entries:
        raise ValueError(f"it lacks {name}, which must be {_described(kind)}")
    try:
        return _as(entries[name], kind)
    except TypeError:
        raise ValueError(
            f"{name} = {entries[name]!r:.{_SHOWN}} must be {_described(kind)}"
        ) from None


def _read(
    path: Path, language: str, parse: Callable[[str], dict[str, Any]]
) -> dict[str, Any]:
    with regular_file(path).open("rb") as stream:
        content = stream.read(_LARGEST + 1)
    try:
        if len(content) > _LARGEST:
            raise ValueError(f"it is larger than {_LARGEST:,} bytes")
        return parse(content.decode())
    except ValueError as error:
        raise ValueError(f"{path} cannot be read as {language}: {error}") from error


def _parsed(parse: Callable[[str], Any], text: str) -> dict[str, Any]:
    try:
        values = parse(text)
    # Both parsers follow nesting by recursion.
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    if not isinstance(values, dict):
        raise ValueError(f"it holds {values!r:.{_SHOWN}}, not an object in {{braces}}")
    _check(values, _DEEPEST)
    return values


def _check(value: Any, depth: int) -> None:
    """Raise ValueError unless `write_json` could have written this."""
    if depth == 0:
        raise ValueError(f"it is nested deeper than {_DEEPEST} levels")
    if isinstance(value, str):
        value.encode()  # half a surrogate pair is an error
    elif isinstance(value, int | float):
        if not abs(value) <= sys.float_info.max:
            raise ValueError("it holds a number that is infinite or not a number")
    elif isinstance(value, dict):
        for name, part in value.items():
            _check(name, depth)
            _check(part, depth - 1)
    elif isinstance(value, list):
        for part in value:
            _check(part, depth - 1)


def _as(value: Any, kind: Any) -> Any:
    """Return plain data as a type, or raise TypeError."""
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if origin is types.UnionType:
        for one in inner:
            with contextlib.suppress(TypeError):
                return _as(value, one)
    if origin is typing.Literal and type(value) is str and value in inner:
        return value
    if origin in (tuple, Sequence) and type(value) is list:
        return tuple(_as(part, inner[0]) for part in value)
    if origin in (dict, Mapping) and type(value) is dict:
        return {name: _as(part, inner[1]) for name, part in value.items()}
    if kind is float and type(value) is int:
        return float(value)
    if kind is Any or type(value) is kind:
        return value
    raise TypeError


def _described(kind: Any) -> str:
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if origin is types.UnionType:
        return " or ".join(map(_described, inner))
    if origin is typing.Literal:
        return " or ".join(map(repr, inner))
    if origin in (tuple, Sequence):
        return f"a list in [brackets], each of it {_described(inner[0])}"
    if origin in (dict, Mapping):
        each = "" if inner[1] is Any else f", each of it {_described(inner[1])}"
        return f"an object in {{braces}}{each}"
    return _KINDS[kind]
