"""What trials answered, as small JSON: what is kept of ten thousand result files."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from gplfd_experiments.analysis.results.records import EpisodeResult, StudyResults
from gplfd_experiments.analysis.results.statistics import Rate, Shift
from gplfd_experiments.analysis.results.trials import (
    answered,
    of_trial,
    seed_means,
    summary,
)
from gplfd_experiments.studies.trials.protocol import TRIALS, VERSION
from gplfd_experiments.studies.trials.records import Trial

FILE: Final = "trials.json"
"""Name of the file in the folder of a report."""

_DIGITS: Final = 5


def trial_answers(results: StudyResults) -> dict[str, Any]:
    """Return every number of a policy in a trial, seed by seed, and every contrast.

    Args:
        results: Of a study; what belongs to no trial is left out.

    Returns:
        JSON-able, numbers to five digits; without trials an empty mapping of them.
    """
    found = {name: of_trial(results.episodes, name) for name in TRIALS}
    held = {name: own for name, own in found.items() if own}
    return {
        "protocol": VERSION,
        "code": sorted({one.code for one in results.episodes if one.task.trial}),
        "trials": {
            name: _trial(TRIALS[name], policies) for name, policies in held.items()
        },
        "contrasts": [
            entry for name, own in held.items() for entry in _contrasts(name, own)
        ],
    }


def _trial(
    trial: Trial, policies: Mapping[str, Mapping[str, Sequence[EpisodeResult]]]
) -> dict[str, Any]:
    """Return numbers by level, policy and measure."""
    return {
        level: {
            policy: {
                "episodes": len(own),
                "errors": sum(bool(one.error) for one in own if one.counts),
                "lost": sum(one.lost for one in own),
                **{measure: _measure(own, measure) for measure in trial.measures},
            }
            for policy, levels in policies.items()
            if (own := levels.get(level))
        }
        for level in trial.levels
    }


def _measure(episodes: Sequence[EpisodeResult], measure: str) -> dict[str, Any]:
    means = [_rounded(mean) for mean in seed_means(episodes, measure)]
    return {**_interval(summary(episodes, measure)), "seeds": means}


def _contrasts(
    name: str, policies: Mapping[str, Mapping[str, Sequence[EpisodeResult]]]
) -> Iterator[dict[str, Any]]:
    for contrast in TRIALS[name].contrasts:
        answer = answered(contrast, policies)
        yield {
            "idea": contrast.idea,
            "trial": name,
            "measure": contrast.measure,
            "with": str(contrast.having),
            "without": str(contrast.lacking),
            **_interval(answer.shift),
            "verdict": answer.verdict,
        }


def _interval(found: Rate | Shift | None) -> dict[str, float | None]:
    """Return an estimate and its 95 % interval; None for what is not known."""
    if found is None:
        return dict.fromkeys(("estimate", "low", "high"))
    return {
        name: _rounded(getattr(found, name)) for name in ("estimate", "low", "high")
    }


def _rounded(value: float) -> float | None:
    return float(f"{value:.{_DIGITS}g}") if math.isfinite(value) else None
