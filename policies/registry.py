"""Every policy by name, and how an agent is made from demonstrations."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

import numpy as np
from jaxtyping import Float

from policies.adaptation import ProcessAdaptation, ProductAdaptation
from policies.agent import Agent, GaussianProcessAgent
from policies.alignment import align
from policies.baselines.oracle import OracleAgent
from policies.controllers.stiffness import (
    DEFAULT_DYNAMICS,
    DEFAULT_PROFILE,
    StiffnessProfile,
)
from policies.demonstrations import Demonstration
from policies.gridded import Demonstrated, GriddedPolicy, GridDistribution
from policies.phase import PhaseEstimator
from policies.skill import Skill, fit_skill


@dataclass(frozen=True, kw_only=True, slots=True)
class TrainingInput:
    """What a policy may learn from.

    Attributes:
        demonstrations: At least one.
        seed: Seeds whatever is random in the policy's learning.
        radius: The true radius of the door to open [m], or None; privileged, only the
            oracle reads it.
    """

    demonstrations: tuple[Demonstration, ...]
    seed: int = 0
    radius: float | None = None


@dataclass(frozen=True, kw_only=True, slots=True)
class Policy:
    """An entry of the registry.

    Attributes:
        summary: One line for people.
        make: Learns from the training input and returns an agent.
    """

    summary: str
    make: Callable[[TrainingInput], Agent]


def make_agent(
    name: str,
    demonstrations: Sequence[Demonstration],
    *,
    seed: int = 0,
    radius: float | None = None,
) -> Agent:
    """Learn a policy by name and return an agent that follows it.

    Args:
        name: A key of `POLICIES`.
        demonstrations: What to learn from, task frame.
        seed: Seeds whatever is random in the learning.
        radius: True radius of the door to open [m]; only the oracle reads it.

    Raises:
        ValueError: An unknown name, no demonstrations, or the oracle without radius.
    """
    training = TrainingInput(
        demonstrations=tuple(demonstrations), seed=seed, radius=radius
    )
    return policy_entry(name).make(training)


def policy_entry(name: str) -> Policy:
    """Return a policy's registry entry.

    Raises:
        ValueError: An unknown name; the message lists what exists.
    """
    if name in POLICIES:
        return POLICIES[name]
    near = difflib.get_close_matches(name, list(POLICIES), n=1)
    hint = f" (did you mean {near[0]!r}?)" if near else ""
    raise ValueError(
        f"unknown policy {name!r}{hint}; policies: {', '.join(sorted(POLICIES))}"
    )


_GRID: Final = 100


def _learn(training: TrainingInput) -> Skill:
    if not training.demonstrations:
        raise ValueError("no demonstrations were given; a policy needs at least one")
    return fit_skill(align(training.demonstrations))


def _agent(
    skill: Skill,
    form: Callable[[Skill, Float[np.ndarray, " M"]], GridDistribution],
    profile: StiffnessProfile = DEFAULT_PROFILE,
) -> GaussianProcessAgent:
    return GaussianProcessAgent(
        policy=GriddedPolicy(skill, form, _GRID),
        phases=PhaseEstimator(skill),
        profile=profile,
        dynamics=DEFAULT_DYNAMICS,
    )


def _gp(training: TrainingInput) -> Agent:
    return _agent(_learn(training), ProcessAdaptation)


def _gp_product(training: TrainingInput) -> Agent:
    return _agent(_learn(training), ProductAdaptation)


def _gp_fixed(training: TrainingInput) -> Agent:
    return _agent(_learn(training), Demonstrated)


def _gp_constant_stiffness(training: TrainingInput) -> Agent:
    profile = dataclasses.replace(DEFAULT_PROFILE, k_min=DEFAULT_PROFILE.k_max)
    return _agent(_learn(training), ProcessAdaptation, profile)


def _oracle(training: TrainingInput) -> Agent:
    if training.radius is None:
        raise ValueError(
            "the oracle needs the door's true radius: make_agent('oracle', ..., "
            "radius=0.5)"
        )
    return OracleAgent(training.radius)


POLICIES: Final[Mapping[str, Policy]] = MappingProxyType(
    {
        "gp": Policy(
            summary="heteroscedastic GP, adapted while opening, variable stiffness",
            make=_gp,
        ),
        "gp-product": Policy(
            summary="gp with the paper's adaptation, a product of Gaussians",
            make=_gp_product,
        ),
        "gp-fixed": Policy(
            summary="the same GP without adaptation: the demonstrations' mean",
            make=_gp_fixed,
        ),
        "gp-constant-stiffness": Policy(
            summary="the adapted GP, always at the greatest stiffness",
            make=_gp_constant_stiffness,
        ),
        "oracle": Policy(
            summary="knows the door's radius; no policy, no compliance",
            make=_oracle,
        ),
    }
)
