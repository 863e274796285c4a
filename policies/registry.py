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
from threadpoolctl import threadpool_limits

from policies import learning
from policies.adaptation import (
    Adaptation,
    ExactAdaptation,
    ProcessAdaptation,
    ProductAdaptation,
)
from policies.agent import Agent, CompliantAgent, as_agent
from policies.baselines.oracle import OracleAgent
from policies.compliance import ComplianceConfig
from policies.controllers.stiffness import (
    DEFAULT_PROFILE,
    PAPER_DYNAMICS,
    PAPER_PROFILE,
)
from policies.demonstrations import Demonstration
from policies.empirical import EmpiricalDistribution
from policies.gridded import Demonstrated, GriddedMovement
from policies.learning import Learner, TrainingInput
from policies.load import YieldToAll
from policies.movement import Movement, Predictor, ReadaptedMovement
from policies.phase import ClockPhase, PathPhase
from policies.prior_mean import PriorMean
from policies.residual import residual_form

__all__ = [
    "POLICIES",
    "TABLE_1",
    "Policy",
    "TrainingInput",
    "make_agent",
    "policy_entry",
]

Form = Callable[[Any, np.ndarray], Adaptation]
"""Builds, for a movement on a grid of phases, what via-points adapt."""

_GRID: Final = 100


Follow = Callable[[Movement, Form], Agent]
"""Makes an agent of its own that follows a movement; any number from one movement."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Policy:
    """An entry of the registry.

    Attributes:
        summary: One line for people.
        make: Learns from the training input and returns an agent.
        learn: The learning alone; None for an agent that learns no movement.
        form: How the movement adapts; `Demonstrated` for a method without via-points.
        follow: The rest; what makes an agent from the movement.
    """

    summary: str
    make: Callable[[TrainingInput], Agent]
    learn: Learner | None = None
    form: Form = Demonstrated
    follow: Follow | None = None


def make_agent(
    name: str,
    demonstrations: Sequence[Demonstration],
    *,
    seed: int = 0,
    radius: float | None = None,
    prior_mean: PriorMean | None = None,
) -> Agent:
    """Learn a policy by name and return an agent that follows it.

    Args:
        name: A key of `POLICIES`.
        demonstrations: What to learn from, task frame.
        seed: Seeds whatever is random in the learning.
        radius: True radius of the door to open [m]; only the oracle reads it.
        prior_mean: What is expected where nothing was demonstrated.

    Raises:
        ValueError: An unknown name, no demonstrations, the oracle without radius, or a
            prior mean for a method that cannot be given one.
    """
    training = TrainingInput(
        demonstrations=tuple(demonstrations),
        seed=seed,
        radius=radius,
        prior_mean=prior_mean,
    )
    # Matrices of a hundred rows: sharing them out among threads costs ten times the
    # work itself.
    with threadpool_limits(limits=1, user_api="blas"):
        return as_agent(policy_entry(name).make(training))


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


def _follow(
    movement: Movement, form: Form, demonstrated: Predictor | None = None
) -> CompliantAgent:
    """Follow at variable stiffness, the phase found by the movement's own spread."""
    distribution = movement if demonstrated is None else demonstrated
    return CompliantAgent(
        GriddedMovement(movement, form, _GRID),
        phases=PathPhase(distribution, movement.aligned),
    )


def _follow_without_uncertainty(movement: Movement, form: Form) -> Agent:
    """The greatest stiffness, and a phase told by the demonstrations themselves."""
    return _follow(movement, form, EmpiricalDistribution(movement.aligned))


def _follow_stiffly(movement: Movement, form: Form) -> CompliantAgent:
    profile = dataclasses.replace(DEFAULT_PROFILE, k_min=DEFAULT_PROFILE.k_max)
    config = ComplianceConfig(profile=profile)
    return dataclasses.replace(_follow(movement, form), config=config)


def _follow_by_the_clock(movement: Movement, form: Form) -> CompliantAgent:
    return dataclasses.replace(_follow(movement, form), phases=ClockPhase())


