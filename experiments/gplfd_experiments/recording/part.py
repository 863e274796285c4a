"""How much of an episode is to be shown: all of it, or what came since the last time.

A recording shows an episode at once, a live view shows it part by part. Both are made
by the same functions, each of which turns a `Part` into chunks: what a later part adds
never changes what an earlier one showed.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.files.arrays import FloatArray

FRAMES_PER_SECOND: Final = 30.0
"""How often what moves in the scene is shown; no more than a video has."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Part:
    """Rows and forecasts of an episode from some row and forecast on.

    Attributes:
        log: The episode so far.
        first_row: The first of its rows that has not been shown.
        first_forecast: The first of its forecasts that has not been shown.
    """

    log: EpisodeLog
    first_row: int = 0
    first_forecast: int = 0

    def frames(self) -> NDArray[np.intp]:
        """Rows at which moving things are shown, evenly spaced, and the last row."""
        every = max(1, round(1.0 / (FRAMES_PER_SECOND * self.log.dt)))
        last = self.log.times.size - 1
        start = -(-self.first_row // every) * every
        return np.unique(np.append(np.arange(start, last, every), last))

    def shows(self, values: FloatArray) -> bool:
        """Whether any of a series' values (T, ...) in this part is finite."""
        return bool(np.isfinite(values[self.first_row :]).any())

    def begins(self, values: FloatArray) -> bool:
        """Whether none of a series' values (T, ...) before this part was finite."""
        return not np.isfinite(values[: self.first_row]).any()
