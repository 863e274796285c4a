"""All policies by name, their agents, and the skills that they can follow.

A user's policy is an attribute: a `gplfd_policies.Learner`, which gets the whole
pipeline, a function from `gplfd_policies.TrainingInput` to an agent, a
`gplfd_policies.Method` or a `gplfd_policies.Policy`.

* ``module:attribute`` or ``path/to/file.py:attribute`` names it in a user's file. Only
  during the import, the file's folder is first on Python's path.
* A package offers it by name in the entry-point group ``gplfd_policies``.
* ``ws://HOST:PORT`` is a server, see `gplfd_policies.agents.remote`.

The origin of a policy contains a hash of its module and of the files in its folder that
it imports, and so on, which are found by reading: earlier imports do not matter.
"""

import ast
import contextlib
import hashlib
import importlib
import importlib.util
import inspect
import operator
import os
import sys
import traceback
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from gplfd_env.validation.named import nearest_name
from gplfd_policies.agents import remote
from gplfd_policies.agents.agent import Agent, as_agent
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.movements.prior_mean import PriorMean
from gplfd_policies.movements.skill import Skill, fit_skill, load_skill
from gplfd_policies.registry.built_in import POLICIES, in_pipeline
from gplfd_policies.registry.method import (
    Learner,
    Method,
    Policy,
    PolicyOrigin,
    TrainingInput,
)

_OURS: Final = frozenset({"experiments", "gplfd_env", "policies"})
"""Packages in a checkout that do not belong to a user's module."""

_FIRST_SEEN: Final[dict[Path, str]] = {}
"""Hashes of files when this process first read them: it imports a file only once."""


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
    importlib.invalidate_caches()
    sys.path.insert(0, str(first))
    try:
        module = _imported(module_name, first)
        expected = _module_file(module_name, first)
        if expected is not None and expected.resolve() != Path(_file(module)).resolve():
            raise ValueError(
                f"module {module_name!r} is already {_file(module)}; rename {expected}"
            )
        policy = _policy(module, attribute)
        source = _source(module, _module_files(module_name, first), first)
    except ValueError as error:
        raise ValueError(f"policy {name!r}: {error}") from error
    finally:
        with contextlib.suppress(ValueError):  # the module may have removed it
            sys.path.remove(str(first))
    origin = PolicyOrigin(name=name, kind="module", folder=str(folder), **source)
    return replace(policy, origin=origin)


def module_files(name: str, folder: Path) -> dict[str, bytes]:
    """Return the files of a user's policy by their paths from a folder; none if absent.

    They are read and not imported.
    """
    module, first, _ = _place(split_name(name)[0], folder)
    files = _module_files(module, first)
    return {os.path.relpath(file, folder): file.read_bytes() for file in files}


def server_policy(address: str, metadata: str) -> Policy:
    """Return the policy of a server that states its metadata, without connecting."""
    return Policy(
        summary=f"the server at {address}",
        make=lambda training: remote.ChunkAgent(address, metadata),
        origin=PolicyOrigin(name=address, kind="server", metadata=metadata),
    )


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
        policy, source = _policy(module, entry.attr), _source(module)
    except ValueError as error:
        raise ValueError(f"policy {name!r} of {_package(entry)}: {error}") from error
    if entry.dist:
        source |= {"distribution": entry.dist.name, "version": entry.dist.version}
    origin = PolicyOrigin(name=name, kind="package", **source)
    return replace(policy, origin=origin)


def packaged_summaries(taken: Collection[str]) -> dict[str, str]:
    """Return summary and package, or the reason why not, of all packaged policies."""
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


def place_in_source(origin: PolicyOrigin, error: BaseException) -> str:
    """Return file, line and function of an error in a policy's files, or ""."""
    files: Sequence[Path] = (Path(origin.file),)
    if origin.kind == "module":
        module, folder, _ = _place(split_name(origin.name)[0], Path(origin.folder))
        files = _module_files(module, folder) or files
    return _place_in(files, error)


