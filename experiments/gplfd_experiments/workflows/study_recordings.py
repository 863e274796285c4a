"""Recordings of a study's episodes: extremes of every policy, policies side by side.

A study stores metrics, but no logs. Its episodes are deterministic, so that selected
ones are run again, and their metrics are compared with the stored ones. All must be
equal except the times.
"""

import contextlib
import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np

from gplfd_experiments.analysis.report.recordings import (
    COMPARISONS,
    FOLDER,
    INDEX,
    RANKS,
    recording_name,
    trial_recording_name,
)
from gplfd_experiments.analysis.results.measures import by_condition, by_policy, ranked
from gplfd_experiments.analysis.results.reading import (
    NON_STANDARD,
    EpisodeResult,
    read_results,
)
from gplfd_experiments.analysis.results.trials import ByLevel, of_trials
from gplfd_experiments.console.progress import LOG
from gplfd_experiments.data.teacher import DEMONSTRATED_RADII
from gplfd_experiments.episodes.build import demonstrations_of, make_environment
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.metrics import episode_metrics
from gplfd_experiments.episodes.task import EpisodeTask
from gplfd_experiments.files.plain_data import write_json
from gplfd_experiments.recording import record_episode
from gplfd_experiments.recording.comparison import (
    MEASURED,
    RADIAL,
    record_comparison,
)
from gplfd_experiments.studies.jobs import episode_log
from gplfd_experiments.studies.trials.protocol import TRIALS
from gplfd_experiments.studies.trials.records import Side, Trial
from gplfd_policies.demonstrations.demonstration import Demonstration

COMPARED: Final = 6
"""Largest number of policies in a comparison; more would be too small."""

_IN_EVERY_TRIAL: Final = (Side(policy="gp"), Side(policy="hinge-fit"))
_FORECAST_PERIOD: Final = 0.2
"""Shortest time between forecasts in a recording [s]; the study has more forecasts."""
_TIMED: Final = ("latency_", "cpu_")
"""Prefixes of metrics that differ from run to run."""


