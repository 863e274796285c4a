"""Doors of buildings and a mobile robot: python benchmarks/building_doors.py.

Policies learn from six demonstrations of three doors of the same kind. They are
compared with the oracle, which knows the door.
"""

import contextlib
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
import tyro
from harness import opened, report, tasks_of

from gplfd_env import ENVIRONMENT_IDS
from gplfd_env.doors.config import DoorConfig
from gplfd_experiments.analysis.results.measures import ADA_FORCE
from gplfd_experiments.console.progress import LOG
from gplfd_experiments.episodes.metrics import EpisodeMetrics, episode_metrics
from gplfd_experiments.speed.report import Measurement, Value, at_least


def standard_doors(first: int, draws: int) -> Mapping[str, Sequence[DoorConfig]]:
    """Draw doors of buildings with consecutive seeds; return them by kind."""
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
        kind: sorted(kinds[kind], key=lambda door: door.hinge_side != "right")
        for kind in sorted(kinds)
    }


def standard(policies: Sequence[str], first: int, draws: int) -> Measurement:
    """Let policies and the oracle open doors drawn by ``randomization="standard"``."""
    doors = standard_doors(first, draws)
    rows: dict[str, dict[str, Value]] = {}
    everything: dict[str, list[EpisodeMetrics]] = {}
    for policy in dict.fromkeys(("oracle", *policies)):
        found: dict[str, list[EpisodeMetrics]] = {}
        for kind, drawn in doors.items():
            LOG.info("%s opens %d doors: %s", policy, len(drawn), kind)
            logs = opened(tasks_of(drawn, policy, seed=0, base="mobile"))
            found[kind] = [episode_metrics(log) for log in logs]
        for handle in ("bar", "lever", "knob", ""):
            kinds = [kind for kind in found if kind.startswith(handle)]
            for kind in kinds if handle else ():
                rows[f"{kind}: {policy}"] = _summary(found[kind])
            if kinds:
                together = [one for kind in kinds for one in found[kind]]
                rows[f"all {handle or 'door'}s: {policy}"] = _summary(together)
        everything[policy] = together
    told = everything.pop("oracle")
    targets = [at_least("share opened by the oracle", _share(told), 0.8)]
    for policy, metrics in everything.items():
        both = zip(told, metrics, strict=True)
        share = _share([own for by_oracle, own in both if by_oracle.success])
        targets.append(at_least(f"share of these that {policy} opens", share, 0.95))
    return Measurement(
        title=f"{draws} draws of standard doors, seeds from {first}",
        rows=rows,
        targets=tuple(targets),
    )


def _share(found: Sequence[EpisodeMetrics]) -> float:
    return float(np.mean([one.success for one in found]))


def _summary(found: Sequence[EpisodeMetrics]) -> dict[str, Value]:
    peaks = [one.force_handle_peak for one in found]
    opened = [one.force_handle_peak for one in found if one.success]
    failures = Counter(one.reason or one.failure for one in found if not one.success)
    return {
        "doors": len(found),
        "opened": len(opened),
        f"below {ADA_FORCE} N": sum(peak < ADA_FORCE for peak in opened),
        "peak N, median": float(np.median(peaks)),
        "largest": max(peaks),
        "why not": ", ".join(f"{n} {why}" for why, n in failures.items()) or None,
    }


def main(
    policies: tuple[str, ...] = ("gp",),
    draws: int = 200,
    first: int = 0,
) -> None:
    """Report success and force on doors of buildings; takes a minute per policy.

    Args:
        policies: Policies to compare with the oracle.
        draws: Number of standard doors.
        first: Seed of the first door.
    """
    report({"standard": partial(standard, policies, first, draws)})


if __name__ == "__main__":
    tyro.cli(main)
