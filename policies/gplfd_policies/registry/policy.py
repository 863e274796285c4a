"""A policy: a name under which agents are made, and where it comes from."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from gplfd_policies.registry.method import Method, TrainingInput


@dataclass(frozen=True, kw_only=True, slots=True)
class PolicyOrigin:
    """Where a policy was found: plain data, for files and for other processes.

    `gplfd_policies.registry.catalogue.load_policy` finds it again.
    """

    name: str
    """The name under which it was requested."""
    kind: Literal["built-in", "package", "module"] = "built-in"
    """An entry of `POLICIES` in ``registry.catalogue``, an installed package's entry
    point, or an attribute of a module of the user's."""
    folder: str = ""
    """Folder in which a module was looked for first."""
    file: str = ""
    """Source file of the module."""
    sha256: str = ""
    """Hash of that file's content, hexadecimal; where a module of the user's imports
    others of its folder, of the content of all of them."""
    distribution: str = ""
    """Name of the installed package."""
    version: str = ""
    """Its version."""

    @property
    def content(self) -> tuple[str, str]:
        """What must agree for two origins to be those of one policy."""
        return self.version, self.sha256

    def __str__(self) -> str:
        package = f"{self.distribution} {self.version}, " if self.version else ""
        return f"{package}{self.file or 'built in'}, sha256 {self.sha256[:12] or '-'}"


@dataclass(frozen=True, kw_only=True, slots=True)
class Policy:
    """A registered policy: a summary, how agents are made, and where it was found."""

    summary: str
    """One line for people."""
    make: Callable[[TrainingInput], object]
    """Learns from the training input and returns an agent, or anything that
    `gplfd_policies.agents.agent.as_agent` takes: a `Method`, or any function."""
    kind: Literal["method", "ablation", "reference"] = "method"
    """A method; a method with one part removed or replaced; or a model-based policy,
    which learns nothing and which every method is measured against."""
    origin: PolicyOrigin | None = None
    """Where it was found; `policy_named` in ``registry.catalogue`` fills it in."""

    @property
    def method(self) -> Method | None:
        """The method, or None for an agent that follows no learned movement."""
        return self.make if isinstance(self.make, Method) else None

    @property
    def correctable(self) -> bool:
        """Whether it learns from corrections."""
        return self.method is not None and self.method.correct is not None
