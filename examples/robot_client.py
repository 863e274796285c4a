"""The simulator replaces a robot: another process decides, this one moves the arm.

    python examples/robot_client.py                       # starts its own server
    gplfd serve gp --port 5005 --hold-after 60 --stop-after 60
    python examples/robot_client.py tcp:127.0.0.1:5005    # uses a running server

The agent learns from the synthetic human. The same door is then opened by an agent in
this process, and both motions are compared: they are equal to the last bit. A
simulation does not run in real time, so the server's watchdog has long timeouts; on a
robot, omit these options.
"""

import sys

import gymnasium as gym
import numpy as np

from gplfd_env import ENVIRONMENT_ID
from gplfd_experiments.data.teacher import Teacher
from gplfd_policies import make_agent
from gplfd_policies.serving.client import RefusedError, RemoteAgent, ServerLostError

SERVER = [sys.executable, "-m", "gplfd", "serve", "gp"]
PATIENT = ["--hold-after", "60", "--stop-after", "60"]


def opened(agent):
    """Let an agent open a door; return the poses of the hand and whether it opened."""
    env = gym.make(ENVIRONMENT_ID, door="medium")
    observation, info = env.reset(seed=0)
    agent.reset(observation)
    poses, ended = [], False
    while not ended:
        step = agent.act(observation)
        observation, _, terminated, truncated, info = env.step(step.action)
        poses.append(observation["ee_pose"])
        ended = terminated or truncated
    env.close()
    return np.array(poses), info["success"]


try:
    address = sys.argv[1] if sys.argv[1:] else SERVER + PATIENT
    remote = RemoteAgent(address, timeout=60.0)
    poses, success = opened(remote)
except (ServerLostError, RefusedError, ValueError) as error:
    sys.exit(f"robot_client: {error}")
state, reason = remote.last["state"], remote.last["reason"]
print(f"served agent: {len(poses)} steps, opened: {success}, {state} {reason}".rstrip())
served = remote.greeting["source"]
remote.close()

if served == "gp":  # Another skill or policy moves differently.
    here, _ = opened(make_agent("gp", Teacher().standard_demonstrations(seed=0)))
    print(f"equal to one process: {np.array_equal(poses, here)}")
