"""Somebody leads the robot's hand while its policy acts: corrections are recorded.

`LedAgent` puts a leader beside an agent: the synthetic corrector here, or anything else
with the methods of `Leader`, such as a person with a mouse.
"""

import math
from dataclasses import dataclass, replace
from typing import Final, Protocol

import numpy as np

from gplfd_env.conventions.constants import CONTROL_PERIOD, Control
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_env.spatial.rotation_paths import unwrap_rotvecs
from gplfd_env.validation.fields import check_quantities, quantity
from gplfd_experiments.data.teacher.handle_motion import Press, let_back
from gplfd_experiments.data.teacher.random_motion import minimum_jerk, smooth_functions
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.agents.agent import Agent
from gplfd_policies.control.steps import AgentStep, Observation
from gplfd_policies.demonstrations.correction import Correction
from gplfd_policies.demonstrations.correction import Leader as Who
from gplfd_policies.movements.trajectory import GaussianTrajectory

_PATH: Final = np.radians(np.linspace(-2.0, 90.0, 185))
"""Door angles of the true path with which a command is compared [rad]."""
_TURNS: Final = np.linspace(0.0, 1.0, 5)
"""Turns of a handle there, as shares of its travel."""
_LONGEST: Final = 120.0
"""An episode for which the tremor of the leading hand is drawn [s]."""
_SERVO: Final = 2000.0
"""Stiffness of the arm that is commanded a pose [N/m]."""


class Leader(Protocol):
    """Somebody who may take the robot's hand."""

    by: Who
    """Who it is."""

    def begin(self, door: DoorGeometry) -> None:
        """Watch an episode at a door, from its beginning."""

    def lead(self, observation: Observation, step: AgentStep) -> FloatArray | None:
        """Return the commanded hand pose (6,) [m, rad], or None to let the agent act.

        Args:
            observation: What the agent observed.
            step: What it decided.
        """


