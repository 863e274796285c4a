"""Lets a controller for doors with a fixed handle open doors whose handle turns.

The controller of `gplfd_policies.control.compliance` knows a movement, a phase rule and
a load rule, and no handle. Where the demonstrations turn a handle first, this module
puts an adapter around each of the three:

* the phase is found for the hand as it would hold the handle as it was demonstrated;
* a via-point is the pose of the handle's axis, not of the hand, and the direction of
  the path is that of the axis;
* the load is compensated twice, along the turn of the handle and along the door's path.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from gplfd_policies.adaptation.gridded import (
    GriddedMovement,
    GriddedMovements,
    look_ahead,
)
from gplfd_policies.arrays.members import EVERY_MEMBER, Members
from gplfd_policies.control.compliance import ComplianceConfig, ComplianceController
from gplfd_policies.demonstrations.turned_handle import turned_handle
from gplfd_policies.handles.compensation import Handles
from gplfd_policies.handles.load import HandleAndDoor
from gplfd_policies.movements.trajectory import ViaPoint
from gplfd_policies.phase.phase_rule import PhaseEstimate, PhaseRule, Phases, Poses


def controller_of(
    movements: GriddedMovement | Sequence[GriddedMovement],
    phases: PhaseRule,
    config: ComplianceConfig,
) -> ComplianceController:
    """Return the controller of one hand or many, for bars and for turned handles.

    Args:
        movements: The movement that is followed, or one per member, on grids of one
            size; adapted in place.
        phases: Tells where along the task the observed poses lie.
        config: Stiffness, load, timing and via-points.
    """
    alone = isinstance(movements, GriddedMovement)
    each = [movements] if isinstance(movements, GriddedMovement) else movements
    shape = () if alone else (len(each),)
    turned = [turned_handle(one.learned.aligned) for one in each]
    if all(handle is None for handle in turned):
        load = config.load.begin(config.profile, shape)
        return ComplianceController(GriddedMovements(movements), phases, load, config)
    handles = Handles(turned, shape)
    return ComplianceController(
        HandleMovements(movements, handles),
        HandlePhases(phases, handles),
        HandleAndDoor(
            config.load, config.profile, handles, shape, config.control_period
        ),
        config,
    )


class HandlePhases:
    """A phase rule that sees hands without how far they have turned handles on.

    Args:
        rule: The rule.
        handles: What the members turn.
    """

    def __init__(self, rule: PhaseRule, handles: Handles) -> None:
        self._rule, self._handles = rule, handles

    def reset(self, members: Members = EVERY_MEMBER) -> None:
        """Let these members begin at the start of the task."""
        self._rule.reset(members)

    def update(
        self,
        poses: Poses,
        previous: Phases,
        command: Phases,
        members: Members = EVERY_MEMBER,
    ) -> PhaseEstimate:
        """Return the phases of observed poses; see `PhaseRule.update`."""
        shown = self._handles.shown(poses, members)
        return self._rule.update(shown, previous, command, members)

    def rate(self, phases: Phases, members: Members = EVERY_MEMBER) -> Poses:
        """Return dμ/ds of these members' demonstrations at phases, (A, 6)."""
        return self._rule.rate(phases, members)


class HandleMovements(GriddedMovements):
    """Movements of hands that turn handles; what they say of a path is of the axis.

    Args:
        movements: As of `GriddedMovements`.
        handles: What the members turn.
    """

    def __init__(
        self, movements: GriddedMovement | Sequence[GriddedMovement], handles: Handles
    ) -> None:
        super().__init__(movements)
        self._handles = handles

    def reset(self, members: Members = EVERY_MEMBER) -> None:
        """Forget the via-points of these members, and how far their handles turn."""
        super().reset(members)
        self._handles.reset(members)

    def observe(self, member: int, via_point: ViaPoint) -> None:
        """Condition a member's movement on a via-point, given as a pose of the hand."""
        expected, _ = self.at_member(member, via_point.phase)
        pose = self._handles.told(via_point.pose, expected, member)
        super().observe(member, replace(via_point, pose=pose))

    def ahead(
        self, phases: Phases, members: Members = EVERY_MEMBER
    ) -> tuple[Poses, Poses, Float[np.ndarray, "*N 3"]]:
        """Return mean, σ, and the direction of the axis's path where it opens next."""
        points = look_ahead(phases, self._handles.opening(phases, members))
        means, stds = self.at(points, members)
        chord = self._handles.places(means[1:], members)
        return means[0], stds[0], self.direction(chord)

    def hand_poses(self, poses: Poses, members: Members = EVERY_MEMBER) -> Poses:
        """Return poses of the movements as hands on these members' own handles."""
        return self._handles.asked(poses, members)
