"""Stability of the admittance while the hand is rigidly held.

A held hand closes a loop around the virtual dynamics: the displacement e of the command
stretches the servo, and the servo's force returns as F after a delay τ,

    m ë(t) + d ė(t) + k e(t) = F(t) = -k_s e(t - τ),

where k_s is the stiffness of the servo in series with the object that holds the hand.
With the control period h and the integration of
`gplfd_policies.control.rendering.Admittance`, this is

    M (e' - 2e + e⁻) + D (e' - e) + k e' = -k_s e_q,    M = m/h²,  D = d/h,

where e⁻, e, e' are successive displacements and e_q is the displacement q = τ/h periods
before e. docs/method.md derives the consequences.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_policies.arrays.shapes import Axes, SixAxes


@dataclass(frozen=True, kw_only=True, slots=True)
class ContactLoop:
    """Admittance, delay, servo and a rigidly held hand, axis by axis."""

    stiffness: SixAxes
    """k_s: force per displacement of the command [N/m, N m/rad]."""
    delay: float
    """τ: longest time from a command to its effect on the measured force, beyond the
    control period of the command [s]."""
    period: float = CONTROL_PERIOD
    """h: time between two commands [s]."""

    @property
    def sufficient_damping(self) -> SixAxes:
        """k_s τ: damping with which the loop is stable for every m > 0 and k > 0.

        Holds for whole periods τ > 0; no smaller damping is enough for every mass.
        """
        return np.asarray(self.stiffness * self.delay)

    def tolerated_delay(self, stiffness: Axes, damping: Axes, mass: SixAxes) -> Axes:
        """Return the delay up to which the loop is stable [s].

        If k < k_s, it is unstable at every longer delay. The gain of the loop is one at
        the frequency θ/h where p = sin²(θ/2) solves

            (k - A p)² + B² p (1 - p) = k_s²,    A = 4M + 2D + 2k,  B = 2(D + k),

        and its phase reaches -180° there with a delay of
        h/θ arctan2(B √(p(1 - p)), A p - k). The result is infinite if the gain is below
        one at every frequency, and zero if it is above one.
        """
        inertia = mass / (self.period * self.period)
        resistance = damping / self.period + stiffness
        total = inertia + resistance
        real, imaginary = 2.0 * (total + inertia), 2.0 * resistance
        square = 32.0 * inertia * total  # twice A² - B²
        linear = imaginary * imaginary - 2.0 * stiffness * real
        excess = (self.stiffness - stiffness) * (self.stiffness + stiffness)
        discriminant = linear * linear + 2.0 * square * excess
        root = np.sqrt(np.maximum(discriminant, 0.0)) - linear
        crosses = (discriminant >= 0.0) & (root > 0.0)
        share = np.where(crosses, np.minimum(root / square, 1.0), 0.5)
        height = imaginary * np.sqrt(share * (1.0 - share))
        lead = np.arctan2(height, real * share - stiffness)
        delay = self.period * lead / (2.0 * np.arcsin(np.sqrt(share)))
        return np.where(crosses, delay, np.inf)

    def margin(self, stiffness: Axes, damping: Axes, mass: SixAxes) -> Axes:
        """Return the tolerated delay minus `delay` [s]; negative if unstable."""
        return self.tolerated_delay(stiffness, damping, mass) - self.delay


SERVO_LAG: Final = 0.005
"""Delay of servo, contact and wrist sensor [s]: at most 4.6 ms were measured when the
friction grasp holds a locked door."""

HELD_HAND: Final = ContactLoop(
    stiffness=np.repeat([2000.0, 100.0], 3), delay=3.0 * CONTROL_PERIOD + SERVO_LAG
)
"""The servo of `gplfd_env.robot.model` with the longest delay that ``"hard"`` draws. It
is equally stiff along x, y and z, so that the loop decouples along the same directions
as the virtual dynamics."""
