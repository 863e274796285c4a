"""Speed of adapters, and returns of scripts: python benchmarks/learners.py.

Measures steps per second of many doors as a Gymnasium vector environment, in the
wrappers for learners, and as a Stable-Baselines3 environment. Measures the returns of a
gentle and of a violent script under the dense reward and under the reward of
``gplfd/DoorOpeningRL-v1``. Compares policies that learned from six demonstrations with
the learning curves of a policy that learned by reinforcement. Needs the extra sb3.
"""

import copy
import json
import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

import gymnasium as gym
import matplotlib.pyplot as plt
import numpy as np
import tyro
from harness import report
from stable_baselines3.common.vec_env import DummyVecEnv

from gplfd_env import ENVIRONMENT_ID, RL_ENVIRONMENT_ID
from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.spatial.arc import handle_pose_on_arc
from gplfd_env.wrappers import RelativeAction, VectorGentleReward, action_of
from gplfd_env.wrappers.sb3 import make_sb3
from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.speed.machine import load
from gplfd_experiments.speed.report import Measurement, Value, at_least
from gplfd_experiments.speed.timing import Timed, measure, repeated
from gplfd_policies.agents.lockstep import batch_agents
from gplfd_policies.registry.catalogue import policy_named
from gplfd_policies.registry.method import TrainingInput

JUDGED: Final = (0.35, 0.42, 0.50, 0.58, 0.65)
"""Radii of the doors on which learners are evaluated [m]."""
CLONE: Final = f"{Path(__file__).parents[1] / 'examples' / 'cloned_policy.py'}:make"
"""Policy of a network that imitates gp."""

_PERIODS: Final = 30


def resting(envs: Any, n: int, **seed: int) -> Timed:
    """Return a run of n doors whose hands rest for a number of periods, for timing."""
    step = partial(envs.step, np.zeros((n, 6), np.float32))
    return repeated(step, _PERIODS, partial(envs.reset, **seed), operations=n)


def measure_steps(repeats: int, counts: tuple[int, ...]) -> Measurement:
    """Time resting hands in every form of n doors, in turns, 800 steps or more each."""
    forms: dict[str, Timed] = {}
    for n in counts:
        for id in (ENVIRONMENT_ID, RL_ENVIRONMENT_ID):
            envs = gym.make_vec(id, n, autoreset_mode="SameStep")
            forms[f"{id}, {n}"] = resting(envs, n, seed=0)
        forms[f"make_sb3, {n}"] = resting(make_sb3(n), n)
        own = DummyVecEnv(n * [lambda: gym.make(RL_ENVIRONMENT_ID)])
        forms[f"DummyVecEnv, {n}"] = resting(own, n)
    times = measure(forms, repeats, least_operations=800)
    rates = {
        name: times[name].speed_over(times[f"{RL_ENVIRONMENT_ID}, {name.split()[-1]}"])
        for name in times
    }
    return Measurement(
        title=f"control steps of n doors ({load()})",
        rows={
            name: {"steps/s": time.rate, "of the wrapped": rates[name]}
            for name, time in times.items()
        },
        targets=tuple(
            at_least(f"make_sb3, {n}: of the wrapped", rates[f"make_sb3, {n}"], 0.8)
            for n in counts
        ),
    )


def measure_scripts() -> Measurement:
    """Open doors along their true arc in 6 s, and by pulling as fast as allowed.

    Both rewards are computed for the same episode.
    """
    rows: dict[str, dict[str, Value]] = {}
    behind = []
    for door in ("small", "medium", "large", "heavy"):
        returns = []
        for script in (gentle, slam):
            learner: Any = gym.make(RL_ENVIRONMENT_ID, door=door)
            plain = RelativeAction(gym.make(ENVIRONMENT_ID, door=door))
            learner.reset(seed=0)
            observation, _ = plain.reset(seed=0)
            radius, dense, step, over = learner.unwrapped.door.radius, 0.0, 0, False
            while not over:
                step += 1
                action = script(step, observation["ee_pose"], radius)
                observation, reward, *_ = plain.step(action)
                *_, terminated, truncated, info = learner.step(action)
                dense += float(reward)
                over = terminated or truncated
            for env in (learner, plain):
                env.close()
            rows[f"{door}, {script.__name__}"] = {
                "opened": "yes" if info["success"] else "no",
                "angle [deg]": math.degrees(info["door_angle"]),
                "time [s]": step * CONTROL_PERIOD,
                "peak radial [N]": info["peak_force"],
                "peak slip [mm]": 1e3 * info["peak_slip"],
                "dense return": dense,
                "return": info["return"],
            }
            returns.append(float(info["return"]))
        behind.append(returns[0] - returns[1])
    return Measurement(
        title="what two scripts earn",
        rows=rows,
        targets=(at_least("a slam's return below a gentle one's", min(behind), 0.5),),
    )


def gentle(step: int, hand: np.ndarray, radius: float) -> np.ndarray:
    """Return the action that follows the true arc to 66° in 6 s."""
    s = min(step * CONTROL_PERIOD / 6.0, 1.0)
    angle = math.radians(66.0) * (10 * s**3 - 15 * s**4 + 6 * s**5)
    return action_of(handle_pose_on_arc(radius, angle), hand)


