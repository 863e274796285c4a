"""Skills from files, and the methods that follow them."""

from functools import partial
from pathlib import Path

from gplfd_policies.movements.skill import Skill, fit_skill, load_skill
from gplfd_policies.registry.catalogue import POLICIES, policy_named
from gplfd_policies.registry.method import Method


def skill_method(policy: str) -> Method:
    """Return the method of a policy that learns and follows skills.

    Raises:
        ValueError: The policy does not learn skills; the message lists those that do.
    """

    def fits(method: Method | None) -> bool:
        fit = None if method is None else method.fit
        return (fit.func if isinstance(fit, partial) else fit) is fit_skill

    method = policy_named(policy).method
    if method is not None and fits(method):
        return method
    able = ", ".join(sorted(name for name in POLICIES if fits(POLICIES[name].method)))
    raise ValueError(
        f"policy {policy!r} does not learn a skill that a file can contain; choose "
        f"one of {able}"
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
