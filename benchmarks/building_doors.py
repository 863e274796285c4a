"""Doors of buildings and a robot that drives: python benchmarks/building_doors.py.

Policies learn from six demonstrations of three doors of a door's kind, beside the
oracle, which is told the door; and what a lever's scene costs, beside a bar's.
"""

import contextlib
import functools
import itertools
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, Final, Literal

import gymnasium as gym
import numpy as np
import tyro
from harness import opened, report, tasks_of

from gplfd_env import ENVIRONMENT_IDS
from gplfd_env.doors.config import DOORS, DoorConfig
from gplfd_experiments.analysis.results.measures import ADA_FORCE
from gplfd_experiments.console.progress import LOG
from gplfd_experiments.episodes.metrics import EpisodeMetrics, episode_metrics
from gplfd_experiments.speed.report import Measurement, Value, at_least
from gplfd_experiments.speed.timing import Timed, measure, repeated

Part = Literal["rooms", "standard", "costs"]

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
_GENTLE: Final = f"below {ADA_FORCE} N"


def metrics_of(
    policy: str, doors: Sequence[DoorConfig], seed: int
) -> list[EpisodeMetrics]:
    """Let a policy that learned from a seed's demonstrations open doors."""
    tasks = tasks_of(doors, policy, seed=seed, base="mobile")
    return [episode_metrics(log) for log in opened(tasks)]


@functools.cache
def in_rooms(policy: str, seeds: int) -> Mapping[str, list[EpisodeMetrics]]:
    """Open `ROOMS` with demonstrations of several seeds; return metrics by door."""
    each = [metrics_of(policy, list(ROOMS.values()), seed) for seed in range(seeds)]
    return dict(zip(ROOMS, map(list, zip(*each, strict=True)), strict=True))


def rooms(policy: str, seeds: int) -> Measurement:
    """Say with which force a policy opens `ROOMS`."""
    found = in_rooms(policy, seeds)
    gentle = [_shares(found[name])[1] for name in found if name.startswith("room")]
    return Measurement(
        title=f"{policy}, {seeds} seeds of demonstrations, levers that are pulled",
        rows={name: _summary(metrics) for name, metrics in found.items()},
        targets=(
            at_least(
                f"{policy}, rooms: least share opened {_GENTLE}", min(gentle), 0.95
            ),
            at_least(f"{policy}, 0.90 m: opened", _shares(found[_WIDE])[0], 0.9),
        ),
    )


@functools.cache
def standard_doors(first: int, draws: int) -> Mapping[str, tuple[DoorConfig, ...]]:
    """Draw doors of buildings with seeds from the first; return them by kind."""
    env: Any = gym.make(
        ENVIRONMENT_IDS["pose"], base="mobile", randomization="standard"
    )
    kinds: dict[str, list[DoorConfig]] = {}
    with contextlib.closing(env):
        for seed in range(first, first + draws):
            env.reset(seed=seed)
            door = env.unwrapped.door
            kinds.setdefault(f"{door.handle}, {door.swing}", []).append(door)
    # Doors with the hinge on the right before those with it on the left.
    return {
        kind: tuple(sorted(kinds[kind], key=lambda door: door.hinge_side != "right"))
        for kind in sorted(kinds)
    }


@functools.cache
def in_standard_doors(
    policy: str, first: int, draws: int
) -> Mapping[str, list[EpisodeMetrics]]:
    """Open the drawn doors with one seed's demonstrations; return metrics by kind."""
    found = {}
    for kind, doors in standard_doors(first, draws).items():
        LOG.info("%s opens %d doors: %s", policy, len(doors), kind)
        found[kind] = metrics_of(policy, doors, 0)
    return found


