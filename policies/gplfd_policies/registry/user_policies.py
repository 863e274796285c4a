"""Policies from a user's module or an installed package.

* ``module:attribute`` or ``path/to/file.py:attribute`` names an attribute in a user's
  file. Only during the import, the file's folder is first on Python's path, as if the
  file were run as a script.
* A package offers policies by name in the entry-point group ``gplfd_policies``.

In both cases the attribute is a function from `gplfd_policies.TrainingInput` to an
agent, a `gplfd_policies.Method` or a `gplfd_policies.Policy`.
"""

import contextlib
import dataclasses
import importlib
import inspect
import operator
import os
import sys
from collections.abc import Collection, Sequence
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from gplfd_policies.registry.module_files import (
    content_hash,
    module_file,
    module_files,
    place_in,
)
from gplfd_policies.registry.policy import Policy, PolicyOrigin

GROUP: Final = "gplfd_policies"
"""The entry-point group of packages."""


def module_policy(name: str, folder: Path) -> Policy:
    """Import a policy from a user's module."""
    module_name, first, attribute = _place(name, folder)
    if not module_name:
        raise ValueError(
            f"policy {name!r} names no module; give module:function or "
            "path/to/file.py:function"
        )
    file = first / f"{module_name}.py"
    if name.endswith(f".py:{attribute}") and not file.is_file():
        raise ValueError(f"policy {name!r}: there is no file {file}")
    try:
        # The folder is first on the path for this import only.
        importlib.invalidate_caches()
        sys.path.insert(0, str(first))
        try:
            module = _imported(module_name, first)
        finally:
            with contextlib.suppress(ValueError):  # the module may have removed it
                sys.path.remove(str(first))
        expected = module_file(module_name, first)
        if expected is not None and expected.resolve() != Path(_file(module)).resolve():
            raise ValueError(
                f"module {module_name!r} is already {_file(module)}; rename {expected}"
            )
        policy = _policy(module, attribute)
        source = _source(module, module_files(module_name, first), first)
    except ValueError as error:
        raise ValueError(f"policy {name!r}: {error}") from error
    origin = PolicyOrigin(name=name, kind="module", folder=str(folder), **source)
    return dataclasses.replace(policy, origin=origin)


def source_files(origin: PolicyOrigin) -> tuple[str, ...]:
    """Return the files of a policy's module and of its imports from the same folder."""
    beside: tuple[Path, ...] = ()
    if origin.kind == "module":
        module, folder, _ = _place(origin.name, Path(origin.folder))
        beside = module_files(module, folder)
    return tuple(map(str, beside)) or (origin.file,)


def packaged_names() -> tuple[str, ...]:
    """Return the names that installed packages offer, without importing anything."""
    return tuple(sorted({entry.name for entry in _offers()}))


def packaged_policy(name: str) -> Policy | None:
    """Import the policy that an installed package offers by a name, if there is one."""
    offers = [entry for entry in _offers() if entry.name == name]
    if not offers:
        return None
    if len(offers) > 1:
        packages = " and ".join(sorted(map(_package, offers)))
        raise ValueError(f"policy {name!r} is offered by {packages}; uninstall one")
    entry = offers[0]
    try:
        module = _imported(entry.module)
        policy = _policy(module, entry.attr)
        origin = PolicyOrigin(
            name=name,
            kind="package",
            distribution=entry.dist.name if entry.dist else "",
            version=entry.dist.version if entry.dist else "",
            **_source(module),
        )
    except ValueError as error:
        raise ValueError(f"policy {name!r} of {_package(entry)}: {error}") from error
    return dataclasses.replace(policy, origin=origin)


def packaged_summaries(taken: Collection[str]) -> dict[str, str]:
    """Import all policies of installed packages; return summary and package by name.

    If a policy cannot be used, e.g. because its name is taken, the summary is the
    reason.
    """
    summaries = {}
    for entry in sorted(_offers(), key=operator.attrgetter("name")):
        text = "a built-in policy has this name"
        if entry.name not in taken:
            try:
                policy = packaged_policy(entry.name)
                text = policy.summary if policy is not None else ""
            except ValueError as error:
                text = str(error)
        summaries[entry.name] = f"{text} ({_package(entry)})"
    return summaries


def _offers() -> list[Any]:
    # Their class is not `importlib.metadata.EntryPoint` once something has imported the
    # backport, as Dask does: the backport then replaces the search.
    return list(entry_points(group=GROUP))


def _package(entry: Any) -> str:
    return f"{entry.dist.name} {entry.dist.version}" if entry.dist else "a package"


def _place(name: str, folder: Path) -> tuple[str, Path, str]:
    """Return a policy's module, the folder to search first, and the attribute."""
    where, _, attribute = name.rpartition(":")
    if not where.endswith(".py"):
        return where, folder, attribute
    file = Path(os.path.abspath(folder / where))
    return file.stem, file.parent, attribute


def _imported(name: str, folder: Path | None = None) -> ModuleType:
    """Import a module, possibly from a folder, or raise with a one-sentence reason."""
    try:
        return importlib.import_module(name)
    # Any exception: the user's code runs here.
    except (Exception, SystemExit) as error:
        missing = error.name if isinstance(error, ModuleNotFoundError) else None
        if missing is not None and f"{name}.".startswith(f"{missing}."):
            raise ValueError(
                f"there is no module {missing!r}, neither in the working folder nor on "
                "Python's path; give module:function or path/to/file.py:function"
            ) from error
        files = module_files(name, folder) if folder is not None else ()
        place = place_in([str(file) for file in files], error)
        raise ValueError(
            f"importing {name} failed with {type(error).__name__}: {error}"
            + (f" ({place})" if place else "")
        ) from error


def _policy(module: ModuleType, attribute: str) -> Policy:
    """Return an attribute of a module as a policy."""
    where = f"{module.__name__} ({_file(module)})"
    try:
        candidate = operator.attrgetter(attribute)(module)
    except AttributeError:
        functions = [
            name
            for name, value in vars(module).items()
            if callable(value) and getattr(value, "__module__", "") == module.__name__
        ]
        offered = ", ".join(sorted(functions)) or "no functions"
        raise ValueError(
            f"module {where} has no {attribute!r}; it has {offered}"
        ) from None
    if isinstance(candidate, Policy):
        return candidate
    if not callable(candidate):
        raise ValueError(
            f"{attribute} of {where} is a {type(candidate).__name__}; it must be a "
            "function from TrainingInput to an agent, a Method or a Policy, all of "
            "them of gplfd_policies"
        )
    try:
        inspect.signature(candidate).bind("training input")
    except TypeError:
        raise ValueError(
            f"{attribute}{inspect.signature(candidate)} of {where} cannot be called "
            "with one argument, the TrainingInput that an agent is made from"
        ) from None
    except ValueError:
        pass  # Written in C: no signature is available.
    named = inspect.isroutine(candidate) or inspect.isclass(candidate)
    text = (inspect.getdoc(candidate) if named else None) or f"{attribute} of {where}"
    return Policy(summary=text.splitlines()[0], make=candidate)


def _file(module: ModuleType) -> str:
    return getattr(module, "__file__", None) or "part of Python"


def _source(
    module: ModuleType, files: Sequence[Path] = (), folder: Path | None = None
) -> dict[str, str]:
    """Return file and content hash of a module, or of several files of a folder."""
    file = Path(_file(module))
    if not file.is_file():
        return {}
    sha256 = content_hash(files or (file,), folder or file.parent)
    return {"file": str(file), "sha256": sha256}
