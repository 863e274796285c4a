"""Forecasts of an agent that watches a left-out motion sample by sample.

In the module ``via_points`` the phase of every observation is known from the whole path
of the motion. Here a method's agent finds it from the samples so far.
"""

from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np

from gplfd_experiments.episodes.forecast_error import squared_distances
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.studies.learning_tests.accuracy import root_mean_square
from gplfd_experiments.studies.learning_tests.folds import OnPhases
from gplfd_experiments.studies.learning_tests.via_points import (
    FORECASTS,
    GRID,
    rest_scores,
)
from gplfd_policies.adaptation.gridded import GriddedMovement
from gplfd_policies.agents.agent import CompliantAgent
from gplfd_policies.movements.movement import Movement
from gplfd_policies.movements.trajectory import GaussianTrajectory
from gplfd_policies.registry.method import Method

_BEHIND: Final = 0.03
"""How far before the phase at which an agent believes to be its path ahead begins."""


class Forecast(NamedTuple):
    """What an agent expects of the whole task, on `GRID`."""

    phase: float
    """Where along the task it believes the hand to be."""
    trajectory: GaussianTrajectory


def watch(
    method: Method,
    movement: Movement,
    poses: FloatArray,
    counts: Collection[int],
    period: float,
) -> Mapping[int, Forecast]:
    """Let the method's agent observe poses, without any force at the hand.

    The agent's own rules find the phase of every pose and make via-points. Its commands
    are ignored.

    Args:
        method: Has the rules.
        movement: What it learned.
        poses: Of the hand, in order, (N, 6) [m, rad].
        counts: After how many poses the agent is asked, each from 1 to N.
        period: Time between two poses [s].

    Returns:
        Forecasts by count; each depends on no later pose.
    """
    agent = CompliantAgent(
        GriddedMovement(movement, method.adaptation, GRID.size),
        phases=method.phases(movement),
        config=replace(method.config, control_period=period),
        handle_config=method.handle_config,
    )
    found = {}
    for count, pose in enumerate(poses[: max(counts)], start=1):
        step = agent.act({"ee_pose": pose, "wrench": np.zeros(6)})
        if count in counts:
            found[count] = Forecast(float(step.observed_phase), agent.forecast())
    return found


def online_forecasts(
    method: Method, movement: Movement, left_out: OnPhases, period: float
) -> dict[str, float | None]:
    """Return the accuracy of the rest once the shares `FORECASTS` were watched.

    The scores are those of `via_points.forecasts`, at the same phases of the truth,
    which follow from its whole path and are not known to the agent; and ``path_m``, the
    rms distance of the rest of the true path from the forecast one, whose timing is not
    judged. A method without via-points forecasts what it learned.

    Args:
        method: Has the rules of the agent.
        movement: What it learned.
        left_out: The motion, at equal steps of time.
        period: Time between its samples [s].
    """
    counts = np.searchsorted(left_out.phases, FORECASTS, side="right").tolist()
    if method.adaptation is None:
        learned = movement.predict(GRID)
        seen = [Forecast(share, learned) for share in FORECASTS]
    else:
        watched = watch(method, movement, left_out.poses, counts, period)
        seen = [watched[count] for count in counts]
    found: dict[str, float | None] = {}
    for share, forecast in zip(FORECASTS, seen, strict=True):
        name, rest = f"online_{100 * share:.0f}", forecast.trajectory[share < GRID]
        truth = left_out.at(rest.times)[:, :3]
        found |= rest_scores(name, rest, left_out)
        found[f"{name}_path_m"] = path_distance(forecast, truth)
    return found


def path_distance(forecast: Forecast, positions: FloatArray) -> float:
    """Return the rms distance [m] of positions (M, 3) from the forecast path ahead."""
    ahead = forecast.phase - _BEHIND < GRID
    path = forecast.trajectory.mean[ahead, :3]
    return root_mean_square(np.sqrt(squared_distances(positions, path)))
