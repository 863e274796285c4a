"""A recording per trial: who decides it, side by side.

The protocol's best-known policies and both sides of every contrast open the same door,
under the trial's last level, with the first seed.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from gplfd_experiments.analysis.report.recordings import (
    FOLDER,
    INDEX,
    trial_recording_name,
)
from gplfd_experiments.analysis.results.reading import read_results
from gplfd_experiments.analysis.results.records import EpisodeResult
from gplfd_experiments.analysis.results.trials import of_trial
from gplfd_experiments.console.progress import LOG
from gplfd_experiments.files.plain_data import write_json
from gplfd_experiments.recording.comparison import MEASURED, RADIAL
from gplfd_experiments.studies.trials.protocol import TRIALS
from gplfd_experiments.studies.trials.records import Side, Trial
from gplfd_experiments.workflows.extremes import COMPARED, compare

_ALWAYS: Final = (Side(policy="gp"), Side(policy="hinge-fit"))


def record_trials(folder: Path) -> Path:
    """Record a comparison of every trial that a folder has.

    Writes recordings/trial-<name>.rrd and index.json, which says what each file shows
    and whether its repetition has the stored numbers.

    Args:
        folder: Of `gplfd trials`.

    Returns:
        The path of the index.

    Raises:
        FileNotFoundError: There is no such folder.
        ValueError: It is not the folder of a study.
        OSError: A file cannot be written.
    """
    episodes = read_results(folder).episodes
    out = folder / FOLDER
    entries: list[dict[str, Any]] = []
    for name, trial in TRIALS.items():
        if shown := side_by_side(trial, of_trial(episodes, name)):
            file = trial_recording_name(name)
            LOG.info("recording %s", file)
            measure = next((one for one in trial.measures if one in MEASURED), RADIAL)
            heading = f"Trial {name}: {trial.question}"
            levels = {one.task.level for one in shown.values()}
            if len(levels) == 1 < len(trial.levels):
                heading += f" ({levels.pop()})"
            entries.append(compare(out / file, shown, measure, heading))
    write_json(out / INDEX, {"episodes": [], "comparisons": entries})
    return out / INDEX


def side_by_side(
    trial: Trial, episodes: Mapping[str, Mapping[str, Sequence[EpisodeResult]]]
) -> dict[str, EpisodeResult]:
    """Return the episodes to compare by what each is called, at most `COMPARED`.

    Args:
        trial: What was asked.
        episodes: Its own, by policy and level.
    """
    contrasts = [side for one in trial.contrasts for side in (one.having, one.lacking)]
    found: dict[Side, EpisodeResult] = {}
    for side in (*_ALWAYS, *contrasts):
        levels = {
            level: [one for one in own if not one.error]
            for level, own in episodes.get(side.policy, {}).items()
        }
        there = [level for level in trial.levels if levels.get(level)]
        # Who learns nothing has no level with a prior mean.
        level = side.level or next(reversed(there), "")
        if level in there:
            one = _first(levels[level])
            found[Side(policy=side.policy, level=level)] = one
    many = len({side.level for side in found}) > 1
    shown = list(found.items())[:COMPARED]
    return {str(side) if many else side.policy: one for side, one in shown}


def _first(episodes: Sequence[EpisodeResult]) -> EpisodeResult:
    """Of the first seed, at the widest door."""
    return min(episodes, key=lambda one: (one.task.seed, -one.radius, one.pair))
