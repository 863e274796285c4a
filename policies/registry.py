"""Every policy by name, and how an agent is made from demonstrations."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from policies.adaptation import (
    AdaptationForm,
    ExactAdaptation,
    ProcessAdaptation,
    ProductAdaptation,
)
from policies.agent import Agent, AgentConfig, GaussianProcessAgent
from policies.alignment import align
from policies.baselines.oracle import OracleAgent
from policies.controllers.stiffness import (
    DEFAULT_DYNAMICS,
    DEFAULT_PROFILE,
    PAPER_DYNAMICS,
    PAPER_PROFILE,
    StiffnessProfile,
)
from policies.demonstrations import Demonstration
from policies.gridded import Demonstrated, GriddedPolicy
from policies.load import CarriedLoad, YieldToAll
from policies.phase import ClockPhase, PathPhase
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
_START_TOLERANCE: Final = (0.05, 0.2)
"""How far from the closed handle a demonstration may start [m, rad]."""
_LARGEST_REACH: Final = 3.0
"""How far from it a demonstration may ever be [m]."""


def _learn(training: TrainingInput, noise: str = "map", **alignment: Any) -> Skill:
    if not training.demonstrations:
        raise ValueError("no demonstrations were given; a policy needs at least one")
    for number, demonstration in enumerate(training.demonstrations):
        _check_start(number, demonstration)
    return fit_skill(align(training.demonstrations, **alignment), noise=noise)


def _check_start(number: int, demonstration: Demonstration) -> None:
    start, reach = demonstration.poses[0], np.abs(demonstration.poses[:, :3]).max()
    if reach > _LARGEST_REACH:
        raise ValueError(
            f"demonstration {number} reaches {reach:.3g} m from the closed handle; are "
            "its positions in metres, in the task frame?"
        )
    distance, turn = np.linalg.norm(start[:3]), np.linalg.norm(start[3:])
    if distance > _START_TOLERANCE[0] or turn > _START_TOLERANCE[1]:
        raise ValueError(
            f"demonstration {number} starts {distance:.3g} m and {turn:.3g} rad away "
            "from the closed handle, which is the origin of the task frame (x pull, y "
            "up); subtract its first pose, in task axes, from all its poses"
        )


def _agent(
    skill: Skill,
    form: AdaptationForm = ProcessAdaptation,
    profile: StiffnessProfile = DEFAULT_PROFILE,
) -> GaussianProcessAgent:
    return GaussianProcessAgent(
        policy=GriddedPolicy(skill, form, _GRID),
        phases=PathPhase(skill),
        load=CarriedLoad(),
        profile=profile,
        dynamics=DEFAULT_DYNAMICS,
    )


def _gp(training: TrainingInput) -> Agent:
    return _agent(_learn(training))


def _gp_product(training: TrainingInput) -> Agent:
    return _agent(_learn(training), ProductAdaptation)


def _gp_exact(training: TrainingInput) -> Agent:
    return _agent(_learn(training), ExactAdaptation)


def _gp_fixed(training: TrainingInput) -> Agent:
    return _agent(_learn(training), Demonstrated)


def _gp_homoscedastic(training: TrainingInput) -> Agent:
    return _agent(_learn(training, noise="homoscedastic"))


def _gp_dtw_euclidean(training: TrainingInput) -> Agent:
    return _agent(_learn(training, method="dtw-euclidean"))


def _gp_constant_stiffness(training: TrainingInput) -> Agent:
    profile = dataclasses.replace(DEFAULT_PROFILE, k_min=DEFAULT_PROFILE.k_max)
    return _agent(_learn(training), profile=profile)


def _gp_clock(training: TrainingInput) -> Agent:
    skill = _learn(training)
    return dataclasses.replace(_agent(skill), phases=ClockPhase())


def _gp_paper(training: TrainingInput) -> Agent:
    # What the paper states: DTW on the raw completion index, Kersting's noise, a
    # product of Gaussians with zero prior mean, one stiffness law for all axes, the
    # whole wrench in Eq. (22), no limit to the lead. Ours where it is silent: the phase
    # of an observation and the via-point noise that comes with it (read as clock time,
    # no door opens: `gp-clock`), and the governor in place of hand tuning.
    skill = _learn(training, noise="kersting", method="dtw", denoise=False)
    return GaussianProcessAgent(
        policy=GriddedPolicy(
            skill, partial(ProductAdaptation, prior_mean="zero"), _GRID
        ),
        phases=PathPhase(skill),
        load=YieldToAll(),
        profile=PAPER_PROFILE,
        dynamics=PAPER_DYNAMICS,
        config=AgentConfig(max_turn_lead=1.0),
    )


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
        "gp-exact": Policy(
            summary="gp conditioned on demonstrations and via-points, white spread",
            make=_gp_exact,
        ),
        "gp-fixed": Policy(
            summary="the same GP without adaptation: the demonstrations' mean",
            make=_gp_fixed,
        ),
        "gp-homoscedastic": Policy(
            summary="gp with one noise level for the whole task",
            make=_gp_homoscedastic,
        ),
        "gp-dtw-euclidean": Policy(
            summary="gp aligned by distance of poses instead of task completion",
            make=_gp_dtw_euclidean,
        ),
        "gp-clock": Policy(
            summary="gp that dates its observations by the clock: learns its own lag",
            make=_gp_clock,
        ),
        "gp-paper": Policy(
            summary="what the paper states: Kersting, product, one stiffness law",
            make=_gp_paper,
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
