"""Records specified by the name of a preset, or by some of their fields."""

import dataclasses
import difflib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeVar

Record = TypeVar("Record")


def preset(
    spec: object,
    presets: Mapping[str, Record],
    start: str,
    what: str,
    otherwise: str = "",
    within: object = "",
) -> Record:
    """Return the record for a name, a mapping of fields, or the record itself.

    A mapping starts from its ``"preset"``, by default `start`. Messages call a record
    `what` and list the other accepted values and their range. Raises a ValueError for
    an unknown name or field, a TypeError for anything else.
    """
    record = type(presets[start])
    fields = f"a mapping of {record.__name__} fields"
    if isinstance(spec, record):
        return spec
    if not isinstance(spec, str | Mapping):
        others = f"{otherwise}, {fields}" if otherwise else fields
        got = f"{spec!r} ({type(spec).__name__})"
        kinds = f"a preset's name, {others} or a {record.__name__}"
        raise TypeError(f"{what} must be {kinds}, got {got}")
    changes = {"preset": spec} if isinstance(spec, str) else dict(spec)
    name = changes.pop("preset", start)
    if not isinstance(name, str) or name not in presets:
        hint = f"{otherwise} within {within}" if otherwise else fields
        raise ValueError(
            f"unknown {what} {name!r}{nearest_name(name, presets)}; presets: "
            f"{', '.join(presets)}; or give {hint}"
        )
    return with_fields(presets[name], changes, what, other_keys=("preset",))


def with_fields(
    record: Record, fields: Mapping[str, Any], what: str, other_keys: Sequence[str] = ()
) -> Record:
    """Return a frozen dataclass with some fields changed, in its parts by mappings.

    Raises a ValueError that names the fields, and `other_keys`, if one is unknown.
    """
    before: Any = record
    names = [field.name for field in dataclasses.fields(before)]
    changes = {}
    for name, value in fields.items():
        if name not in names:
            raise ValueError(
                f"unknown {what} field {name!r}{nearest_name(name, names)}; fields: "
                f"{', '.join([*names, *other_keys])}"
            )
        part = getattr(before, name)
        nested = dataclasses.is_dataclass(part) and isinstance(value, Mapping)
        changes[name] = with_fields(part, value, name) if nested else value
    changed: Record = dataclasses.replace(before, **changes) if changes else record
    return changed


def record_of(value: object, record: type[Record], what: str) -> Record:
    """Return a record from itself or a mapping of fields, or refuse the value."""
    if isinstance(value, Mapping):
        return with_fields(record(), value, what)
    if not isinstance(value, record):
        got, kind = f"{value!r} ({type(value).__name__})", record.__name__
        raise TypeError(f"{what} must be a {kind} or its fields, got {got}")
    return value


def changed_fields(record: Any) -> dict[str, Any]:
    """Return the fields that differ from their default, nested records as mappings."""
    changed = {}
    for field in dataclasses.fields(record):
        value = getattr(record, field.name)
        if value != field.default:
            nested = dataclasses.is_dataclass(value)
            changed[field.name] = changed_fields(value) if nested else value
    return changed


def nearest_name(name: object, names: Iterable[str]) -> str:
    """Return a hint at a near name, or names with the word; "" if there is none."""
    names = list(names)
    meant = [candidate for candidate in names if str(name) in candidate.split("_")]
    meant = meant or difflib.get_close_matches(str(name), names, n=1)
    return f" (did you mean {' or '.join(map(repr, meant))}?)" if meant else ""
