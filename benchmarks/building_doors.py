"""Doors of buildings and a robot that drives: python benchmarks/building_doors.py.

A policy learns from six demonstrations of three doors of a door's kind, beside the
oracle, which is told the door; and what a lever's scene costs, beside a bar's.
"""

import contextlib
import itertools
import warnings
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any, Final

import gymnasium as gym
import numpy as np
import tyro

from gplfd_env import ENVIRONMENT_IDS
from gplfd_env.conventions.constants import Base
from gplfd_env.doors.config import DOORS, DoorConfig
from gplfd_experiments.analysis.results.measures import ADA_FORCE
from gplfd_experiments.episodes.build import learned_agents, open_together
from gplfd_experiments.episodes.metrics import EpisodeMetrics, episode_metrics
from gplfd_experiments.episodes.task import episode_task
from gplfd_experiments.speed.report import Measurement, Value, at_least, measure_all
from gplfd_experiments.speed.timing import Timed, measure, repeated
from gplfd_policies import POLICIES

_WIDE: Final = "lever at 0.90 m"

ROOMS: Final[Mapping[str, DoorConfig]] = {
    **{name: DOORS[name] for name in ("room-584", "room-709", "room-834", "room-959")},
    _WIDE: DoorConfig(radius=0.90, handle="lever", latch="spring"),
    "office-closer-2": DOORS["office-closer-2"],
    "heavy-fire": DOORS["heavy-fire"],
}
"""Doors that are pulled by a lever; 0.53, 0.65 and 0.78 m are demonstrated."""

_SCENES: Final = {
    "bar": DOORS["medium"],
    "lever": DoorConfig(radius=0.5, handle="lever", latch="spring", seal=1.5),
}
"""What `costs` compares, before a robot that stands still."""

_TOGETHER: Final = 16
_GENTLE: Final = f"below {ADA_FORCE} N"


def opened(
    policy: str, doors: Sequence[DoorConfig], seed: int, base: Base = "mobile"
) -> Iterator[EpisodeMetrics]:
    """Let a policy open doors of one kind, and yield the metrics in their order.

    Args:
        policy: Its name.
        doors: The doors.
        seed: Of demonstrations and resets.
        base: Whether the robot drives.
    """
    tasks = [
        episode_task(f"{door.radius:g}", door, policy=policy, seed=seed, base=base)
        for door in doors
    ]
    with warnings.catch_warnings():
        # Preparing demonstrations says what it found.
        warnings.simplefilter("ignore")
        make = learned_agents(tasks[0], POLICIES[policy])
    for first in range(0, len(tasks), _TOGETHER):
        some = tasks[first : first + _TOGETHER]
        logs = open_together(some, [make() for _ in some])
        yield from map(episode_metrics, logs)


def rooms(policy: str, seeds: int) -> Measurement:
    """Open `ROOMS` with demonstrations of several seeds."""
    found: dict[str, list[EpisodeMetrics]] = {name: [] for name in ROOMS}
    for seed in range(seeds):
        each = opened(policy, list(ROOMS.values()), seed)
        for name, metrics in zip(ROOMS, each, strict=True):
            found[name].append(metrics)
    rows = {name: _summary(metrics) for name, metrics in found.items()}
    gentle = [_shares(found[name])[1] for name in found if name.startswith("room")]
    return Measurement(
        title=f"{policy}, {seeds} seeds of demonstrations, levers that are pulled",
        rows=rows,
        targets=(
            at_least(f"rooms: least share opened {_GENTLE}", min(gentle), 0.95),
            at_least("0.90 m: opened", _shares(found[_WIDE])[0], 0.9),
        ),
    )


