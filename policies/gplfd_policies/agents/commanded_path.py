"""Commanded path of an agent without measurements: set-points and stiffness."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy

from gplfd_env.spatial.rotation_paths import unwrap_rotvecs
from gplfd_env.spatial.se3 import compose_rotvecs
from gplfd_policies.agents.agent import CompliantAgent
from gplfd_policies.arrays.records import own_arrays, short_repr
from gplfd_policies.arrays.shapes import Float, Outputs, Pose
from gplfd_policies.control.stability import rate_bound
from gplfd_policies.control.stiffness import StiffnessProfile, VirtualDynamics

_MOST_SAMPLES: Final = 60_000


@dataclass(frozen=True, kw_only=True, repr=False)
class CommandedPath:
    """Commands at M equal time steps, the first at 0; immutable.

    Stiffness and damping are along the axes of the poses, by default of the task frame.
    """

    times: Float[np.ndarray, " M"]
    """Time of each sample [s]."""
    poses: Outputs
    """Set-points of the hand [m, rad]. They lead the path by d v/k, so that a robot
    that damps its own motion with d does not lag behind the path."""
    path: Outputs
    """Mean of the movement: the poses without their lead [m, rad]."""
    std: Outputs
    """Standard deviation of the movement [m, rad]."""
    stiffness: Outputs
    """Governed stiffness [N/m, N m/rad]."""
    profile: StiffnessProfile
    """Function from σ to stiffness, along the axes of the task frame."""
    dynamics: VirtualDynamics
    """Mass and damping with which the stiffness is stable."""

    __repr__ = short_repr

    def __post_init__(self) -> None:
        own_arrays(self, "times", "poses", "path", "std", "stiffness")
        for name in ("times", "poses", "path", "std", "stiffness"):
            if not np.isfinite(getattr(self, name)).all():
                raise ValueError(f"{name} must be finite; learn the skill again")
        for sample, axis in np.argwhere(~(self.margin > 0.0)).tolist():
            raise ValueError(
                f"at {self.times[sample]:.4g} s the stiffness of axis {axis} rises to "
                f"{self.stiffness[sample, axis]:.4g}, which is faster than stable"
            )

    @property
    def damping(self) -> Outputs:
        """Damping for the stiffness [N s/m, N m s/rad]."""
        return self.dynamics.damping(self.stiffness)

    @property
    def margin(self) -> Outputs:
        """Stability bound minus rate of the stiffness [N/(m s), N m/(rad s)].

        If it is positive, (k' - k) + γ(d' - d) < 2γhk: see `StiffnessGovernor`.
        """
        before = np.vstack([self.stiffness[:1], self.stiffness[:-1]])
        rate = (self.stiffness - before) / self.times[1]
        return np.asarray(rate_bound(before, self.profile.k_min, self.dynamics) - rate)

    def seen_from(self, task: Pose, tool: Float[np.ndarray, "3"]) -> "CommandedPath":
        """Return the path in another frame, given the pose of the task frame in it.

        There K = R diag(k) Rᵀ is not diagonal. Here k along a new axis is the least k
        of the old axes with a component above 1e-4 along it, which is in no direction
        stiffer than K and rises no faster. The lead is that of the new stiffness.

        Args:
            task: pose of the task frame in the new frame [m, rad].
            tool: orientation of the robot's tool at the closed door, task frame [rad].
        """
        both = np.array([self.profile.k_min, self.dynamics.mass])
        if np.ptp(both.reshape(4, 3), axis=1).any():
            raise ValueError(f"k_min or mass differ between axes: {both.tolist()}")
        turn = scipy.spatial.transform.Rotation.from_rotvec(task[3:]).as_matrix()
        old = self.stiffness.reshape(-1, 2, 1, 3)
        least = np.where(np.abs(turn) > 1e-4, old, np.inf).min(axis=-1)
        stiffness = least.reshape(-1, 6)
        turns = compose_rotvecs(task[3:], compose_rotvecs(self.path[:, 3:], tool))
        positions = task[:3] + self.path[:, :3] @ turn.T
        path = np.hstack([positions, unwrap_rotvecs(turns)])
        velocity = (self.poses - self.path) * self.stiffness / self.damping
        lead = self.dynamics.damping(stiffness) / stiffness
        lead[:, :3] *= velocity[:, :3] @ turn.T
        lead[:, 3:] = 0.0
        variance = (self.std**2).reshape(-1, 2, 3) @ (turn**2).T
        return replace(
            self,
            poses=path + lead,
            path=path,
            std=np.sqrt(variance).reshape(-1, 6),
            stiffness=stiffness,
        )


def commanded_path(agent: CompliantAgent) -> CommandedPath:
    """Compute the commands of an agent for a hand that follows without force.

    The agent must be one of `gplfd_policies.registry.method.Method.open_loop`. Raises a
    ValueError for a motion of more than 60,000 samples, and as `CommandedPath`.
    """
    lasting, period = agent.movement.learned.duration, agent.config.control_period
    if lasting > _MOST_SAMPLES * period:
        raise ValueError(
            f"the motion takes {lasting:.4g} s; commands are computed for at most "
            f"{_MOST_SAMPLES * period:.4g} s at this rate"
        )
    agent.reset({})
    hand, free = agent.forecast().mean[0], np.zeros(6)
    steps, arrived = [], False
    while not arrived:
        step = agent.act({"ee_pose": hand, "wrench": free})
        steps.append(step)
        hand, lead = step.desired, np.abs(step.action - step.desired)
        arrived = bool(step.phase >= 1.0 and lead.max() < 1e-4)  # [m]
    return CommandedPath(
        times=np.arange(len(steps)) * period,
        poses=np.array([step.action for step in steps]),
        path=np.array([step.desired for step in steps]),
        std=np.array([step.std for step in steps]),
        stiffness=np.array([step.stiffness for step in steps]),
        profile=agent.config.profile,
        dynamics=agent.config.dynamics,
    )
