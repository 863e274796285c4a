"""Learning from demonstration: alignment, Gaussian processes, adaptation, control.

Nothing here depends on a simulator::

    from gplfd_policies import ViaPoint, adapt, align, fit_skill, make_agent
    from gplfd_policies import load_demonstrations

    demonstrations = load_demonstrations("demonstrations.npz").demonstrations
    skill = fit_skill(align(demonstrations))
    adapted = adapt(skill, [ViaPoint(phase=0.3, pose=pose)])
    agent = make_agent("gp", demonstrations)

A name is imported when it is first used: all of them together take a second. From then
on, the BLAS of NumPy and SciPy computes on one thread in this process, so that numbers
do not depend on the machine's number of cores. Where threadpoolctl is not installed,
set ``OPENBLAS_NUM_THREADS=1`` before Python starts.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gplfd_policies.adaptation import adapt
    from gplfd_policies.agents.agent import Agent, as_agent
    from gplfd_policies.agents.lockstep import batch_agents
    from gplfd_policies.control.steps import AgentStep
    from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
    from gplfd_policies.demonstrations.alignment import align
    from gplfd_policies.demonstrations.demonstration import Demonstration
    from gplfd_policies.demonstrations.npz import (
        load_demonstrations,
        save_demonstrations,
    )
    from gplfd_policies.movements.prior_mean import PosePath, PriorMean
    from gplfd_policies.movements.skill import Skill, fit_skill, load_skill
    from gplfd_policies.movements.trajectory import GaussianTrajectory, ViaPoint
    from gplfd_policies.registry.catalogue import (
        POLICIES,
        load_policy,
        make_agent,
        policy_named,
    )
    from gplfd_policies.registry.method import Method, TrainingInput
    from gplfd_policies.registry.policy import Policy, PolicyOrigin

_MODULES = {
    "adaptation": ("adapt",),
    "agents.agent": ("Agent", "as_agent"),
    "agents.lockstep": ("batch_agents",),
    "control.steps": ("AgentStep",),
    "demonstrations.aligned": ("AlignedDemonstrations",),
    "demonstrations.alignment": ("align",),
    "demonstrations.demonstration": ("Demonstration",),
    "demonstrations.npz": ("load_demonstrations", "save_demonstrations"),
    "movements.prior_mean": ("PosePath", "PriorMean"),
    "movements.skill": ("Skill", "fit_skill", "load_skill"),
    "movements.trajectory": ("GaussianTrajectory", "ViaPoint"),
    "registry.catalogue": ("POLICIES", "load_policy", "make_agent", "policy_named"),
    "registry.method": ("Method", "TrainingInput"),
    "registry.policy": ("Policy", "PolicyOrigin"),
}
"""Modules of the public names."""

__all__ = [
    "POLICIES",
    "Agent",
    "AgentStep",
    "AlignedDemonstrations",
    "Demonstration",
    "GaussianTrajectory",
    "Method",
    "Policy",
    "PolicyOrigin",
    "PosePath",
    "PriorMean",
    "Skill",
    "TrainingInput",
    "ViaPoint",
    "adapt",
    "align",
    "as_agent",
    "batch_agents",
    "fit_skill",
    "load_demonstrations",
    "load_policy",
    "load_skill",
    "make_agent",
    "policy_named",
    "save_demonstrations",
]


def __getattr__(name: str) -> Any:
    for module, names in _MODULES.items():
        if name in names:
            value = getattr(import_module(f"{__name__}.{module}"), name)
            globals()[name] = value
            return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
