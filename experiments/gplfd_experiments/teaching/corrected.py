"""Episodes of a policy in which a person leads the hand, and the corrected skill."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from gplfd_experiments.episodes.leading import LedAgent
from gplfd_experiments.episodes.practice import LOST
from gplfd_experiments.episodes.task import EpisodeTask
from gplfd_experiments.teaching.lead import Lead, Person
from gplfd_experiments.teaching.lesson import Lesson
from gplfd_policies.demonstrations.correction import Correction
from gplfd_policies.movements.movement import Movement
from gplfd_policies.movements.skill import Skill
from gplfd_policies.registry.method import Method


class CorrectedSkill:
    """A skill that learns from corrections, and its file."""

    def __init__(self, method: Method, skill: Skill, place: Path) -> None:
        self.method, self.place = method, place
        self.skill: Movement = skill
        self.kept: list[Correction] = []

    def keep(self, correction: Correction) -> None:
        """Learn from a correction, and save skill and correction."""
        skill = self.method.update(self.skill, correction)
        if isinstance(skill, Skill):
            skill.save(self.place)
        self.skill = skill
        self.kept.append(correction)


class CorrectionLesson(Lesson):
    """An episode of a policy, which acts while the person does not lead the hand."""

    longest, control = 3000, "pose"
    invitation = "Press Start: the policy opens the door."
    request = "Lead the hand where the policy fails; then the policy continues."

    def __init__(
        self, task: EpisodeTask, store: CorrectedSkill, device: str, *, drawn: bool
    ) -> None:
        self._store, self._device = store, device
        super().__init__(task, drawn=drawn)

    def _begin(self) -> Lead:
        self._person = Person(self.view)
        agent = self._store.method.follow(self._store.skill)
        self._agent = LedAgent(agent, self._person)
        self._agent.inform(self._env.door_geometry)
        self._agent.reset(self._observation)
        return self._person.spring

    def _action(self, sample: Float[np.ndarray, " 9"]) -> Float[np.ndarray, " 6"]:
        self._person.take(sample, float(self._info["handle_angle"]))
        return self._agent.act(self._observation).command(self.control)

    def step(self, sample: Float[np.ndarray, " 9"]) -> None:
        """Simulate one control period, until the door is open."""
        super().step(sample)
        if self._info["success"]:
            self.over = "the door is open"

    def record(self) -> Correction:
        """Return the correction; raise a ValueError if there is none."""
        correction = self._agent.correction(door=self.task.door, seed=self.task.seed)
        if correction is None:
            raise ValueError(
                f"{self._ended}. The hand was not led: there is nothing to keep"
            )
        if self._info["failure"] in (LOST, "simulation_error"):
            raise ValueError(f"{self._ended}. This gives no correction")
        return replace(correction, device=self._device, inputs=np.array(self._inputs))

    def result(self) -> str:
        """Return how the episode ended, and the time of leading."""
        seconds = self.record().seconds
        return f"{self._ended}. You led the hand for {seconds:.1f} s."

    @property
    def _ended(self) -> str:
        if self._info["success"]:
            return "The door is open"
        angle, why = round(self.state["angle"]), self.over or "you stopped"
        return f"The door is not open, at {angle}°: {why}"
