"""Other environments' steps and vectors, quoted: nothing here is measured by us now.

Measured once with the method of `experiments.benchmarks.stepping` and
`experiments.benchmarks.vectors`, in 2026, on another machine with two shared cores:
random actions, no pictures, medians of five to fifteen rounds, replays bit for bit.
Only ratios carry over to another machine, and only roughly.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from experiments.benchmarks.report import Table, Target

__all__ = ["Elsewhere", "quote_elsewhere"]


@dataclass(frozen=True, kw_only=True, slots=True)
class QuotedStep:
    """One environment's step over the same physics alone."""

    environment: str
    """Name, and settings that are not the default."""
    package: str
    """Package and version, with the MuJoCo that it ran on."""
    step: float
    """CPU time of a step [µs]."""
    physics: float
    """Of its physics alone [µs]."""
    ratio: float
    """Median over rounds of their ratio."""
    reset: float
    """Reset [ms]."""


@dataclass(frozen=True, kw_only=True, slots=True)
class QuotedVector:
    """Environment steps per second on the wall, over `SyncVectorEnv` of two."""

    environment: str
    """What was vectorised."""
    vector: str
    """How: simulations on threads, or processes."""
    of_sync: float
    """Times as fast."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Elsewhere:
    """What others take, for comparison."""

    steps: tuple[QuotedStep, ...]
    """Single environments."""
    vectors: tuple[QuotedVector, ...]
    """Vectors; MuJoCo 4.0.0."""

    def tables(self) -> tuple[Table, ...]:
        """Two tables that say that they are quoted."""
        return (
            Table(
                title="others' steps, quoted: measured before, on another machine",
                columns=("", "", "step µs", "physics µs", "ratio", "reset ms"),
                rows=tuple(
                    (
                        one.environment,
                        one.package,
                        f"{one.step:.0f}",
                        f"{one.physics:.0f}",
                        f"{one.ratio:.2f}",
                        f"{one.reset:.3g}",
                    )
                    for one in self.steps
                ),
            ),
            Table(
                title="others' vectors, quoted likewise: speed over SyncVectorEnv, 2",
                columns=("", "", "of Sync"),
                rows=tuple(
                    (one.environment, one.vector, f"{one.of_sync:.2f}")
                    for one in self.vectors
                ),
            ),
        )

    def targets(self) -> tuple[Target, ...]:
        """Nothing was measured, so there is nothing to hold."""
        return ()


def quote_elsewhere(repeats: int) -> Elsewhere:
    """Return the quoted numbers.

    Args:
        repeats: Of no importance: nothing is measured.
    """
    return Elsewhere(
        steps=tuple(
            QuotedStep(
                environment=environment,
                package=package,
                step=step,
                physics=physics,
                ratio=ratio,
                reset=reset,
            )
            for environment, package, step, physics, ratio, reset in _STEPS
        ),
        vectors=tuple(
            QuotedVector(environment=environment, vector=vector, of_sync=of_sync)
            for environment, vector, of_sync in _VECTORS
        ),
    )


_ROBOSUITE: Final = "robosuite 1.5.2, MuJoCo 3.5.0"
_ROBOTICS: Final = "gymnasium-robotics 1.4.2, MuJoCo 3.5.0"
_METAWORLD: Final = "metaworld 3.1.1, MuJoCo 3.3.0"
_GYMNASIUM: Final = "gymnasium 1.4.0, MuJoCo 4.0.0"

_STEPS: Final = (
    ("AdroitHandDoor-v1", _ROBOTICS, 241.0, 204.0, 1.19, 0.073),
    ("FrankaKitchen-v1", _ROBOTICS, 1995.0, 1742.0, 1.15, 0.22),
    ("door-open-v3", _METAWORLD, 303.0, 61.0, 4.99, 7.7),
    ("door-close-v3", _METAWORLD, 312.0, 66.0, 4.76, 8.4),
    ("Door, Panda, OSC_POSE", _ROBOSUITE, 6144.0, 698.0, 8.82, 135.0),
    ("Door, Panda, OSC_POSE, variable", _ROBOSUITE, 6158.0, 703.0, 8.86, 1.8),
    ("Door, Panda, JOINT_POSITION, variable", _ROBOSUITE, 4280.0, 694.0, 6.19, 1.8),
    ("Door, Tiago", _ROBOSUITE, 17600.0, 5435.0, 3.27, 7.3),
    ("Pusher-v5", _GYMNASIUM, 48.6, 29.1, 1.67, 0.034),
)
_VECTORS: Final = (
    ("Pusher-v5", "AsyncVectorEnv, 2", 0.29),
    ("Pusher-v5", "mujoco.batch, 2 on 1 thread", 1.80),
    ("Pusher-v5", "mujoco.batch, 2 on 2 threads", 3.03),
    ("Pusher-v5", "mujoco.batch, 256 on 2 threads", 4.20),
    ("AdroitHandDoor-v1", "AsyncVectorEnv, 2", 0.75),
    ("AdroitHandDoor-v1", "mujoco.batch, 2 on 2 threads", 1.83),
    ("AdroitHandDoor-v1", "mujoco.batch, 64 on 2 threads", 2.02),
    ("AdroitHandDoor-v1", "mujoco.batch, 256 on 2 threads", 2.14),
)
