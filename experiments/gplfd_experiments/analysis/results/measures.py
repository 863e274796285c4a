"""The measures by which results are compared, and groups of results."""

import math
import statistics
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import Final, Literal, TypeVar

from gplfd_env.doors.randomization import RANDOMIZATIONS
from gplfd_experiments.analysis.results.reading import EpisodeResult, TaskResult
from gplfd_experiments.analysis.results.statistics import Shift, number_text, shift
from gplfd_experiments.episodes.metrics import why_closed
from gplfd_experiments.studies.settings import Condition

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
    """Whether it is defined for opened doors only; without a grasp there is no
    force."""
    share: bool = False
    """Whether it is a share of episodes."""
    better: Literal["less", "more"] = "less"

    @property
    def column(self) -> str:
        """Column heading, with the unit in brackets at the end."""
        return f"{self.short} [{self.unit}]" if self.unit else self.short

    @property
    def title(self) -> str:
        """The name, with the unit in brackets or "share" at the end."""
        if self.share:
            return f"{self.name}, share"
        return f"{self.name} [{self.unit}]"

    @property
    def sign(self) -> float:
        """Sign of the measure: 1 if more is better, −1 if less is better."""
        return 1.0 if self.better == "more" else -1.0

    def of(self, result: TaskResult) -> float | None:
        """Return the number; None if it is missing."""
        value = result.number(self.metric)
        if self.if_opened and result.number("time_to_60_deg") is None:
            return None
        return None if value is None else self.convert(value)

    def convert(self, value: float) -> float:
        """Return a metric in the unit of the measure."""
        return self.scale * (math.sqrt(value) if self.root else float(value))

    def values(self, results: Iterable[TaskResult]) -> list[float]:
        """Return the numbers of the results that have this measure."""
        return [value for value in map(self.of, results) if value is not None]

    def median(self, results: Iterable[TaskResult]) -> float | None:
        """Return the median of the results that have this measure; None without any."""
        values = self.values(results)
        return statistics.median(values) if values else None

    def seed_means(self, results: Iterable[TaskResult]) -> list[float]:
        """Return the mean over the results of each seed that have this measure."""
        seeds = grouped(results, lambda result: result.task.seed).values()
        by_seed = [values for group in seeds if (values := self.values(group))]
        return [math.fsum(values) / len(values) for values in by_seed]

    def typical(self, results: Iterable[TaskResult]) -> Shift | None:
        """Return the typical value of a seed with its interval; None without any."""
        means = self.seed_means(results)
        return shift(means, [0.0] * len(means)) if means else None

    def seed_value(self, results: Iterable[TaskResult]) -> float | None:
        """Return the typical value of a seed; None without any."""
        typical = self.typical(results)
        return None if typical is None else typical.estimate

    def text(self, value: float | None, *, unit: bool = False, finer: int = 0) -> str:
        """Format a value, or a dash; optionally with its unit or more decimals."""
        if value is None:
            return "–"
        space = " " * (self.unit not in ("", "°"))
        return number_text(value, self.digits + finer) + f"{space}{self.unit}" * unit


_TABLES: Final = tomllib.loads(Path(__file__).with_suffix(".toml").read_text("utf-8"))


def _measures(table: str) -> dict[str, Measure]:
    """Return the measures of a table of measures.toml by metric."""
    fields = _TABLES[table].items()
    return {metric: Measure(metric=metric, **values) for metric, values in fields}


WALL_TIME: Final = "latency_wall_median_ms"
"""Metric of the wall time of a decision; of the policy alone."""
EPISODE_MEASURES: Final = _measures("episodes")
LEARNING_MEASURES: Final = _measures("learning")
RECORDED_MEASURES: Final = _measures("rest")
FORCE_MEASURES: Final = _measures("forces")
COLUMNS: Final[Mapping[str, list[list[str]]]] = _TABLES["columns"]
"""Metrics of the columns of the report's tables of episodes."""
LEARNING_HEADLINES: Final = ("nlpd", "rmse_position_m", "rmse_rotation_rad")
"""Measures of learning tests in summaries and plots."""

ResultT = TypeVar("ResultT", bound=TaskResult)
GroupT = TypeVar("GroupT")

Runs = Mapping[str, Sequence[EpisodeResult]]
"""Episodes by the name of their policy."""

_BAND: Final = 0.1  # Width of a band of random radii [m].


def grouped(
    results: Iterable[ResultT], group: Callable[[ResultT], GroupT]
) -> dict[GroupT, list[ResultT]]:
    """Return results by a group key, groups in the order of their first result."""
    groups: dict[GroupT, list[ResultT]] = {}
    for result in results:
        groups.setdefault(group(result), []).append(result)
    return groups


def by_policy(results: Iterable[ResultT]) -> dict[str, list[ResultT]]:
    """Return results by the name of their policy."""
    return grouped(results, attrgetter("policy"))


def by_condition(results: Iterable[ResultT]) -> dict[Condition, list[ResultT]]:
    """Return results by condition, those with most results first."""
    names = [*RANDOMIZATIONS]

    groups = grouped((r for r in results if r.condition), attrgetter("condition"))

    def order(item: tuple[Condition, Sequence[ResultT]]) -> tuple[float, ...]:
        name, noise = item[0].randomization, item[0].teacher_noise
        number = item[0].demonstrations_per_door
        place = names.index(name) if name in names else len(names)
        return -len(item[1]), place, abs(noise - 1.0), noise, abs(number - 2), number

    return dict(sorted(groups.items(), key=order))


def ranked(episodes: Iterable[EpisodeResult]) -> dict[str, list[EpisodeResult]]:
    """Return episodes by policy, ordered by doors opened, then by radial force."""

    def order(item: tuple[str, Sequence[EpisodeResult]]) -> tuple[float, float, str]:
        counting = [result for result in item[1] if result.counts]
        opened = sum(result.opened() for result in counting)
        closed = -opened / len(counting) if counting else 1.0
        force = EPISODE_MEASURES["force_radial_peak"].seed_value(counting)
        return closed, math.inf if force is None else force, item[0]

    return dict(sorted(by_policy(episodes).items(), key=order))


def counted(results: Mapping[str, Sequence[ResultT]]) -> dict[str, list[ResultT]]:
    """Return by policy the results that count, as `TaskResult.counts` says."""
    return {
        policy: [result for result in group if result.counts]
        for policy, group in results.items()
    }


def door_name(episode: EpisodeResult) -> str:
    """Return the name of a door with its radius; for a random radius, with its band."""
    if episode.drawn:
        low = _BAND * math.floor(episode.radius / _BAND + 1e-9)
        return f"{low:.1f}–{low + _BAND:.1f} m"
    try:
        float(episode.task.door)
    except ValueError:
        return f"{episode.task.door} {episode.radius:g}"
    return episode.task.door


def closed_because(episodes: Iterable[EpisodeResult]) -> str:
    """Count the reasons why doors stayed closed, the most frequent first."""
    reasons = Counter(
        why_closed(episode.metrics["failure"], episode.metrics.get("reason", ""))
        for episode in episodes
        if episode.counts and not episode.solved
    )
    order = sorted(reasons.items(), key=lambda item: (-item[1], item[0]))
    return ", ".join(f"{count} × {reason}" for reason, count in order)
