"""Bringing two demonstrations onto one clock: interpolation and time warping."""

import warnings
from collections.abc import Sequence
from functools import partial

import numpy as np

from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.speed.peers import NOT_INSTALLED, dtw_python, installed
from gplfd_experiments.speed.report import Measurement, at_least
from gplfd_experiments.speed.timing import Timed, measure, repeated
from gplfd_policies.demonstrations.alignment import align
from gplfd_policies.demonstrations.completion import measure_completion
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.demonstrations.dynamic_time_warping import dynamic_time_warping

_SIZES = (200, 1000, 5000)
_MATCH, _MATCH_PEER = "matching: interpolation", "matching: dtw-python"
_ALIGN = "align(), interpolation"


def measure_alignment(repeats: int) -> Measurement:
    """Time alignment at 200, 1000 and 5000 samples, beside dtw-python's.

    Args:
        repeats: Measurements of each.
    """
    rng = np.random.default_rng(0)
    recorded = Teacher().demonstrate_doors((0.35, 0.65), 1, rng=rng)
    with warnings.catch_warnings():
        # Sensor noise is part of the demonstrations, and `align` says so.
        warnings.simplefilter("ignore", UserWarning)
        times = {size: measure(_candidates(recorded, size), repeats) for size in _SIZES}
    at_1000 = times[1000]
    targets = tuple(
        at_least(
            f"align: dtw-python's matching / {ours}, 1000 samples",
            at_1000[_MATCH_PEER].cpu_over(at_1000[line]),
            100.0,
        )
        for ours, line in (("ours", _MATCH), ("whole align()", _ALIGN))
        if _MATCH_PEER in at_1000
    )
    return Measurement(
        title="align: two demonstrations, CPU ms [quartiles]; matching alone starts "
        "from completion indices",
        rows={
            line: {
                f"{size} samples": times[size].get(line, NOT_INSTALLED)
                for size in _SIZES
            }
            for line in (*at_1000, _MATCH_PEER)
        },
        targets=targets,
    )


def resampled(recorded: Demonstration, size: int) -> Demonstration:
    """Return a demonstration at equal steps of its own time."""
    times = np.linspace(recorded.times[0], recorded.times[-1], size)
    columns = [np.interp(times, recorded.times, column) for column in recorded.poses.T]
    return Demonstration(times=times, poses=np.column_stack(columns))


def _candidates(recorded: Sequence[Demonstration], size: int) -> dict[str, Timed]:
    """What is timed with two demonstrations, resampled to a size."""
    two = [resampled(demo, size) for demo in recorded]

    def completions() -> list[FloatArray]:
        return [measure_completion(demo, 0.5, denoise=True).index for demo in two]

    first, second = completions()
    many = max(1, 5000 // size)
    candidates = {
        "completion indices of both": repeated(completions, many),
        # ζ rises, so the match of each sample of one is where the other reaches it.
        _MATCH: repeated(partial(np.interp, first, second, np.arange(size)), many),
        "matching: our exact DTW": repeated(
            lambda: dynamic_time_warping(lambda row: np.abs(second - first[row]), size)
        ),
        _ALIGN: repeated(partial(align, two), many),
        "align(), dtw": repeated(partial(align, two, method="dtw")),
    }
    if installed("dtw"):
        candidates[_MATCH_PEER] = repeated(partial(dtw_python, first, second))
    return candidates
