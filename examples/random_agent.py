"""Random commands near the pose of the hand: the loop of any Gymnasium environment."""

import gymnasium as gym

import gplfd_env  # noqa: F401  (registers the ids)

env = gym.make("gplfd/DoorOpening-v1", door="medium", max_episode_steps=300)
env.action_space.seed(0)
observation, info = env.reset(seed=0)
total, ended = 0.0, False
while not ended:
    action = observation["ee_pose"] + 0.05 * env.action_space.sample()
    observation, reward, terminated, truncated, info = env.step(action)
    total += reward
    ended = terminated or truncated
env.close()
print(
    f"reward {total:.3f}, door at {info['door_angle']:.3f} rad, "
    f"grasped: {info['grasped']}, failure: {info['failure'] or 'none'}"
)
