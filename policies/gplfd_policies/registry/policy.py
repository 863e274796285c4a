"""A policy: a name from which agents are made, and its origin."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from gplfd_policies.registry.method import Method, TrainingInput


@dataclass(frozen=True, kw_only=True, slots=True)
class PolicyOrigin:
    """Origin of a policy: plain data, for files and for other processes.

    `gplfd_policies.registry.catalogue.load_policy` finds the policy again.
    """

    name: str
    """The name under which it was requested."""
    kind: Literal["built-in", "package", "module"] = "built-in"
    """An entry of `POLICIES` in ``registry.catalogue``, an installed package's entry
    point, or an attribute of a user's module."""
    folder: str = ""
    """Folder in which the module was searched first."""
    file: str = ""
    """Source file of the module."""
    sha256: str = ""
    """Hash of that file's content, hexadecimal; if a user's module imports others from
    its folder, of the content of all of them."""
    distribution: str = ""
    """Name of the installed package."""
    version: str = ""
    """Version of the installed package."""

    @property
    def content(self) -> tuple[str, str]:
        """Data that must be equal if two origins are of the same policy."""
        return self.version, self.sha256

    def __str__(self) -> str:
        package = f"{self.distribution} {self.version}, " if self.version else ""
        return f"{package}{self.file or 'built in'}, sha256 {self.sha256[:12] or '-'}"


@dataclass(frozen=True, kw_only=True, slots=True)
class Policy:
    """A registered policy: summary, function that makes agents, and origin."""

    summary: str
    """One line for people."""
    make: Callable[[TrainingInput], object]
    """Function that learns from the training input and returns an agent, or an object
    that `gplfd_policies.agents.agent.as_agent` accepts: a `Method`, or any function."""
    kind: Literal["method", "ablation", "reference"] = "method"
    """A method; a method with one part removed or replaced; or a model-based policy,
    which does not learn and is used for comparison."""
    told: bool = False
    """Whether its agents need the true door, by `Agent.inform`."""
    origin: PolicyOrigin | None = None
    """Origin; `policy_named` in ``registry.catalogue`` adds it."""

    @property
    def method(self) -> Method | None:
        """The method, or None if agents do not follow a learned movement."""
        return self.make if isinstance(self.make, Method) else None

    @property
    def correctable(self) -> bool:
        """Whether the policy learns from corrections."""
        return self.method is not None and self.method.correct is not None
