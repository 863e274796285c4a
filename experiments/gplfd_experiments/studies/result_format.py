"""Format of result files: required metrics by version.

A result states its version and is complete if it has every metric of that version.
Older results lack the metrics of later versions and stay readable and complete. To add
a metric of an episode, raise `VERSION` and name it in `_ADDED`.
"""

import typing
from collections.abc import Mapping
from typing import Any, Final

from gplfd_env.doors.config import door_config
from gplfd_experiments.episodes.metrics import EpisodeMetrics
from gplfd_experiments.episodes.task import EpisodeTask, Task
from gplfd_experiments.files.plain_data import check_stamp, entry, stamp
from gplfd_experiments.studies.tasks import RecordedTask

KIND: Final = "gplfd result"
VERSION: Final = 2
"""Version of the layout and the required metrics of result files."""
STAMP: Final[Mapping[str, Any]] = stamp(KIND, VERSION)
"""First entries of a result file."""

POLICY_ERROR: Final = "policy_error"
"""Failure of an episode in which the policy raised an error, in learning or acting."""

_NUMBER: Final[Any] = float | None
# The runner writes None for numbers that are not finite.
_EPISODE_KINDS: Final[Mapping[str, Any]] = {
    name: _NUMBER if kind is float else kind
    for name, kind in typing.get_type_hints(EpisodeMetrics).items()
} | {"radius": float}

_ADDED: Final[Mapping[int, frozenset[str]]] = {
    1: frozenset(
        {
            *("reason", "capability", "stage"),
            *("latency_wall_median_ms", "latency_wall_p95_ms"),
        }
    )
}
"""Metrics of an episode that a version added."""

EPISODE_METRICS: Final[Mapping[int, frozenset[str]]] = {
    version: frozenset(_EPISODE_KINDS).difference(
        *(names for later, names in _ADDED.items() if later > version)
    )
    for version in range(VERSION + 1)
}
"""Metrics of a complete episode, by version; 0 is before files stated a version."""

LEARNING_METRICS: Final = frozenset(
    {
        *("rmse_position_m", "rmse_rotation_rad", "nlpd"),
        *("coverage_50", "coverage_90", "coverage_95", "log_dimensionless_jerk"),
        *("via_error_position_m", "via_far_change"),
        *("cpu_fit_s", "cpu_predict_s", "cpu_adapt_s"),
    }
)
"""Metrics of a complete learning test, in every version."""

FORECAST_METRICS: Final = frozenset(
    f"forecast_{share}_{what}"
    for share in (10, 25, 50)
    for what in ("position_m", "rotation_rad", "nlpd", "coverage_95")
)
"""Further metrics of a complete test on a recording, in every version."""

ONLINE_METRICS: Final = frozenset(
    f"online_{share}_{what}"
    for share in (10, 25, 50)
    for what in ("position_m", "rotation_rad", "nlpd", "coverage_95", "path_m")
)
"""Metrics that version 2 added."""

_LARGEST: Final = 1e9
"""Largest magnitude of a metric, so that computed values stay finite."""
_OUTPUTS: Final = frozenset({"outputs_cpu_s", "outputs_nlpd"})
"""Metrics of learning tests with a value for several numbers of outputs; only
earlier results have the second."""


def outcome(record: Mapping[str, Any], task: Task) -> dict[str, Any]:
    """Return the metrics of a result; none if it is an error."""
    version = check_stamp(record, KIND, VERSION)
    if "error" in record:
        entry(record, "error", str)
        return {}
    metrics: dict[str, Any] = entry(record, "metrics", dict[str, Any])
    if isinstance(task, EpisodeTask):
        known = EPISODE_METRICS[version] | metrics.keys()
        kinds = {n: kind for n, kind in _EPISODE_KINDS.items() if n in known}
    else:
        needed = set(LEARNING_METRICS)
        if isinstance(task, RecordedTask):
            needed |= FORECAST_METRICS
            needed |= ONLINE_METRICS if version >= 2 else frozenset()
        kinds = dict.fromkeys((*metrics, *sorted(needed)), _NUMBER)
        kinds |= dict.fromkeys(_OUTPUTS & kinds.keys(), dict[str, float | None])
    for name, kind in kinds.items():
        value = entry(metrics, name, kind)
        parts = value.values() if isinstance(value, Mapping) else value
        low = 0.0 if name.startswith("prediction_error") else -_LARGEST
        for part in parts if isinstance(value, Mapping | tuple) else [value]:
            plausible = not isinstance(part, int | float) or low <= part <= _LARGEST
            if not plausible and name != "seed":
                raise ValueError(f"{name} = {part:g} is no plausible measurement")
    if isinstance(task, EpisodeTask):
        door_config(dict(task.door_config)).replaced({"radius": metrics["radius"]})
        if len(metrics["forecast_progress"]) != len(metrics["forecast_error_mm"]):
            raise ValueError("forecast_progress and forecast_error_mm differ in length")
    return metrics


def lost(record: Mapping[str, Any]) -> bool:
    """Return whether the machine, not the policy, caused an error.

    In results without a version, such errors have no traceback, because the worker
    died.
    """
    if "error" not in record:
        return False
    if "format_version" in record:
        return bool(record.get("lost", False))
    return record.get("traceback") == ""