def _follow_the_paper(movement: Movement, form: Form) -> CompliantAgent:
    # One stiffness law for all axes, the whole wrench in Eq. (22), no limit to the
    # lead. Ours where the paper is silent: the phase of an observation and the
    # via-point noise that comes with it (read as clock time, no door opens:
    # `gp-clock`), and the governor in place of hand tuning.
    return dataclasses.replace(
        _follow(movement, form),
        config=ComplianceConfig(
            load=YieldToAll(),
            profile=PAPER_PROFILE,
            dynamics=PAPER_DYNAMICS,
            max_turn_lead=1.0,
        ),
    )


def _oracle(training: TrainingInput) -> Agent:
    learning.refuse_prior_mean(training, "oracle")
    if training.radius is None:
        raise ValueError(
            "the oracle needs the door's true radius: make_agent('oracle', ..., "
            "radius=0.5)"
        )
    return OracleAgent(training.radius)


def _policy(
    summary: str, learn: Learner, form: Form = Demonstrated, follow: Follow = _follow
) -> Policy:
    return Policy(
        summary=summary,
        make=lambda training: follow(learn(training), form),
        learn=learn,
        form=form,
        follow=follow,
    )


_PROCESS: Final = residual_form(ProcessAdaptation)

TABLE_1: Final = (
    *("dmp", "promp", "gmr", "local-gp", "wishart-gp", "kmp", "gmm-gp"),
    *("gp-paper", "gp"),
)
"""The methods of the paper's Table 1, the paper's own and ours."""

POLICIES: Final[Mapping[str, Policy]] = MappingProxyType(
    {
        "gp": _policy(
            "heteroscedastic GP, adapted while opening, variable stiffness",
            learning.learn_gp,
            _PROCESS,
        ),
        "gp-product": _policy(
            "gp with the paper's adaptation, a product of Gaussians",
            learning.learn_gp,
            residual_form(ProductAdaptation),
        ),
        "gp-exact": _policy(
            "gp conditioned on demonstrations and via-points, white spread",
            learning.learn_gp,
            residual_form(ExactAdaptation),
        ),
        "gp-fixed": _policy(
            "the same GP without adaptation: the demonstrations' mean",
            learning.learn_gp,
        ),
        "gp-homoscedastic": _policy(
            "gp with one noise level for the whole task",
            learning.learn_homoscedastic_gp,
            _PROCESS,
        ),
        "gp-dtw-euclidean": _policy(
            "gp aligned by distance of poses instead of task completion",
            learning.learn_euclidean_gp,
            _PROCESS,
        ),
        "gp-clock": _policy(
            "gp that dates its observations by the clock: learns its own lag",
            learning.learn_gp,
            _PROCESS,
            _follow_by_the_clock,
        ),
        "gp-paper": _policy(
            "what the paper states: Kersting, product, one stiffness law",
            learning.learn_paper_gp,
            residual_form(partial(ProductAdaptation, prior_mean="zero")),
            _follow_the_paper,
        ),
        "gp-constant-stiffness": _policy(
            "the adapted GP, always at the greatest stiffness",
            learning.learn_gp,
            _PROCESS,
            _follow_stiffly,
        ),
        "dmp": _policy(
            "dynamic movement primitive of the mean; no uncertainty, no via-points",
            learning.learn_dmp,
            follow=_follow_without_uncertainty,
        ),
        "promp": _policy(
            "probabilistic movement primitive, conditioned while opening",
            learning.learn_promp,
            ReadaptedMovement,
        ),
        "gmr": _policy(
            "Gaussian-mixture regression; no via-points", learning.learn_gmr
        ),
        "local-gp": _policy(
            "local Gaussian processes (reconstruction); no via-points",
            learning.learn_local_gp,
        ),
        "wishart-gp": _policy(
            "GP mean, Wishart-process spread (reconstruction); no via-points",
            learning.learn_wishart_gp,
        ),
        "kmp": _policy(
            "kernelised movement primitive, regularisation calibrated for doors",
            learning.learn_kmp,
            ReadaptedMovement,
        ),
        "kmp-published": _policy(
            "kernelised movement primitive with the published regularisation",
            learning.learn_published_kmp,
            ReadaptedMovement,
        ),
        "gmm-gp": _policy(
            "GP with a Gaussian-mixture prior, conditioned while opening",
            learning.learn_gmm_gp,
            ReadaptedMovement,
        ),
        "oracle": Policy(
            summary="knows the door's radius; no policy, no compliance", make=_oracle
        ),
    }
)
