"""Bringing two demonstrations onto one clock: interpolation and time warping."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from experiments.benchmarks.peers import dtw_python, installed
from experiments.benchmarks.report import NOT_INSTALLED, Table, Target
from experiments.benchmarks.timing import Candidate, CpuTime, interleaved, repeated
from experiments.teacher import Teacher
from policies.alignment import align
from policies.completion import measure_completion
from policies.demonstrations import Demonstration
from policies.dynamic_time_warping import WarpingPath, dynamic_time_warping

__all__ = ["AlignmentTimes", "measure_alignment"]

Array = NDArray[np.float64]

_SIZES = (200, 1000, 5000)
_COMPLETION = "completion indices of both"
_MATCH, _MATCH_DTW, _MATCH_PEER = (
    *("matching: interpolation", "matching: our exact DTW"),
    "matching: dtw-python",
)
_ALIGN, _ALIGN_DTW = "align(), interpolation", "align(), dtw"
_LINES = (_COMPLETION, _MATCH, _MATCH_DTW, _MATCH_PEER, _ALIGN, _ALIGN_DTW)


@dataclass(frozen=True, kw_only=True, slots=True)
class AlignmentTimes:
    """Two demonstrations of equally many samples."""

    times: Mapping[int, Mapping[str, CpuTime]]
    """CPU time by samples per demonstration, then by what was done."""

    def tables(self) -> tuple[Table, ...]:
        """What was done down, samples across."""
        return (
            Table(
                title="align: two demonstrations, CPU ms [quartiles]; matching alone "
                "starts from completion indices",
                columns=("", *(f"{size} samples" for size in self.times)),
                rows=tuple(
                    (name, *(self._cell(size, name) for size in self.times))
                    for name in _LINES
                ),
            ),
        )

    def _cell(self, size: int, name: str) -> str:
        time = self.times[size].get(name)
        return NOT_INSTALLED if time is None else str(time)

    def targets(self) -> tuple[Target, ...]:
        """Interpolation beside dtw-python at 1000 samples, where it is installed."""
        at_1000 = self.times[1000]
        if _MATCH_PEER not in at_1000:
            return ()
        peer = at_1000[_MATCH_PEER].median
        return (
            Target(
                name="align: dtw-python's matching / ours, 1000 samples",
                value=peer / at_1000[_MATCH].median,
                low=100.0,
            ),
            Target(
                name="align: dtw-python's matching / whole align(), 1000 samples",
                value=peer / at_1000[_ALIGN].median,
                low=100.0,
            ),
        )


def measure_alignment(repeats: int, seed: int = 0) -> AlignmentTimes:
    """Time alignment at 200, 1000 and 5000 samples.

    Args:
        repeats: Measurements of each.
        seed: Seed of the demonstrations.
    """
    recorded = Teacher().demonstrate_doors(
        (0.35, 0.65), 1, rng=np.random.default_rng(seed)
    )
    with warnings.catch_warnings():
        # Sensor noise is part of the demonstrations, and `align` says so.
        warnings.simplefilter("ignore", UserWarning)
        return AlignmentTimes(
            times={
                size: interleaved(
                    _candidates([_resampled(demo, size) for demo in recorded]), repeats
                )
                for size in _SIZES
            }
        )


def _resampled(recorded: Demonstration, size: int) -> Demonstration:
    times = np.linspace(recorded.times[0], recorded.times[-1], size)
    columns = [np.interp(times, recorded.times, column) for column in recorded.poses.T]
    return Demonstration(times=times, poses=np.column_stack(columns))


def _candidates(two: list[Demonstration]) -> dict[str, Candidate]:
    def completions() -> list[Array]:
        return [measure_completion(demo, 0.5, denoise=True).index for demo in two]

    first, second = completions()
    size = len(first)
    many = max(1, 5000 // size)
    candidates = {
        _COMPLETION: repeated(completions, many),
        # ζ rises, so the match of each sample of one is where the other reaches it.
        _MATCH: repeated(partial(np.interp, first, second, np.arange(size)), many),
        _MATCH_DTW: repeated(partial(_warp, first, second)),
        _ALIGN: repeated(partial(align, two), many),
        _ALIGN_DTW: repeated(partial(align, two, method="dtw")),
    }
    if installed("dtw"):
        candidates[_MATCH_PEER] = repeated(partial(dtw_python, first, second))
    return candidates


def _warp(first: Array, second: Array) -> WarpingPath:
    return dynamic_time_warping(
        lambda row: np.abs(second - first[row]), n_rows=len(first)
    )
