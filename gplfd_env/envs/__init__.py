"""The Gymnasium environments: single, vector, gripper, reinforcement learning, Warp."""
