"""Tables of a study for the terminal and table.md: a row per door or per task."""

import csv
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from operator import itemgetter
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
from gplfd_experiments.episodes.metrics import late_decisions, why_closed
from gplfd_experiments.files.table import Table, markdown_table
from gplfd_experiments.studies.settings import StudySettings
from gplfd_experiments.studies.store import result_path
from gplfd_experiments.studies.tasks import conditions, episodes
from gplfd_policies.arrays.storage import complete_or_absent

_EPISODE: Final = EPISODE_MEASURES
_OF_SOLVED: Final = (
    replace(_EPISODE["force_radial_peak"], short="radial force"),
    replace(_EPISODE["time_to_60_deg"], digits=1),
    replace(_EPISODE["force_tangential_peak"], short="tangential"),
    _EPISODE["slip_max_mm"],
)
_OF_ALL: Final = (
    *(_EPISODE["prediction_error_position"], _EPISODE["governed_share"]),
    *(_EPISODE["latency_median_ms"], _EPISODE[WALL_TIME]),
)
_OF_RUN: Final = (
    *(_EPISODE["final_angle_deg"], *_OF_SOLVED, _EPISODE["radius"]),
    replace(_EPISODE["time_to_30_deg"], digits=1),
    *(_EPISODE["prediction_error_position"], _EPISODE["latency_wall_p95_ms"]),
)
_WHY: Final = "not opened because"
_Cell = Callable[[Mapping[str, Any]], str]


def study_rows(results: Iterable[EpisodeResult]) -> list[dict[str, Any]]:
    """Return the numbers of a table: a row per policy and door.

    Of ``episodes`` that count, ``opened`` has a 95 % ``interval``; ``errors`` of the
    policy count as not opened, and ``lost`` episodes do not count. Medians are named by
    their metrics: time, forces and slip over the doors that were opened, the others
    over all episodes that have them; None without values.
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


def _metric_text(measure: Measure, row: Mapping[str, Any]) -> str:
    return measure.text(row[measure.metric])


def study_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Return the table of `study_rows`, grouped if there are several kinds of doors."""

    def texts(measures: Iterable[Measure]) -> dict[str, _Cell]:
        return {m.column: partial(_metric_text, m) for m in measures}

    columns: dict[str, _Cell] = {
        "policy": itemgetter("policy"),
        "door": itemgetter("door"),
        "opened": lambda row: f"{row['opened']}/{row['episodes']}",
        **texts(_OF_SOLVED[:1]),
        _WHY: itemgetter("not_opened_because"),
        **texts(_OF_SOLVED[1:]),
        "95 %": itemgetter("interval"),
        "errors": lambda row: str(row["errors"]),
        **texts(_OF_ALL),
    }
    for heading, name in ((_WHY, "not_opened_because"), ("errors", "errors")):
        if not any(row[name] for row in rows):
            del columns[heading]
    cells: list[tuple[str, ...]] = []
    kinds = dict.fromkeys(row["door_kind"] for row in rows)
    for kind in kinds:
        if len(kinds) > 1:
            cells.append((f"**{kind}**", *[""] * (len(columns) - 1)))
        here = (row for row in rows if row["door_kind"] == kind)
        cells += [tuple(cell(row) for cell in columns.values()) for row in here]
    return Table(columns=tuple(columns), rows=tuple(cells))


def remarks(results: Sequence[EpisodeResult]) -> list[str]:
    """Return notes for readers of rates: errors, lost episodes, late decisions."""
    failed = "ended in an error of the policy and count as not opened"
    lost = (
        "were lost, because the machine failed, and are excluded; run the study again"
    )
    texts = []
    for which, text in ((False, failed), (True, lost)):
        some = [result for result in results if result.error and result.lost == which]
        if some:
            groups = by_policy(some).items()
            numbers = ", ".join(f"{name} {len(group)}" for name, group in groups)
            texts.append(f"{len(some)} of {len(results)} episodes {text}: {numbers}.")
    for name, group in by_policy(r for r in results if not r.error).items():
        if late := late_decisions([result.metrics for result in group]):
            texts.append(f"{name}: {late}.")
    return texts


def run_table(metrics: Sequence[Mapping[str, Any]]) -> Table:
    """Return the main metrics of a run, a row per door."""
    any_closed = not all(episode["success"] for episode in metrics)
    rows = []
    for episode in metrics:
        cells = {"door": episode["door"], "opened": "no"}
        if episode["success"]:
            cells["opened"] = "yes"
        for measure in _OF_RUN:
            value = episode.get(measure.metric)
            number = None if value is None else measure.convert(value)
            cells[measure.column.replace(" [", "\n[")] = measure.text(number)
            if any_closed and len(cells) == 4:  # among the first, which are printed
                cells[_WHY] = why_closed(episode["failure"], episode.get("reason", ""))
        rows.append(cells)
    return Table.of(rows)


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
        here = study_rows(results)
        parts += [f"{condition}:"] * (len(several) > 1)
        parts += [*remarks(results), *unreadable, study_table(here)]
        rows += [{"condition": str(condition), **row} for row in here]
    texts = (part if isinstance(part, str) else markdown_table(part) for part in parts)
    with complete_or_absent(folder / "table.md") as path:
        path.write_text("\n\n".join(texts) + "\n", encoding="utf-8")
    return parts, rows


def write_rows(path: Path, results: StudyResults) -> None:
    """Write fields and metrics of every task as CSV; None is empty, lists are JSON."""
    if path.suffix != ".csv":
        raise ValueError(f"{path} must end in .csv")
    tasks = [
        {**result.task.definition, "error": result.error, "code": result.code}
        | dict(result.metrics)
        for result in results.all
    ]
    plain = bool | int | float | str | None
    with (
        complete_or_absent(path) as temporary,
        temporary.open("w", newline="", encoding="utf-8") as file,
    ):
        names = dict.fromkeys(name for row in tasks for name in row)
        writer = csv.DictWriter(file, names)
        writer.writeheader()
        for row in tasks:
            cells = row.items()
            texts = {n: v if isinstance(v, plain) else json.dumps(v) for n, v in cells}
            writer.writerow(texts)
