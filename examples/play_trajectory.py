"""Write a learned movement as a table for any robot, and play the table at a door.

    python examples/play_trajectory.py [TABLE.csv]

Plays a table on the simulated arm, like the software of a robot manufacturer: without
this project's policies, adaptation or compliance. This is sufficient for a door like
the demonstrated ones. Without an argument it first writes such a table, movement.csv: a
row per control period with time, position, quaternion and standard deviations. The file
states its frame and units.
"""

import csv
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np

from gplfd_env import ENVIRONMENT_ID
from gplfd_env.spatial.rotation_paths import rotvecs_from_quaternions
from gplfd_experiments.data.teacher import Teacher
from gplfd_policies import align, fit_skill

PERIOD, SLOW_DOWN = 0.01, 1.5


def write_table(path):
    demonstrations = Teacher().demonstrate_doors(
        [0.5], per_door=4, rng=np.random.default_rng(0)
    )
    skill = fit_skill(align(demonstrations))
    # Any times are possible: the movement is evaluated at exactly these times.
    duration = SLOW_DOWN * skill.duration
    times = np.arange(0.0, duration, PERIOD)
    skill.predict(times / duration).to_csv(path, duration=duration)


def read_table(path):
    with path.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))

    def column(*names):
        return np.array([[float(row[name]) for name in names] for row in rows])

    rotations = rotvecs_from_quaternions(column("qx", "qy", "qz", "qw"), order="xyzw")
    return np.hstack([column("x [m]", "y [m]", "z [m]"), rotations])


table = Path(sys.argv[1] if sys.argv[1:] else "movement.csv")
if not sys.argv[1:]:
    write_table(table)
poses = read_table(table)

env = gym.make(ENVIRONMENT_ID, door="medium")  # 0.5 m from hinge to handle
observation, info = env.reset(seed=0)
ended, step = False, 0
while not ended:
    # One row per control period; at the end the hand keeps its last pose.
    pose = poses[min(step, len(poses) - 1)]
    observation, reward, terminated, truncated, info = env.step(pose)
    ended, step = terminated or truncated, step + 1
env.close()
print(
    f"{len(poses)} rows of {table} played: door at "
    f"{np.degrees(info['door_angle']):.0f} deg, opened: {info['success']}"
)
