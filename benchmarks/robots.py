"""What the pages say of robots: python benchmarks/robots.py {arms,commands,insistence}.

Each writes its results to docs/results.
"""

import itertools
import sysconfig
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final
from unittest import mock

import gymnasium as gym
import numpy as np
import tyro

from gplfd_env import ENVIRONMENT_ID
from gplfd_env.doors.config import door_config
from gplfd_env.doors.motion import end_angle
from gplfd_env.robot.robots import ROBOTS, robot_named
from gplfd_experiments.episodes.build import Movements, learned_agents, open_together
from gplfd_experiments.episodes.metrics import episode_metrics
from gplfd_experiments.episodes.task import episode_task
from gplfd_experiments.files.plain_data import read_json, write_json
from gplfd_experiments.files.provenance import code_state
from gplfd_experiments.studies.jobs import episode_log
from gplfd_experiments.workflows.runs import episode_tasks
from gplfd_experiments.workflows.settings import RunSettings
from gplfd_policies.agents import handles
from gplfd_policies.control.load import LearnedLoad
from gplfd_policies.registry.catalogue import policy_named

DOCS: Final = Path(__file__).parents[1] / "docs"
EXAMPLES: Final = (
    Path(sysconfig.get_path("purelib")) / "cmeel.prefix/share/example-robot-data/robots"
)
ARMS: Final = tomllib.loads(Path(__file__).with_name("arms.toml").read_text("utf-8"))


def opened(robot: Path) -> dict[str, Any]:
    """Return what `gplfd run --robot ROBOT --doors medium` measures, or its refusal."""
    try:
        (task,) = episode_tasks(RunSettings(doors=("medium",), robot=str(robot)), [0])
    except ValueError as error:
        reason = str(error).replace(f"{robot}", robot.name)
        return {"opened": False, "reason": reason}
    measured = episode_metrics(episode_log(task))
    return {
        "opened": measured["success"],
        "base": task.base,
        "radial_force_N": measured["force_radial_peak"],
        "reason": measured["reason"],
    }


def arms() -> None:
    """Let arms of other people open the medium door."""
    rows = []
    for arm, file in ARMS.items():
        rows.append({"arm": arm, "file": file, **opened(EXAMPLES / file)})
        print(rows[-1], flush=True)
    rows.sort(key=lambda row: row.get("radial_force_N", np.inf))
    write_json(DOCS / "results/arms.json", {**code_state(), "rows": rows})


def excesses(
    env: Any, arm: Sequence[str], steps: int, seed: int
) -> Iterator[dict[str, float]]:
    """Command random actions, each for 0.3 s, and yield every step's excesses."""
    env.reset(seed=seed)
    rng, space = np.random.default_rng(seed), env.action_space
    low, high = env.model.jnt_range[[env.model.joint(name).id for name in arm]].T
    for step in range(steps):
        if step % 30 == 0:
            action = rng.uniform(space.low, space.high)
        observation, _, ended, _, info = env.step(action)
        position, angle = observation["joint_pos"], info["door_angle"]
        beyond = np.maximum(low - position, position - high).max()
        depths = env.data.contact.dist
        yield {
            "joint_speed_rad_s": np.abs(observation["joint_vel"]).max(),
            "joint_beyond_range_rad": beyond,
            "leaf_beyond_stop_deg": np.rad2deg(angle - end_angle(env.door)),
            "leaf_into_frame_deg": np.rad2deg(-angle),
            "penetration_mm": -1e3 * depths.min(initial=0.0),
        }
        if ended:
            env.reset(seed=seed + step)


def commands(steps: int = 1500) -> None:
    """Give built-in robots random commands, and measure what exceeds limits.

    Args:
        steps: Control steps per door, disturbance and grasp; two seeds of each.
    """
    circumstances = [*itertools.product(("medium", "cabinet"), ("none", "push"))]
    rows = []
    for robot in ROBOTS:
        arm = robot_named(robot).arm
        for grasp in ("contact", "weld"):
            most: dict[str, float] = {}
            for door, disturbance in circumstances:
                arguments = {"robot": robot, "grasp": grasp, "door": door}
                env = gym.make(ENVIRONMENT_ID, disturbance=disturbance, **arguments)
                for seed in (0, 1):
                    for excess in excesses(env.unwrapped, arm, steps, seed):
                        for name, value in excess.items():
                            most[name] = max(most.get(name, 0.0), float(value))
            rows.append({"robot": robot, "grasp": grasp, **most})
    write_json(DOCS / "results/random-commands.json", {**code_state(), "rows": rows})


PULLS: Final = (
    *((force, 0.5) for force in (34.0, 42.0, 50.0, 58.0, 66.0)),
    *((58.0, hold) for hold in (0.0, 1.0, 2.0)),
)
"""Greatest force at a closed door whose handle turns [N], and how long it lasts before
the hand gives up [s]; `gp` has 58 N for 0.5 s."""


def insistence() -> None:
    """Vary how `gp` pulls at closed doors; takes half an hour.

    It opens the 24 doors of heavy-closers.json with seeds 1000 and 1001, and pulls at
    the first six, locked and without a closer, with seed 1000. It gives up when the
    force on the lock, from 10 N on, last exceeds the mean of its greatest and its final
    value.
    """
    gp, movements, rows = policy_named("gp"), Movements(), []
    assert gp.method is not None
    doors = read_json(DOCS / "results/heavy-closers.json")["doors"]
    cases = [*itertools.product((1000, 1001), doors, ("none",))]
    cases += [(1000, door | {"closer": {}}, "locked") for door in doors[:6]]
    room, shared = door_config("room-834"), {"policy": "gp", "base": "mobile"}
    tasks = [
        episode_task("", room.replaced(door), seed=seed, disturbance=kind, **shared)
        for seed, door, kind in cases
    ]
    for force, hold in PULLS:
        load = LearnedLoad(hook_grasp_gain=force / LearnedLoad().limit)
        config = replace(gp.method.pipeline.config, load=load)
        pipeline = replace(gp.method.pipeline, config=config)
        policy = replace(gp, make=replace(gp.method, pipeline=pipeline))
        agents = [learned_agents(t, policy, movements=movements)() for t in tasks]
        until = force + hold * handles.INSISTENCE_RATE
        with mock.patch.object(handles, "GIVING_UP", until):
            logs = open_together(tasks, agents)
        row: dict[str, Any] = {"force_N": force, "hold_s": hold}
        row["opened"] = [log.success for log in logs[:-6]]
        row |= {"gives_up_s": [], "lock_peak_N": [], "lock_half_second_N": []}
        for log in logs[-6:]:
            lock, measured = log.forces.stop_force, episode_metrics(log)
            (pulls,) = np.nonzero(lock > (lock.max() + lock[-1]) / 2.0)
            begins = np.argmax(lock >= handles.LATCHED_FORCE)
            row["gives_up_s"].append(log.times[pulls[-1]] - log.times[begins])
            row["lock_peak_N"].append(measured["stop_force_peak"])
            row["lock_half_second_N"].append(measured["stop_force_sustained"])
        rows.append(row)
        print(row, flush=True)
    write_json(DOCS / "results/insistence.json", {**code_state(), "rows": rows})


if __name__ == "__main__":
    made = {"arms": arms, "commands": commands, "insistence": insistence}
    tyro.extras.subcommand_cli_from_dict(made)
