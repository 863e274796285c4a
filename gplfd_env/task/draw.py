"""Random draws for an episode, its sensor noise and its command delay."""

import dataclasses
from collections import deque
from typing import Final, NamedTuple

import numpy as np

from gplfd_env.conventions.constants import Array, Start
from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.disturbance import Disturbance
from gplfd_env.doors.randomization import DoorRandomization
from gplfd_env.doors.variation import Perception, SensorNoise, Standoff, Variation

_BLOCK: Final = 128


class NoiseSource:
    """White Gaussian noise on pose [m, rad] and wrench [N, N m], drawn in blocks."""

    def __init__(self, noise: SensorNoise, seed: int) -> None:
        stds = noise.position, noise.rotation, noise.force, noise.torque
        self._std = np.repeat(stds, 3)
        self._rng = np.random.default_rng(seed)
        self._next = _BLOCK
        self._rows = np.empty((0, 12))
        self.sample = np.zeros(12)

    def draw(self) -> None:
        """Draw the next `sample`."""
        if self._next == _BLOCK:
            self._rows = self._std * self._rng.standard_normal((_BLOCK, 12))
            self._next = 0
        self.sample = self._rows[self._next]
        self._next += 1


class DelayLine:
    """Delays commands by a number of control periods."""

    def __init__(self, delay: int) -> None:
        self._delay = delay
        self._waiting: deque[Array] = deque()

    def pass_on(self, command: Array, rest: Array) -> Array:
        """Put a command in; return the one that is due, or `rest` at the beginning."""
        self._waiting.append(command.copy())
        return self._waiting.popleft() if len(self._waiting) > self._delay else rest


class SampledEpisode(NamedTuple):
    """A drawn episode with its noise source and its delay line, if any."""

    variation: Variation
    noise: NoiseSource | None
    delay: DelayLine | None


def draw_episode(
    door: DoorConfig,
    randomization: DoorRandomization,
    disturbance: Disturbance,
    rng: np.random.Generator,
    start: Start = "grasped",
) -> SampledEpisode:
    """Draw an episode.

    The number of draws depends only on the start and on what is idle; neither
    disturbance nor start changes the other values.
    """
    variation, noise = Variation(door=door), None
    if not randomization.idle:
        variation = randomization.sample(door, rng)
        seed = int(rng.integers(2**63))
        noise = None if variation.noise.silent else NoiseSource(variation.noise, seed)
    if not disturbance.idle:
        generator = np.random.default_rng(int(rng.integers(2**63)))
        drawn = disturbance.drawn(generator)
        variation = dataclasses.replace(variation, disturbance=drawn)
    if start == "approach":
        standoff = Standoff()
        if not randomization.idle:
            generator = np.random.default_rng(int(rng.integers(2**63)))
            standoff = Standoff.drawn(generator)
            # Drawn after the standoff from its generator, so no other draw changes.
            position, rotation = randomization.perception
            belief = Perception(position=position, rotation=rotation).drawn(generator)
            placement = dataclasses.replace(variation.placement, **belief)
            variation = dataclasses.replace(variation, placement=placement)
        variation = dataclasses.replace(variation, standoff=standoff)
    delay = DelayLine(variation.delay) if variation.delay else None
    return SampledEpisode(variation, noise, delay)
