"""Doors on MuJoCo Warp compared with MuJoCo: python benchmarks/on_warp.py.

Measures the agreement for the same actions in the same doors, and control steps per
second of many doors, compared with MuJoCo on threads. Needs the extra warp; ``--device
cuda:0`` selects a GPU.
"""

import itertools
import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Final

import gymnasium as gym
import mujoco_warp
import numpy as np
import tyro
import warp
from gplfd_experiments.speed.machine import load
from gplfd_experiments.speed.report import Measurement, Value, at_most
from gplfd_experiments.speed.timing import measure, repeated
from harness import report

from gplfd_env import RL_ENVIRONMENT_ID, TIME_LIMIT
from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.envs.reinforcement import for_learners
from gplfd_env.envs.vector import DoorOpeningImpedanceVectorEnv
from gplfd_env.envs.warp import make_warp
from gplfd_env.simulation.command import COMMANDS
from gplfd_env.simulation.loads import NO_EXTRA_INPUTS
from gplfd_env.spatial.arc import handle_pose_on_arc
from gplfd_env.wrappers import action_of

DOORS: Final = (
    *("small", "medium", "large", "heavy", "cabinet", "wardrobe"),
    {"radius": 0.45, "swing": "push"},
    {"radius": 0.45, "hinge_side": "left"},
)
"""Doors that are compared."""

Array = np.ndarray
Script = Callable[[int, Array], Array]
"""Maps the step and the poses of the hands (n, 6) to actions (n, 6)."""

_POSE, _WRENCH = slice(0, 6), slice(27, 33)
_PERIODS: Final = 30


class StiffestImpedance(DoorOpeningImpedanceVectorEnv):
    """MuJoCo simulations of the model for Warp: commands without stiffness."""

    def __init__(self, num_envs: int = 1, *args: Any, **arguments: Any) -> None:
        super().__init__(num_envs, *args, **arguments)
        self.single_action_space = COMMANDS["pose"].space

    def step(self, poses: Array) -> Any:
        """Command every hand for one control period."""
        stiffest = np.tile(self.command.rest[6:], (self.num_envs, 1))
        return super().step(np.hstack([poses, stiffest]))


class Rounded(StiffestImpedance):
    """The same with joint positions rounded to float32 once per control period."""

    def step(self, poses: Array) -> Any:
        """Command every hand for one control period."""
        for row in range(self.num_envs):
            qpos = self._batch.qpos_of(row)
            qpos[:] = qpos.astype(np.float32)
        return super().step(poses)


def mujoco(envs: type = StiffestImpedance, **arguments: Any) -> Any:
    """Return MuJoCo simulations of `DOORS`."""
    made = envs(len(DOORS), door=DOORS, max_episode_steps=TIME_LIMIT, **arguments)
    return for_learners(made)


def arcs(envs: Any, rng: np.random.Generator) -> Script:
    """Follow the true arcs of the doors to random angles within 3 s."""
    doors = [one.door for one in envs.unwrapped.variations]
    angles = np.radians(rng.uniform(20.0, 66.0, len(doors)))
    mirrored = np.array([(1, 1, 1, 1, 1, 1)] * len(doors))
    for row, door in enumerate(doors):
        mirrored[row] = (
            door.swing_sign,
            1,
            door.hinge_sign,
            1,
            door.swing_sign * door.hinge_sign,
            1,
        )
    radii = np.array([door.radius for door in doors])

    def script(step: int, hands: Array) -> Array:
        s = min(step * CONTROL_PERIOD / 3.0, 1.0)
        progress = 10 * s**3 - 15 * s**4 + 6 * s**5
        poses = mirrored * handle_pose_on_arc(radii, progress * angles)
        return np.clip(action_of(poses, hands), -1.0, 1.0).astype(np.float32)

    return script


