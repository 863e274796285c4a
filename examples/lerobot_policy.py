"""A checkpoint of `lerobot-train` as a policy; needs the extra lerobot.

    GPLFD_LEARNED=CHECKPOINT gplfd trials --policies examples/lerobot_policy.py:make

The folder `pretrained_model` of a policy without pictures, trained at 20 actions per
second; several, joined as in PATH, take turns by the seed. As in `lerobot-eval`.
"""

import os
from collections import deque

import torch
from lerobot.configs import PreTrainedConfig
from lerobot.policies.factory import get_policy_class, make_pre_post_processors

from gplfd_env.conventions.constants import TASK
from gplfd_env.envs.waypoints import SIZES, Waypoints, seen

RATE = 20  # actions per second


class Checkpoint:
    """An agent that asks the policy for an action when the last one is carried out."""

    def __init__(self, folder):
        config = PreTrainedConfig.from_pretrained(folder)
        kind = get_policy_class(config.type)
        self.policy = kind.from_pretrained(folder, config=config).eval()
        self.before, self.after = make_pre_post_processors(config, folder)
        (size,) = config.output_features["action"].shape
        (form,) = (form for form, numbers in SIZES.items() if numbers == size)
        self.waypoints = Waypoints(RATE, form)
        self.control = self.waypoints.control

    def reset(self, observation):
        self.policy.reset()
        self.waypoints.reset(observation["ee_pose"])
        self.commands = deque()

    def act(self, observation):
        if not self.commands:
            state, wrench = map(torch.from_numpy, seen(observation).values())
            batch = {"observation.state": state[None], "task": [TASK]}
            batch["observation.environment_state"] = wrench[None]
            with torch.inference_mode():
                action = self.after(self.policy.select_action(self.before(batch)))[0]
            hand = observation["ee_pose"]
            self.commands.extend(self.waypoints.commands(action.numpy(), hand))
        return self.commands.popleft()


def make(training):
    folders = os.environ["GPLFD_LEARNED"].split(os.pathsep)
    return Checkpoint(folders[training.seed % len(folders)])
