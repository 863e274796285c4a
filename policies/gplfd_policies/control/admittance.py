"""The virtual spring-mass-damper that turns forces into displacements."""

import numpy as np

from gplfd_policies.arrays.rows import ALL_ROWS, Rows
from gplfd_policies.arrays.shapes import Axes, Frames
from gplfd_policies.control.frame import product
from gplfd_policies.control.stiffness import VirtualDynamics


class Admittance:
    """Integrates M ë + D ė + K e = F, Eq. (22), implicitly at the control rate.

    e is the displacement of the commanded from the desired pose and F the force and
    torque that the environment exerts on the hand, both in the task frame. e[3:] is a
    rotation vector; the commanded rotation is exp(e[3:]) exp(desired[3:]).

    Implicit Euler, v' = (m v + h(F - K e))/(m + h D + h² K), e' = e + h v', is stable
    for every step h and only adds damping. Semi-implicit Euler with the published gains
    is unstable at 50 ms: `test_eq22_is_stable_where_semi_implicit_euler_diverges`.
    """

    def __init__(self, dynamics: VirtualDynamics, shape: tuple[int, ...] = ()) -> None:
        self._dynamics = dynamics
        self._displacement = np.zeros((*shape, 6))
        self._velocity = np.zeros((*shape, 6))

    @property
    def displacement(self) -> Axes:
        """e: commanded minus desired pose [m, rad]."""
        return self._displacement.copy()

    @property
    def velocity(self) -> Axes:
        """Rate of e [m/s, rad/s]."""
        return self._velocity.copy()

    def reset(self, rows: Rows = ALL_ROWS) -> None:
        """Return to rest at the desired pose."""
        self._displacement[rows] = 0.0
        self._velocity[rows] = 0.0

    def step(
        self,
        stiffness: Axes,
        wrench: Axes,
        dt: float,
        rows: Rows = ALL_ROWS,
        frame: Frames | None = None,
    ) -> Axes:
        """Advance these rows by a period [s]; return a copy of e at its end.

        With a frame T, the translational stiffness k is along its columns, K = T k Tᵀ,
        and D is a function of K. The mass must be the same along x, y and z; then the
        step decouples along the columns.
        """
        mass, before = self._dynamics.mass, self._displacement[rows]
        held, speed, force = before, self._velocity[rows], wrench
        if frame is not None:
            states = np.empty((*before.shape, 3))
            states[..., 0], states[..., 1], states[..., 2] = held, speed, force
            into = frame.swapaxes(-1, -2)
            states[..., :3, :] = product(into, states[..., :3, :])
            held, speed, force = states[..., 0], states[..., 1], states[..., 2]
        damping = self._dynamics.damping(stiffness)
        impulse = dt * (force - stiffness * held)
        inertia = mass + dt * (damping + dt * stiffness)
        velocity = (mass * speed + impulse) / inertia
        if frame is not None:
            velocity[..., :3] = product(frame, velocity[..., :3, None])[..., 0]
        displacement = before + dt * velocity
        self._velocity[rows] = velocity
        self._displacement[rows] = displacement
        return np.asarray(displacement)
