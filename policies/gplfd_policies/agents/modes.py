"""An agent for demonstrations of several modes: it tries one mode after another.

A hand that pulls a door which must be pushed does not move. The agent compares the
force with the force that a door may need, moves back, and tries the next mode.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_env.validation.fields import Quantities, quantity
from gplfd_policies.adaptation.gridded import LOOK_AHEAD
from gplfd_policies.agents.agent import (
    BATCHES,
    AgentBatch,
    CompliantAgent,
    batch_agents,
    row_of,
    shared_in_batch,
)
from gplfd_policies.arrays.rows import Rows
from gplfd_policies.arrays.shapes import Pose
from gplfd_policies.control.steps import AgentStep, Observation, measured
from gplfd_policies.movements.movement import GaussianTrajectory

_ARM: Final = np.repeat([1.0, 0.1], 3)
"""Lever arm by which a rotation counts as a distance, and a moment as a force [m]."""
_LASTING: Final = 3
"""Control steps that a force must last to count: slipping fingers cause short peaks."""
_TURNED: Final = 0.5
"""Share of the demonstrated turn above which a handle counts as turned."""
_STRIDE: Final = 1e-3  # largest step while the hand moves back [m]: 10 cm/s
_SLOWING: Final = 0.05
"""Such a step relative to the distance from the start: the leaf shuts softly."""
_REST: Final = 0.4
"""Rest at the start before another mode begins [s], so that the leaf can shut."""


@dataclass(frozen=True, kw_only=True, slots=True)
class ModeConfig(Quantities):
    """Criteria by which an agent abandons a mode.

    With shares π_j of the demonstrations, the mode j has the weight

        w_j = π_j exp(-F_j²/2b² - D_j²/2).

    F_j is the greatest force on the hand since it last moved forward along the path of
    j: for the active mode the whole force, for others the component against their path.
    exp(-F_j²/2b²) is the probability that a door of kind j does not open under this
    force, if the force that opens a door has a Rayleigh distribution with the scale b.
    D_j is the largest Mahalanobis distance of the hand from the path of j so far.

    The agent changes from its mode i to the mode j if w_j > `odds` w_i. With two modes
    of equal shares it abandons the first at F = b √(2 log `odds`), 15 N, the second at
    √2 F, the first again at √3 F, and so on up to the limit of the load rule.
    """

    load_scale: float = quantity(7.5, above=0.0, unit="N")
    """b: most probable force that opens a door [N] (ADA 404.2.9: 22.2 N)."""
    turned_load_scale: float = quantity(20.0, above=0.0, unit="N")
    """b after the hand has turned a handle [N]: the grasp behind it is stronger."""
    odds: float = quantity(math.exp(2.0), above=1.0)
    """Ratio of probabilities above which the agent changes to another mode."""
    step: float = quantity(5e-3, above=0.0, unit="m")
    """Distance along the path after which the hand counts as moved [m]."""
    position_std: float = quantity(5e-3, above=0.0, unit="m")
    """Error of the hand's position on its path, in addition to the movement's σ [m]."""
    rotation_std: float = quantity(0.5, above=0.0, unit="rad")
    """Error of the hand's rotation, because the hand turns on the bar [rad]."""
    settling_time: float = quantity(0.2, above=0.0, unit="s")
    """Time constant with which the set-point settles when the mode changes [s]."""