def shoves(envs: Any, rng: np.random.Generator) -> Script:
    """Move hands in a new random direction every 0.1 s, by up to 12 mm and 0.04 rad."""
    drawn = rng.uniform(-0.4, 0.4, (1000, envs.num_envs, 6)).astype(np.float32)
    return lambda step, hands: drawn[step // 10]


def differences(
    first: Any, second: Any, script: Any, periods: int, seed: int = 0
) -> dict[str, Array]:
    """Run a script in two vector environments, and return how they differ.

    The actions of the script depend on the observations of the second one. There is one
    number per period and simulation, until an episode of either ends: absolute
    differences of ``door`` [rad], ``hand`` [m, rad], ``wrench`` [N, N m],
    ``peak_force`` [N] and ``return``.
    """
    first.reset(seed=seed)
    observations, _ = second.reset(seed=seed)
    acting = np.ones(first.num_envs, dtype=bool)
    play = script(second, np.random.default_rng(seed))
    found: dict[str, list[Array]] = {}
    for step in range(1, periods + 1):
        actions = play(step, observations[:, _POSE])
        seen, _, *ended, infos = first.step(actions)
        observations, _, *over, expected = second.step(actions)
        acting = acting & ~np.any([*ended, *over], axis=0)
        apart = np.abs(seen - observations)
        row = {
            "hand": apart[:, _POSE].max(axis=1),
            "wrench": apart[:, _WRENCH].max(axis=1),
            **{
                name.removesuffix("_angle"): np.abs(infos[name] - expected[name])
                for name in ("door_angle", "peak_force", "return")
            },
        }
        for name, values in row.items():
            found.setdefault(name, []).append(values[acting])
    return {name: np.concatenate(values) for name, values in found.items()}


def measure_agreement(seeds: int, periods: int) -> Measurement:
    """Compare Warp with MuJoCo, and MuJoCo with itself and with the other servo."""
    doors = {"door": DOORS}
    firsts = {
        "Warp": lambda **given: make_warp(len(DOORS), **doors, **given),
        "MuJoCo, rounded": lambda **given: mujoco(Rounded, **given),
        "MuJoCo, one servo": lambda **given: gym.make_vec(
            RL_ENVIRONMENT_ID, len(DOORS), **doors, **given
        ),
    }
    columns = (("door", 1e3, "mrad"), ("wrench", 1.0, "N"), ("return", 1.0, ""))
    rows: dict[str, Mapping[str, Value]] = {}
    worst = 0.0
    cases = itertools.product((arcs, shoves), ("none", "hard"), firsts.items())
    for script, randomization, (name, make) in cases:
        pair = [each(randomization=randomization) for each in (make, mujoco)]
        found = [differences(*pair, script, periods, seed) for seed in range(seeds)]
        for envs in pair:
            envs.close()
        apart = {
            what: np.concatenate([one[what] for one in found]) for what in found[0]
        }
        # Median, 95 % quantile and maximum.
        rows[f"{script.__name__}, {randomization}: {name}"] = {
            f"{what} {share} [{unit}]".removesuffix(" []"): float(
                np.quantile(scale * apart[what], level)
            )
            for what, scale, unit in columns
            for share, level in (("50 %", 0.5), ("95 %", 0.95), ("all", 1.0))
        }
        if name == "Warp" and script is arcs:
            worst = max(worst, math.degrees(apart["door"].max()))
    return Measurement(
        title=f"apart from MuJoCo with three servos, {periods} control periods",
        rows=rows,
        targets=(at_most("door's angle on arcs [deg], worst", worst, 0.05),),
    )


def measure_steps(repeats: int, counts: tuple[int, ...]) -> Measurement:
    """Time resting hands at n doors, on Warp and on MuJoCo's threads, in turns."""
    rows: dict[str, Mapping[str, Value]] = {}
    for n in counts:
        still, rest = np.zeros((n, 6), np.float32), np.zeros((n, 6))
        ways = {}
        for name, envs in {
            "MuJoCo": gym.make_vec(RL_ENVIRONMENT_ID, n),
            "Warp": make_warp(n),
        }.items():
            advance = envs.unwrapped._batch.advance
            step = partial(envs.step, still)
            physics = partial(advance, rest, None, NO_EXTRA_INPUTS)
            for way, action in ((name, step), (f"{name}, physics", physics)):
                begin = partial(envs.reset, seed=0)
                ways[way] = repeated(action, _PERIODS, begin, operations=n)
        times = measure(ways, repeats, least_operations=2 * n * _PERIODS)
        for name, time in times.items():
            # Time of a step of one door without its physics [µs].
            alone = times.get(f"{name}, physics")
            beside = alone and 1e6 * (1.0 / time.rate - 1.0 / alone.rate)
            rows[f"{name}, {n}"] = {
                "steps/s": time.rate,
                "of MuJoCo": time.speed_over(times["MuJoCo"]),
                "beside physics [us]": beside,
            }
    return Measurement(
        title=f"control steps of n doors, Warp on {warp.get_device()} ({load()})",
        rows=rows,
    )


def main(
    repeats: int = 5,
    counts: tuple[int, ...] = (1, 8, 64),
    seeds: int = 3,
    periods: int = 300,
    device: str | None = None,
) -> None:
    """Measure agreement with MuJoCo, and control steps per second.

    Args:
        repeats: Measurements of every time.
        counts: Numbers of doors; thousands are for a GPU.
        seeds: Episodes per compared door; 0 disables the comparison.
        periods: Control periods of each.
        device: For example cpu or cuda:0; by default Warp chooses.
    """
    warp.config.log_level = warp.LOG_WARNING
    if device is not None:
        warp.set_device(device)
    measures: dict[str, Callable[[], Measurement]] = {}
    if seeds:
        measures["agreement"] = partial(measure_agreement, seeds, periods)
    measures["steps"] = partial(measure_steps, repeats, counts)
    report(measures)
    print(f"MuJoCo Warp {mujoco_warp.__version__}, Warp {warp.__version__}")


if __name__ == "__main__":
    tyro.cli(main)
