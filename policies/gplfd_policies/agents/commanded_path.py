"""What an agent commands without measurements: set-points and stiffness over time.

A robot's own impedance controller executes it open loop, sample by sample.
"""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from gplfd_env.spatial.rotation_paths import unwrap_rotvecs
from gplfd_env.spatial.se3 import compose_rotvecs
from gplfd_policies.agents.agent import CompliantAgent
from gplfd_policies.arrays.records import freeze, short_repr
from gplfd_policies.arrays.shapes import Outputs, Pose
from gplfd_policies.control.stability import StiffnessGovernor, step_condition
from gplfd_policies.control.stiffness import StiffnessProfile, VirtualDynamics

_ARRIVED: Final = 1e-4
"""Distance of the set-point from the end of the path at which a path ends [m]."""
_ROUNDING: Final = 1e-9
"""Elements of a matrix of stiffness below this are zero [N/m, N m/rad]."""
_AXES: Final = ("x", "y", "z", "rotation x", "rotation y", "rotation z")


@dataclass(frozen=True, kw_only=True, repr=False)
class CommandedPath:
    """Commands at T times, h apart; immutable.

    The set-point leads the path by d v/k, with which a robot that damps its own motion
    with d does not lag behind the path. Stiffness and damping are diagonal in the axes
    of the poses, which are those of the task frame until `seen_from`.

    Raises:
        ValueError: A number is not finite, or the stiffness rises faster than stable.
    """

    times: Float[np.ndarray, " T"]
    """When a sample is to be commanded [s]; the first is 0."""
    poses: Float[np.ndarray, "T 6"]
    """Set-points of the hand [m, rad]."""
    path: Float[np.ndarray, "T 6"]
    """The movement's mean: the poses without their lead [m, rad]."""
    std: Float[np.ndarray, "T 6"]
    """Its standard deviation [m, rad]."""
    stiffness: Float[np.ndarray, "T 6"]
    """Governed stiffness [N/m, N m/rad]."""
    damping: Float[np.ndarray, "T 6"]
    """Damping that goes with it [N s/m, N m s/rad]."""
    margin: Float[np.ndarray, "T 6"]
    """Stability bound minus rate of the stiffness [N/(m s), N m/(rad s)]; positive."""
    profile: StiffnessProfile
    """The law from σ to stiffness, along the axes of the task frame."""
    dynamics: VirtualDynamics
    """Mass and damping for which the stability bound is computed."""

    def __post_init__(self) -> None:
        arrays = ("times", "poses", "path", "std", "stiffness", "damping", "margin")
        freeze(self, *arrays)
        for name in arrays:
            if not np.isfinite(getattr(self, name)).all():
                raise ValueError(f"the {name} of a commanded path must be finite")
        condition = step_condition(
            self.stiffness, self.period, self.profile.k_min, self.dynamics
        )
        for sample, axis in np.argwhere(condition >= 0.0)[:1].tolist():
            before, after = self.stiffness[sample : sample + 2, axis]
            raise ValueError(
                f"the stiffness of {_AXES[axis]} rises from {before:.4g} to "
                f"{after:.4g} within {self.period:.4g} s at {self.times[sample]:.4g} "
                "s, which is faster than stable "
                "(gplfd_policies.control.stability.StiffnessGovernor)"
            )

    __repr__ = short_repr

    @property
    def period(self) -> float:
        """Time between two samples h [s]."""
        return float(self.times[1] - self.times[0])

    def seen_from(self, task: Pose, tool: Float[np.ndarray, "3"]) -> "CommandedPath":
        """Return the same in another frame, in which the task frame has a pose.

        A diagonal does not stay one: K = R diag(k) Rᵀ. Here k becomes a diagonal that
        is in no direction stiffer than K, k_min + E_ii (1 - Σ_j |E_ij| / √(E_ii E_jj))
        with E = R diag(k - k_min) Rᵀ by Gershgorin's theorem, or k_min on axes among
        which one of these is less, and a governor lets it rise no faster than stable.
        Between parallel axes it is k itself. σ is exact, and the lead is that of the
        new stiffness.

        Args:
            task: pose of the task frame in the new frame [m, rad].
            tool: orientation of the robot's tool frame relative to the axes of the
                hand, which are those of the task frame at the closed door [rad].
        """
        turn = Rotation.from_rotvec(task[3:]).as_matrix()
        k_min = np.repeat(self.profile.k_min.reshape(2, 3).min(axis=1), 3)
        if np.ptp(self.dynamics.mass.reshape(2, 3), axis=1).any():
            raise ValueError(
                "a frame can only be given where the virtual mass is the same along x, "
                f"y and z, got {self.dynamics.mass}"
            )

        def turned(diagonals: Outputs) -> Float[np.ndarray, "T 2 3 3"]:
            blocks = diagonals.reshape(-1, 2, 1, 3)
            return np.asarray((turn * blocks) @ turn.T)

        excess = turned(self.stiffness - k_min)
        excess[np.abs(excess) < _ROUNDING] = 0.0
        own = np.diagonal(excess, axis1=-2, axis2=-1)
        scale = np.sqrt(own[..., :, None] * own[..., None, :])
        ratios = np.divide(np.abs(excess), scale, out=0.0 * scale, where=scale > 0.0)
        share = 2.0 - ratios.sum(axis=-1)
        linked = excess != 0.0
        linked = linked @ linked  # of three axes also those that the third one links
        weak = linked & (share <= 0.0)[..., None, :]
        sound = np.where(weak.any(axis=-1), 0.0, own * share)
        profile = replace(self.profile, k_min=k_min)
        governor = StiffnessGovernor(profile, self.dynamics)
        governed = [
            governor.step(target, self.period)
            for target in k_min + sound.reshape(-1, 6)
        ]
        stiffness = np.array([one.stiffness for one in governed])
        damping = self.dynamics.damping(stiffness)

        path = self.path.copy()
        path[:, :3] = task[:3] + self.path[:, :3] @ turn.T
        turns = compose_rotvecs(task[3:], compose_rotvecs(self.path[:, 3:], tool))
        path[:, 3:] = unwrap_rotvecs(turns)
        poses, lead = path.copy(), self.poses - self.path
        velocity = (lead * self.stiffness / self.damping)[:, :3]
        poses[:, :3] += velocity @ turn.T * (damping / stiffness)[:, :3]
        variance = np.diagonal(turned(self.std**2), axis1=-2, axis2=-1)
        return CommandedPath(
            times=self.times,
            poses=poses,
            path=path,
            std=np.sqrt(variance.reshape(-1, 6)),
            stiffness=stiffness,
            damping=damping,
            margin=np.array([one.margin for one in governed]),
            profile=profile,
            dynamics=self.dynamics,
        )


