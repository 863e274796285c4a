"""Agents from a policy, and where in a policy of the user's an error arose."""

import contextlib
import dataclasses
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path

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


def where(error: BaseException, policy: Policy) -> str:
    """Return file, line and function of the policy's in which an error arose, or ""."""
    file = policy.origin.file if policy.origin is not None else ""
    places = traceback.extract_tb(error.__traceback__)
    own = [place for place in places if place.filename == file]
    if not own:
        return ""
    return f"{Path(file).name}, line {own[-1].lineno}, in {own[-1].name}"


@contextlib.contextmanager
def reported_errors(name: str, policy: Policy) -> Iterator[None]:
    """Say of an error in a file of the user's what and where it is.

    Raises:
        ValueError: In place of the error.
    """
    try:
        yield
    # Anything: it is the user's code that runs here.
    except Exception as error:
        place = where(error, policy)
        if not place:
            raise
        raise ValueError(
            f"policy {name!r} failed with {type(error).__name__}: {error} ({place})"
        ) from error
