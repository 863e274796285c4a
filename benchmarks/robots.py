"""What the pages say of robots: python benchmarks/robots.py {arms,commands}.

Each writes its results to docs/results; `commands` also writes its table into the page.
"""

import re
import sysconfig
from collections.abc import Iterator, Mapping, Sequence
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
from gplfd_experiments.files.table import Table, markdown_table
from gplfd_experiments.studies.jobs import episode_log
from gplfd_experiments.workflows.runs import episode_tasks
from gplfd_experiments.workflows.settings import RunSettings

DOCS: Final = Path(__file__).parents[1] / "docs"
EXAMPLES: Final = (
    Path(sysconfig.get_path("purelib")) / "cmeel.prefix/share/example-robot-data/robots"
)
ARMS: Final[Mapping[str, str]] = {
    "Panda": "panda_description/urdf/panda.urdf",
    "UR10": "ur_description/urdf/ur10_robot.urdf",
    "UR5": "ur_description/urdf/ur5_robot.urdf",
    "UR3": "ur_description/urdf/ur3_robot.urdf",
    "Kinova j2s6s200": "kinova_description/robots/kinova.urdf",
    "Kinova on ANYmal": "anymal_b_simple_description/robots/anymal-kinova.urdf",
    "xArm7": "xarm_description/urdf/xarm7.urdf",
    "Z1": "z1_description/urdf/z1.urdf",
    "B1-Z1": "b1_description/urdf/b1-z1.urdf",
    "Baxter": "baxter_description/urdf/baxter.urdf",
    "TIAGo without hand": "tiago_description/robots/tiago_no_hand.urdf",
    "TIAGo dual": "tiago_description/robots/tiago_dual.urdf",
    "TIAGo Pro": "tiago_pro_description/robots/tiago_pro.urdf",
    "PR2": "pr2_description/urdf/pr2.urdf",
    "Talos, left arm": "talos_data/robots/talos_left_arm.urdf",
    "Talos, reduced": "talos_data/robots/talos_reduced.urdf",
    "Romeo": "romeo_description/urdf/romeo.urdf",
    "Alex": "alex_description/urdf/alex_nub_hands.urdf",
    "G1": "g1_description/urdf/g1_29dof_rev_1_0.urdf",
    "iCub": "icub_description/robots/icub.urdf",
    "SO-101": "so_arm_description/urdf/so101.urdf",
    "Centauro": "centauro_description/urdf/centauro.urdf",
}
"""Files of the package `example-robot-data` with an arm."""

Rows = Sequence[Mapping[str, Any]]


def stored(name: str, rows: Rows, page: str, table: Table) -> None:
    """Write results with the state of the code, and the table between its marks."""
    write_json(DOCS / f"results/{name}.json", {**code_state(), "rows": rows})
    mark, text = f"<!-- {name} -->", (DOCS / page).read_text()
    written = f"{mark}\n{markdown_table(table)}\n{mark}"
    text, count = re.subn(f"(?s){mark}\n.*?\n{mark}", lambda _: written, text)
    if count != 1:
        raise ValueError(f"{page} has no table between two lines {mark}")
    (DOCS / page).write_text(text)


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


def arms(folder: Path = EXAMPLES) -> None:
    """Let arms of other people open the medium door.

    Args:
        folder: The folder `robots` of the package example-robot-data.
    """
    rows = []
    for arm, file in ARMS.items():
        rows.append({"arm": arm, "file": file, **opened(folder / file)})
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
    rows = []
    for robot in ROBOTS:
        arm = robot_named(robot).arm
        for grasp in ("contact", "weld"):
            most: dict[str, float] = {}
            for door in ("medium", "cabinet"):
                for disturbance in ("none", "push"):
                    arguments = {"robot": robot, "grasp": grasp, "door": door}
                    arguments["disturbance"] = disturbance
                    env = gym.make(ENVIRONMENT_ID, **arguments).unwrapped
                    for seed in (0, 1):
                        for excess in excesses(env, arm, steps, seed):
                            for name, value in excess.items():
                                most[name] = max(most.get(name, 0.0), float(value))
            rows.append({"robot": robot, "grasp": grasp, **most})
    cells = [
        (f"`{row['robot']}`, {row['grasp']}", *(f"{row[n]:.2g}" for n in most))
        for row in rows
    ]
    columns = (
        "robot, grasp",
        "joint speed [rad/s]",
        "joint beyond its range [rad]",
        "leaf beyond its stop [°]",
        "leaf into its frame [°]",
        "penetration [mm]",
    )
    table = Table(columns=columns, rows=tuple(cells))
    stored("random-commands", rows, "environment.md", table)


if __name__ == "__main__":
    tyro.extras.subcommand_cli_from_dict({"arms": arms, "commands": commands})
