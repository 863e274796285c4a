# The public names, each with its module; `__init__.py` imports them when they are used.
from gplfd_policies.adaptation import adapt as adapt
from gplfd_policies.agents.agent import Agent as Agent
from gplfd_policies.agents.agent import as_agent as as_agent
from gplfd_policies.agents.agent import batch_agents as batch_agents
from gplfd_policies.control.steps import AgentStep as AgentStep
from gplfd_policies.demonstrations.aligned import (
    AlignedDemonstrations as AlignedDemonstrations,
)
from gplfd_policies.demonstrations.alignment import align as align
from gplfd_policies.demonstrations.demonstration import Demonstration as Demonstration
from gplfd_policies.demonstrations.npz import load_demonstrations as load_demonstrations
from gplfd_policies.demonstrations.npz import save_demonstrations as save_demonstrations
from gplfd_policies.movements.movement import GaussianTrajectory as GaussianTrajectory
from gplfd_policies.movements.movement import ViaPoint as ViaPoint
from gplfd_policies.movements.prior_mean import PosePath as PosePath
from gplfd_policies.movements.prior_mean import PriorMean as PriorMean
from gplfd_policies.movements.skill import Skill as Skill
from gplfd_policies.movements.skill import fit_skill as fit_skill
from gplfd_policies.movements.skill import load_skill as load_skill
from gplfd_policies.registry.built_in import POLICIES as POLICIES
from gplfd_policies.registry.catalogue import make_agent as make_agent
from gplfd_policies.registry.catalogue import policy_named as policy_named
from gplfd_policies.registry.method import Learner as Learner
from gplfd_policies.registry.method import Method as Method
from gplfd_policies.registry.method import Pipeline as Pipeline
from gplfd_policies.registry.method import Policy as Policy
from gplfd_policies.registry.method import PolicyOrigin as PolicyOrigin
from gplfd_policies.registry.method import TrainingInput as TrainingInput