def commanded_path(agent: CompliantAgent) -> CommandedPath:
    """Let an agent command its whole motion to a hand that follows without force.

    It is what `gplfd_policies.registry.open_loop.open_loop` makes of a method that
    commands the same whatever the hand does. The samples are its control period apart.

    Raises:
        ValueError: The agent does not command stiffness.
    """
    if agent.control != "impedance":
        raise ValueError("the agent commands poses alone; export one of open_loop()")
    agent.reset({})
    hand, free = agent.movement.at(0.0)[0], np.zeros(6)
    steps, arrived = [], False
    while not arrived:
        step = agent.act({"ee_pose": hand, "wrench": free})
        steps.append(step)
        hand = step.desired
        lead = float(np.linalg.norm(step.action - step.desired))
        arrived = bool(step.phase >= 1.0) and lead < _ARRIVED
    stiffness = np.array([step.stiffness for step in steps])
    return CommandedPath(
        times=np.arange(len(steps)) * agent.config.control_period,
        poses=np.array([step.action for step in steps]),
        path=np.array([step.desired for step in steps]),
        std=np.array([step.std for step in steps]),
        stiffness=stiffness,
        damping=agent.config.dynamics.damping(stiffness),
        margin=np.array([step.stability_margin for step in steps]),
        profile=agent.config.profile,
        dynamics=agent.config.dynamics,
    )