def standard(policy: str, first: int, draws: int) -> Measurement:
    """Say how a policy opens draws of ``randomization="standard"``."""
    found = {name: in_standard_doors(name, first, draws) for name in ("oracle", policy)}
    rows: dict[str, dict[str, Value]] = {
        f"{kind}: {name}": _summary(found[name][kind])
        for kind in found["oracle"]
        for name in found
    }
    everything = {name: _all(by_kind) for name, by_kind in found.items()}
    rows |= {f"all: {name}": _summary(metrics) for name, metrics in everything.items()}
    both = zip(everything["oracle"], everything[policy], strict=True)
    learned, _ = _shares([own for told, own in both if told.success])
    return Measurement(
        title=f"{draws} draws of standard doors, seeds from {first}",
        rows=rows,
        targets=(
            at_least(
                "standard: share opened by the oracle",
                _shares(everything["oracle"])[0],
                0.8,
            ),
            at_least(f"standard: share of these that {policy} opens", learned, 0.95),
        ),
    )


def methods(policies: Sequence[str], seeds: int, first: int, draws: int) -> Measurement:
    """Compare policies by the numbers of doors that they open."""
    rows: dict[str, dict[str, Value]] = {}
    for policy in policies:
        drawn, row = (
            in_standard_doors(policy, first, draws),
            rows.setdefault(policy, {}),
        )
        for handle in ("bar", "lever", "knob"):
            here = _all({k: v for k, v in drawn.items() if k.startswith(handle)})
            row[f"{handle}s"] = f"{sum(one.success for one in here)} of {len(here)}"
        inside = in_rooms(policy, seeds).items()
        room = [one for name, of in inside if name.startswith("room") for one in of]
        for name, episodes in (("standard", _all(drawn)), ("rooms", room)):
            share, gentle = _shares(episodes)
            row[f"{name}: opened"] = round(share * len(episodes))
            row[f"{name}: {_GENTLE}"] = round(gentle * len(episodes))
    return Measurement(title="numbers of doors", rows=rows)


def costs(repeats: int) -> Measurement:
    """Time resets and steps of a lever's scene beside a bar's, in turns."""
    actions: dict[tuple[str, str], Timed] = {}
    for name, door in _SCENES.items():
        env: Any = gym.make(ENVIRONMENT_IDS["pose"], door=door)
        # Doors that no cache has seen.
        new = (door.replaced({"radius": 0.45 + 1e-6 * n}) for n in itertools.count())

        def reset_new(env: Any = env, new: Any = new) -> None:
            env.reset(options={"door": next(new)})

        actions["reset", name] = repeated(env.reset, 20)
        actions["reset to a new door", name] = repeated(reset_new)
        actions["step", name] = repeated(
            partial(env.step, np.zeros(6)), 200, begin=env.reset
        )
    times = measure(actions, repeats)
    rows: dict[str, dict[str, Value]] = {}
    for what in dict.fromkeys(what for what, _ in actions):
        bar, lever = (times[what, name] for name in _SCENES)
        rows[what] = {"bar": bar, "lever": lever, "ratio": lever.cpu_over(bar)}
    return Measurement(title="a latched lever beside a bar, CPU time [ms]", rows=rows)


def _all(by_kind: Mapping[str, list[EpisodeMetrics]]) -> list[EpisodeMetrics]:
    return [one for metrics in by_kind.values() for one in metrics]


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
    policy: tuple[str, ...] = ("gp",),
    seeds: int = 20,
    draws: int = 200,
    first: int = 0,
    repeats: int = 20,
    parts: tuple[Part, ...] = ("rooms", "standard", "costs"),
) -> None:
    """Open doors of buildings, and say with which force; some minutes per policy.

    Args:
        policy: One policy or several, which are printed one after the other.
        seeds: Draws of the demonstrations, for the presets.
        draws: Number of standard doors.
        first: Seed of the first of them.
        repeats: Measurements of every time.
        parts: What to measure.
    """
    measures: dict[str, Any] = {}
    for one in policy:
        if "rooms" in parts:
            measures[f"rooms, {one}"] = partial(rooms, one, seeds)
        if "standard" in parts:
            measures[f"standard, {one}"] = partial(standard, one, first, draws)
    if {"rooms", "standard"} <= {*parts}:
        measures["methods"] = partial(methods, policy, seeds, first, draws)
    if "costs" in parts:
        measures["costs"] = partial(costs, repeats)
    report(measures)


if __name__ == "__main__":
    tyro.cli(main)