def standard(policy: str, first: int, draws: int) -> Measurement:
    """Open draws of ``randomization="standard"``, beside the oracle."""
    kinds: dict[str, list[DoorConfig]] = {}
    for door in _drawn(first, draws):
        kinds.setdefault(f"{door.handle}, {door.swing}", []).append(door)
    rows: dict[str, dict[str, Value]] = {}
    everything: dict[str, list[EpisodeMetrics]] = {"oracle": [], policy: []}
    for kind, doors in sorted(kinds.items()):
        for name in everything:
            these = [one for same in _sides(doors) for one in opened(name, same, 0)]
            rows[f"{kind}: {name}"] = _summary(these)
            everything[name] += these
    rows |= {f"all: {name}": _summary(metrics) for name, metrics in everything.items()}
    share, _ = _shares(everything["oracle"])
    both = zip(everything["oracle"], everything[policy], strict=True)
    learned, _ = _shares([own for told, own in both if told.success])
    return Measurement(
        title=f"{draws} draws of standard doors, seeds from {first}",
        rows=rows,
        targets=(
            at_least("standard: share opened by the oracle", share, 0.8),
            at_least("standard: share of these that are opened", learned, 0.95),
        ),
    )


def costs(repeats: int) -> Measurement:
    """Time resets and steps of a lever's scene beside a bar's, in turns."""
    actions: dict[tuple[str, str], Timed] = {}
    for name, door in _SCENES.items():
        env: Any = gym.make(ENVIRONMENT_IDS["pose"], door=door)
        new = _new_radii(door)
        actions["reset", name] = repeated(env.reset, 20)
        actions["reset to a new door", name] = repeated(partial(_reset, env, new))
        actions["step", name] = repeated(
            partial(env.step, np.zeros(6)), 200, begin=env.reset
        )
    times = measure(actions, repeats)
    rows: dict[str, dict[str, Value]] = {}
    for what in dict.fromkeys(what for what, _ in actions):
        bar, lever = (times[what, name] for name in _SCENES)
        rows[what] = {"bar": bar, "lever": lever, "ratio": lever.cpu_over(bar)}
    return Measurement(title="a latched lever beside a bar, CPU time [ms]", rows=rows)


def _reset(env: Any, doors: Iterator[DoorConfig]) -> None:
    env.reset(options={"door": next(doors)})


def _new_radii(door: DoorConfig) -> Iterator[DoorConfig]:
    """Yield doors that no cache has seen."""
    return (door.replaced({"radius": 0.45 + 1e-6 * n}) for n in itertools.count())


def _drawn(first: int, draws: int) -> Iterator[DoorConfig]:
    """Yield the doors of resets with seeds from the first."""
    env: Any = gym.make(
        ENVIRONMENT_IDS["pose"], base="mobile", randomization="standard"
    )
    with contextlib.closing(env):
        for seed in range(first, first + draws):
            env.reset(seed=seed)
            yield env.unwrapped.door


def _sides(doors: Sequence[DoorConfig]) -> Iterator[list[DoorConfig]]:
    """Yield doors with their hinge on either side: each side is a kind of its own."""
    for side in ("right", "left"):
        same = [door for door in doors if door.hinge_side == side]
        if same:
            yield same


def _summary(found: Sequence[EpisodeMetrics]) -> dict[str, Value]:
    peaks = [one.force_handle_peak for one in found]
    share, gentle = _shares(found)
    return {
        "doors": len(found),
        "opened": share,
        _GENTLE: gentle,
        "peak N, median": float(np.median(peaks)),
        "largest": max(peaks),
        "too heavy": sum(one.reason == "too_heavy" for one in found),
        "out of reach": sum(one.reason == "out_of_reach" for one in found),
        "stalled": sum(one.reason == "stalled" for one in found),
        "latched": sum(one.failure == "latched" for one in found),
    }


def _shares(found: Sequence[EpisodeMetrics]) -> tuple[float, float]:
    """Return the shares opened, and opened with less than the allowed force."""
    gentle = [one.success and one.force_handle_peak < ADA_FORCE for one in found]
    return float(np.mean([one.success for one in found])), float(np.mean(gentle))


def main(
    policy: str = "gp",
    seeds: int = 20,
    draws: int = 200,
    first: int = 0,
    repeats: int = 20,
) -> None:
    """Open doors of buildings, and say with which force; some minutes.

    Args:
        policy: Who opens them.
        seeds: Draws of the demonstrations, for the presets.
        draws: Number of standard doors.
        first: Seed of the first of them.
        repeats: Measurements of every time.
    """
    measure_all(
        {
            "rooms": lambda _: rooms(policy, seeds),
            "standard": lambda _: standard(policy, first, draws),
            "costs": lambda _: costs(repeats),
        },
        repeats,
    )


if __name__ == "__main__":
    tyro.cli(main)
