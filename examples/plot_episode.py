"""Plot door angle, forces and stiffness of one episode from its log.

Runs an episode first, as `gplfd run` does; to plot another log, load it instead.
"""

import tempfile
from pathlib import Path

import gymnasium as gym
import matplotlib.pyplot as plt
import numpy as np

from gplfd_env import ENVIRONMENT_ID
from gplfd_experiments.data.teacher import DEMONSTRATED_RADII, Teacher
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.rollout import rollout
from gplfd_policies import make_agent

PICTURE = Path("episode.png")

demonstrations = Teacher().demonstrate_doors(
    DEMONSTRATED_RADII, per_door=2, rng=np.random.default_rng(0)
)
env = gym.make(ENVIRONMENT_ID, door="large")
made = rollout(env, make_agent("gp", demonstrations), policy="gp", door="large", seed=0)
env.close()
with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "large.npz"
    made.save(path)
    log = EpisodeLog.load(path)  # all values of every control step, as arrays

figure, (angle, force, stiffness) = plt.subplots(
    3, sharex=True, figsize=(7, 7), layout="constrained"
)
angle.plot(log.times, np.degrees(log.opening.door_angle), color="black")
angle.axhline(60.0, color="grey", linestyle=":", label="task")
angle.set_ylabel("door angle [deg]")
angle.set_title(f"{log.policy} opens the {log.door} door, radius {log.radius} m")

force.plot(log.times, log.forces.force_tangential, label="tangential: opens the door")
force.plot(log.times, log.forces.force_radial, label="radial: the path does not fit")
force.set_ylabel("hand on handle [N]")

for axis, name in ((0, "along the path"), (1, "up"), (2, "across")):
    stiffness.plot(log.times, log.decisions.stiffness[:, axis], label=name)
stiffness.set_ylabel("stiffness [N/m]")
stiffness.set_xlabel("time [s]")
for axes in (angle, force, stiffness):
    axes.grid(alpha=0.3)
    axes.legend(loc="best", frameon=False)
figure.savefig(PICTURE, dpi=120)
print(f"{PICTURE}: {log.times.size} control steps, opened: {log.success}")
