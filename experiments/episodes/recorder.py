"""Collects what happens in an episode, or in many in lockstep, for their logs."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.episodes.log import PER_STEP, EpisodeLog
from policies.trajectory import GaussianTrajectory

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
            step: What the agent decided: `policies.steps.AgentStep`, or the steps of a
                batch.
            known: Everything else by its name in the log.

        Raises:
            ValueError: The information lacks an entry.
        """
        for name, column in self._columns.items():
            for source in (known, observation, info):
                if name in source:
                    value = source[name]
                    break
            else:
                try:
                    value = getattr(step, name)
                except AttributeError:
                    raise ValueError(
                        f"the environment's info lacks {name!r}; it has {sorted(info)}"
                    ) from None
            column.append(np.copy(value))

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
        self._forecasts: list[GaussianTrajectory] = []

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
                self._times.append(now)
                self._forecasts.append(forecast)

    def arrays(self) -> Arrays:
        """Return the forecasts by their names in `EpisodeLog`."""
        forecasts = self._forecasts
        phase = forecasts[0].times if forecasts else np.empty(0)
        shape = (len(forecasts), phase.size, 6)
        return {
            "forecast_times": np.array(self._times),
            "forecast_phase": np.array(phase),
            "forecast_mean": np.reshape([one.mean for one in forecasts], shape),
            "forecast_std": np.reshape([one.std for one in forecasts], shape),
        }


def make_log(
    arrays: Mapping[str, Any], *, failure: str, truncated: bool, **names: Any
) -> EpisodeLog:
    """Return the log of an episode.

    Args:
        arrays: Steps and forecasts by name.
        failure: The environment's last ``failure``.
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
    )