def _offers() -> list[Any]:
    # Their class is not `importlib.metadata.EntryPoint` once something has imported the
    # backport, as Dask does: the backport then replaces the search.
    return list(entry_points(group="gplfd_policies"))


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
    except KeyboardInterrupt:
        raise
    # Any exception: the user's code runs here.
    except BaseException as error:
        missing = error.name if isinstance(error, ModuleNotFoundError) else None
        if missing is not None and f"{name}.".startswith(f"{missing}."):
            raise ValueError(
                f"there is no module {missing!r}, neither in the working folder nor on "
                "Python's path; give module:function or path/to/file.py:function"
            ) from error
        place = _place_in(_module_files(name, folder) if folder else (), error)
        raise ValueError(
            f"importing {name} failed with {type(error).__name__}: {error}"
            + (f" ({place})" if place else "")
        ) from error


def _place_in(files: Sequence[Path], error: BaseException) -> str:
    for place in reversed(traceback.extract_tb(error.__traceback__)):
        if Path(place.filename) in files:
            return f"{Path(place.filename).name}, line {place.lineno}, in {place.name}"
    return ""


def _policy(module: ModuleType, attribute: str) -> Policy:
    """Return an attribute of a module as a policy."""
    where = f"{module.__name__} ({_file(module)})"
    try:
        candidate = operator.attrgetter(attribute)(module)
    except AttributeError:
        names = [
            name
            for name, value in vars(module).items()
            if isinstance(value, Learner | Method | Policy)
            or (callable(value) and getattr(value, "__module__", "") == module.__name__)
        ]
        raise ValueError(
            f"module {where} has no {attribute!r}{nearest_name(attribute, names)}; it "
            f"has {', '.join(sorted(names)) or 'no policies'}"
        ) from None
    if isinstance(candidate, Policy):
        return candidate
    if isinstance(candidate, Learner):
        return Policy(summary=candidate.summary, make=Method(learner=candidate))
    if not callable(candidate):
        raise ValueError(
            f"{attribute} of {where} is a {type(candidate).__name__}; it must be a "
            "Learner, a Method, a Policy, or a function from TrainingInput to an agent"
        )
    try:
        inspect.signature(candidate).bind("training input")
    except TypeError:
        raise ValueError(
            f"{attribute}{inspect.signature(candidate)} of {where} cannot be called "
            "with one argument, the TrainingInput"
        ) from None
    except ValueError:
        pass  # Written in C: no signature is available.
    named = inspect.isroutine(candidate) or inspect.isclass(candidate)
    text = (inspect.getdoc(candidate) if named else None) or f"{attribute} of {where}"
    return Policy(summary=text.splitlines()[0], make=candidate)


def _file(module: ModuleType) -> str:
    return getattr(module, "__file__", None) or "part of Python"


def _source(
    module: ModuleType, files: Sequence[Path] = (), folder: Path = Path()
) -> dict[str, str]:
    """Return file and content hash of a module, or of several files of a folder."""
    file = Path(_file(module))
    if not file.is_file():
        return {}
    contents = {
        path: hashlib.sha256(path.read_bytes()).hexdigest() for path in files or (file,)
    }
    for path, sha256 in contents.items():
        if _FIRST_SEEN.setdefault(path, sha256) != sha256:
            raise ValueError(
                f"{path} has changed since this process imported it; start the "
                "process (of a cluster: its workers) again"
            )
    if len(contents) == 1:
        return {"file": str(file), "sha256": next(iter(contents.values()))}
    lines = [f"{p.relative_to(folder).as_posix()} {s}" for p, s in contents.items()]
    whole = hashlib.sha256("\n".join(lines).encode()).hexdigest()
    return {"file": str(file), "sha256": whole}


def _module_file(name: str, folder: Path) -> Path | None:
    """Return the source file in a folder for a dotted name, or None."""
    path = folder.joinpath(*name.split("."))
    files = (path / "__init__.py", path.with_name(f"{path.name}.py"))
    return next((file for file in files if file.is_file()), None)


def _module_files(name: str, folder: Path) -> tuple[Path, ...]:
    """Return the files of a module in a folder, sorted; none if it is elsewhere."""
    files: dict[str, Path | None] = {}
    waiting = [name]
    while waiting:
        name = waiting.pop()
        package = name.rpartition(".")[0]
        if not name or name in files or name.partition(".")[0] in _OURS:
            continue
        file = files[name] = _module_file(name, folder)
        waiting.append(package)
        if file is not None:
            waiting += _imports(file, name if file.stem == "__init__" else package)
    return tuple(sorted({file for file in files.values() if file is not None}))


