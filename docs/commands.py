"""Tables of commands, policies and robots, from code and results: a hook of MkDocs."""

import dataclasses
import json
import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, get_args

from gplfd_experiments.cli import main as cli
from gplfd_experiments.cli.commands.demos import SUBCOMMANDS
from gplfd_experiments.cli.doctor import catalogue


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Put a table in the place of ``<!-- table: NAME -->``."""
    for table in (commands, policies, arms, random_commands):
        mark = f"<!-- table: {table.__name__} -->"
        if mark in markdown:
            markdown = markdown.replace(mark, "\n".join(table()))
    return markdown


def commands() -> Iterator[str]:
    """Yield for every command a heading, what it does, and its options."""
    records = {f"demos {name}": record for name, record in SUBCOMMANDS.items()}
    records |= {"doors import": cli.COMMANDS["doors"]}
    records |= {n: cli.COMMANDS[n] for n in cli.COMMANDS if n not in ("demos", "doors")}
    for name, record in sorted(records.items()):
        summary = " ".join((record.__doc__ or "").split())
        yield f"### gplfd {name}\n\n{_escaped(summary)}\n"
        cli._prepare(record)
        yield "| option | meaning | default |\n|---|---|---|"
        yield from map(_row, options(record))
        yield ""


def options(record: Any) -> Iterator[dataclasses.Field[Any]]:
    """Yield the options of a command, with those that several commands share."""
    for option in dataclasses.fields(record):
        kind, *_ = (*get_args(option.type), option.type)
        if dataclasses.is_dataclass(kind):
            yield from options(kind)
        elif option.name != "action":  # the word `import` of `gplfd doors import`
            yield option


def _row(option: dataclasses.Field[Any]) -> str:
    """Return a line of the table; arguments without a name are in capitals."""
    help_text, name = option.metadata.get("help", ""), f"--{option.name}"
    typed: Any = partial(map, str)
    for part in getattr(option.type, "__metadata__", ()):
        help_text = getattr(part, "help", None) or help_text
        typed = getattr(part, "str_from_instance", typed)
    if "Positional" in str(option.type):
        name = option.name.upper()
    default = "required"
    if option.default is not dataclasses.MISSING:
        default = _text(option.default, typed)
    elif option.default_factory is not dataclasses.MISSING:
        default = _text(option.default_factory(), typed)
    return f"| `{name.replace('_', '-')}` | {_escaped(help_text)} | {default} |"


def _text(value: object, typed: Any) -> str:
    """Return a default as it is typed; nothing for options that may be absent."""
    if isinstance(value, bool):
        return "on" if value else "off"
    words = " ".join(typed(value)) if isinstance(value, tuple) else str(value or "")
    return f"`{words}`" if words else ""


def _escaped(text: str) -> str:
    """Return text for a page, on which files of pages are links."""
    text = re.sub(r"([|>*])", r"\\\1", text.replace("<", "&lt;"))
    return re.sub(r"docs/([\w-]+\.md)", r"[\1](\1)", text)


def policies() -> Iterator[str]:
    """Yield what `gplfd list` says of learners, pipelines and model-based policies."""
    for title, lines in catalogue().items():
        if title.startswith(("learners", "pipelines", "references")):
            yield f"**{title.capitalize()}**\n\n| name | meaning |\n|---|---|"
            yield from (f"| `{name}` | {_escaped(lines[name])} |" for name in lines)
            yield ""


def arms() -> Iterator[str]:
    """Yield which arms of other people open the medium door, by docs/results."""
    file = Path(__file__).with_name("results") / "arms.json"
    yield "| arm | opened | base | peak radial force, or why not |\n|---|---|---|---|"
    for arm in json.loads(file.read_text())["rows"]:
        opened, result = "no", f"`{arm['reason']}`"
        if arm["opened"]:
            opened, result = "yes", f"{arm['radial_force_N']:.1f} N"
        yield f"| {arm['arm']} | {opened} | {arm.get('base', '')} | {result} |"


def random_commands() -> Iterator[str]:
    """Yield by how much random commands exceed limits, by docs/results."""
    file = Path(__file__).with_name("results") / "random-commands.json"
    heads = "joint speed [rad/s]", "joint beyond its range [rad]"
    heads += "leaf beyond its stop [°]", "leaf into its frame [°]", "penetration [mm]"
    yield f"| robot, grasp | {' | '.join(heads)} |\n| :-- |{' --: |' * len(heads)}"
    for row in json.loads(file.read_text())["rows"]:
        robot, grasp, *excesses = row.values()
        cells = " | ".join(f"{excess:.2g}" for excess in excesses)
        yield f"| `{robot}`, {grasp} | {cells} |"
