"""Learning from demonstration: alignment, Gaussian processes, adaptation, control.

Nothing here depends on a simulator::

    from gplfd_policies import ViaPoint, adapt, align, fit_skill, make_agent
    from gplfd_policies import load_demonstrations

    demonstrations = load_demonstrations("demonstrations.npz").demonstrations
    skill = fit_skill(align(demonstrations))
    adapted = adapt(skill, [ViaPoint(phase=0.3, pose=pose)])
    agent = make_agent("gp", demonstrations)

A name is imported when it is first used: all of them together take a second. From then
on, the BLAS of NumPy and SciPy computes on one thread in this process, so that numbers
do not depend on the machine's number of cores.
"""

import ast
from importlib import import_module
from pathlib import Path
from typing import Any

_MODULES = {
    alias.name: statement.module
    for statement in ast.parse(Path(__file__).with_suffix(".pyi").read_bytes()).body
    if isinstance(statement, ast.ImportFrom) and statement.module
    for alias in statement.names
}
"""Modules of the public names, which the stub beside this file lists."""

__all__ = [*_MODULES]  # noqa: PLE0604


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(_MODULES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
