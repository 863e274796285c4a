"""``python -m gplfd_policies.serving``: serve without the command line `gplfd`.

Its options are the fields of `ServeSettings`, like those of `gplfd serve`.
"""

import sys

if __name__ == "__main__" and not sys.flags.safe_path:
    # ``-m`` searches the working folder first, which may hold a random.py.
    sys.path.pop(0)

import argparse
import dataclasses
from collections.abc import Sequence
from types import NoneType
from typing import Any, get_args, get_origin

from gplfd_policies.serving.settings import ServeSettings


def parsed(arguments: Sequence[str] | None = None) -> ServeSettings:
    """Return the settings from arguments; exits with status 2 if they are invalid."""
    parser = argparse.ArgumentParser(
        "python -m gplfd_policies.serving",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    for field in dataclasses.fields(ServeSettings):
        options: dict[str, Any] = {"help": field.metadata["help"]}
        if field.name == "source":
            parser.add_argument(field.name, **options)
            continue
        options["default"] = field.default
        kinds = [kind for kind in get_args(field.type) if kind != NoneType]
        kind = (kinds or [field.type])[0]
        if kind is bool:
            options["action"] = "store_true"
        else:
            options["type"] = kind if callable(kind) else str
            if get_origin(field.type) is tuple:
                options["nargs"] = len(kinds)
        parser.add_argument(f"--{field.name.replace('_', '-')}", **options)
    values: dict[str, Any] = vars(parser.parse_args(arguments))
    boxes = {name: tuple(v) for name, v in values.items() if isinstance(v, list)}
    try:
        return ServeSettings(**values | boxes)
    except ValueError as error:
        parser.error(str(error))


def main(arguments: Sequence[str] | None = None) -> int:
    """Serve and return the exit status: 0, 2 if serving is impossible, or 130."""
    settings = parsed(arguments)
    from gplfd_policies.serving.server import serve

    try:
        serve(settings)
    except (ValueError, OSError) as error:
        print(f"gplfd: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    return 0


if __name__ == "__main__":
    sys.exit(main())
