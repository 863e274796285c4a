"""What an agent decides and expects when it is shown a logged episode."""

from collections.abc import Iterator

from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_policies.agents.agent import Agent
from gplfd_policies.control.steps import AgentStep, Observation
from gplfd_policies.movements.trajectory import GaussianTrajectory


def decisions(log: EpisodeLog, agent: Agent) -> Iterator[AgentStep]:
    """Show an agent the observations of a logged episode, row by row.

    Nothing is simulated: the door has moved as it has moved, whatever this agent
    decides. The agent of the log repeats its decisions; another one says what it
    would have made of the same observations.

    Returns:
        The decision at each row. The agent is reset at once and acts when asked for
        its next decision: in between, `expectation` is what it expects.
    """
    agent.reset(_observation(log, 0))
    return (agent.act(_observation(log, row)) for row in range(log.times.size))


def _observation(log: EpisodeLog, row: int) -> Observation:
    names = ("ee_pose", "ee_twist", "wrench", "joint_pos", "joint_vel")
    seen = {name: getattr(log, name)[row] for name in names}
    return seen | {"time": log.times[row : row + 1]}


def expectation(agent: Agent) -> GaussianTrajectory:
    """Return what an agent now expects of the whole task.

    Raises:
        ValueError: The agent expects nothing: its policy has no uncertainty.
    """
    forecast = agent.forecast()
    if forecast is None:
        raise ValueError("the agent makes no forecasts; use a Gaussian-process policy")
    return forecast
