"""From a learned movement to a table for any robot, and from the table to a door.

Writes opening.csv: a row per control period with time, position, quaternion and
standard deviations, its frame and units inside. Then it plays the file on the simulated
arm, as a program of a robot's maker would: without this project's policies, adaptation
or compliance. That is enough for a door like the demonstrated ones.
"""

import csv
from pathlib import Path

import gymnasium as gym
import numpy as np

from experiments.teacher import Teacher
from gplfd_env import ENVIRONMENT_ID
from gplfd_env.rotation_paths import rotvecs_from_quaternions
from policies import align, fit_skill

TABLE, PERIOD, SLOW_DOWN = Path("opening.csv"), 0.01, 1.5

demonstrations = Teacher().demonstrate_doors(
    [0.5], per_radius=4, rng=np.random.default_rng(0)
)
skill = fit_skill(align(demonstrations))

# Any times will do: the movement is asked at exactly these.
duration = SLOW_DOWN * skill.duration
times = np.arange(0.0, duration, PERIOD)
skill.predict(times / duration).to_csv(TABLE, duration=duration)

with TABLE.open(encoding="utf-8") as file:
    rows = list(csv.DictReader(line for line in file if not line.startswith("#")))


def column(*names):
    return np.array([[float(row[name]) for name in names] for row in rows])


rotations = rotvecs_from_quaternions(column("qx", "qy", "qz", "qw"), order="xyzw")
poses = np.hstack([column("x [m]", "y [m]", "z [m]"), rotations])

env = gym.make(ENVIRONMENT_ID, door="medium")  # 0.5 m from hinge to handle
observation, info = env.reset(seed=0)
ended, step = False, 0
while not ended:
    # One row per control period; at the end the hand stays where it is.
    pose = poses[min(step, len(poses) - 1)]
    observation, reward, terminated, truncated, info = env.step(pose)
    ended, step = terminated or truncated, step + 1
env.close()
print(
    f"{len(rows)} rows of {TABLE} played: door at "
    f"{np.degrees(info['door_angle']):.0f} deg, opened: {info['success']}"
)
