"""Candidates of tuning: settings, and the protocol on which they are evaluated."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from dataclasses import dataclass
from typing import Any, Final

from scipy.stats import qmc

from gplfd_env.validation.named import nearest_name
from gplfd_policies.registry.tuning_spaces import SPACES, Values


@dataclass(frozen=True, kw_only=True, slots=True)
class Protocol:
    """Budget, seeds and doors; the same for every candidate of every method."""

    evaluations: int = 24
    """Candidates per method; the first is the method as published."""
    seeds: tuple[int, ...] = (1000, 1001, 1002)
    """Of teacher, method and environment. Studies count theirs from 0."""
    radii: tuple[float, ...] = (0.38, 0.46, 0.54)
    """Doors to open [m]; none of them in a study."""
    demonstrations_per_door: int = 2
    """How often the teacher opens each demonstrated door."""
    sequence: int = 1
    """Seed of the scrambled Sobol sequence."""


STANDARD: Final = Protocol()
"""The protocol of the tuned policies."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Candidate:
    """A method with some settings, to be evaluated."""

    policy: str
    """Name of the method as published."""
    number: int
    """Index among the method's candidates; 0 is as published."""
    settings: Values
    """A value for every setting of the method's space."""
    protocol: Protocol = STANDARD
    """Protocol on which it is evaluated."""

    @property
    def definition(self) -> dict[str, Any]:
        """Everything that defines it, as JSON returns it."""
        fields: dict[str, Any] = json.loads(json.dumps(dataclasses.asdict(self)))
        return fields

    @property
    def key(self) -> str:
        """Hash of the definition."""
        text = json.dumps(self.definition, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


def checked_policies(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return names of policies that have a space; all of them for none.

    Raises:
        ValueError: One has none, or is given twice.
    """
    for name in names:
        if name not in SPACES:
            raise ValueError(
                f"{name!r} has no settings to tune{nearest_name(name, SPACES)}; "
                f"policies: {', '.join(SPACES)}"
            )
        if names.count(name) > 1:
            raise ValueError(f"{name} is given twice in --policies")
    return names or tuple(SPACES)


def candidates(policy: str, protocol: Protocol = STANDARD) -> tuple[Candidate, ...]:
    """Return a method as published, and points of a Sobol sequence in its space.

    Args:
        policy: A key of `gplfd_policies.registry.tuning_spaces.SPACES`.
        protocol: Says how many, and seeds the sequence.
    """
    space = SPACES[policy]
    sequence = qmc.Sobol(len(space.settings), scramble=True, seed=protocol.sequence)
    # The sequence is balanced for powers of two.
    exponent = max(protocol.evaluations - 2, 0).bit_length()
    points = sequence.random_base2(exponent)[: protocol.evaluations - 1]
    tried = [space.published, *(space.at(point) for point in points.tolist())]
    return tuple(
        Candidate(policy=policy, number=number, settings=settings, protocol=protocol)
        for number, settings in enumerate(tried)
    )