def slam(step: int, hand: np.ndarray, radius: float) -> np.ndarray:
    """Return the largest allowed pull; the rotation follows the hand."""
    return np.array([math.cos(hand[4]), 0.0, -math.sin(hand[4]), 0.0, 0.5, 0.0])


def measure_policies(policies: tuple[str, ...]) -> Measurement:
    """Let policies that learned from six demonstrations open the doors `JUDGED`."""
    training = TrainingInput(demonstrations=Teacher().standard_demonstrations(seed=0))
    rows: dict[str, dict[str, Value]] = {}
    for name in policies:
        agent = policy_named(name).make(training)
        rows[Path(name).stem] = judged([copy.deepcopy(agent) for _ in JUDGED])
    return Measurement(title=f"doors of {', '.join(map(str, JUDGED))} m", rows=rows)


def judged(alone: Sequence[object]) -> dict[str, Value]:
    """Return the results of one episode per door, in the format of a learning curve."""
    agents = batch_agents(alone)
    made = gym.make_vec(
        ENVIRONMENT_ID, len(JUDGED), door=list(JUDGED), autoreset_mode="Disabled"
    )
    envs = VectorGentleReward(made)
    observations, infos = envs.reset(seed=0)
    agents.reset(observations)
    acting, steps = np.ones(len(JUDGED), dtype=bool), 0
    while acting.any():
        steps += np.count_nonzero(acting)
        actions = agents.act(observations, acting).action
        observations, _, terminated, truncated, infos = envs.step(actions)
        acting = acting & ~(terminated | truncated)
    envs.close()
    return {
        "opened": int(np.count_nonzero(infos["success"])),
        "return": float(np.mean(infos["return"])),
        "angle_deg": float(np.degrees(np.mean(infos["door_angle"]))),
        "peak_force": float(np.median(infos["peak_force"])),
        "steps": steps,
    }


def summarize_curves(curves: tuple[Path, ...]) -> Measurement:
    """Return the final results of runs of ``examples/learned_policy.py``."""
    ends: dict[str, dict[str, Value]] = {}
    for curve in curves:
        rows = json.loads(curve.read_text())
        since = math.inf
        for row in reversed(rows):
            if row["opened"] < row["of"]:
                break
            since = row["steps"]
        ends[str(curve.parent)] = {**rows[-1], "all open since": since}
    columns = next(iter(ends.values()))
    summary: dict[str, dict[str, Value]] = {
        name: {
            column: float(of([end[column] for end in ends.values()]))
            for column in columns
        }
        for name, of in (("median", np.median), ("least", np.min), ("greatest", np.max))
    }
    return Measurement(title="PPO, judged at the end", rows={**ends, **summary})


def draw(
    curves: Sequence[Path], rows: Mapping[str, Mapping[str, Value]], figure: Path
) -> None:
    """Draw learning curves and the results of policies with six demonstrations."""
    panels = (
        ("opened", f"doors opened, of {len(JUDGED)}"),
        ("return", "return, mean"),
        ("peak_force", "peak radial force [N], median"),
    )
    shades = plt.get_cmap("Oranges")(np.linspace(0.4, 0.9, len(curves)))
    drawing, places = plt.subplots(1, len(panels), figsize=(10.0, 3.2))
    for place, (name, title) in zip(places, panels, strict=True):
        for curve, shade in zip(curves, shades, strict=True):
            judged = json.loads(curve.read_text())
            steps = [1e-3 * row["steps"] for row in judged]
            values = [row[name] for row in judged]
            place.plot(steps, values, color=shade, label=curve.parent.name)
        for number, (policy, row) in enumerate(rows.items()):
            style = (("C0", "--"), ("C2", ":"))[number % 2]
            label = f"{policy}, 6 demonstrations"
            place.axhline(row[name], color=style[0], linestyle=style[1], label=label)
        place.set(xlabel="thousand control steps", ylabel=title)
        place.spines[["top", "right"]].set_visible(False)
    lines = places[0].get_lines()
    drawing.legend(handles=lines, frameon=False, ncols=len(lines), loc="upper center")
    drawing.tight_layout(rect=(0.0, 0.0, 1.0, 0.92))
    drawing.savefig(figure, dpi=110)
    plt.close(drawing)


def main(
    repeats: int = 5,
    counts: tuple[int, ...] = (2, 8, 32),
    policies: tuple[str, ...] = ("gp", CLONE),
    curves: tuple[Path, ...] = (),
    figure: Path = Path("learners.png"),
) -> None:
    """Measure the speed of adapters, the returns of scripts, and results of policies.

    Args:
        repeats: Measurements of every time.
        counts: Numbers of doors.
        policies: Policies that learn from six demonstrations.
        curves: Files curve.json of runs of examples/learned_policy.py to compare with.
        figure: Picture to write if curves are given.
    """
    measures: dict[str, Callable[[], Measurement]] = {
        "steps": partial(measure_steps, repeats, counts),
        "scripts": measure_scripts,
        "policies": partial(measure_policies, policies),
    }
    if curves:
        measures["curves"] = partial(summarize_curves, curves)
    found = report(measures)
    if curves:
        draw(curves, found["policies"].rows, figure)


if __name__ == "__main__":
    tyro.cli(main)
