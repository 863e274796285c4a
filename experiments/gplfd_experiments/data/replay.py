"""Repeats a recorded episode, and compares it bit for bit.

Compares the physics state, the observations, and the course of the episode.
"""

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from gplfd_experiments.console.progress import progress_bar
from gplfd_experiments.data.minari.dataset import REPRODUCING, Dataset
from gplfd_experiments.data.minari.episode import RecordedEpisode, Recorder
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.files.provenance import arithmetic, versions


class Departure(NamedTuple):
    """Difference between a replay and the recording.

    Distances are the largest absolute difference of a number, in the unit of the field;
    infinite if only one of the two is a number.
    """

    step: int
    """First step with a result that differs in any bit; 0 is the reset."""
    fields: Mapping[str, float]
    """Differences at this step: parts of the physics state first."""
    largest: Mapping[str, float]
    """Largest differences in the whole episode."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Comparison:
    """Comparison of a recorded episode with its replay."""

    steps: int
    """Steps of the recording."""
    replayed_steps: int
    """Steps until the replay ended or the actions were used up."""
    departure: Departure | None
    """None if the replay equals the recording, bit for bit."""
    model_parts: tuple[str, ...]
    """Parts of the model that differ, by what they describe; see `model_digests`."""

    @property
    def exact(self) -> bool:
        """Whether every compared bit and the number of steps are equal."""
        return self.departure is None and self.steps == self.replayed_steps

    def __str__(self) -> str:
        """The comparison as text."""
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


def replay(recorded: RecordedEpisode, env: gym.Env[Any, Any]) -> RecordedEpisode:
    """Reset as recorded, and repeat the actions until the episode ends."""
    recorder = Recorder(env)
    recorder.reset(seed=recorded.seed, options=dict(recorded.options) or None)
    for action in recorded.actions:
        _, _, terminated, truncated, _ = recorder.step(action)
        if terminated or truncated:
            break
    return recorder.episode


def replays(
    dataset: Dataset, numbers: Sequence[int]
) -> Iterator[tuple[int, Comparison]]:
    """Repeat episodes; yield the number of each, and its comparison."""
    for number in progress_bar(numbers, desc="replaying", unit="episode"):
        recorded = dataset.episode(number)
        with contextlib.closing(dataset.make_environment()) as env:
            try:
                again = replay(recorded, env)
            except (TypeError, ValueError) as error:
                raise ValueError(
                    f"{dataset.path}: episode {number} cannot be run: {error!s:.300}"
                ) from error
        yield number, compare(recorded, again)


def compare(recorded: RecordedEpisode, again: RecordedEpisode) -> Comparison:
    """Return the first difference, and the largest ones."""
    first, second = _signals(recorded), _signals(again)
    rows = min(len(recorded), len(again)) + 1
    # The largest difference in every row, NaN if all bits are equal.
    gaps = {}
    for name in first | second:
        a, b = first.get(name), second.get(name)
        if a is None or b is None or a.shape[1:] != b.shape[1:]:
            gaps[name] = np.full(rows, np.inf)
            continue
        a, b = a[:rows], b[:rows]
        same = a.view(np.uint64) == b.view(np.uint64)
        with np.errstate(invalid="ignore"):
            gap = np.abs(a - b)
        gap[same | (np.isnan(a) & np.isnan(b))] = 0.0
        gap[np.isnan(gap)] = np.inf
        gaps[name] = np.where(same.all(axis=1), np.nan, gap.max(axis=1))
    starts = {
        name: int(np.argmax(~np.isnan(gap)))
        for name, gap in gaps.items()
        if not np.isnan(gap).all()
    }
    departure = None
    if starts:
        step = min(starts.values())
        departure = Departure(
            step=step,
            fields={n: float(gaps[n][step]) for n in starts if starts[n] == step},
            largest={n: float(np.nanmax(gaps[n])) for n in starts},
        )
    parts = recorded.model_digests.items() ^ again.model_digests.items()
    return Comparison(
        steps=len(recorded),
        replayed_steps=len(again),
        departure=departure,
        model_parts=tuple(sorted({part for part, _ in parts})),
    )


def _signals(episode: RecordedEpisode) -> dict[str, FloatArray]:
    """All compared arrays: one row per step, the reset first."""
    signals: dict[str, NDArray[Any]] = {}
    start = 0
    for name, size in episode.state_layout.items():
        signals[name] = episode.states[:, start : start + size]
        start += size
    for name, values in episode.observations.items():
        signals[f"observed {name}"] = values.reshape(len(values), -1)
    for name in ("rewards", "terminations", "truncations"):
        signals[name] = np.append(0.0, getattr(episode, name))[:, None]
    return {
        name: np.ascontiguousarray(values, dtype=np.float64)
        for name, values in signals.items()
    }


def changes_since(origin: Mapping[str, Any]) -> dict[str, tuple[str, str]]:
    """Return differences in the versions and machine that determine the last bits."""
    recorded = {**origin["versions"], **origin["arithmetic"]}
    here = {**{name: versions()[name] for name in REPRODUCING}, **arithmetic()}
    return {
        name: (recorded.get(name, "unknown"), now)
        for name, now in here.items()
        if recorded.get(name) != now
    }


def _distances(fields: Mapping[str, float]) -> str:
    return ", ".join(f"{name} by {gap:.2g}" for name, gap in fields.items())
