"""A leader moves the robot's hand while its policy acts; the motion is recorded.

`LedAgent` combines an agent with a `Leader`: the synthetic corrector, or a person. In
practice, a policy opens doors while the synthetic corrector watches it.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Protocol

import numpy as np

from gplfd_env.conventions.constants import CONTROL_PERIOD, Control
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_env.spatial.rotation_paths import unwrap_rotvecs
from gplfd_experiments.data.teacher.motion import (
    Press,
    handle_angles,
    minimum_jerk,
    smooth_functions,
)
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.agents.agent import Agent
from gplfd_policies.control.steps import AgentStep, Observation
from gplfd_policies.demonstrations.demonstration import Correction, Demonstration, Who
from gplfd_policies.movements.movement import GaussianTrajectory

_PATH: Final = np.radians(np.linspace(-2.0, 90.0, 185))
"""Door angles of the true path with which a command is compared [rad]."""
_SERVO: Final = 2000.0  # Stiffness of the arm under pose commands [N/m].
_DEVIATION: Final = 0.02
"""Distance of the command from the path at which the corrector takes the hand, and from
the leading command below which it hands over [m]: 40 N, at which a grasp slips."""
_STALL_TIME: Final = 3.0
"""Time without `_PROGRESS` after which the corrector takes the hand [s]."""
_PROGRESS: Final = math.radians(2.0)  # Opening that counts as progress [rad].
_GOAL: Final = math.radians(64.0)
"""Largest opening angle to which the hand is led and at which it is held [rad]."""
_LEAD_TIME: Final = 1.5  # Shortest time of leading [s].
_SPEED: Final = 0.25  # Speed of the point that pulls the hand along the path [rad/s].
BLEND_TIME: Final = 0.4
"""Duration of taking the hand and of handing over [s]."""
PULLS: Final = (34.0, 58.0)
"""Largest force [N] along the path: bar (fingers slip at 37 N), handle that turns."""
_PRESS_TIME: Final = 0.8  # Duration of turning a handle [s].
_TREMOR: Final = (0.001, math.radians(0.5))
"""Standard deviation per axis of the leading hand [m, rad]."""
# Correlation time of this tremor, and the longest episode with it [s].
_TREMOR_TIME, _LONGEST = 0.15, 120.0


class Leader(Protocol):
    """A person or program that may lead the robot's hand."""

    by: Who

    def begin(self, door: DoorGeometry) -> None:
        """Watch an episode at a door, from its beginning."""

    def lead(self, observation: Observation, step: AgentStep) -> FloatArray | None:
        """Return the commanded hand pose (6,) [m, rad], or None: the agent acts."""


class LedAgent:
    """An agent that observes the led motion; only its command is replaced."""

    control: Control = "pose"

    def __init__(self, agent: Agent, leader: Leader) -> None:
        if agent.control != "pose":
            raise ValueError(
                "a hand is led by its pose, but this policy commands the arm's "
                "stiffness, too; correct one that commands poses, such as gp"
            )
        self._agent, self._leader, self.dynamics = agent, leader, agent.dynamics
        self._rows: list[tuple[float, FloatArray, FloatArray, bool, float]] = []

    def inform(self, door: DoorGeometry) -> None:
        """Give both the door of the next episode."""
        self._agent.inform(door)
        self._leader.begin(door)

    def reset(self, observation: Observation) -> None:
        """Start an episode and its recording."""
        self._agent.reset(observation)
        self._rows = []

    def act(self, observation: Observation) -> AgentStep:
        """Return the agent's step, with the leader's command if the hand is led."""
        step = self._agent.act(observation)
        command = self._leader.lead(observation, step)
        time, pose = float(observation["time"][0]), np.array(observation["ee_pose"])
        row = (time, pose, -np.asarray(observation["wrench"]), command is not None)
        self._rows.append((*row, float(step.observed_phase)))
        return step if command is None else replace(step, action=command)

    def forecast(self) -> GaussianTrajectory | None:
        """Return the agent's forecast."""
        return self._agent.forecast()

    def correction(self, *, door: str, seed: int) -> Correction | None:
        """Return the correction of the episode so far; None if the hand was not led."""
        if not any(led for *_, led, _ in self._rows):
            return None
        columns = map(np.array, zip(*self._rows, strict=True))
        times, poses, wrenches, led, phases = columns
        poses[:, 3:] = unwrap_rotvecs(poses[:, 3:])
        phase = float(np.clip(np.nan_to_num(phases[led.argmax()]), 0.0, 1.0))
        motion = Demonstration(times=times, poses=poses, wrenches=wrenches)
        about: Any = {"door": door, "seed": seed, "by": self._leader.by}
        return Correction(motion=motion, led=led, phase=phase, **about)


