"""Stability and force in contact: python benchmarks/contact.py {loop,person}.

``loop`` holds the hand at a locked door, or removes the bar from it. It disturbs the
set-point of the admittance once and checks whether the force at the wrist decays, for
every delay of the command that ``"hard"`` draws.

``person`` measures the smallest possible force on a person who holds the hand. Hand,
arm and door arrive with the speed of the demonstrations. From the first touch on, the
measured pose of the hand is commanded. The remaining force on the person is one that no
pose controller can remove.
"""

import contextlib
import itertools
import math
import statistics
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, Final

import gymnasium as gym
import numpy as np
import tyro
from harness import report

from gplfd_env import ENVIRONMENT_ID
from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.doors.config import DOORS
from gplfd_experiments.episodes.build import learned_agents, make_environment
from gplfd_experiments.episodes.task import EpisodeTask, episode_task
from gplfd_experiments.speed.report import Measurement, Target, at_most
from gplfd_policies import POLICIES
from gplfd_policies.agents.agent import Agent
from gplfd_policies.control.admittance import Admittance
from gplfd_policies.control.contact import HELD_HAND, SERVO_LAG
from gplfd_policies.control.stiffness import DEFAULT_DYNAMICS, VirtualDynamics

# --- Disturbed set-point ----------------------------------------------------------

PERIODS: Final = (0, 1, 2, 3)
"""Delays [control periods]."""
STIFFNESSES: Final = (100.0, 200.0, 330.0, 500.0)
"""k of the admittance [N/m]."""
DAMPINGS: Final = (0.0, 60.0)
"""Least damping [N s/m]: none, and k_s times 30 ms."""
AXIS: Final = 0
"""The set-point is disturbed along x, the direction of opening of a closed door."""

_KNOCK, _KNOCK_BEGINS, _KNOCK_ENDS = 0.001, 0.5, 0.6
_DIED_OUT: Final = 0.5
"""The force has decayed if less than this share of the initial force remains."""
_NEAR: Final = 0.0005
"""Smaller margins do not predict the simulation [s]."""


def dynamics(least: float) -> VirtualDynamics:
    """Return the default virtual dynamics with a least damping [N s/m]."""
    return replace(DEFAULT_DYNAMICS, least_damping=np.full(6, least))


def remaining_force_ratio(
    stiffness: float, least: float, periods: int, *, held: bool, seconds: float
) -> float:
    """Disturb the set-point of a simulated hand, held by a locked door or free.

    Returns the ratio of the standard deviations of the force in the last and in the
    first second, infinite if the grasp is lost.
    """
    env: Any = gym.make(
        ENVIRONMENT_ID,
        randomization={"shortest_delay": periods, "longest_delay": periods},
        disturbance="locked" if held else "none",
        max_episode_steps=10_000,
    )
    with contextlib.closing(env):
        observation, _ = env.reset(seed=0)
        if not held:
            env.unwrapped.model.geom("handle_bar").conaffinity = 0
        admittance = Admittance(dynamics(least))
        only, gains = np.eye(6)[AXIS], np.full(6, stiffness)
        forces = []
        for step in range(round((_KNOCK_ENDS + seconds) / CONTROL_PERIOD)):
            knocked = _KNOCK_BEGINS <= step * CONTROL_PERIOD < _KNOCK_ENDS
            wrench = observation["wrench"] * only
            offset = admittance.step(gains, wrench, CONTROL_PERIOD)
            action = offset + _KNOCK * knocked * only
            observation, _, ended, _, _ = env.step(action)
            forces.append(float(observation["wrench"][AXIS]))
            if held and ended:
                return math.inf
    second = round(1.0 / CONTROL_PERIOD)
    after = forces[round(_KNOCK_ENDS / CONTROL_PERIOD) :]
    return float(np.std(after[-second:]) / np.std(after[:second]))


def model_margin(stiffness: float, least: float, periods: int) -> float:
    """Return the additional delay that the model allows for a held hand, x axis [s]."""
    gains, virtual = np.full(6, stiffness), dynamics(least)
    limit = HELD_HAND.tolerated_delay(gains, virtual.damping(gains), virtual.mass)
    return float(limit[AXIS]) - (periods * CONTROL_PERIOD + SERVO_LAG)


