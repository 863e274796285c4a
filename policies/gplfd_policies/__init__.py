"""Learning from demonstration: alignment, Gaussian processes, adaptation, control.

Nothing here knows a simulator::

    from gplfd_policies import ViaPoint, adapt, align, fit_skill, make_agent

    skill = fit_skill(align(demonstrations))
    adapted = adapt(skill, [ViaPoint(phase=0.3, pose=pose)])
    agent = make_agent("gp", demonstrations)
"""

from gplfd_policies.adaptation import adapt
from gplfd_policies.agents.agent import Agent, as_agent
from gplfd_policies.agents.lockstep import batch_agents
from gplfd_policies.control.steps import AgentStep
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.demonstrations.alignment import align
from gplfd_policies.demonstrations.demonstration import Demonstration
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
    "load_policy",
    "load_skill",
    "make_agent",
    "policy_named",
]
