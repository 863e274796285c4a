"""A method without measurements: what a robot can execute from a file."""

from dataclasses import replace
from typing import Final

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_policies.control.load import YieldToAll
from gplfd_policies.control.rendering import ARM_DYNAMICS, ArmRendering
from gplfd_policies.registry.method import Method, clock_phase

_NEVER: Final = 2.0
"""Distance of via-points, in phase, with which there is none."""


def open_loop(method: Method, period: float = CONTROL_PERIOD) -> Method:
    """Return the method without adaptation and load compensation, by the clock.

    The arm itself renders the stiffness, along the axes of the task frame. The agent
    commands the same whatever it observes.

    Args:
        method: of which profile and alignment are kept.
        period: time between two commands [s].

    Raises:
        ValueError: The method has stiffness along the path, which is none along axes.
    """
    if method.phase_stiffness is not None:
        raise ValueError(
            "this method has a stiffness along the path, from demonstrated forces, "
            "which six numbers along fixed axes cannot express; choose another policy, "
            "such as gp"
        )
    config = replace(
        method.config,
        load=YieldToAll(),
        rendering=ArmRendering(),
        dynamics=ARM_DYNAMICS,
        stiffness_frame="axes",
        control_period=period,
        via_spacing=_NEVER,
    )
    return replace(
        method,
        phases=clock_phase,
        adaptation=None,
        door_adaptation=None,
        force_adaptation=None,
        modes=None,
        config=config,
    )
