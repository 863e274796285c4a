"""Agents from a policy, and where in a policy of the user's an error arose."""

import contextlib
from collections.abc import Callable, Iterator

from gplfd_policies.agents.agent import Agent, as_agent
from gplfd_policies.arrays.one_thread import one_thread
from gplfd_policies.registry.method import TrainingInput
from gplfd_policies.registry.module_files import place_in
from gplfd_policies.registry.policy import Policy
from gplfd_policies.registry.user_policies import source_files


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
    with one_thread:
        movement = method.learn(training) if method is not None else None

    def make() -> Agent:
        with one_thread:
            if method is not None and movement is not None:
                return method.follow(movement)
            return as_agent(policy.make(training))

    return make


def where(error: BaseException, policy: Policy) -> str:
    """Return file, line and function of the user's in which an error arose, or ""."""
    return place_in(source_files(policy.origin), error) if policy.origin else ""


class PolicyError(ValueError):
    """The user's policy raised an error, in learning or acting."""


@contextlib.contextmanager
def reported_errors(name: str, policy: Policy) -> Iterator[None]:
    """Say of an error of the user's policy what it is and, if known, where.

    Raises:
        PolicyError: In place of the error.
    """
    try:
        yield
    # Anything: it is the user's code that runs here, which may leave by `sys.exit`.
    except (Exception, SystemExit) as error:
        place = where(error, policy)
        built_in = policy.origin is None or policy.origin.kind == "built-in"
        # What is wrong with a file, an argument or an action says so itself.
        if built_in or (not place and isinstance(error, ValueError | OSError)):
            raise
        raise PolicyError(
            f"policy {name!r} failed with {type(error).__name__}: {error}"
            + (f" ({place})" if place else "")
        ) from error
