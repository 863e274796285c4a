"""The measures of results, groups of results, and their tables for the terminal."""

import csv
import json
import math
import statistics
import tomllib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter
from pathlib import Path
from typing import Any, Final, Literal, TypeVar

from gplfd_env.doors.randomization import RANDOMIZATIONS
from gplfd_experiments.analysis.results.reading import (
    EpisodeResult,
    StudyResults,
    TaskResult,
    read_files,
)
from gplfd_experiments.analysis.results.statistics import (
    Estimate,
    number_text,
    shift,
    success_rate,
)
from gplfd_experiments.episodes.metrics import late_decisions, why_closed
from gplfd_experiments.files.table import Table, markdown_table
from gplfd_experiments.studies.settings import Condition, StudySettings
from gplfd_experiments.studies.store import result_path
from gplfd_experiments.studies.tasks import conditions, episodes
from gplfd_policies.arrays.storage import complete_or_absent

ADA_FORCE: Final = 22.2
"""Largest force that opens an interior hinged door, 5 lbf, by section 404.2.9 of the
ADA Standards for Accessible Design [N]."""


@dataclass(frozen=True, slots=True)
class Measure:
    """A number of a result, converted from a metric."""

    metric: str
    short: str
    """Name in a column heading."""
    unit: str = ""
    name: str = ""
    """What it is, in a sentence and at an axis; "" for measures without either."""
    digits: int = 2
    scale: float = 1.0
    root: bool = False
    """Whether it is the root of the metric, before it is multiplied by the scale."""
    if_opened: bool = False
    """Whether it is defined for opened doors only: a lost handle has no force."""
    share: bool = False
    better: Literal["less", "more"] = "less"

    @property
    def column(self) -> str:
        """Column heading, with the unit in brackets at the end."""
        return f"{self.short} [{self.unit}]" if self.unit else self.short

    @property
    def title(self) -> str:
        """The name, with the unit in brackets or "share" at the end."""
        return f"{self.name}, share" if self.share else f"{self.name} [{self.unit}]"

    @property
    def sign(self) -> float:
        """Sign of the measure: 1 if more is better, −1 if less is better."""
        return 1.0 if self.better == "more" else -1.0

    def of(self, result: TaskResult) -> float | None:
        """Return the number; None if it is missing."""
        closed = self.if_opened and result.number("time_to_60_deg") is None
        return None if closed else self.convert(result.number(self.metric))

    def convert(self, value: float | None) -> float | None:
        """Return a metric in the unit of the measure; None remains None."""
        if value is None:
            return None
        return self.scale * (math.sqrt(value) if self.root else float(value))

    def values(self, results: Iterable[TaskResult]) -> list[float]:
        """Return the numbers of the results that have this measure."""
        return [value for value in map(self.of, results) if value is not None]

    def median(self, results: Iterable[TaskResult]) -> float | None:
        """Return the median of the results that have this measure; None without any."""
        values = self.values(results)
        return statistics.median(values) if values else None

    def seed_means(self, results: Iterable[TaskResult]) -> dict[int, float]:
        """Return the mean over the results that have this measure, by seed."""
        seeds = grouped(results, "task.seed")
        return {
            seed: math.fsum(values) / len(values)
            for seed in sorted(seeds)
            if (values := self.values(seeds[seed]))
        }

    def typical(self, results: Iterable[TaskResult]) -> Estimate | None:
        """Return the typical value of a seed, or the rate; None without any."""
        group = [result for result in results if self.of(result) is not None]
        if self.share and group:
            return success_rate((r.task.seed, bool(self.of(r))) for r in group)
        means = [*self.seed_means(group).values()]
        return shift(means, [0.0] * len(means)) if means else None

    def text(self, value: float | None, *, unit: bool = False, finer: int = 0) -> str:
        """Format a value, or a dash; optionally with its unit or more decimals."""
        if value is None:
            return "–"
        space = " " * (self.unit not in ("", "°"))
        return number_text(value, self.digits + finer) + f"{space}{self.unit}" * unit


_TABLES: Final = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))


def _measures(*tables: str) -> dict[str, Measure]:
    """Return the measures of tables of measures.toml by metric."""
    fields = [entry for table in tables for entry in _TABLES[table].items()]
    return {metric: Measure(metric=metric, **values) for metric, values in fields}


WALL_TIME: Final = "latency_wall_median_ms"
"""Metric of the wall time of a decision; of the policy alone."""
EPISODE_MEASURES: Final = _measures("episodes")
PREDICTED: Final = _measures("learning", "rest", "forces")
COLUMNS: Final[Mapping[str, list[list[str]]]] = _TABLES["columns"]
"""Metrics of the columns of the report's tables of episodes."""

ResultT = TypeVar("ResultT", bound=TaskResult)

Runs = Mapping[str, Sequence[EpisodeResult]]
"""Episodes by the name of their policy."""


def grouped(results: Iterable[ResultT], *names: str) -> dict[Any, list[ResultT]]:
    """Return results by an attribute or several, in the order of the first result."""
    groups: dict[Any, list[ResultT]] = {}
    for result in results:
        groups.setdefault(attrgetter(*names)(result), []).append(result)
    return groups


def by_condition(results: Iterable[ResultT]) -> dict[Condition, list[ResultT]]:
    """Return results by condition, those with most results first."""
    names = [*RANDOMIZATIONS]
    groups = grouped((r for r in results if r.condition), "condition")
    order = {}
    for condition, group in groups.items():
        name, noise = condition.randomization, condition.teacher_noise
        place = names.index(name) if name in names else len(names)
        number = condition.demonstrations_per_door
        noises, numbers = (abs(noise - 1.0), noise), (abs(number - 2), number)
        order[condition] = -len(group), place, *noises, *numbers
    first_to_last = sorted(order, key=order.__getitem__)
    return {condition: groups[condition] for condition in first_to_last}


