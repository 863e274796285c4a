"""Learning from demonstration: alignment, Gaussian processes, adaptation, control.

Nothing here knows a simulator::

    from policies import ViaPoint, adapt, align, fit_skill, make_agent

    skill = fit_skill(align(demonstrations))
    adapted = adapt(skill, [ViaPoint(phase=0.3, pose=pose)])
    agent = make_agent("gp", demonstrations)
"""

from policies.adaptation import adapt
from policies.agent import Agent, as_agent
from policies.aligned import AlignedDemonstrations
from policies.alignment import align
from policies.demonstrations import Demonstration
from policies.lockstep import batch_agents
from policies.method import Method, TrainingInput
from policies.policy import Policy, PolicyOrigin
from policies.prior_mean import PosePath, PriorMean
from policies.registry import POLICIES, load_policy, make_agent, policy_named
from policies.skill import Skill, fit_skill, load_skill
from policies.steps import AgentStep
from policies.trajectory import GaussianTrajectory, ViaPoint

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