class LedAgent:
    """An agent beside which somebody watches, who may lead its hand.

    The agent acts on while it is led, and so observes what it is shown; only its
    command is replaced.
    """

    control: Control = "pose"

    def __init__(self, agent: Agent, leader: Leader) -> None:
        if agent.control != "pose":
            raise ValueError(
                "a hand is led by its pose, but this policy commands the arm's "
                "stiffness, too; correct one that commands poses, such as gp"
            )
        self._agent, self._leader = agent, leader
        self._rows: list[tuple[float, FloatArray, FloatArray, bool, float]] = []

    def inform(self, door: DoorGeometry) -> None:
        """Tell both which door the next episode has."""
        self._agent.inform(door)
        self._leader.begin(door)

    def reset(self, observation: Observation) -> None:
        """Begin an episode and a recording."""
        self._agent.reset(observation)
        self._rows = []

    def act(self, observation: Observation) -> AgentStep:
        """Return the agent's step, with the command of the one who leads, if any."""
        step = self._agent.act(observation)
        command = self._leader.lead(observation, step)
        self._rows.append(
            (
                float(observation["time"][0]),
                np.array(observation["ee_pose"]),
                -np.asarray(observation["wrench"]),
                command is not None,
                float(step.observed_phase),
            )
        )
        return step if command is None else replace(step, action=command)

    def forecast(self) -> GaussianTrajectory | None:
        """Return the agent's forecast."""
        return self._agent.forecast()

    def correction(self, *, door: str, seed: int) -> Correction | None:
        """Return the correction of the episode so far; None if nobody led."""
        times, poses, wrenches, led, phases = map(
            np.array, zip(*self._rows, strict=True)
        )
        if not led.any():
            return None
        poses[:, 3:] = unwrap_rotvecs(poses[:, 3:])
        phase = float(np.nan_to_num(phases[led.argmax()]))
        return Correction(
            times=times,
            poses=poses,
            wrenches=wrenches,
            led=led,
            door=door,
            seed=seed,
            by=self._leader.by,
            phase=min(max(phase, 0.0), 1.0),
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class CorrectorConfig:
    """When the synthetic corrector takes the hand, and how it leads it.

    Raises:
        ValueError: A field is not finite or outside its range.
    """

    deviation: float = quantity(0.02, above=0.0, unit="m")
    """Distance of the command from the handle's path from which the hand is taken: 40 N
    of the servo, at which a friction grasp slips."""
    stall_time: float = quantity(3.0, above=0.0, unit="s")
    """Time without progress after which it is taken."""
    progress: float = quantity(math.radians(2.0), above=0.0, unit="rad")
    """Opening that counts as progress."""
    goal: float = quantity(math.radians(64.0), above=0.0, unit="rad")
    """Opening to which the hand is led at most, and at which it is held."""
    lead_time: float = quantity(1.5, above=0.0, unit="s")
    """For how long the hand is led at least. It is handed over when the policy's own
    command is within `deviation` of the leading one; until then it is led on."""
    speed: float = quantity(0.25, above=0.0, unit="rad/s")
    """Speed at which the point that pulls the hand moves along the path."""
    blend_time: float = quantity(0.4, above=0.0, unit="s")
    """Time of taking the hand and of handing it over."""
    bar_force: float = quantity(34.0, above=0.0, unit="N")
    """Greatest force along the path; a friction grasp slips at 37 N."""
    handle_force: float = quantity(58.0, above=0.0, unit="N")
    """The same with the fingers behind a turned handle."""
    press_time: float = quantity(0.8, above=0.0, unit="s")
    """Time in which a handle is turned."""
    tremor: tuple[float, float] = (0.001, math.radians(0.5))
    """Standard deviation per axis of the leading hand [m, rad]."""
    tremor_time: float = quantity(0.15, above=0.0, unit="s")
    """Its correlation time."""

    def __post_init__(self) -> None:
        check_quantities(self)


class SyntheticCorrector:
    """Leads the hand along the handle's true path when the policy leaves it or stalls.

    It watches as a person does who knows the door. The hand is pulled by the arm's own
    servo, a spring of 2000 N/m, towards a point that moves along the path ahead of the
    hand, by no more than a force limit allows. Taking over and handing over are
    minimum-jerk blends of two commands. The leading hand trembles, by the seed.

    Args:
        rng: Source of randomness.
        config: When and how.
    """

    by: Who = "synthetic"

    def __init__(
        self, rng: np.random.Generator, config: CorrectorConfig = CorrectorConfig()
    ) -> None:
        self.config, self._rng = config, rng

    def begin(self, door: DoorGeometry) -> None:
        """Watch an episode at a door."""
        config, self._door = self.config, door
        turns = door.travel * (_TURNS if door.travel > 0.0 else _TURNS[:1])
        grid = np.meshgrid(_PATH, turns)
        self._path = door.hand_poses(*grid)[..., :3].reshape(-1, 3)
        times = np.arange(0.0, _LONGEST, CONTROL_PERIOD)
        tremor = smooth_functions(times, config.tremor_time, 6, self._rng)
        self._tremor = tremor * np.repeat(config.tremor, 3)
        self._mark = (0.0, 0.0)  # time [s] and angle [rad] of the last progress
        self._taken: float | None = None  # when the hand was taken [s]
        self._handed: float | None = None  # when handing it over began [s]
        self._from = np.zeros(6)

    def lead(self, observation: Observation, step: AgentStep) -> FloatArray | None:
        """Return the command while the hand is led."""
        config, now = self.config, float(observation["time"][0])
        angle = float(self._door.angle(observation["ee_pose"][:3]))
        if angle > self._mark[1] + config.progress:
            self._mark = (now, angle)
        if self._taken is None:
            apart = np.min(np.sum((self._path - step.action[:3]) ** 2, axis=1))
            stalled = now - self._mark[0] > config.stall_time
            lost = apart > config.deviation**2
            if not (stalled or lost):
                return None
            self._taken, self._handed = now, None
            self._point = max(angle, 0.0)
            self._from = np.array(step.action)
        command = self._pull(now, angle)
        done = minimum_jerk(np.array((now - self._taken) / config.blend_time))
        command = (1.0 - done) * self._from + done * command
        if self._handed is None:
            apart = np.linalg.norm(step.action[:3] - command[:3])
            enough = now - self._taken >= config.lead_time
            if enough and apart < config.deviation:
                self._handed = now
            return command
        left = (now - self._handed) / config.blend_time
        if left >= 1.0:
            self._taken, self._mark = None, (now, angle)
        share = minimum_jerk(np.array(left))
        return np.asarray((1.0 - share) * command + share * step.action)

    def _pull(self, now: float, angle: float) -> FloatArray:
        """Return the pose that pulls the hand on, (6,)."""
        config, door = self.config, self._door
        since = now - (self._taken or 0.0)
        press = Press(config.press_time, door.travel)
        share = minimum_jerk(np.array(since / config.press_time))
        force = config.handle_force if door.travel > 0.0 else config.bar_force
        ends = door.hand_poses([angle, angle + 1e-3])[:, :3]
        metres_per_radian = float(np.linalg.norm(ends[1] - ends[0])) / 1e-3
        furthest = max(angle, 0.0) + force / (_SERVO * metres_per_radian)
        # The handle is turned before the door is moved.
        closed = door.travel > 0.0 and angle < config.progress
        ready = not closed or since > 0.85 * config.press_time
        rate = config.speed * float(minimum_jerk(np.array(since))) if ready else 0.0
        self._point = min(self._point + rate * CONTROL_PERIOD, furthest, config.goal)
        turn = 0.0
        if door.travel > 0.0:
            turn = float(let_back(press, share, np.array(self._point)))
        pose = door.easy_hand_poses(self._point, turn)
        row = min(round(now / CONTROL_PERIOD), len(self._tremor) - 1)
        return np.asarray(pose + self._tremor[row])
