"""Tables made from the records of the code: a hook of MkDocs.

A line ``<!-- table: door parameters -->`` of a page becomes the table of `TABLES` with
this name, whenever the site is built. Units and ranges come from the fields of the
records, meanings from their docstrings.
"""

import dataclasses
import inspect
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final

from docstring_parser import parse, parse_from_object

from gplfd_env import DOORS
from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.disturbance import CAUSES, DISTURBANCES
from gplfd_env.doors.randomization import RANDOMIZATIONS, DoorRandomization
from gplfd_env.envs.door_opening import DoorOpeningEnv
from gplfd_env.envs.vector import DoorOpeningVectorEnv
from gplfd_env.task.info import INFO
from gplfd_env.validation.named import changed_fields

Rows = Iterator[tuple[object, ...]]


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Put every table in the place of the line that names it."""
    for name in TABLES:
        mark = f"<!-- table: {name} -->"
        if mark in markdown:
            markdown = markdown.replace(mark, table(name))
    return markdown


def table(name: str) -> str:
    """Return a table as Markdown; its first row is its head."""
    head, *rows = TABLES[name]()
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)


def _declared(record: type, prefix: str = "") -> Rows:
    """Yield name, default, range, unit and meaning of every field of a record.

    A field that is a record itself is a part, whose fields follow in its place.
    """
    meanings = _meanings(parse_from_object(record))
    for field in dataclasses.fields(record):
        if dataclasses.is_dataclass(field.default):
            yield from _declared(type(field.default), f"{prefix}{field.name}.")
            continue
        choices, allowed = (field.metadata.get(x) for x in ("choices", "range"))
        limits = ", ".join(f"`{choice}`" for choice in choices or ())
        if allowed:
            limits = str(dataclasses.replace(allowed, unit="", reason=""))
        unit = allowed.unit if allowed else ""
        name, default = f"`{prefix}{field.name}`", _number(field.default)
        yield name, default, limits, unit, meanings[field.name]


def _meanings(docstring: Any) -> dict[str, str]:
    """Return what a docstring says of every name, in one line as a cell needs it."""
    texts = {part.arg_name: part.description or "" for part in docstring.params}
    lines = {name: " ".join(text.split()) for name, text in texts.items()}
    return {name: line.replace("``", "`") for name, line in lines.items()}


def _number(value: object) -> object:
    if isinstance(value, tuple):
        return f"[{', '.join(str(_number(end)) for end in value)}]"
    return f"{value:.5g}" if isinstance(value, float) else value


def _door_parameters() -> Rows:
    yield "parameter", "default", "range", "unit", "meaning"
    yield from _declared(DoorConfig)


def _door_presets() -> Rows:
    yield "preset", "motion", "handle", "radius [m]", "mass [kg]", "needs [N]"
    for name, door in DOORS.items():
        closing = door.closing_spring[0] + door.closer.boost + door.seal + door.stiction
        force = (door.friction + closing) / door.hand_radius
        numbers = door.radius, round(door.panel_mass, 1), round(force)
        yield f"`{name}`", door.motion, door.handle, *map(_number, numbers)


def _disturbances() -> Rows:
    yield "cause", "field", "default", "range", "unit", "meaning"
    for cause, record in CAUSES.items():
        for row in _declared(record):
            yield f"`{cause}`", *row


def _disturbance_presets() -> Rows:
    yield "preset", "event"
    for name, disturbance in DISTURBANCES.items():
        yield f"`{name}`", f"`{_text(changed_fields(disturbance))}`"


def _text(fields: Mapping[str, Any]) -> str:
    """Return a mapping of fields as one writes it."""
    pairs = (
        f'"{name}": {_text(value) if isinstance(value, Mapping) else _quoted(value)}'
        for name, value in fields.items()
    )
    return f"{{{', '.join(pairs)}}}"


def _quoted(value: object) -> object:
    return f'"{value}"' if isinstance(value, str) else _number(value)


def _randomization() -> Rows:
    presets = ("mild", "hard", "standard", "detector")
    yield "parameter", *presets, "allowed", "meaning"
    meanings = _meanings(parse_from_object(DoorRandomization))
    for field in dataclasses.fields(DoorRandomization):
        limits = field.metadata.get("limits") or (field.metadata.get("range"),)
        plain = [dataclasses.replace(x, unit="", reason="") for x in limits if x]
        widest = ", ".join(dict.fromkeys(map(str, plain)))
        values = [getattr(RANDOMIZATIONS[x], field.name) for x in presets]
        drawn = [_number("" if x == field.default else x) for x in values]
        yield f"`{field.name}`", *drawn, widest, meanings[field.name]


def _infos() -> Rows:
    yield "key", "type", "unit", "meaning"
    for name, entry in INFO.items():
        texts = ", ".join(f'`"{text}"`' for text in entry.texts)
        meaning = f"{entry.meaning}: {texts}" if texts else entry.meaning
        yield f"`{name}`", entry.kind.__name__, entry.unit, meaning


def _arguments(make: type, leave_out: type | None = None) -> Rows:
    """Yield the arguments of an environment, without those that another one has."""
    meanings, others = _meanings(parse(make.__doc__ or "")), set()
    if leave_out:
        others = {*inspect.signature(leave_out).parameters} - {*meanings}
    yield "argument", "default", "meaning"
    for name, argument in inspect.signature(make).parameters.items():
        if name not in others:
            default = getattr(argument.default, "value", argument.default)
            yield f"`{name}`", f"`{default!r}`", meanings[name]


TABLES: Final[Mapping[str, Callable[[], Rows]]] = {
    "arguments": lambda: _arguments(DoorOpeningEnv),
    "arguments of vectors": lambda: _arguments(DoorOpeningVectorEnv, DoorOpeningEnv),
    "door parameters": _door_parameters,
    "door presets": _door_presets,
    "randomization": _randomization,
    "disturbances": _disturbances,
    "disturbance presets": _disturbance_presets,
    "infos": _infos,
}
"""Tables by the name with which a page asks for them."""
