"""Tables of a study for the terminal and table.md: a row per door or per task."""

import csv
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from gplfd_experiments.analysis.results.measures import (
    EPISODE_MEASURES,
    WALL_TIME,
    Measure,
    by_door_kind,
    by_policy,
    closed_because,
    grouped,
)
from gplfd_experiments.analysis.results.reading import (
    EpisodeResult,
    StudyResults,
    read_files,
)
from gplfd_experiments.analysis.results.statistics import success_rate
from gplfd_experiments.episodes.failures import why_closed
from gplfd_experiments.episodes.metrics import late_decisions
from gplfd_experiments.files.libraries import optional_libraries
from gplfd_experiments.files.table import Table, markdown_table
from gplfd_experiments.studies.settings import Condition, StudySettings
from gplfd_experiments.studies.store import result_path
from gplfd_experiments.studies.tasks import conditions, episodes
from gplfd_policies.arrays.storage import complete_or_absent

_OF_SOLVED: Final = (
    replace(EPISODE_MEASURES["time_to_60_deg"], digits=1),
    replace(EPISODE_MEASURES["force_radial_peak"], short="radial force"),
    replace(EPISODE_MEASURES["force_tangential_peak"], short="tangential"),
    EPISODE_MEASURES["slip_max_mm"],
)
_OF_ALL: Final = (
    EPISODE_MEASURES["prediction_error_position"],
    EPISODE_MEASURES["governed_share"],
    EPISODE_MEASURES["latency_median_ms"],
    EPISODE_MEASURES[WALL_TIME],
)
_OF_RUN: Final = (
    EPISODE_MEASURES["radius"],
    EPISODE_MEASURES["final_angle_deg"],
    replace(EPISODE_MEASURES["time_to_30_deg"], digits=1),
    *_OF_SOLVED,
    EPISODE_MEASURES["prediction_error_position"],
    EPISODE_MEASURES["latency_wall_p95_ms"],
)


_Group = tuple[str, str, list[EpisodeResult], list[EpisodeResult], list[EpisodeResult]]
"""A policy's episodes at a door: all, those that count, and those that were solved."""


def _by_policy_and_door(episodes: Iterable[EpisodeResult]) -> Iterator[_Group]:
    groups = grouped(episodes, lambda one: (one.policy, one.task.door))
    for (policy, door), own in groups.items():
        known = [one for one in own if one.counts]
        yield policy, door, own, known, [one for one in known if one.solved]


def _medians(
    known: Sequence[EpisodeResult], solved: Sequence[EpisodeResult]
) -> list[tuple[Measure, float | None]]:
    of_solved = [(one, one.median(solved)) for one in _OF_SOLVED]
    return of_solved + [(one, one.median(known)) for one in _OF_ALL]


def remarks(episodes: Sequence[EpisodeResult]) -> list[str]:
    """Return notes for readers of rates: errors, lost episodes."""

    def of_all(some: Sequence[EpisodeResult]) -> str:
        return f"{len(some)} of {len(episodes)} episodes"

    def whose(some: Sequence[EpisodeResult]) -> str:
        return ", ".join(f"{name} {len(own)}" for name, own in by_policy(some).items())

    said = []
    if raised := [one for one in episodes if one.error and one.counts]:
        said.append(
            f"{of_all(raised)} ended in an error of the policy and count as not opened:"
            f" {whose(raised)}."
        )
    if lost := [one for one in episodes if one.lost]:
        said.append(
            f"{of_all(lost)} were lost, because the machine failed, and are excluded; "
            f"run the study again: {whose(lost)}."
        )
    measured = [one for one in episodes if not one.error]
    for name, own in by_policy(measured).items():
        if late := late_decisions([one.metrics for one in own]):
            said.append(f"{name}: {late}.")
    return said


def study_table(episodes: Sequence[EpisodeResult]) -> Table:
    """Return a row per policy and door, in groups if there are several kinds of doors.

    Rates are over all episodes except lost ones; after an error of the policy, the door
    counts as not opened. Forces, slip and times are medians over the successes. The
    prediction error, the share of decisions in which the stability bound limited the
    stiffness, and the CPU and wall time of a decision are medians over all episodes
    that have them. The last column counts the reasons why doors stayed closed.
    """
    errors = any(one.error for one in episodes if one.counts)
    closed = any(not one.solved for one in episodes if one.counts)
    columns = (
        *("policy", "door", "opened", "95 %"),
        *(["errors"] if errors else []),
        *(one.column for one in (*_OF_SOLVED, *_OF_ALL)),
        *(["not opened because"] if closed else []),
    )
    kinds = by_door_kind(episodes)
    rows: list[tuple[str, ...]] = []
    for kind, here in kinds.items():
        if len(kinds) > 1:
            rows.append((f"**{kind}**", *("" for _ in columns[1:])))
        for policy, door, own, known, solved in _by_policy_and_door(here):
            rate = success_rate((one.task.seed, one.solved) for one in known)
            row = (
                *(policy, door, f"{rate.successes}/{rate.trials}", rate.interval),
                *([str(sum(bool(one.error) for one in known))] if errors else []),
                *(one.text(value) for one, value in _medians(known, solved)),
                *([closed_because(own)] if closed else []),
            )
            rows.append(row)
    return Table(columns=columns, rows=tuple(rows))


