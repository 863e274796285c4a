"""What was learned from demonstrations, ready to act on any door."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

from threadpoolctl import threadpool_limits

from policies.agent import Agent, as_agent
from policies.method import TrainingInput
from policies.policy import Policy


def learned(policy: Policy, training: TrainingInput) -> Callable[[float], Agent]:
    """Learn a policy's movement once, if it follows one.

    Args:
        policy: What to learn.
        training: What to learn from, without a radius.

    Returns:
        What makes an agent for a door's radius [m]. Policies that follow no learned
        movement begin anew for every door.
    """
    method = policy.method

    def make(radius: float) -> Agent:
        # Matrices of a hundred rows: sharing them out among threads costs ten times
        # the work itself.
        with threadpool_limits(limits=1, user_api="blas"):
            if method is None:
                given = dataclasses.replace(training, radius=radius)
                return as_agent(policy.make(given))
            return method.follow(movement)

    if method is not None:
        with threadpool_limits(limits=1, user_api="blas"):
            movement = method.learn(training)
    return make
