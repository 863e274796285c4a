"""Learning from demonstration: alignment, Gaussian processes, adaptation, control.

Nothing here knows a simulator::

    from gplfd.policies import ViaPoint, adapt, align, fit_skill, make_agent

    skill = fit_skill(align(demonstrations))
    adapted = adapt(skill, [ViaPoint(phase=0.3, pose=pose)])
    agent = make_agent("gp", demonstrations)
"""

from gplfd.policies.adaptation import adapt
from gplfd.policies.agent import Agent, as_agent
from gplfd.policies.aligned import AlignedDemonstrations
from gplfd.policies.alignment import align
from gplfd.policies.demonstrations import Demonstration
from gplfd.policies.lockstep import batch_agents
from gplfd.policies.method import Method, TrainingInput
from gplfd.policies.policy import Policy, PolicyOrigin
from gplfd.policies.prior_mean import PosePath, PriorMean
from gplfd.policies.registry import POLICIES, load_policy, make_agent, policy_named
from gplfd.policies.skill import Skill, fit_skill, load_skill
from gplfd.policies.steps import AgentStep
from gplfd.policies.trajectory import GaussianTrajectory, ViaPoint

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
