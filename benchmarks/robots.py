"""What the pages say of robots: python benchmarks/robots.py {arms,commands}.

Each writes its results to docs/results.
"""

import itertools
import sysconfig
import tomllib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import gymnasium as gym
import numpy as np
import tyro

from gplfd_env import ENVIRONMENT_ID
from gplfd_env.doors.motion import end_angle
from gplfd_env.robot.robots import ROBOTS, robot_named
from gplfd_experiments.episodes.metrics import episode_metrics
from gplfd_experiments.files.plain_data import write_json
from gplfd_experiments.files.provenance import code_state
from gplfd_experiments.studies.jobs import episode_log
from gplfd_experiments.workflows.runs import episode_tasks
from gplfd_experiments.workflows.settings import RunSettings

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
        return {"opened": False, "reason": str(error).replace(str(robot), robot.name)}
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
    cases = [*itertools.product(("medium", "cabinet"), ("none", "push"), (0, 1))]
    rows = []
    for robot, grasp in itertools.product(ROBOTS, ("contact", "weld")):
        most: dict[str, float] = {}
        for door, event, seed in cases:
            arguments = {"robot": robot, "grasp": grasp, "door": door}
            env = gym.make(ENVIRONMENT_ID, disturbance=event, **arguments).unwrapped
            for excess in excesses(env, robot_named(robot).arm, steps, seed):
                for name, value in excess.items():
                    most[name] = max(most.get(name, 0.0), float(value))
        rows.append({"robot": robot, "grasp": grasp, **most})
    write_json(DOCS / "results/random-commands.json", {**code_state(), "rows": rows})


if __name__ == "__main__":
    tyro.extras.subcommand_cli_from_dict({"arms": arms, "commands": commands})
