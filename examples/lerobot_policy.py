"""A checkpoint of `lerobot-train` as a policy; needs the extra lerobot.

    GPLFD_LEARNED=CHECKPOINT gplfd trials --policies examples/lerobot_policy.py:make

The folder `pretrained_model` of a policy without pictures, trained at 20 actions per
second; several, joined as in PATH, take turns by the seed. As in `lerobot-eval`; by
`make_compliant`, virtual dynamics yield with the policy's stiffness, or with 500 N/m.
"""

import os

import numpy as np
import torch
from lerobot.configs import PreTrainedConfig
from lerobot.policies.factory import get_policy_class, make_pre_post_processors

from gplfd_env.conventions.constants import CONTROL_PERIOD, TASK
from gplfd_env.envs.waypoints import SIZES, Waypoints, seen
from gplfd_policies.control.rendering import VirtualRendering
from gplfd_policies.control.stiffness import DEFAULT_DYNAMICS

STIFFNESS = np.repeat([500.0, 50.0], 3)  # [N/m, N m/rad]
STRETCH = {"relative": 2.0}  # What suits the stiff arm pulls too weakly otherwise.


class Checkpoint:
    """An agent that asks the policy for an action when the last one is carried out."""

    @property
    def control(self):
        return self.waypoints.control

    def __init__(self, folder, seed):
        self.seed, self.stretch = seed, 1.0
        config = PreTrainedConfig.from_pretrained(folder)
        kind = get_policy_class(config.type)
        self.policy = kind.from_pretrained(folder, config=config).eval()
        self.before, self.after = make_pre_post_processors(config, folder)
        shape = config.output_features["action"].shape
        (form,) = (form for form, size in SIZES.items() if (size,) == shape)
        self.waypoints = Waypoints(20, form)  # actions per second

    def reset(self, observation):
        self.policy.reset()
        self.waypoints.reset(observation["ee_pose"])
        self.commands, self.asked = [], 0

    def act(self, observation):
        if not self.commands:
            state, wrench = map(torch.from_numpy, seen(observation).values())
            batch = {"observation.state": state[None], "task": [TASK]}
            batch["observation.environment_state"] = wrench[None]
            # Episodes in lockstep draw alike, each as if alone.
            torch.manual_seed(1000 * self.seed + self.asked)
            self.asked += 1
            with torch.inference_mode():
                action = self.after(self.policy.select_action(self.before(batch)))[0]
            numbers, hand = self.stretch * action.numpy(), observation["ee_pose"]
            self.commands.extend(self.waypoints.commands(numbers, hand))
        return self.commands.pop(0)


class CompliantCheckpoint(Checkpoint):
    """Displaces the poses by the force on the hand, like `gp`."""

    control = "pose"

    def reset(self, observation):
        super().reset(observation)
        self.stretch = STRETCH.get(self.waypoints.form, 1.0)
        self.admittance = VirtualRendering(DEFAULT_DYNAMICS, CONTROL_PERIOD)

    def act(self, observation):
        pose, stiffness = np.split(super().act(observation), [6])
        stiffness, none = stiffness if stiffness.size else STIFFNESS, np.zeros(3)
        wrench = {"compliant_wrench": observation["wrench"], "compensated_force": none}
        return self.admittance.command(pose, none, stiffness, **wrench)


def make(training, kind=Checkpoint):
    folders = os.environ["GPLFD_LEARNED"].split(os.pathsep)
    return kind(folders[training.seed % len(folders)], training.seed)


def make_compliant(training):
    return make(training, CompliantCheckpoint)
