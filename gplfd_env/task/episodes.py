"""The episodes of n simulations, in arrays."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np

from gplfd_env.conventions.constants import Array, Info, Mask
from gplfd_env.conventions.one_and_many import (
    Number,
    columns,
    mapped,
    row_of,
    stacked,
    where,
    with_rows,
)
from gplfd_env.doors.variation import Variation
from gplfd_env.task.episode import Episode, Thing
from gplfd_env.task.info import INFO, TEXTS, VECTORS
from gplfd_env.task.observation import Values

_WORDS: Final = {name: np.array(INFO[name].texts, dtype=object) for name in TEXTS}


class Episodes(Episode):
    """n episodes whose numbers are arrays (n,), bit for bit equal to single ones."""

    def __init__(self, begun: Sequence[Episode]) -> None:
        first, self.n = begun[0], len(begun)
        super().__init__(
            first.command,
            first.reader,
            first._reward,
            [episode._parts[0] for episode in begun],
            stacked([episode.constants for episode in begun]),
        )
        self.readings = stacked([episode.readings for episode in begun])
        self.progress = stacked([episode.progress for episode in begun])

    def replace(self, begun: Mapping[int, Episode]) -> None:
        """Replace some episodes by new ones."""
        if not begun:
            return
        for name in ("constants", "readings", "progress"):
            records = [getattr(episode, name) for episode in begun.values()]
            changed = with_rows(getattr(self, name), self.n, list(begun), records)
            setattr(self, name, changed)
        self.reader = dataclasses.replace(self.reader, hand=self.constants.hand)
        for row, episode in begun.items():
            self._parts[row] = episode._parts[0]
        self._index()

    @property
    def variations(self) -> tuple[Variation, ...]:
        """Door and circumstances of every simulation."""
        return tuple(parts.variation for parts in self._parts)

    def advance(self, values: Values, stepped: Mask | None = None) -> None:
        """Update the episodes from the sensor values, (number of values, n).

        Simulations that were not `stepped` get no reward and keep their state.
        """
        # Arrays are never modified in place: copies of the records are enough.
        before = self.readings, mapped(lambda entry: entry, self.progress)
        super().advance(values, stepped)
        if stepped is not None:
            before[1].terms = self._terms(0.0, 0.0, False)
            self.readings, self.progress = mapped(
                lambda now, then: where(stepped, now, then),
                (self.readings, self.progress),
                before,
            )

    def outcome(self, limit: float) -> tuple[Array, Mask, Mask]:
        """Return rewards, terminations, and truncations after `limit` steps, (n,)."""
        late = self.progress.simulation_error | (self.progress.steps >= limit)
        rewards, ended = np.asarray(self.reward), np.asarray(self.terminated)
        return rewards, ended, np.asarray(late)

    def info(self) -> Info:
        """Return the infos as new arrays (n, ...)."""
        info = self._info_values()
        for name, value in info.items():
            kind = INFO[name].kind
            if kind is dict:
                terms = {term: columns((x,), self.n)[:, 0] for term, x in value.items()}
                info[name] = terms
            elif name in VECTORS:
                info[name] = columns(value, self.n)
            elif kind is str:
                info[name] = _WORDS[name][value]
            else:
                info[name] = np.empty(self.n, kind)
                info[name][:] = value
        return info

    def _of(self, row: int, record: Thing) -> Thing:
        return row_of(record, row)

    def _index_of(self, row: int) -> Any:
        return row

    def _column(self, vector: Sequence[Number]) -> Array:
        return columns(vector, self.n)

    def _each(self, things: Mapping[int, Any], name: str, default: Any) -> Any:
        if not things:
            return default
        values = np.empty((self.n, *np.shape(default)), np.asarray(default).dtype)
        values[:] = default
        for row, thing in things.items():
            values[row] = getattr(thing, name)
        return tuple(values.T) if values.ndim > 1 else values