def measure_verdicts(seconds: int) -> Measurement:
    """Compare the model's stability predictions with the simulation."""
    rows: dict[str, dict[str, str]] = {}
    wrong = {True: 0, False: 0}
    for least, held, delay in itertools.product(DAMPINGS, (True, False), PERIODS):
        damped = f"d >= {least:g}, " if least else ""
        name = f"{'held' if held else 'free'}, {damped}{delay} periods"
        rows[name] = {}
        for k in STIFFNESSES:
            rest = remaining_force_ratio(k, least, delay, held=held, seconds=seconds)
            # A free hand has no contact loop that could oscillate.
            margin = model_margin(k, least, delay) if held else math.inf
            calm = rest < _DIED_OUT
            wrong[held] += calm != (margin > 0.0) and abs(margin) > _NEAR
            said = f" ({1e3 * margin:+.1f} ms)" if held else ""
            rows[name][f"k = {k:g}"] = ("calm" if calm else "OSCILLATES") + said
    return Measurement(
        title="force after a disturbance, simulated (and the model's contact margin)",
        rows=rows,
        targets=tuple(
            at_most(f"different predictions, {name}", wrong[held], 0)
            for name, held in (("held", True), ("free", False))
        ),
    )


def threshold(oscillates: Callable[[float], bool], low: float, high: float) -> float:
    """Return the k between two bounds at which oscillations stop, to 1 % [N/m]."""
    while high > 1.01 * low:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if oscillates(middle) else (low, middle)
    return math.sqrt(low * high)


def measure_lag(seconds: int) -> Measurement:
    """Find the softest stable admittance per delay, and the lag that explains it."""
    rows, targets = {}, list[Target]()
    for delay in PERIODS[1:]:

        def simulated(k: float, delay: int = delay) -> bool:
            rest = remaining_force_ratio(k, 0.0, delay, held=True, seconds=seconds)
            return rest >= _DIED_OUT

        def modelled(k: float, delay: int = delay) -> bool:
            return model_margin(k, 0.0, delay) + SERVO_LAG < 0.0

        found = threshold(simulated, 20.0, 1500.0)
        lag = 1e3 * (model_margin(found, 0.0, delay) + SERVO_LAG)
        rows[f"{delay} periods"] = {
            "simulation: calm from k =": found,
            "model without lag": threshold(modelled, 20.0, 1500.0),
            "lag that explains it [ms]": lag,
        }
        name = f"lag at {delay} periods [ms]"
        targets.append(at_most(name, lag, 1e3 * SERVO_LAG))
    return Measurement(
        title="the softest admittance with d = 2√(m k) that is stable when held",
        rows=rows,
        targets=tuple(targets),
    )


# --- A held hand -------------------------------------------------------------

_WATCHED: Final = 100
"""Steps after the first touch; the peak occurs within twenty steps."""


def held_by_a_person(
    task: EpisodeTask, agent: Agent, follows: bool
) -> tuple[float, float]:
    """Let a person hold the hand; return the peak force [N] and the speed [m/s].

    If ``follows``, the measured pose of the hand is commanded from the first touch on.
    """
    env: Any = make_environment(task, agent.control)
    with contextlib.closing(env):
        observation, info = env.reset(seed=task.reset_seed)
        agent.reset(observation)
        peak, speed, since = 0.0, 0.0, 0
        while since < _WATCHED:
            action = agent.act(observation).action
            if since and follows:
                action = observation["ee_pose"]
            if not since:
                speed = float(np.linalg.norm(observation["ee_twist"][:3]))
            observation, _, terminated, truncated, info = env.step(action)
            peak = max(peak, info["person_force"])
            since += info["person_force"] > 0.0 or since > 0
            if terminated or truncated:
                break
    return peak, speed


def measure_persons(seeds: int) -> Measurement:
    """Hold the hand under the agent, and under commands that follow the hand."""
    found: dict[str, list[tuple[float, float]]] = {}
    for seed in range(seeds):
        task = episode_task(
            "medium", DOORS["medium"], policy="gp", seed=seed, disturbance="person"
        )
        make = learned_agents(task, POLICIES["gp"])
        for name, follows in (("gp", False), ("command follows the hand", True)):
            one = held_by_a_person(task, make(), follows)
            found.setdefault(name, []).append(one)
    rows = {}
    for name, each in found.items():
        peak, speed = (statistics.median(values) for values in zip(*each, strict=True))
        rows[name] = {"peak on the person [N]": peak, "hand before [m/s]": speed}
    ours = rows["gp"]["peak on the person [N]"]
    return Measurement(
        title=f"somebody holds the hand, medians of {seeds} seeds",
        rows=rows,
        targets=(at_most("peak on the person, gp [N]", ours, 20.0),),
    )


# --- Commands ----------------------------------------------------------------


def loop(seconds: int = 3) -> None:
    """Compare the model of the contact loop with the simulation.

    Args:
        seconds: Simulated time after each disturbance [s], at least two.
    """
    verdicts, lag = (partial(one, seconds) for one in (measure_verdicts, measure_lag))
    report({"verdicts": verdicts, "lag": lag})


def person(seeds: int = 5) -> None:
    """Compare the agent with the smallest possible force, on seeds from 0."""
    report({"person": partial(measure_persons, seeds)})


COMMANDS: Final = {"loop": loop, "person": person}

if __name__ == "__main__":
    tyro.extras.subcommand_cli_from_dict(COMMANDS)
