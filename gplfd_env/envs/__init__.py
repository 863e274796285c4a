"""The Gymnasium environments: single, vector, gripper, reinforcement learning, Warp."""

from gplfd_env.conventions.opengl import choose_opengl

choose_opengl()