def _imports(file: Path, package: str) -> Iterator[str]:
    """Yield the names that a file may import: ``from a import b`` may import a.b."""
    try:
        nodes = list(ast.walk(ast.parse(file.read_bytes())))
    except (SyntaxError, ValueError):  # the error of the import is clearer
        return
    for node in nodes:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            origin = "." * node.level + (node.module or "")
            with contextlib.suppress(ImportError):  # beyond the topmost package
                origin = importlib.util.resolve_name(origin, package)
                yield origin
                yield from (f"{origin}.{alias.name}" for alias in node.names)


def make_agent(
    name: str,
    demonstrations: Sequence[Demonstration],
    *,
    seed: int = 0,
    prior_mean: PriorMean | None = None,
) -> Agent:
    """Learn a policy by name and return an agent that follows it.

    Args:
        name: As for `policy_named`: a key of `POLICIES`, a policy of a package, or
            ``module:function`` for your own policy.
        demonstrations: Demonstrations in the task frame.
        seed: Seed for random numbers in learning.
        prior_mean: Expected poses far from demonstrations.

    Raises:
        TypeError: The demonstrations are not a sequence of demonstrations.
        ValueError: An unknown name, no demonstrations, a prior mean for a method that
            does not accept one, or your own policy whose agent cannot act.
    """
    training = TrainingInput(
        demonstrations=demonstrations, seed=seed, prior_mean=prior_mean
    )
    policy = policy_named(name)
    if prior_mean is not None and policy.kind == "reference":
        raise ValueError(f"{name} accepts no prior mean; a learner, such as gp, does")
    return as_agent(policy.make(training))


def policy_named(name: str, folder: str | Path | None = None) -> Policy:
    """Find a policy.

    Args:
        name: A key of `POLICIES`; a name that an installed package offers in the
            entry-point group ``gplfd_policies``; ``module:attribute`` or
            ``path/to/file.py:attribute``; or ``ws://HOST:PORT``. After an @ follows
            another pipeline than the default one, as in ``gp@no-size``
            (`built_in.in_pipeline`).
        folder: Folder that is searched first; by default the working folder.

    Raises:
        ValueError: An unknown name or pipeline, a module that cannot be used.
    """
    name, pipeline = split_name(name)
    if pipeline:
        policy = policy_named(name, folder)
        changed, origin = in_pipeline(name, policy, pipeline), policy.origin
        assert origin is not None, "every named policy has one"
        return replace(changed, origin=replace(origin, name=f"{name}@{pipeline}"))
    if name in POLICIES:
        return replace(POLICIES[name], origin=PolicyOrigin(name=name))
    if remote.is_address(name):
        return server_policy(name, remote.stated_metadata(name))
    if ":" in name:
        return module_policy(name, Path(folder or "").absolute())
    if name.endswith(".py"):
        raise ValueError(f"policy {name!r}: name a function in it, as in {name}:make")
    packaged = packaged_policy(name)
    if packaged is not None:
        return packaged
    names = sorted({*POLICIES, *(entry.name for entry in _offers())})
    raise ValueError(
        f"unknown policy {name!r}{nearest_name(name, names)}; policies: "
        f"{', '.join(names)}; or give one of your own as module:function"
    )


def split_name(policy: str) -> tuple[str, str]:
    """Return the name of a policy without its pipeline, and the pipeline or ""."""
    name, _, pipeline = policy.rpartition("@")
    if not name or {"/", ":"} & set(pipeline):  # part of a file's path
        return policy, ""
    return name, pipeline


def skill_method(policy: str) -> Method:
    """Return the method of a policy that learns and follows skills."""
    method = policy_named(policy).method
    if method is not None:
        fit = method.learner.fit
        if getattr(fit, "func", fit) is fit_skill:
            return method
    raise ValueError(
        f"policy {policy!r} learns no skill that a file can contain; choose gp, "
        "gp-paper or gp-homoscedastic"
    )


def method_and_skill(policy: str, file: Path) -> tuple[Method, Skill]:
    """Return the method of a policy, and the skill of a file that it can follow."""
    method, skill = skill_method(policy), load_skill(file)
    continues = method.pipeline.beyond > 0.0
    if continues != (skill.aligned.end < 1.0):
        raise ValueError(
            f"policy {policy!r} {'goes on' if continues else 'ends'} where "
            f"demonstrations end, and the skill in {file} does not; learn it again with"
            f"  gplfd learn --policy {policy}"
        )
    return method, skill
