"""Collects what happens in an episode, or in many in lockstep, for their logs."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gplfd_experiments.episodes.log import PER_STEP, EpisodeLog
from gplfd_policies.movements.trajectory import GaussianTrajectory

Arrays = dict[str, NDArray[Any]]


class StepRecorder:
    """Collects a row per control step: of one episode, or of N with a leading axis.

    The names are those of `EpisodeLog`; where each comes from follows from who has it.
    """

    def __init__(self) -> None:
        self._columns: dict[str, list[Any]] = {name: [] for name in PER_STEP}

    def __len__(self) -> int:
        """Number of steps."""
        return len(self._columns["times"])

    def add(
        self,
        observation: Mapping[str, NDArray[np.float64]],
        info: Mapping[str, Any],
        step: object,
        **known: Any,
    ) -> None:
        """Add a control step.

        Args:
            observation: What the agent saw.
            info: What the environment says of the same moment.
            step: What the agent decided: `gplfd_policies.control.steps.AgentStep`, or
                the steps of a batch.
            known: Everything else by its name in the log.

        Raises:
            ValueError: The information lacks an entry.
        """
        given = {**info, **observation, **known}
        for name, column in self._columns.items():
            if name not in given and not hasattr(step, name):
                raise ValueError(
                    f"the environment's info lacks {name!r}; it has {sorted(info)}"
                )
            column.append(
                np.copy(given[name] if name in given else getattr(step, name))
            )

    def arrays(self) -> Arrays:
        """Return all steps by name, stacked along the first axis."""
        return {name: np.asarray(rows) for name, rows in self._columns.items()}


class ForecastRecorder:
    """Asks for a forecast before the first decision and then regularly.

    Args:
        ask: Gives the agent's forecast, or None.
        period: Simulated time between forecasts [s]; None for no forecasts at all.
    """

    def __init__(
        self, ask: Callable[[], GaussianTrajectory | None], period: float | None
    ) -> None:
        self._ask = ask
        self._period = period
        self._times: list[float] = []
        self._phase: NDArray[np.float64] = np.empty(0)
        self._moments: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []

    def take_if_due(self, now: float, *, force: bool) -> None:
        """Take a forecast if it is time, or if ``force`` says so.

        Args:
            now: Simulated time [s].
            force: Take it anyway.
        """
        if self._period is None:
            return
        # Half a microsecond: times are sums of steps and miss the multiple by rounding.
        due = not self._times or now >= self._times[-1] + self._period - 5e-7
        if due or force:
            forecast = self._ask()
            if forecast is not None:
                # Not the trajectory itself: it holds on to what it was computed from,
                # up to a megabyte.
                self._times.append(now)
                self._phase = forecast.times
                self._moments.append((forecast.mean, forecast.std))

    def arrays(self) -> Arrays:
        """Return the forecasts by their names in `EpisodeLog`."""
        means, stds = zip(*self._moments, strict=True) if self._moments else ((), ())
        shape = (len(means), self._phase.size, 6)
        return {
            "forecast_times": np.array(self._times),
            "forecast_phase": np.array(self._phase),
            "forecast_mean": np.reshape(means, shape),
            "forecast_std": np.reshape(stds, shape),
        }


def make_log(
    arrays: Mapping[str, Any],
    *,
    failure: str,
    reason: str,
    truncated: bool,
    **names: Any,
) -> EpisodeLog:
    """Return the log of an episode.

    Args:
        arrays: Steps and forecasts by name.
        failure: The environment's last ``failure``, and
        reason: its ``reason``.
        truncated: Whether the episode was cut off.
        names: ``policy``, ``door``, ``door_config`` and ``seed``.
    """
    success = bool(arrays["solved"][-1])
    late = truncated and not failure and not success
    return EpisodeLog(
        **names,
        **arrays,
        dt=float(np.median(np.diff(arrays["times"]))),
        success=success,
        failure="time_limit" if late else failure,
        reason="time_limit" if late else reason,
    )