class ModesAgent:
    """Acts by the agent of the most probable mode, and moves back to try another one.

    It begins with the mode of most demonstrations. To move back, the hand returns
    through the poses of its path to the start, where the agent of the other mode
    begins. The set-point does not jump at either change.

    Args:
        agents: One per mode, the mode of most demonstrations first.
        counts: Number of demonstrations of each mode.
        config: When a mode is abandoned.
    """

    def __init__(
        self,
        agents: Sequence[CompliantAgent],
        counts: Sequence[int],
        config: ModeConfig = ModeConfig(),
    ) -> None:
        self.agents, self.config = tuple(agents), config
        self.control, self.dynamics = agents[0].control, agents[0].dynamics
        self._prior = np.log(np.divide(counts, sum(counts)))
        self._decay = config.settling_time / (CONTROL_PERIOD + config.settling_time)
        paths = [agent.movement.trajectory() for agent in agents]
        self._means = np.stack([path.mean for path in paths])
        floor = np.repeat([config.position_std, config.rotation_std], 3)
        self._variances = np.stack([path.std for path in paths]) ** 2 + floor**2
        ahead = math.ceil(LOOK_AHEAD * (self._means.shape[1] - 1))
        chords = _ARM * (self._means[:, ahead:] - self._means[:, :-ahead])
        chords /= np.sqrt((chords**2).sum(axis=2, keepdims=True)) + 1e-9
        last = np.repeat(chords[:, -1:], ahead, axis=1)
        self._directions = np.concatenate([chords, last], axis=1)
        self.begin(np.zeros(6))

    def inform(self, door: DoorGeometry) -> None:
        """Ignore the door: the agent uses only what it learns and observes."""

    def reset(self, observation: Observation) -> None:
        """Begin at the closed, grasped door with the most probable mode."""
        self.begin(measured(observation)[0])
        self.agents[0].reset(observation)

    def begin(self, pose: Pose) -> None:
        """Forget the last door; the agent of the first mode is reset separately."""
        count, pose = len(self.agents), np.array(pose)
        self._last: AgentStep | None = None
        self.mode, self._next = 0, 0  # They differ while the hand moves back.
        self.begins = False
        # Per mode: pose at the last forward motion, F, D² and the latest forces.
        self._marks = np.tile(pose, (count, 1))
        self._loads, self._errors = np.zeros((2, count))
        self._recent = [np.zeros(count)]
        self._log_weights = self._prior
        # Poses of the hand's path, the next one on the way back, time at the start [s].
        self._trail, self._target, self._rested = [pose], pose, 0.0
        self._offset = np.zeros(6)  # of the set-point from the mode's command

    @property
    def shared_in_batch(self) -> tuple[object, ...] | None:
        """What agents of a `ModesBatch` share; None if the modes are not alike."""
        first, *others = map(shared_in_batch, self.agents)
        return (first,) if all(parts == first for parts in others) else None

    def act(self, observation: Observation) -> AgentStep:
        """Return the command from ``ee_pose`` [m, rad] and ``wrench`` [N, N m]."""
        back = self.step_back(observation)
        if back is not None:
            return back
        if self.begins:
            self.agents[self.mode].reset(observation)
        return self.onward(self.agents[self.mode].act(observation))

    def step_back(self, observation: Observation) -> AgentStep | None:
        """Return the next step of the way back, or None if the agent of `mode` acts.

        Then that agent is reset first if it `begins`, and its step goes to `onward`.
        """
        seen, wrench = measured(observation)
        pose, last, config = np.array(seen), self._last, self.config
        self._offset = self._decay * self._offset
        if self._next == self.mode:
            errors = ((pose - self._means) ** 2 / self._variances).sum(axis=2)
            modes, nearest = np.arange(len(errors)), errors.argmin(axis=1)
            directions = self._directions[modes, nearest]
            load = -(directions * (wrench / _ARM)).sum(axis=1)
            load[self.mode] = math.sqrt(wrench[:3] @ wrench[:3])
            self._recent = [*self._recent[1 - _LASTING :], load]
            along = (directions * (_ARM * (pose - self._marks))).sum(axis=1)
            came = along >= config.step
            self._marks[came] = pose
            borne = np.maximum(self._loads, np.min(self._recent, axis=0))
            self._loads = np.where(came, 0.0, borne)
            self._errors = np.maximum(self._errors, errors[modes, nearest])
            turned = [
                agent.handle is not None
                and agent.handle.turned(pose.tolist()) >= _TURNED * agent.handle.travel
                for agent in self.agents
            ]
            scales = np.where(turned, config.turned_load_scale, config.load_scale)
            misfits = (self._loads / scales) ** 2 + self._errors
            self._log_weights = self._prior - 0.5 * misfits
            best = int(np.argmax(self._log_weights))
            lead = self._log_weights[best] - self._log_weights[self.mode]
            if last is not None and lead > math.log(config.odds):
                self._next, self._target = best, pose
                self._offset = self._decay * (last.action - pose)
        if last is not None and self._next != self.mode:
            self._rested = 0.0 if self._trail else self._rested + CONTROL_PERIOD
            if self._rested < _REST:
                if self._trail:  # one step back through the poses of the hand's path
                    way = self._trail[-1] - self._target
                    left = _length(self._trail[0] - self._target)
                    stride = min(_STRIDE, _SLOWING * left + 0.1 * _STRIDE)
                    distance = _length(way)
                    if distance <= stride:
                        self._target = self._trail.pop()
                    else:
                        self._target = self._target + stride / distance * way
                return self._decided(
                    last,
                    action=self._target + self._offset,
                    desired=self._target,
                    # The stiffness is held.
                    std_rate=np.zeros(6),
                    stiffness_rate=np.zeros(6),
                    stability_margin=last.stability_margin + last.stiffness_rate,
                    via_point=False,
                )
            self.mode, self._trail, self.begins = self._next, [self._target], True
        else:
            self.begins = False
            if _length(pose - self._trail[-1]) >= _STRIDE:
                self._trail.append(pose)
        return None

    def onward(self, step: AgentStep) -> AgentStep:
        """Return a step of the agent of `mode`, without a jump of the set-point."""
        if self.begins and self._last is not None:
            self._offset = self._decay * (self._last.action - step.action)
        return self._decided(step, action=step.action + self._offset)

    def _decided(self, step: AgentStep, **changes: Any) -> AgentStep:
        weights = np.exp(self._log_weights - self._log_weights.max())
        changes["mode_probability"] = float(weights[self.mode] / weights.sum())
        self._last = replace(step, mode=float(self.mode), **changes)
        return self._last

    def forecast(self) -> GaussianTrajectory:
        """Return the current movement of the active mode over the whole task."""
        return self.agents[self.mode].forecast()