class SyntheticCorrector:
    """Leads the hand along the handle's true path if the policy deviates or stalls.

    The servo pulls the hand with a limited force towards a point on the path ahead.
    Taking and handing over are minimum-jerk blends. The tremor is drawn from `rng`.
    """

    by: Who = "synthetic"

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng

    def begin(self, door: DoorGeometry) -> None:
        """Watch an episode at a door."""
        self._door = door
        turns = door.travel * np.linspace(0.0, 1.0, 5 if door.travel > 0.0 else 1)
        grid = np.meshgrid(_PATH, turns)
        self._path = door.hand_poses(*grid)[..., :3].reshape(-1, 3)
        times = np.arange(0.0, _LONGEST, CONTROL_PERIOD)
        tremor = smooth_functions(times, _TREMOR_TIME, 6, self._rng)
        self._tremor = tremor * np.repeat(_TREMOR, 3)
        self._mark = (0.0, 0.0)  # time [s] and angle [rad] of the last progress
        self._taken: float | None = None  # when the hand was taken [s]
        self._handed: float | None = None  # when handing it over began [s]
        self._from, self._point = np.zeros(6), 0.0

    def lead(self, observation: Observation, step: AgentStep) -> FloatArray | None:
        """Return the command while the hand is led."""
        now, door = float(observation["time"][0]), self._door
        angle = float(door.angle(observation["ee_pose"][:3]))
        if angle > self._mark[1] + _PROGRESS:
            self._mark = (now, angle)
        if self._taken is None:
            apart = np.min(np.sum((self._path - step.action[:3]) ** 2, axis=1))
            stalled = now - self._mark[0] > _STALL_TIME
            if not stalled and apart <= _DEVIATION**2:
                return None
            self._taken, self._handed = now, None
            self._from, self._point = np.array(step.action), max(angle, 0.0)
        since = now - self._taken
        # The pose that pulls the hand along the path.
        turns = door.travel > 0.0
        ends = door.hand_poses([angle, angle + 1e-3])[:, :3]
        metres_per_radian = float(np.linalg.norm(ends[1] - ends[0])) / 1e-3
        ahead = PULLS[turns] / (_SERVO * metres_per_radian)
        rate = _SPEED * float(minimum_jerk(np.array(since)))
        if turns and angle < _PROGRESS and since <= 0.85 * _PRESS_TIME:
            rate = 0.0  # The handle is turned before the door is moved.
        self._point += rate * CONTROL_PERIOD
        self._point = min(self._point, max(angle, 0.0) + ahead, _GOAL)
        turn = 0.0
        if turns:
            share = minimum_jerk(np.array(since / _PRESS_TIME))
            press = Press(_PRESS_TIME, door.travel)
            turn = float(handle_angles(press, share, np.array(self._point)))
        row = min(round(now / CONTROL_PERIOD), len(self._tremor) - 1)
        pull = door.easy_hand_poses(self._point, turn) + self._tremor[row]
        taken = minimum_jerk(np.array(since / BLEND_TIME))
        command: FloatArray = (1.0 - taken) * self._from + taken * pull
        if self._handed is None:
            apart = np.linalg.norm(step.action[:3] - command[:3])
            if since >= _LEAD_TIME and apart < _DEVIATION:
                self._handed = now
            return command
        left = (now - self._handed) / BLEND_TIME
        if left >= 1.0:
            self._taken, self._mark = None, (now, angle)
        share = minimum_jerk(np.array(left))
        return np.asarray((1.0 - share) * command + share * step.action)


LOST: Final = "grasp_lost"
"""Episodes with this failure give no correction: the hand lost the handle."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Practice:
    """Doors opened in turn until N corrections, or a round without a correction."""

    corrections: int
    """Number N of corrections."""
    doors: Sequence[Mapping[str, Any]]
    """The doors of a round, as `DoorConfig.as_dict` gives them."""
    randomization: str | Mapping[str, Any] = "none"
    """Randomization of every opening."""
    demonstrated: bool = False
    """Whether it learns instead from demonstrations at the corrected doors with forces,
    as many as were begun in the seconds of the corrections."""


def corrected(
    agent: Agent, seed: int, name: str, open_door: Callable[[Agent], EpisodeLog]
) -> tuple[EpisodeLog, Correction | None]:
    """Open a door with the corrector; return the log and the correction."""
    led = LedAgent(agent, SyntheticCorrector(np.random.default_rng(seed)))
    log = open_door(led)
    taken = None if log.failure == LOST else led.correction(door=name, seed=seed)
    return log, taken
