"""Running a recorded episode again, and comparing bit for bit.

Two runs are compared by what MuJoCo's next step depends on (the physics state, part by
part), by what the agent saw, and by what it was told of the outcome.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from experiments.datasets.minari.episode import Episode, Recorder
from experiments.datasets.minari.physics import arithmetic
from experiments.datasets.minari.reading import Dataset
from experiments.datasets.minari.writing import REPRODUCING
from experiments.files.provenance import versions
from experiments.progress import progress_bar

Array = NDArray[Any]

_OUTCOMES: Final = ("rewards", "terminations", "truncations")


@dataclass(frozen=True, kw_only=True, slots=True)
class Departure:
    """Where a replay leaves the recording.

    Distances are the largest absolute difference of a number, in the unit of the field;
    infinite where only one of the two is a number.
    """

    step: int
    """First step whose result differs, in any bit; 0 is the reset itself."""
    fields: Mapping[str, float]
    """What differs at that step, and by how much: parts of the physics state first."""
    largest: Mapping[str, float]
    """What differs anywhere in the episode, and by how much at most."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Comparison:
    """A recorded episode beside its replay."""

    steps: int
    """Steps of the recording."""
    replayed_steps: int
    """Steps until the replay ended or the actions were used up."""
    departure: Departure | None
    """None when the replay is the recording, bit for bit."""
    model_parts: tuple[str, ...]
    """Parts of the model that differ, by what they describe; see `model_digests`."""

    @property
    def exact(self) -> bool:
        """Whether every compared bit is the same and the replay is as long."""
        return self.departure is None and self.steps == self.replayed_steps

    def __str__(self) -> str:
        """The comparison in words."""
        text = []
        if self.model_parts:
            text.append(f"the model differs in {', '.join(self.model_parts)}")
        if self.departure is not None:
            step, fields = self.departure.step, _distances(self.departure.fields)
            text.append(f"departs at step {step} of {self.steps}: {fields}")
            text.append(f"at most: {_distances(self.departure.largest)}")
        if self.replayed_steps != self.steps:
            text.append(f"ended after {self.replayed_steps} of {self.steps} steps")
        if self.exact:
            text.append(f"bit-exact over {self.steps} steps")
        return "; ".join(text)


def replays(
    dataset: Dataset, numbers: Sequence[int]
) -> Iterator[tuple[int, Comparison]]:
    """Run episodes again; yield the number of each and how it compares.

    Raises:
        ValueError: An episode is damaged.
        OSError: The file cannot be read.
    """
    for number in progress_bar(numbers, desc="replaying", unit="episode"):
        episode = dataset.episode(number)
        with contextlib.closing(dataset.make_environment()) as env:
            yield number, compare(episode, replay(episode, env))


def replay(recorded: Episode, env: gym.Env[Any, Any]) -> Episode:
    """Reset as recorded, repeat the actions until the episode ends.

    Args:
        recorded: Episode of a data set.
        env: Environment made anew, see `Dataset.make_environment`.

    Raises:
        ValueError: The environment refuses the options or an action.
    """
    recorder = Recorder(env)
    recorder.reset(seed=recorded.seed, options=dict(recorded.options) or None)
    for action in recorded.actions:
        _, _, terminated, truncated, _ = recorder.step(action)
        if terminated or truncated:
            break
    return recorder.episode


def compare(recorded: Episode, again: Episode) -> Comparison:
    """Find the first bit that differs, and how far the episodes part."""
    first, second = _signals(recorded), _signals(again)
    rows = min(len(recorded), len(again)) + 1
    at: dict[str, int] = {}
    distances: dict[str, Array] = {}
    for name, values in first.items():
        if name not in second or second[name].shape[1:] != values.shape[1:]:
            at[name], distances[name] = 0, np.full(rows, np.inf)
            continue
        a, b = values[:rows], second[name][:rows]
        differs = np.any(_bytes(a) != _bytes(b), axis=1)
        if differs.any():
            at[name], distances[name] = int(differs.argmax()), _distance(a, b)
    for name in second.keys() - first.keys():
        at[name], distances[name] = 0, np.full(rows, np.inf)
    departure = None
    if at:
        step = min(at.values())
        departure = Departure(
            step=step,
            fields={n: float(distances[n][step]) for n in at if at[n] == step},
            largest={n: float(distances[n].max()) for n in at},
        )
    parts = {**recorded.model_digests, **again.model_digests}
    return Comparison(
        steps=len(recorded),
        replayed_steps=len(again),
        departure=departure,
        model_parts=tuple(
            part
            for part in sorted(parts)
            if recorded.model_digests.get(part) != again.model_digests.get(part)
        ),
    )


def changes_since(origin: Mapping[str, Any]) -> dict[str, tuple[str, str]]:
    """What may change the last bits: of the recording, and here; only what differs.

    Args:
        origin: `Dataset.origin`.
    """
    recorded = {name: origin["versions"][name] for name in REPRODUCING}
    here = {name: versions()[name] for name in REPRODUCING}
    recorded |= origin["arithmetic"]
    here |= arithmetic()
    return {
        name: (recorded.get(name, "unknown"), here[name])
        for name in here
        if recorded.get(name) != here[name]
    }


def _signals(episode: Episode) -> dict[str, Array]:
    """Everything that is compared: one row per step, the reset first."""
    signals: dict[str, Array] = {}
    start = 0
    for name, size in episode.state_layout.items():
        signals[name] = episode.states[:, start : start + size]
        start += size
    for name, values in episode.observations.items():
        signals[f"observed {name}"] = values.reshape(len(values), -1)
    for name in _OUTCOMES:
        values = np.asarray(getattr(episode, name), dtype=np.float64)
        signals[name] = np.concatenate([[0.0], values])[:, None]
    return signals


def _distances(fields: Mapping[str, float]) -> str:
    return ", ".join(f"{name} by {gap:.2g}" for name, gap in fields.items())


def _bytes(values: Array) -> Array:
    return np.ascontiguousarray(values).view(np.uint8).reshape(len(values), -1)


def _distance(a: Array, b: Array) -> Array:
    """Largest absolute difference in every row, (rows,)."""
    with np.errstate(invalid="ignore"):
        gap = np.abs(a - b)
    gap[(a == b) | (np.isnan(a) & np.isnan(b))] = 0.0
    distance: Array = np.where(np.isnan(gap), np.inf, gap).max(axis=1)
    return distance
