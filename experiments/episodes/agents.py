"""Agents from a policy, and where in a policy of the user's an error arose."""

import contextlib
import traceback
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from threadpoolctl import threadpool_limits

from policies.agent import Agent, as_agent
from policies.method import TrainingInput
from policies.policy import Policy


def learned(policy: Policy, training: TrainingInput) -> Callable[[], Agent]:
    """Learn a policy's movement once, if it follows one.

    Args:
        policy: What to learn.
        training: What to learn from.

    Returns:
        What makes an agent. Policies that follow no learned movement begin anew for
        every one.
    """
    method = policy.method
    # Matrices of a hundred rows: sharing them out among threads costs ten times the
    # work itself.
    one_thread = partial(threadpool_limits, limits=1, user_api="blas")
    with one_thread():
        movement = method.learn(training) if method is not None else None

    def make() -> Agent:
        with one_thread():
            if method is not None and movement is not None:
                return method.follow(movement)
            return as_agent(policy.make(training))

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
