"""All policies by name, their agents, and the skills that they can follow."""

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Final

from gplfd_policies.agents.agent import Agent, as_agent
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.movements.prior_mean import PriorMean
from gplfd_policies.movements.skill import Skill, fit_skill, load_skill
from gplfd_policies.registry.built_in import AS_PUBLISHED, SPACES, tuned, tuned_settings
from gplfd_policies.registry.method import Method, Policy, PolicyOrigin, TrainingInput
from gplfd_policies.registry.user_policies import (
    module_policy,
    packaged_names,
    packaged_policy,
)


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
    takes = policy.method is not None and policy.method.accepts_prior_mean
    if prior_mean is not None and name in POLICIES and not takes:
        raise ValueError(
            f"{name} does not accept a prior mean; leave it out, or choose another "
            "policy, such as gp"
        )
    return as_agent(policy.make(training))


def policy_named(name: str, folder: str | Path | None = None) -> Policy:
    """Find a policy.

    Args:
        name: A key of `POLICIES`; a name that an installed package offers in the
            entry-point group ``gplfd_policies``; or ``module:attribute`` or
            ``path/to/file.py:attribute``, see `gplfd_policies.registry.user_policies`.
        folder: Folder that is searched first; by default the working folder.

    Raises:
        ValueError: An unknown name, or a module or package that cannot be used.
    """
    if name in POLICIES:
        return replace(POLICIES[name], origin=PolicyOrigin(name=name))
    if ":" in name:
        return module_policy(name, Path(folder or "").absolute())
    if name.endswith(".py"):
        raise ValueError(f"policy {name!r}: name a function in it, as in {name}:make")
    packaged = packaged_policy(name)
    if packaged is not None:
        return packaged
    names = sorted({*POLICIES, *packaged_names()})
    near = difflib.get_close_matches(name, names, n=1)
    hint = f" (did you mean {near[0]!r}?)" if near else ""
    raise ValueError(
        f"unknown policy {name!r}{hint}; policies: {', '.join(names)}; or give one of "
        "your own as module:function"
    )


def load_policy(origin: PolicyOrigin) -> Policy:
    """Find the policy of an origin again, in another process or on another day.

    Raises:
        ValueError: The policy does not exist any more, or has changed.
    """
    policy = policy_named(origin.name, origin.folder or None)
    now = policy.origin
    if now is None or now.content != origin.content:
        raise ValueError(
            f"policy {origin.name!r} is not the one that was chosen: that was "
            f"{origin}, this is {now}"
        )
    return policy


POLICIES: Final[Mapping[str, Policy]] = MappingProxyType(
    dict(AS_PUBLISHED)
    | {
        f"{name}-tuned": tuned(name, values, SPACES[name].resolution)
        for name, values in tuned_settings().items()
    }
)
"""The built-in policies: as published, and as tuning found them."""


def skill_method(policy: str) -> Method:
    """Return the method of a policy that learns and follows skills.

    Raises:
        ValueError: The policy does not learn skills.
    """
    method = policy_named(policy).method
    fit = getattr(method, "fit", None)
    if method is not None and getattr(fit, "func", fit) is fit_skill:
        return method
    raise ValueError(
        f"policy {policy!r} does not learn a skill that a file can contain; choose "
        "gp, gp-paper or an ablation of gp"
    )


def method_and_skill(policy: str, file: Path) -> tuple[Method, Skill]:
    """Return the method of a policy, and the skill of a file that it can follow.

    Raises:
        ValueError: The file does not contain a skill, or the policy cannot follow it.
    """
    method, skill = skill_method(policy), load_skill(file)
    if (method.beyond > 0.0) != (skill.aligned.end < 1.0):
        goes = "continues beyond the end of demonstrations"
        raise ValueError(
            f"policy {policy!r} {goes if method.beyond > 0.0 else 'ends there'}, and "
            f"the skill in {file} was learned by one that does not; learn it again "
            f"with  gplfd learn --policy {policy}"
        )
    return method, skill
