"""Where compliance is realised: in the set-point (virtual dynamics) or in the arm.

Virtual dynamics move the set-point of a stiff arm by the measured force, Eq. (22) of
Arduengo et al., arXiv:2002.09979. A commanded stiffness needs no measured force.
"""

import math
from typing import ClassVar, Final

import numpy as np

from gplfd_env.conventions.constants import Control
from gplfd_env.spatial.se3 import compose_rotvecs
from gplfd_policies.arrays.rows import ALL_ROWS, Rows
from gplfd_policies.arrays.shapes import Axes, Frames, Vectors
from gplfd_policies.control.stiffness import VirtualDynamics, product


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
        self.displacement: Axes = np.zeros((*shape, 6))
        self.velocity: Axes = np.zeros((*shape, 6))
        """e, commanded minus desired pose [m, rad], and its rate [m/s, rad/s]."""

    def reset(self, rows: Rows = ALL_ROWS) -> None:
        """Return to rest at the desired pose."""
        self.displacement[rows] = 0.0
        self.velocity[rows] = 0.0

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
        and D is a function of K. Equal masses along x, y, z then decouple the columns.
        """
        mass, before = self._dynamics.mass, self.displacement[rows]
        held, speed, force = before, self.velocity[rows], wrench
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
        self.velocity[rows] = velocity
        self.displacement[rows] = displacement
        return np.asarray(displacement)


ARM_DYNAMICS: Final = VirtualDynamics(mass=np.repeat([4.0, 0.15], 3), damping_ratio=1.0)
"""Apparent dynamics of the arm of `gplfd_env` at the hand that renders a stiffness."""

_SMOOTHING: Final = 0.2
"""Time constant of the velocity for the lead [s]. Near the limit of the load the pace
falls by 0.16 per newton: without smoothing the lead would alternate."""

StiffnessRange = tuple[tuple[float, float], tuple[float, float]]


class VirtualRendering(Admittance):
    """Virtual dynamics displace the set-point of the arm, which is always stiff."""

    control: ClassVar[Control] = "pose"
    stiffness_range: ClassVar[StiffnessRange] = ((0.0, math.inf), (0.0, math.inf))

    def __init__(
        self, dynamics: VirtualDynamics, period: float, shape: tuple[int, ...] = ()
    ) -> None:
        super().__init__(dynamics, shape)
        self._period = period

    def displaced(self, hands: Vectors, rows: Rows = ALL_ROWS) -> Vectors:
        """Return how far hands have been displaced from their desired positions [m]."""
        return self.displacement[rows][..., :3]  # e of Eq. (22)

    def command(
        self,
        desired: Axes,
        velocity: Vectors,
        stiffness: Axes,
        *,
        compliant_wrench: Axes,
        compensated_force: Vectors,
        rows: Rows = ALL_ROWS,
        frame: Frames | None = None,
    ) -> Axes:
        """Return desired poses [m, rad] displaced by the compliant wrench [N, N m]."""
        # The stiff arm exerts the compensated force without a lead.
        offset = self.step(stiffness, compliant_wrench, self._period, rows, frame)
        action: Axes = desired + offset
        action[..., 3:] = compose_rotvecs(offset[..., 3:], desired[..., 3:])
        return action


class ArmRendering:
    """The arm's servo is commanded the stiffness; the set-point is the desired pose.

    Two leads are added, without which a soft arm would lag behind the policy:

    * A compensated force f would stretch a spring k by f/k. The set-point leads by
      f (1/k - 1/K), with the greatest stiffness K of the arm: a hand that lags by x
      pulls its load with K x. For a held hand, the share 1 - k/K < 1 of its force
      returns as compensated load, so that it settles at every delay.
    * The servo's damper opposes the hand's velocity v, whereas the virtual damper
      opposes only the deviation. The set-point therefore leads by d v/k; v is smoothed,
      because it sets the load, which sets the pace of the clock, and thus v.
    """

    control: ClassVar[Control] = "impedance"
    stiffness_range: ClassVar[StiffnessRange] = ((20.0, 2000.0), (1.0, 100.0))

    def __init__(
        self, dynamics: VirtualDynamics, period: float, shape: tuple[int, ...] = ()
    ) -> None:
        self._dynamics, self._share = dynamics, period / (period + _SMOOTHING)
        self._velocity = np.zeros((*shape, 3))
        self._rest = np.zeros((*shape, 3))  # where the load alone would hold the hand

    def reset(self, rows: Rows = ALL_ROWS) -> None:
        """Begin at rest at the desired poses."""
        self._velocity[rows] = 0.0
        self._rest[rows] = 0.0

    def displaced(self, hands: Vectors, rows: Rows = ALL_ROWS) -> Vectors:
        """Return how far hands have been displaced from their desired positions [m]."""
        return np.asarray(hands - self._rest[rows])

    def command(
        self,
        desired: Axes,
        velocity: Vectors,
        stiffness: Axes,
        *,
        compliant_wrench: Axes,
        compensated_force: Vectors,
        rows: Rows = ALL_ROWS,
        frame: Frames | None = None,
    ) -> Axes:
        """Return desired poses that lead by the compensated force and velocity."""
        before = self._velocity[rows]
        smooth = self._velocity[rows] = before + self._share * (velocity - before)
        damping = self._dynamics.damping(stiffness)[..., :3]
        pull = compensated_force + damping * smooth
        stiffest = self.stiffness_range[0][1]
        rest = self._rest[rows] = desired[..., :3] - compensated_force / stiffest
        action = desired.copy()
        action[..., :3] = rest + pull / stiffness[..., :3]
        return action
