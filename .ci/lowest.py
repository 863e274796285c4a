"""Print the lowest version of every requirement that pyproject.toml allows.

One requirement a line, for ``pip install -r``: ``>=X`` becomes ``==X``. Arguments name
the extras to include; those that name other extras of gplfd bring them along::

    python .ci/lowest.py test > lowest.txt
"""

import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

_PROJECT = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())
_PROJECT = _PROJECT["project"]


def lowest(texts: list[str]) -> Iterator[str]:
    """Yield the requirements pinned to their lower bounds, without their markers."""
    for text in texts:
        requirement = Requirement(text)
        if requirement.name == _PROJECT["name"]:
            for extra in sorted(requirement.extras):
                yield from lowest(_PROJECT["optional-dependencies"][extra])
            continue
        bounds = [each for each in requirement.specifier if each.operator == ">="]
        if len(bounds) != 1:
            sys.exit(f"pyproject.toml: {text!r} has no lower bound (>=)")
        requirement.specifier = SpecifierSet(f"=={bounds[0].version}")
        yield str(requirement)


wanted = [f"{_PROJECT['name']}[{','.join(sys.argv[1:])}]"] if sys.argv[1:] else []
print("\n".join(dict.fromkeys(lowest(_PROJECT["dependencies"] + wanted))))