def ranked(episodes: Iterable[EpisodeResult]) -> dict[str, list[EpisodeResult]]:
    """Return episodes by policy, ordered by doors opened, then by radial force."""
    groups = grouped(episodes, "policy")
    ranks = []
    for policy, group in groups.items():
        counting = [result for result in group if result.counts]
        opened = sum(result.opened() for result in counting)
        closed = -opened / len(counting) if counting else 1.0
        force = EPISODE_MEASURES["force_radial_peak"].typical(counting)
        ranks.append((closed, force.estimate if force else math.inf, policy))
    return {policy: groups[policy] for *_, policy in sorted(ranks)}


def closed_because(episodes: Iterable[EpisodeResult]) -> str:
    """Count the reasons why doors stayed closed, the most frequent first."""
    reasons = Counter(
        why_closed(episode.metrics["failure"], episode.metrics.get("reason", ""))
        for episode in episodes
        if episode.counts and not episode.solved
    )
    order = sorted(reasons.items(), key=lambda item: (-item[1], item[0]))
    return ", ".join(f"{count} × {reason}" for reason, count in order)


# --- Tables for the terminal and table.md: a row per door or per task

_OF_SOLVED: Final = (
    replace(EPISODE_MEASURES["force_radial_peak"], short="radial force"),
    replace(EPISODE_MEASURES["time_to_60_deg"], digits=1),
    replace(EPISODE_MEASURES["force_tangential_peak"], short="tangential"),
    EPISODE_MEASURES["slip_max_mm"],
)
_ALL = ("prediction_error_position", "governed_share", "latency_median_ms", WALL_TIME)
_OF_ALL: Final = tuple(EPISODE_MEASURES[metric] for metric in _ALL)
_OF_RUN: Final = (
    EPISODE_MEASURES["final_angle_deg"],
    *_OF_SOLVED,
    EPISODE_MEASURES["radius"],
    replace(EPISODE_MEASURES["time_to_30_deg"], digits=1),
    EPISODE_MEASURES["prediction_error_position"],
    EPISODE_MEASURES["latency_wall_p95_ms"],
)
_WHY: Final = "not opened because"


def study_rows(results: Iterable[EpisodeResult]) -> list[dict[str, Any]]:
    """Return the numbers of a table: a row per policy and door.

    Of ``episodes`` that count, ``opened`` has a 95 % ``interval``; ``errors`` of the
    policy count as not opened, and ``lost`` episodes do not count. Medians are named by
    their metrics: time, forces and slip over the doors that were opened, the others
    over all episodes that have them; None without values.
    """
    rows = []
    for (policy, door), group in grouped(results, "policy", "task.door").items():
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
    kinds = list(dict.fromkeys(row["door_kind"] for row in rows))
    lines: list[dict[str, str]] = []
    previous = kinds[0] if len(kinds) == 1 else None
    for row in sorted(rows, key=lambda row: kinds.index(row["door_kind"])):
        cells = {"policy": row["policy"], "door": row["door"]}
        cells["opened"] = f"{row['opened']}/{row['episodes']}"
        for measure in (*_OF_SOLVED, *_OF_ALL):
            cells[measure.column] = measure.text(row[measure.metric])
            if measure is _OF_SOLVED[0] and any(r["not_opened_because"] for r in rows):
                cells[_WHY] = row["not_opened_because"]
            if measure is _OF_SOLVED[-1]:
                cells["95 %"] = row["interval"]
                if any(other["errors"] for other in rows):
                    cells["errors"] = str(row["errors"])
        if row["door_kind"] != previous:
            previous = row["door_kind"]
            lines.append(dict.fromkeys(cells, "") | {"policy": f"**{previous}**"})
        lines.append(cells)
    return Table.of(lines)


def remarks(results: Sequence[EpisodeResult]) -> list[str]:
    """Return notes for readers of rates: errors, lost episodes, late decisions."""
    failed = "ended in an error of the policy and count as not opened"
    lost = "were lost, as the machine failed, and are excluded; run the study again"
    texts = []
    for which, text in ((False, failed), (True, lost)):
        if some := [r for r in results if r.error and r.lost == which]:
            groups = grouped(some, "policy").items()
            numbers = ", ".join(f"{name} {len(group)}" for name, group in groups)
            texts.append(f"{len(some)} of {len(results)} episodes {text}: {numbers}.")
    for name, group in grouped((r for r in results if not r.error), "policy").items():
        if late := late_decisions([result.metrics for result in group]):
            texts.append(f"{name}: {late}.")
    return texts


def run_table(metrics: Sequence[Mapping[str, Any]]) -> Table:
    """Return the main metrics of a run, a row per door."""
    any_closed = not all(episode["success"] for episode in metrics)
    rows = []
    for episode in metrics:
        opened = "yes" if episode["success"] else "no"
        cells = {"door": episode["door"], "opened": opened}
        for measure in _OF_RUN:
            number = measure.convert(episode.get(measure.metric))
            cells[measure.column.replace(" [", "\n[")] = measure.text(number)
            if any_closed and len(cells) == 4:  # among the first, which are printed
                cells[_WHY] = why_closed(episode["failure"], episode.get("reason", ""))
        rows.append(cells)
    return Table.of(rows)


def write_tables(
    folder: Path, settings: StudySettings
) -> tuple[list[str | Table], list[dict[str, Any]]]:
    """Write DIR/table.md, a table per condition of a study.

    Returns its texts and tables, and the `study_rows` of all, with their ``condition``.
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
