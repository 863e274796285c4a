"""A policy of your own against the same doors, logged and measured like the others.

It plays the demonstrations' mean at half speed, without compliance: what the field
calls open-loop replay. It opens the door that is the demonstrations' mean and loses the
handle of the others. Run it by itself, or by name:

    gplfd run --policy your_own_policy.py:make
"""

import numpy as np

from gplfd.policies import align, fit_skill


class Replay:
    """Commands the mean of the demonstrations, whatever the door does."""

    def __init__(self, demonstrations, slow_down=2.0, control_period=0.01):
        skill = fit_skill(align(demonstrations))
        steps = round(slow_down * skill.duration / control_period)
        self.poses = skill.predict(np.linspace(0.0, 1.0, steps)).mean
        self.step = 0

    def reset(self, observation):
        self.step = 0

    def act(self, observation):
        self.step += 1
        return self.poses[min(self.step, len(self.poses)) - 1]


def make(training):
    """Open-loop replay of the demonstrations' mean."""
    return Replay(training.demonstrations)


if __name__ == "__main__":
    from gplfd.experiments.cli import main  # the command line: only to run this file

    main(["run", "--policy", f"{__file__}:make", "--out", "results/replay"])
