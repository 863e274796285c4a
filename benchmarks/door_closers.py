"""Levers with closers, forces demonstrated: python benchmarks/door_closers.py.

Two thirds of the doors have a closer with 8 to 47 N m at rest, like the doors of
DoorBench. Policies learn from six other doors, drawn from the same ranges, with and
without the forces of the demonstrations. They are compared with the oracle, which knows
the door.
"""

from collections.abc import Sequence
from functools import partial

import numpy as np
import tyro
from gplfd_experiments.speed.report import Measurement, Target, Value, at_least, at_most
from harness import opened, report, tasks_of

from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.parts import Closer, Leaf
from gplfd_experiments.console.progress import LOG
from gplfd_experiments.data.teacher import ForceConfig, Teacher
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.metrics import episode_metrics
from gplfd_policies.demonstrations.npz import LabelledDemonstrations

_SHOWN = 6
"""Demonstrated doors, each opened once."""
_FELT = 0.05
"""Door angle from which the hand has measured the load of the door [rad]."""


def levers(count: int, seed: int) -> list[DoorConfig]:
    """Draw pulled doors, 0.70 to 0.97 m wide."""
    rng = np.random.default_rng(seed)
    doors = []
    for number in range(count):
        width = float(rng.uniform(0.70, 0.97))
        moment = float(rng.uniform(8.0, 47.0)) if number % 3 else 0.0
        leaf = {
            "panel_mass": float(rng.uniform(20.0, 45.0)),
            "hinge_friction": float(rng.uniform(0.3, 1.0)),
            "hinge_damping": float(rng.uniform(0.2, 1.0)),
        }
        closer = {
            "preload": moment,
            "stiffness": moment * float(rng.uniform(0.05, 0.3)),
            "damping": float(rng.uniform(4.0, 15.0)),
            "closing_damping": float(rng.uniform(20.0, 60.0)),
        }
        door = DoorConfig(
            handle="lever",
            latch="spring",
            handle_height=1.0,
            leaf=Leaf(width=width, backset=0.06),
            radius=width - 0.06,
            **leaf,
            closer=Closer(**closer) if moment else Closer(),
        )
        doors.append(door)
    return doors


def demonstrated(seed: int, *, forces: bool) -> LabelledDemonstrations:
    """Record demonstrations at six other doors with levers; the motion is the same."""
    doors = levers(_SHOWN, seed=50 + seed)
    teacher = Teacher(forces=ForceConfig() if forces else None)
    given = teacher.demonstrate_doors(doors, 1, rng=np.random.default_rng(100 + seed))
    radii = tuple(door.radius for door in doors)
    return LabelledDemonstrations(demonstrations=given, radii=radii)


def closers(policies: Sequence[str], seeds: int, count: int) -> Measurement:
    """Let policies and the oracle open doors with levers and closers."""
    doors = levers(count, seed=1)

    def logs_of(policy: str, seed: int, forces: bool | None) -> list[EpisodeLog]:
        LOG.info("%s opens %d doors, seed %d", policy, count, seed)
        shown = None if forces is None else demonstrated(seed, forces=forces)
        return opened(tasks_of(doors, policy, seed=seed, base="mobile"), shown)

    told = [episode_metrics(log) for log in logs_of("oracle", 0, None)]
    rows: dict[str, dict[str, Value]] = {}
    targets: list[Target] = []
    for policy in policies:
        for forces in (False, True):
            logs = [one for n in range(seeds) for one in logs_of(policy, n, forces)]
            found = [episode_metrics(log) for log in logs]
            both = list(zip(told * seeds, found, strict=True))
            share = np.mean([own.success for oracle, own in both if oracle.success])
            ratios = [
                own.force_handle_peak / oracle.force_handle_peak
                for oracle, own in both
                if own.success and oracle.success
            ]
            name = f"{policy}, {'with' if forces else 'without'} forces"
            coverage = _coverage(logs)
            rows[name] = {
                "opened": sum(one.success for one in found),
                "of": len(found),
                "oracle's": float(share),
                "peak / oracle's, median": float(np.median(ratios or [np.nan])),
                "largest": float(np.max(ratios or [np.nan])),
                "slip mm": max(one.slip_max_mm or 0.0 for one in found if one.success),
                "in 95 %": coverage,
            }
            if not forces:
                continue
            targets += [
                at_least(f"share of the oracle's doors, {name}", float(share), 0.95),
                at_most(
                    f"median of peak / oracle's, {name}",
                    float(np.median(ratios or [np.nan])),
                    1.3,
                ),
            ]
    return Measurement(
        title=f"{count} levers with closers, {seeds} sets of demonstrations",
        rows=rows,
        targets=tuple(targets),
    )


def _coverage(logs: Sequence[EpisodeLog]) -> float | None:
    """Share of measured forces along the path inside the expected interval."""
    inside = []
    for log in logs:
        felt = np.isfinite(log.expected_force[:, 0]) & (log.door_angle > _FELT)
        force = -np.sum(log.frame[felt, :, 0] * log.wrench[felt, :3], axis=1)
        error = np.abs(force - log.expected_force[felt, 0])
        inside.append(error < 1.96 * log.expected_force_std[felt, 0])
    together = np.concatenate(inside)
    return float(together.mean()) if together.size else None


def main(policies: tuple[str, ...] = ("gp",), seeds: int = 2, doors: int = 24) -> None:
    """Open doors with levers and closers; takes a minute per policy.

    Args:
        policies: Policies to compare with the oracle.
        seeds: Sets of demonstrations.
        doors: Number of doors.
    """
    report({"closers": partial(closers, policies, seeds, doors)})


if __name__ == "__main__":
    tyro.cli(main)
