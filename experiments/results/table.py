"""A study, and the doors of one run, as tables for the terminal and table.md."""

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from gplfd.experiments.episodes.metrics import EpisodeMetrics
from gplfd.experiments.files.table import Table, markdown_table
from gplfd.experiments.results.failures import why_closed
from gplfd.experiments.results.grouping import by_policy, grouped
from gplfd.experiments.results.measures import (
    EPISODE_MEASURES,
    PREDICTION_ERROR,
    Measure,
)
from gplfd.experiments.results.reading import read_files
from gplfd.experiments.results.records import EpisodeResult
from gplfd.experiments.results.statistics import success_rate
from gplfd.experiments.study.plan import conditions, episodes
from gplfd.experiments.study.settings import Condition, StudySettings
from gplfd.experiments.study.store import result_path
from gplfd.policies.storage import complete_or_absent

_OF_SOLVED: Final = (
    Measure("time_to_60_deg", "to 60° [s]", digits=1),
    Measure("force_radial_peak", "radial force [N]", digits=1),
    Measure("force_tangential_peak", "tangential [N]", digits=1),
    Measure("slip_max_mm", "slip [mm]", digits=1),
)
_OF_ALL: Final = (
    PREDICTION_ERROR,
    Measure("governed_share", "governed [%]", digits=1, convert=lambda x: 100.0 * x),
    EPISODE_MEASURES["latency_median_ms"],
)
_OF_RUN: Final = (
    Measure("radius", "radius [m]"),
    Measure("final_angle_deg", "angle [°]", digits=1),
    Measure("time_to_30_deg", "to 30° [s]", digits=1),
    *_OF_SOLVED,
    PREDICTION_ERROR,
    Measure("latency_p95_ms", "CPU time\nper decision\np95 [ms]"),
)


def error_count(episodes: Sequence[EpisodeResult]) -> str:
    """Say how many episodes ended in an error; "" if none did."""
    failed = [one for one in episodes if one.error]
    if not failed:
        return ""
    whose = ", ".join(f"{name} {len(own)}" for name, own in by_policy(failed).items())
    return (
        f"{len(failed)} of {len(episodes)} episodes ended in an error and count "
        f"neither as opened nor as closed: {whose}."
    )


def study_table(episodes: Iterable[EpisodeResult]) -> Table:
    """Return a row per policy and door, in the order in which they come.

    Rates are over the episodes that ran. Forces, slip and times are medians over the
    successes; the prediction error, the share of decisions in which the stability bound
    limited the stiffness, and the decision time are medians over all that ran.
    """
    groups = grouped(episodes, lambda one: (one.policy, one.task.door))
    measures = (*_OF_SOLVED, *_OF_ALL)
    why = {names: why_closed(own) for names, own in groups.items()}
    last = ["not opened because"] if any(why.values()) else []
    return Table(
        columns=(
            *("policy", "door", "opened", "95 %"),
            *(one.title for one in measures),
            *last,
        ),
        rows=tuple(
            (*names, *_cells(own), *([why[names]] if last else []))
            for names, own in groups.items()
        ),
    )


def _cells(own: Sequence[EpisodeResult]) -> tuple[str, ...]:
    ran = [one for one in own if not one.error]
    solved = [one for one in ran if one.solved]
    return (
        f"{len(solved)}/{len(ran)}",
        success_rate((one.task.seed, one.solved) for one in ran).interval,
        *(measure.text(measure.median(solved)) for measure in _OF_SOLVED),
        *(measure.text(measure.median(ran)) for measure in _OF_ALL),
    )


def run_table(metrics: Iterable[EpisodeMetrics]) -> Table:
    """Return the most telling metrics of a run, a row per door."""

    def text(measure: Measure, one: EpisodeMetrics) -> str:
        value = getattr(one, measure.metric)
        return measure.text(None if value is None else measure.convert(value))

    heads = (measure.title.replace(" [", "\n[") for measure in _OF_RUN)
    rows = (
        (
            one.door,
            "yes" if one.success else one.failure.replace("_", " "),
            *(text(measure, one) for measure in _OF_RUN),
        )
        for one in metrics
    )
    return Table(columns=("door", "opened", *heads), rows=tuple(rows))


def write_tables(folder: Path, settings: StudySettings) -> str:
    """Write DIR/table.md, a table per condition of the study, and return its text.

    Raises:
        OSError: The file cannot be written.
    """
    text = "\n\n".join(_tables(folder, settings))
    with complete_or_absent(folder / "table.md") as path:
        path.write_text(text + "\n", encoding="utf-8")
    return text


def study_rows(folder: Path, settings: StudySettings) -> list[dict[str, Any]]:
    """Return the numbers of the tables: a row per condition, policy and door.

    Each has ``condition``, ``policy``, ``door``, ``episodes`` that ran, ``opened``,
    ``errors``, and by their metrics' names the medians of `study_table`, in its units;
    None where there is nothing to take one of.
    """
    rows: list[dict[str, Any]] = []
    for condition in conditions(settings):
        results, _ = _results(folder, settings, condition)
        groups = grouped(results, lambda one: (one.policy, one.task.door))
        for (policy, door), own in groups.items():
            ran = [one for one in own if not one.error]
            solved = [one for one in ran if one.solved]
            said = {"condition": str(condition), "policy": policy, "door": door}
            counts = {"episodes": len(ran), "opened": len(solved)}
            medians = {one.metric: one.median(solved) for one in _OF_SOLVED} | {
                one.metric: one.median(ran) for one in _OF_ALL
            }
            rows.append(said | counts | {"errors": len(own) - len(ran)} | medians)
    return rows


def _results(
    folder: Path, settings: StudySettings, condition: Condition
) -> tuple[list[EpisodeResult], Sequence[str]]:
    """Return a condition's episodes, and remarks on files that cannot be read."""
    tasks = episodes(settings, condition, range(settings.seeds))
    found, unreadable = read_files(result_path(folder, task) for task in tasks)
    return [one for one in found if isinstance(one, EpisodeResult)], unreadable


def _tables(folder: Path, settings: StudySettings) -> Iterator[str]:
    """Yield a table per condition of the study, and what is missing in it."""
    several = list(conditions(settings))
    for condition in several:
        results, unreadable = _results(folder, settings, condition)
        if len(several) > 1:
            yield f"{condition}:"
        yield from filter(None, (error_count(results), *unreadable))
        yield markdown_table(study_table(results))