class ModesBatch(AgentBatch):
    """Agents of several modes in lockstep, whose active modes are computed together."""

    def __init__(self, agents: Sequence[ModesAgent]) -> None:
        super().__init__(agents)
        self._agents: tuple[ModesAgent, ...] = tuple(agents)
        self._counts = [len(agent.agents) for agent in agents]
        self._firsts = np.cumsum(self._counts) - self._counts
        self._modes = batch_agents([mode for agent in agents for mode in agent.agents])

    def _reset(self, observations: Observation, rows: Rows) -> None:
        begun = np.isin(np.arange(sum(self._counts)), self._firsts[rows])
        for row in np.arange(len(self._agents))[rows].tolist():
            self._agents[row].begin(measured(row_of(observations, row))[0])
        self._modes.reset(observations, begun)

    def decide(self, observations: Observation, rows: Rows) -> AgentStep:
        """See `AgentBatch.decide`."""
        steps: dict[int, Any] = {}
        for row in np.arange(len(self._agents))[rows].tolist():
            steps[row] = self._agents[row].step_back(row_of(observations, row))
        acting = [row for row, back in steps.items() if back is None]
        places = [self._firsts[row] + self._agents[row].mode for row in acting]
        begins = np.zeros(sum(self._counts), dtype=bool)
        begins[places] = [self._agents[row].begins for row in acting]
        each = {n: np.repeat(v, self._counts, axis=0) for n, v in observations.items()}
        if begins.any():
            self._modes.reset(each, begins)
        if acting:
            together = self._modes.decide(each, np.array(places))
            for index, row in enumerate(acting):
                steps[row] = self._agents[row].onward(together.of(index))
        return AgentStep.stacked([*steps.values()])


BATCHES[ModesAgent] = ModesBatch


def _length(way: Pose) -> float:
    """Return the length of a displacement, rotations scaled by a lever arm [m]."""
    scaled = _ARM * way
    return math.sqrt(scaled @ scaled)