def record_extremes(folder: Path, reference: str = "gp") -> Path:
    """Record episodes of a study's standard condition, and comparisons.

    Writes recordings/<policy>-best.rrd, -median.rrd and -worst.rrd, comparison.rrd and
    comparison-widest.rrd (policies side by side, the reference first, at the
    demonstrated door in the middle and at the widest) and index.json, which says what
    each file shows and whether its repetition has the stored numbers. If a policy
    raises an error in the repetition, the entry contains the error instead of a
    recording.
    """
    conditions = by_condition(read_results(folder).episodes)
    standard = [one for one in next(iter(conditions.values()), []) if not one.error]
    out = folder / FOLDER
    entries: list[dict[str, Any]] = []
    for policy, own in by_policy(standard).items():
        for rank, episode in extremes(own).items():
            file = recording_name(policy, rank)
            LOG.info("recording %s", file)
            again, entry = _repeated(episode)
            entries.append({"file": file, "rank": rank, **entry})
            if again is not None:
                record_episode(out / file, again.log, again.model, again.demonstrations)
    comparisons = []
    radii = sorted(DEMONSTRATED_RADII)
    shown = (radii[len(radii) // 2], radii[-1])
    for file, radius in zip(COMPARISONS, shown, strict=True):
        if compared := same_door(standard, radius, reference):
            comparisons.append(_compare(out / file, compared))
    write_json(out / INDEX, {"episodes": entries, "comparisons": comparisons})
    return out / INDEX


def extremes(episodes: Sequence[EpisodeResult]) -> dict[str, EpisodeResult]:
    """Return the best, the median and the worst of some episodes that ran.

    Two episodes have no median; a single one is the best.
    """

    def rank(one: EpisodeResult) -> tuple[bool, float, float, str]:
        force = one.number("force_radial_peak")
        angle = one.number("final_angle_deg")
        return (
            not one.solved,
            math.inf if force is None else force,
            math.inf if angle is None else -angle,
            one.pair,
        )

    order = sorted(episodes, key=rank)
    ranks = {0: (), 1: RANKS[:1], 2: (RANKS[0], RANKS[-1])}.get(len(order), RANKS)
    places = {"best": 0, "median": len(order) // 2, "worst": len(order) - 1}
    return {rank: order[places[rank]] for rank in ranks}


def same_door(
    episodes: Sequence[EpisodeResult], radius: float, reference: str
) -> dict[str, EpisodeResult]:
    """Return an episode per policy: a standard door of a radius [m], the first seed.

    The reference is first, then the policies by success; if there are more than
    `COMPARED`, a selection from the best to the worst.
    """
    same = [
        one
        for one in episodes
        if one.split != NON_STANDARD and math.isclose(one.radius, radius)
    ]
    # Doors of another kind may have the same radius.
    same = [one for one in same if one.door_kind == same[0].door_kind]
    first = min((one.task.seed for one in same), default=0)
    found = {one.policy: one for one in same if one.task.seed == first}
    order = [name for name in ranked(episodes) if name in found]
    order.sort(key=lambda name: name != reference)
    if len(order) > COMPARED:
        step = (len(order) - 2) / (COMPARED - 2)
        order = [order[0], *(order[1 + round(n * step)] for n in range(COMPARED - 1))]
    return {name: found[name] for name in order}


def record_trials(folder: Path) -> Path:
    """Record a comparison of every trial in a folder of `gplfd trials`.

    Writes recordings/trial-<name>.rrd and an index.json like `record_extremes`.
    """
    out = folder / FOLDER
    comparisons: list[dict[str, Any]] = []
    for name, episodes in of_trials(read_results(folder)).items():
        trial = TRIALS[name]
        if shown := side_by_side(trial, episodes):
            measure = next((one for one in trial.measures if one in MEASURED), RADIAL)
            heading = f"Trial {name}: {trial.question}"
            levels = {one.task.level for one in shown.values()}
            if len(levels) == 1 < len(trial.levels):
                heading += f" ({levels.pop()})"
            path = out / trial_recording_name(name)
            comparisons.append(_compare(path, shown, measure, heading))
    write_json(out / INDEX, {"episodes": [], "comparisons": comparisons})
    return out / INDEX


def side_by_side(trial: Trial, episodes: ByLevel) -> dict[str, EpisodeResult]:
    """Return the episodes of a trial to compare, at most `COMPARED`, by their labels.

    The first is of the first seed, at the widest door; the others open the same door.
    """
    contrasts = [side for one in trial.contrasts for side in (one.having, one.lacking)]
    found: dict[Side, EpisodeResult] = {}
    for side in (*_IN_EVERY_TRIAL, *contrasts):
        levels = {
            level: [one for one in own if not one.error]
            for level, own in episodes.get(side.policy, {}).items()
        }
        there = [level for level in trial.levels if levels.get(level)]
        # A policy without learning has no level with a prior mean.
        level = side.level or next(reversed(there), "")
        if level not in there:
            continue
        own = levels[level]
        if found:
            first = next(iter(found.values()))
            own = [one for one in own if _opened(one) == _opened(first)]
        if own:
            found[Side(policy=side.policy, level=level)] = min(
                own, key=lambda one: (one.task.seed, -one.radius, one.pair)
            )
    several = len({side.level for side in found}) > 1
    shown = list(found.items())[:COMPARED]
    return {str(side) if several else side.policy: one for side, one in shown}


def _opened(one: EpisodeResult) -> tuple[object, ...]:
    """Return what determines the door of an episode and its draws."""
    return one.task.door_config, one.task.randomization, one.task.reset_seed


def _compare(
    path: Path,
    compared: Mapping[str, EpisodeResult],
    measure: str = RADIAL,
    heading: str = "",
) -> dict[str, Any]:
    """Record episodes on one door side by side, by their labels; return the entry.

    Episodes that cannot be run again are left out.
    """
    LOG.info("recording %s", path.name)
    found = {name: _repeated(episode) for name, episode in compared.items()}
    entries = [entry for _, entry in found.values()]
    repeated = {name: again for name, (again, _) in found.items() if again is not None}
    if not repeated:
        return {"file": None, "episodes": entries}
    logs = [
        dataclasses.replace(again.log, policy=name) for name, again in repeated.items()
    ]
    one = next(iter(repeated.values()))
    shown = (logs, one.model, one.demonstrations)
    record_comparison(path, *shown, measure=measure, heading=heading)
    return {"file": path.name, "episodes": entries}


@dataclass(frozen=True, kw_only=True, slots=True)
class Repeated:
    """A repeated episode."""

    log: EpisodeLog
    """Its log, with as many forecasts as can be shown."""
    model: mujoco.MjModel
    """Model of its scene, without the gains of the servos."""
    demonstrations: tuple[Demonstration, ...]
    """Demonstrations of the policy."""
    different: Mapping[str, Any]
    """Stored and repeated values of metrics that differ."""


def _repeated(episode: EpisodeResult) -> tuple[Repeated | None, dict[str, Any]]:
    """Repeat an episode; return it, if it ran, and the entry of the index."""
    entry = {
        "policy": episode.policy,
        "door": episode.task.door,
        "radius": episode.radius,
        "seed": episode.task.seed,
        "success": episode.solved,
        "force_radial_peak": episode.number("force_radial_peak"),
        "final_angle_deg": episode.number("final_angle_deg"),
    }
    try:
        again = repeat(episode)
    # A policy may raise any exception; the other recordings are still made.
    except Exception as error:
        reason = f"{type(error).__name__}: {error}"
        return None, {**entry, "repeated": False, "error": reason}
    different = dict(again.different)
    return again, {**entry, "repeated": not different, "different": different}


def repeat(episode: EpisodeResult) -> Repeated:
    """Repeat an episode of the study, and compare it with the stored result."""
    task = episode.task
    log = episode_log(task)
    metrics = episode_metrics(log, demonstrated_angle=task.teacher["angle_mean"])
    times = log.forecast_times
    if times.size >= 2:
        every = max(1, round(_FORECAST_PERIOD / float(np.median(np.diff(times)))))
        kept = np.unique(np.append(np.arange(0, times.size, every), times.size - 1))
        log = dataclasses.replace(
            log,
            forecast_times=times[kept],
            forecast_mean=log.forecast_mean[kept],
            forecast_std=log.forecast_std[kept],
        )
    return Repeated(
        log=log,
        model=model_of(task),
        demonstrations=demonstrations_of(task).demonstrations,
        different=differences(episode.metrics, metrics.as_json()),
    )


def differences(
    stored: Mapping[str, Any], repeated: Mapping[str, Any]
) -> dict[str, list[Any]]:
    """Return the common metrics that differ, except times."""
    return {
        name: [stored[name], repeated[name]]
        for name in sorted(stored.keys() & repeated.keys())
        if not name.startswith(_TIMED) and stored[name] != repeated[name]
    }


def model_of(task: EpisodeTask) -> mujoco.MjModel:
    """Return the model of the scene of the task's episode."""
    with contextlib.closing(make_environment(task, "pose")) as env:
        env.reset(seed=task.reset_seed)
        return env.unwrapped.model  # type: ignore[attr-defined]
