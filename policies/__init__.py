"""Learning from demonstration: alignment, Gaussian processes, adaptation, control.

Nothing here knows a simulator::

    from policies import Demonstration, align, fit_skill, make_agent

    skill = fit_skill(align(demonstrations))
    agent = make_agent("gp", demonstrations)
"""

from policies.agent import Agent, AgentStep
from policies.aligned import AlignedDemonstrations
from policies.alignment import align
from policies.demonstrations import Demonstration
from policies.prior_mean import PosePath, PriorMean
from policies.registry import POLICIES, make_agent
from policies.skill import Skill, fit_skill, load_skill
from policies.trajectory import GaussianTrajectory, ViaPoint

__all__ = [
    "POLICIES",
    "Agent",
    "AgentStep",
    "AlignedDemonstrations",
    "Demonstration",
    "GaussianTrajectory",
    "PosePath",
    "PriorMean",
    "Skill",
    "ViaPoint",
    "align",
    "fit_skill",
    "load_skill",
    "make_agent",
]
