"""A method without measurements, whose commands a robot can execute from a file."""

from dataclasses import replace

from gplfd_policies.control.load import YieldToAll
from gplfd_policies.control.rendering import ARM_DYNAMICS, ArmRendering
from gplfd_policies.registry.method import Method, clock_phase


def open_loop(method: Method, period: float) -> Method:
    """Return the method without adaptation and load compensation, driven by time.

    The arm itself renders the stiffness, along the axes of the task frame. The commands
    do not depend on observations; there is one per period [s]. A method with stiffness
    along the path raises ValueError.
    """
    if method.phase_stiffness is not None:
        raise ValueError(
            "this policy has a stiffness along the path, which six numbers along fixed "
            "axes cannot express; choose another, such as gp"
        )
    config = replace(
        method.config,
        load=YieldToAll(),
        rendering=ArmRendering(),
        dynamics=ARM_DYNAMICS,
        stiffness_frame="axes",
        control_period=period,
        via_spacing=2.0,  # longer than the task: no via-points
    )
    without = replace(method, adaptation=None, door_adaptation=None, modes=None)
    return replace(without, force_adaptation=None, phases=clock_phase, config=config)
