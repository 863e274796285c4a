"""Tables of a study for the terminal and table.md: a row per door or per task."""

import csv
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from gplfd_experiments.analysis.results.measures import (
    EPISODE_MEASURES,
    WALL_TIME,
    Measure,
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
from gplfd_experiments.studies.settings import StudySettings
from gplfd_experiments.studies.store import result_path
from gplfd_experiments.studies.tasks import conditions, episodes
from gplfd_policies.arrays.storage import complete_or_absent

_OF_SOLVED: Final = (
    replace(EPISODE_MEASURES["force_radial_peak"], short="radial force"),
    replace(EPISODE_MEASURES["time_to_60_deg"], digits=1),
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
    EPISODE_MEASURES["final_angle_deg"],
    *_OF_SOLVED,
    EPISODE_MEASURES["radius"],
    replace(EPISODE_MEASURES["time_to_30_deg"], digits=1),
    EPISODE_MEASURES["prediction_error_position"],
    EPISODE_MEASURES["latency_wall_p95_ms"],
)
_WHY: Final = 4
"""Place of the column with the reason why a door stayed closed: among the first."""


def study_rows(results: Iterable[EpisodeResult]) -> list[dict[str, Any]]:
    """Return the numbers of a table: a row per policy and door.

    Each has ``policy``, ``door``, its ``door_kind``, ``episodes`` that count,
    ``opened`` with its 95 % ``interval``, ``errors`` of the policy, which count as not
    opened, ``lost`` episodes, which do not count, and ``not_opened_because``. Medians
    are named by their metrics: time, forces and slip over the doors that were opened,
    the others over all episodes that have them; None without values.
    """
    rows = []
    groups = grouped(results, lambda result: (result.policy, result.task.door))
    for (policy, door), group in groups.items():
        counting = [result for result in group if result.counts]
        solved = [result for result in counting if result.solved]
        rate = success_rate((r.task.seed, r.solved) for r in counting)
        row = {
            "policy": policy,
            "door": door,
            "door_kind": group[0].door_kind,
            "episodes": rate.trials,
            "opened": rate.successes,
            "interval": rate.interval,
            "errors": sum(bool(result.error) for result in counting),
            "lost": len(group) - len(counting),
            "not_opened_because": closed_because(group),
        }
        row |= {measure.metric: measure.median(solved) for measure in _OF_SOLVED}
        row |= {measure.metric: measure.median(counting) for measure in _OF_ALL}
        rows.append(row)
    return rows


def study_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Return the table of `study_rows`, grouped if there are several kinds of doors."""
    errors, closed = (
        any(row[name] for row in rows) for name in ("errors", "not_opened_because")
    )
    first, *solved = _OF_SOLVED
    columns = (
        *("policy", "door", "opened", first.column),
        *(["not opened because"] if closed else []),
        *(measure.column for measure in solved),
        *("95 %", *(["errors"] if errors else [])),
        *(measure.column for measure in _OF_ALL),
    )
    cells: list[tuple[str, ...]] = []

    def texts(row: Mapping[str, Any], measures: Iterable[Measure]) -> list[str]:
        return [measure.text(row[measure.metric]) for measure in measures]

    kinds = dict.fromkeys(row["door_kind"] for row in rows)
    for kind in kinds:
        if len(kinds) > 1:
            cells.append((f"**{kind}**", *("" for _ in columns[1:])))
        cells += [
            (
                *(row["policy"], row["door"], f"{row['opened']}/{row['episodes']}"),
                *texts(row, [first]),
                *([row["not_opened_because"]] if closed else []),
                *texts(row, solved),
                *(row["interval"], *([str(row["errors"])] if errors else [])),
                *texts(row, _OF_ALL),
            )
            for row in rows
            if row["door_kind"] == kind
        ]
    return Table(columns=columns, rows=tuple(cells))


def remarks(results: Sequence[EpisodeResult]) -> list[str]:
    """Return notes for readers of rates: errors, lost episodes, late decisions."""
    texts = []
    for failed, text in (
        (
            [result for result in results if result.error and result.counts],
            "ended in an error of the policy and count as not opened",
        ),
        (
            [result for result in results if result.lost],
            "were lost, because the machine failed, and are excluded; run the study "
            "again",
        ),
    ):
        if failed:
            policies = by_policy(failed).items()
            numbers = ", ".join(f"{name} {len(group)}" for name, group in policies)
            texts.append(f"{len(failed)} of {len(results)} episodes {text}: {numbers}.")
    for name, group in by_policy(r for r in results if not r.error).items():
        if late := late_decisions([result.metrics for result in group]):
            texts.append(f"{name}: {late}.")
    return texts


def run_table(metrics: Sequence[Mapping[str, Any]]) -> Table:
    """Return the main metrics of a run, a row per door."""
    any_closed = not all(episode["success"] for episode in metrics)
    rows = []
    for episode in metrics:
        cells = [episode["door"], "yes" if episode["success"] else "no"]
        for measure in _OF_RUN:
            value = episode.get(measure.metric)
            cells.append(
                measure.text(None if value is None else measure.convert(value))
            )
        if any_closed:
            why = why_closed(episode["failure"], episode.get("reason", ""))
            cells.insert(_WHY, why)
        rows.append(tuple(cells))
    columns = ["door", "opened", *(measure.column for measure in _OF_RUN)]
    if any_closed:
        columns.insert(_WHY, "not opened because")
    heads = (column.replace(" [", "\n[") for column in columns)
    return Table(columns=tuple(heads), rows=tuple(rows))


def write_tables(
    folder: Path, settings: StudySettings
) -> tuple[list[str | Table], list[dict[str, Any]]]:
    """Write DIR/table.md, a table per condition of a study.

    Returns its texts and tables, and the `study_rows` of all conditions, each with its
    ``condition``.
    """
    parts: list[str | Table] = []
    rows: list[dict[str, Any]] = []
    several = list(conditions(settings))
    for condition in several:
        tasks = episodes(settings, condition, range(settings.seeds))
        read, unreadable = read_files(result_path(folder, task) for task in tasks)
        results = [result for result in read if isinstance(result, EpisodeResult)]
        if len(several) > 1:
            parts.append(f"{condition}:")
        here = study_rows(results)
        parts += [*remarks(results), *unreadable, study_table(here)]
        rows += [{"condition": str(condition), **row} for row in here]
    text = "\n\n".join(
        part if isinstance(part, str) else markdown_table(part) for part in parts
    )
    with complete_or_absent(folder / "table.md") as path:
        path.write_text(text + "\n", encoding="utf-8")
    return parts, rows


def write_rows(path: Path, results: StudyResults) -> None:
    """Write fields and metrics of every task; None as an empty cell, lists as JSON.

    Raises ValueError for another suffix, ModuleNotFoundError without pyarrow.
    """
    if path.suffix not in (".csv", ".parquet"):
        raise ValueError(f"{path} must end in .csv or .parquet")
    tasks = [
        {**result.task.definition, "error": result.error, "code": result.code}
        | dict(result.metrics)
        for result in results.all
    ]
    columns = dict.fromkeys(name for row in tasks for name in row)
    plain = bool | int | float | str | None
    rows = [
        {n: v if isinstance(v := row.get(n), plain) else json.dumps(v) for n in columns}
        for row in tasks
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
