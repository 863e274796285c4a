"""The episodes of n simulations: a few one by one, many in arrays."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from gplfd_env.conventions.constants import Array, Mask
from gplfd_env.conventions.resets import masked
from gplfd_env.doors.variation import Variation
from gplfd_env.simulation.loads import NO_EXTRA_INPUTS, ExtraInputs
from gplfd_env.task.episode import Episode
from gplfd_env.task.info import infos_of
from gplfd_env.task.observation import Observation

MANY: Final = 12
"""From this number of simulations on, arrays are faster than Python's floats."""


class Episodes:
    """Episodes of n simulations, each bit for bit equal to a single `Episode`."""

    def __init__(self, begun: Sequence[Episode]) -> None:
        self._n = len(begun)
        self._ones: list[Episode] = [] if self._n >= MANY else list(begun)
        self._many = Episode.together(begun) if self._n >= MANY else None

    def replace(self, begun: Mapping[int, Episode]) -> None:
        """Replace some episodes by new ones."""
        if self._many is not None:
            self._many.replace(begun)
            return
        for row, one in begun.items():
            self._ones[row] = one

    def prepare_step(self, commands: Array, stepped: Mask | None) -> ExtraInputs:
        """See `Episode.prepare_step`."""
        if self._many is not None:
            return self._many.prepare_step(commands, stepped)
        total = ExtraInputs({}, {}, {})
        for row, one in enumerate(self._ones):
            if stepped is None or stepped[row]:
                own = one.prepare_step(commands[row : row + 1])
                if own is not NO_EXTRA_INPUTS:
                    pairs: Any = zip(total, own, strict=True)
                    for every, alone in pairs:
                        if alone:
                            every[row] = alone[0]
        return total

    def advance(
        self, sensordata: Array, stepped: Mask | None, diverged: Mask | None
    ) -> None:
        """Update the episodes from the sensor arrays (n, number of values).

        Simulations that were not `stepped`, or have `diverged`, get no reward and keep
        their state.
        """
        if self._many is not None:
            self._many.advance(np.ascontiguousarray(sensordata.T), stepped)
            if diverged is not None:
                self._many.mark_diverged(diverged)
            return
        values = sensordata.tolist()
        for row, one in enumerate(self._ones):
            if stepped is None or stepped[row]:
                one.advance(values[row])
            elif diverged is not None and diverged[row]:
                one.mark_diverged()
            else:
                one.rest()

    def observation(self, sensordata: Array) -> Observation:
        """Return the observations of all simulations, (n, ...)."""
        if self._many is not None:
            return self._many.observation(sensordata)
        ones = self._ones
        wrench = np.array([one.readings.wrench for one in ones])
        time = np.array([[one.readings.time] for one in ones])
        first = ones[0]
        observation = first.reader.observation(sensordata, wrench, time, first.command)
        for row, one in enumerate(ones):
            one.add_errors(observation, row)
        return observation

    def infos(self, rows: Mask) -> dict[str, Any]:
        """Return infos as new arrays, with masks of the valid `rows`."""
        episodes = self._ones if self._many is None else [self._many]
        return masked(infos_of(episodes), rows)

    def outcome(self, limit: float) -> tuple[Array, Mask, Mask]:
        """Return rewards, terminations and truncations, (n,)."""
        if self._many is not None:
            many, progress = self._many, self._many.progress
            late = progress.simulation_error | (progress.steps >= limit)
            return many.reward, many.terminated, late
        ones = [(one, one.progress) for one in self._ones]
        return (
            np.array([one.reward for one, _ in ones]),
            np.array([one.terminated for one, _ in ones]),
            np.array([own.simulation_error or own.steps >= limit for _, own in ones]),
        )

    @property
    def variations(self) -> tuple[Variation, ...]:
        """Door and circumstances of every simulation."""
        if self._many is not None:
            return self._many.variations
        return tuple(own for one in self._ones for own in one.variations)