def run_table(metrics: Sequence[Mapping[str, Any]]) -> Table:
    """Return the main metrics of a run, a row per door."""
    any_closed = not all(row["success"] for row in metrics)

    def text(measure: Measure, row: Mapping[str, Any]) -> str:
        value = row.get(measure.metric)
        return measure.text(None if value is None else measure.convert(value))

    heads = (measure.column.replace(" [", "\n[") for measure in _OF_RUN)
    rows = (
        (
            row["door"],
            "yes" if row["success"] else "no",
            *(text(measure, row) for measure in _OF_RUN),
            *([why_closed(row["failure"], row.get("reason", ""))] * any_closed),
        )
        for row in metrics
    )
    why = ("not opened because",) if any_closed else ()
    return Table(columns=("door", "opened", *heads, *why), rows=tuple(rows))


def write_tables(folder: Path, settings: StudySettings) -> str:
    """Write DIR/table.md, a table per condition of the study, and return its text."""
    parts: list[str] = []
    several = list(conditions(settings))
    for condition in several:
        results, unreadable = _results(folder, settings, condition)
        if len(several) > 1:
            parts.append(f"{condition}:")
        parts += [*remarks(results), *unreadable]
        parts.append(markdown_table(study_table(results)))
    text = "\n\n".join(parts)
    with complete_or_absent(folder / "table.md") as path:
        path.write_text(text + "\n", encoding="utf-8")
    return text


def study_rows(folder: Path, settings: StudySettings) -> list[dict[str, Any]]:
    """Return the numbers of the tables: a row per condition, policy and door.

    Each has ``condition``, ``policy``, ``door``, its ``door_kind``, ``episodes`` that
    count, ``opened``, ``errors`` of the policy, which count as not opened, ``lost``
    episodes, which do not count, and, by the names of their metrics, the medians of
    `study_table` in its units; None without values.
    """
    return [
        {
            "condition": str(condition),
            "policy": policy,
            "door": door,
            "door_kind": own[0].door_kind,
            "episodes": len(known),
            "opened": len(solved),
            "errors": sum(bool(one.error) for one in known),
            "lost": len(own) - len(known),
            **{one.metric: value for one, value in _medians(known, solved)},
        }
        for condition in conditions(settings)
        for policy, door, own, known, solved in _by_policy_and_door(
            _results(folder, settings, condition)[0]
        )
    ]


def _results(
    folder: Path, settings: StudySettings, condition: Condition
) -> tuple[list[EpisodeResult], Sequence[str]]:
    """Return a condition's episodes, and remarks on files that cannot be read."""
    tasks = episodes(settings, condition, range(settings.seeds))
    found, unreadable = read_files(result_path(folder, task) for task in tasks)
    return [one for one in found if isinstance(one, EpisodeResult)], unreadable


def write_rows(path: Path, results: StudyResults) -> None:
    """Write fields and metrics of every task; None as an empty cell, lists as JSON.

    Raises ValueError for another suffix, ModuleNotFoundError without pyarrow.
    """
    if path.suffix not in (".csv", ".parquet"):
        raise ValueError(f"{path} must end in .csv or .parquet")
    found = [
        {**one.task.definition, "error": one.error, "code": one.code, **one.metrics}
        for one in results.all
    ]
    columns = dict.fromkeys(name for row in found for name in row)
    plain = bool | int | float | str | None
    rows = [
        {n: v if isinstance(v := row.get(n), plain) else json.dumps(v) for n in columns}
        for row in found
    ]
    with complete_or_absent(path) as temporary:
        if path.suffix == ".csv":
            with temporary.open("w", newline="", encoding="utf-8") as file:
                writer = csv.DictWriter(file, columns)
                writer.writeheader()
                writer.writerows(rows)
        else:
            with optional_libraries("Parquet needs pyarrow", "lerobot"):
                import pyarrow.parquet
            pyarrow.parquet.write_table(pyarrow.Table.from_pylist(rows), temporary)
